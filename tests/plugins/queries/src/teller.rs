//! The server's side: does what each request says.

use std::hint::black_box;
use std::time::Duration;

use component_sdk::prelude::*;

use crate::{Ask, Told, todo};

const LONG: Duration = Duration::from_secs(30);

/// Answers, keeps, forgets, fails, asks others.
#[derive(Component)]
#[component(name = "Teller", version = "1.0", periodic = "2ms")]
pub struct Teller {
    #[port(handler = on_ask)]
    told: QueryServer<Ask, Told>,
    /// To the third component.
    #[port]
    onward: QueryClient<Ask, Told>,
    /// To the asker.
    #[port]
    back: QueryClient<Ask, Told>,
    kept: Vec<Pending<Ask, Told>>,
    later: Vec<Pending<Ask, Told>>,
    last: u32,
    handled: u64,
    /// It succeeds one that failed.
    is_successor: bool,
}

impl Callbacks for Teller {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        for pending in self.later.drain(..) {
            let number = pending.request()?.number;
            let mut answer = pending.loan(cx)?;
            (answer.number, answer.handled) = (number + 1, self.handled);
            answer.send()?;
        }
        Ok(())
    }

    fn recover(&mut self, _: &mut Context<'_>, _: &FaultInfo<'_>) -> Outcome {
        self.is_successor = true;
        Ok(())
    }
}

impl Teller {
    fn on_ask(&mut self, cx: &mut Context<'_>, query: Query<'_, Ask, Told>) -> Outcome {
        self.handled += 1;
        let (number, handled) = (query.number, self.handled);
        let told = |number| Told { number, handled };
        match query.todo {
            todo::KEEP => self.kept.push(query.keep()),
            todo::LATER => self.later.push(query.keep()),
            todo::CUT => {
                cx.wiring().disconnect(("asker", "tell"))?;
                self.kept.push(query.keep());
            }
            todo::ANSWER_AND_NOTE => {
                self.last = u32::MAX;
                self.last = query.answer(told(number + 1)).map_or_else(Status::code, |()| 0);
            }
            todo::ONWARD_KEEP | todo::ROUND => {
                let onward = if query.todo == todo::ROUND { todo::ROUND } else { todo::KEEP };
                let answer = self.onward.query_within(Ask { todo: onward, number }, LONG)?.number;
                query.answer(told(answer))?;
            }
            todo::LET_GO => {
                let count = self.kept.len() as u64;
                for pending in self.kept.drain(..).rev() {
                    let number = pending.request().map_or(0, |ask| ask.number);
                    self.last = pending.answer(told(number + 1)).map_or_else(Status::code, |()| 0);
                }
                query.answer(told(count))?;
            }
            todo::FORGET => drop(query),
            todo::REFUSE => query.refuse(Status::NotAllowed)?,
            todo::ONWARD => {
                let answer = self.onward.query(Ask { todo: todo::ANSWER, number })?.number;
                query.answer(told(answer))?;
            }
            todo::BACK => {
                let end = self.back.query(Ask { todo: todo::ANSWER, number }).err();
                query.answer(told(end.map_or(0, |status| u64::from(status.code()))))?;
            }
            todo::SLEEP => {
                let _ = cx.sleep(Duration::from_millis(number));
                query.answer(told(number + 1))?;
            }
            todo::REPORT => query.answer(told(u64::from(self.last)))?,
            todo::TRAP_ONCE if self.is_successor => query.answer(told(number + 1))?,
            todo::TRAP | todo::TRAP_ONCE => trap(),
            todo::PANIC => panic!("asked to"),
            todo::HANG => hang(),
            _ => query.answer(told(number + 1))?,
        }
        Ok(())
    }
}

#[allow(unsafe_code, reason = "the write faults, which is its purpose")]
fn trap() {
    // SAFETY: none.
    unsafe { black_box(8 as *mut u32).write_volatile(1) };
}

fn hang() {
    let mut turns = 0u64;
    while black_box(turns) < u64::MAX {
        turns = turns.wrapping_add(1);
    }
}

/// Answers with the number and ten, or later.
#[derive(Component)]
#[component(name = "Echo", version = "1.0", passive)]
pub struct Echo {
    #[port(handler = on_ask)]
    told: QueryServer<Ask, Told>,
    /// To the asker.
    #[port]
    back: QueryClient<Ask, Told>,
    kept: Vec<Pending<Ask, Told>>,
}

impl Callbacks for Echo {}

impl Echo {
    fn on_ask(&mut self, _: &mut Context<'_>, query: Query<'_, Ask, Told>) -> Outcome {
        let number = match query.todo {
            todo::KEEP => {
                self.kept.push(query.keep());
                return Ok(());
            }
            todo::KEPT => self.kept.len() as u64,
            todo::LET_GO => {
                let count = self.kept.len() as u64;
                for pending in self.kept.drain(..) {
                    let number = pending.request()?.number + 10;
                    pending.answer(Told { number, handled: 0 })?;
                }
                count
            }
            todo::ROUND => {
                let end = self.back.query(Ask { todo: todo::ANSWER, number: query.number }).err();
                end.map_or(0, |status| u64::from(status.code()))
            }
            _ => query.number + 10,
        };
        let mut answer = query.loan()?;
        answer.number = number;
        answer.send()?;
        Ok(())
    }
}

/// Answers something else.
#[derive(Component)]
#[component(name = "OtherEcho", version = "1.0", passive)]
pub struct OtherEcho {
    #[port(handler = on_ask)]
    told: QueryServer<Ask, Pose2D>,
}

impl Callbacks for OtherEcho {}

impl OtherEcho {
    fn on_ask(&mut self, _: &mut Context<'_>, query: Query<'_, Ask, Pose2D>) -> Outcome {
        query.answer(Pose2D::default())?;
        Ok(())
    }
}
