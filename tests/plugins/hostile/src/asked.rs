//! A server that does to its client whatever it is asked to, and the client that asks for one after the other.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use component_sdk::prelude::*;

use crate::fail;

/// What is asked, in that order: 0, which is answered, comes before each.
pub const ASKED: [(u64, &str); 15] = [
    (1, "panic"),
    (2, "segv"),
    (3, "check"),
    (4, "spin"),
    (5, "error"),
    (6, "raise, answer"),
    (7, "answer, segv"),
    (8, "answer, panic"),
    (9, "answer later"),
    (10, "sleep, answer"),
    (11, "ask one that traps"),
    (12, "ask back"),
    (13, "answer from a task"),
    (14, "forget"),
    (15, "exit"),
];

const CYCLES: u64 = 100;

/// Does what it is asked to.
#[derive(Component)]
#[component(name = "Fragile", version = "1.0", periodic = "2ms")]
pub struct Fragile {
    #[port(handler = on_ask)]
    asked: QueryServer<u64, u64>,
    /// To one that traps.
    #[port]
    onward: QueryClient<u64, u64>,
    /// To who asks.
    #[port]
    back: QueryClient<u64, u64>,
    kept: Option<Pending<u64, u64>>,
    for_task: Arc<Mutex<Option<Pending<u64, u64>>>>,
    cycles: u64,
}

impl Callbacks for Fragile {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        self.cycles += 1;
        self.kept.take().map_or(Ok(()), |kept| Ok(kept.answer(9)?))
    }
}

fn code(asked: Result<u64, Status>) -> u64 {
    asked.unwrap_or_else(|status| u64::from(status.code()))
}

impl Fragile {
    fn on_ask(&mut self, cx: &mut Context<'_>, query: Query<'_, u64, u64>) -> Outcome {
        let asked = *query;
        let name = ASKED.iter().find(|(number, _)| *number == asked).map_or("", |(_, name)| *name);
        match name {
            "panic" | "segv" | "check" | "error" => return fail(name),
            "spin" => loop {
                std::hint::spin_loop();
            },
            "raise, answer" => cx.raise_fault("as it was asked to"),
            "answer, segv" | "answer, panic" => {
                query.answer(asked)?;
                return fail(if asked == 7 { "segv" } else { "panic" });
            }
            "answer later" => {
                self.kept = Some(query.keep());
                return Ok(());
            }
            "sleep, answer" => _ = cx.sleep(Duration::from_millis(3)),
            "ask one that traps" => {
                let told = self.onward.query(2).map(|told| *told);
                return Ok(query.answer(code(told))?);
            }
            "ask back" => {
                let told = self.back.query(0).map(|told| *told);
                return Ok(query.answer(code(told))?);
            }
            "answer from a task" => {
                *self.for_task.lock().map_err(|_| fault!("poisoned"))? = Some(query.keep());
                let kept = Arc::clone(&self.for_task);
                cx.spawn(Task::new("answers"), move |_: &mut Context<'_>| -> Outcome {
                    let kept = kept.lock().map_err(|_| fault!("poisoned"))?.take();
                    kept.map_or(Ok(()), |kept| Ok(kept.answer(13)?))
                })?;
                return Ok(());
            }
            "forget" => return Ok(()),
            "exit" => std::process::exit(7),
            _ => {}
        }
        let answer = if asked == CYCLES { self.cycles } else { asked };
        Ok(query.answer(answer)?)
    }
}

/// Asks.
#[derive(Component)]
#[component(name = "Prober", version = "1.0", periodic = "2ms")]
pub struct Prober {
    #[port]
    ask: QueryClient<u64, u64>,
    #[port(handler = on_ask)]
    asked: QueryServer<u64, u64>,
    next: usize,
}

impl Callbacks for Prober {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        let Some((number, name)) = ASKED.get(self.next) else { return self.ask_on_and_on(cx) };
        self.next += 1;
        let before = self.probe(0);
        let told = self.probe(*number);
        info!(cx, "asked to {name}: {before:?}, {told:?}");
        Ok(())
    }
}

impl Prober {
    fn probe(&mut self, what: u64) -> Result<u64, Status> {
        self.ask.query_within(what, Duration::from_secs(30)).map(|told| *told)
    }

    /// Until the server has run by itself: in one callback, without a pause.
    fn ask_on_and_on(&mut self, cx: &mut Context<'_>) -> Outcome {
        if self.next == ASKED.len() {
            self.next += 1;
            let first = self.probe(CYCLES)?;
            while self.probe(CYCLES)? < first + 3 {}
            info!(cx, "others had their turn");
        }
        Ok(())
    }

    fn on_ask(&mut self, _: &mut Context<'_>, query: Query<'_, u64, u64>) -> Outcome {
        Ok(query.answer(0)?)
    }
}
