//! The server's side: does what it is asked for.

use std::hint::black_box;
use std::time::Duration;

use component_sdk::prelude::*;

use crate::{Order, todo};

/// Periods after which something is done later.
const LATER: u32 = 10;

/// Puts, starts, stops, fails.
#[derive(Component)]
#[component(name = "Sender", version = "1.0", periodic = "3ms")]
pub struct Sender {
    #[port(handler = on_order)]
    orders: QueryServer<Order, u64>,
    #[port]
    first: PushServer<u64>,
    #[port(timed = "1s", handler = on_tick)]
    timed: PushTimedServer<u64>,
    #[port(timed = "10ms", started, handler = on_auto)]
    auto: PushTimedServer<u64>,
    #[port(min_cycle = "3600s")]
    thin: PushServer<u64>,
    #[port]
    narrow: PushServer<u64>,
    #[port]
    plain: DataOut<u64>,
    /// Of the listener.
    #[port]
    back: PushClient<u64>,
    ticks: u64,
    autos: u64,
    puts: Option<u64>,
    later: Option<(u32, u32)>,
}

impl Callbacks for Sender {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        if let Some(number) = self.puts {
            self.first.put(number)?;
        }
        match self.later {
            Some((_, periods)) if periods > 0 => self.later = self.later.map(|(what, periods)| (what, periods - 1)),
            Some((what, _)) => {
                self.later = None;
                match what {
                    todo::STOP_LATER => self.timed.stop()?,
                    todo::CUT_LATER => cx.wiring().disconnect(("listener", "newest"))?,
                    _ => trap(),
                }
            }
            None => {}
        }
        Ok(())
    }
}

/// How a value was delivered, in a number.
fn code(delivered: Result<Delivered, Status>) -> u64 {
    match delivered {
        Ok(delivered) => delivered as u64,
        Err(status) => 100 + u64::from(status.code()),
    }
}

fn done(result: Result<(), Status>) -> u64 {
    result.map_or_else(|status| 100 + u64::from(status.code()), |()| 0)
}

impl Sender {
    fn on_order(&mut self, cx: &mut Context<'_>, order: Query<'_, Order, u64>) -> Outcome {
        let number = order.number;
        let told = match order.todo {
            todo::PUT => code(self.first.put(number)),
            todo::PUT_ON => {
                self.puts = Some(number);
                0
            }
            todo::STILL => {
                self.puts = None;
                0
            }
            todo::START => {
                self.ticks = 0;
                done(self.timed.start())
            }
            todo::STOP => done(self.timed.stop()),
            todo::PUT_TIMED => code(self.timed.put(number)),
            todo::TICKS => self.ticks,
            todo::PUT_THIN => code(self.thin.put(number)),
            todo::PUT_NARROW => {
                let mut loan = self.narrow.loan()?;
                *loan = number;
                code(loan.put())
            }
            todo::WRITE => self.plain.write(number) as u64,
            todo::SLEEP => u64::from(cx.sleep(Duration::from_millis(number))),
            todo::WAIT_BACK => {
                self.back.subscribe(1)?;
                self.back.update_wait().map_or_else(|status| u64::from(status.code()), |_| 0)
            }
            later => {
                self.later = Some((later, LATER));
                0
            }
        };
        order.answer(told)?;
        Ok(())
    }

    fn on_tick(&mut self, _: &mut Context<'_>) -> Outcome {
        self.ticks += 1;
        Ok(())
    }

    fn on_auto(&mut self, _: &mut Context<'_>) -> Outcome {
        self.autos += 1;
        self.auto.put(self.autos)?;
        Ok(())
    }
}

#[allow(unsafe_code, reason = "the write faults, which is its purpose")]
fn trap() {
    // SAFETY: none.
    unsafe { black_box(8 as *mut u32).write_volatile(1) };
}

/// Waits for the next value when it is asked to, beside the listener.
#[derive(Component)]
#[component(name = "Waiter", version = "1.0", passive)]
pub struct Waiter {
    #[port(handler = on_order)]
    orders: QueryServer<Order, u64>,
    #[port]
    newest: PushClient<u64>,
}

impl Callbacks for Waiter {}

impl Waiter {
    fn on_order(&mut self, _: &mut Context<'_>, order: Query<'_, Order, u64>) -> Outcome {
        self.newest.subscribe(1)?;
        let value = self.newest.update_wait_within(Duration::from_secs(30)).copied()?;
        order.answer(value)?;
        Ok(())
    }
}

/// Sends something else.
#[derive(Component)]
#[component(name = "OtherSender", version = "1.0", passive)]
pub struct OtherSender {
    #[port]
    first: PushServer<Pose2D>,
    #[port]
    values: PushServer<u64>,
}

impl Callbacks for OtherSender {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        self.first.put(Pose2D::default())?;
        self.values.put(1)?;
        Ok(())
    }
}
