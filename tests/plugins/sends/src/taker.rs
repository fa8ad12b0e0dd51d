//! The server's side: does what each order says.

use std::hint::black_box;
use std::time::Duration;

use component_sdk::prelude::*;

use crate::{Order, Taken, todo};

/// Notes, sleeps, fails.
#[derive(Component)]
#[component(name = "Taker", version = "1.0", passive)]
pub struct Taker {
    #[port(handler = on_order)]
    orders: SendServer<Order>,
    #[port(handler = on_report)]
    taken: QueryServer<u64, Taken>,
    /// Takes something else.
    #[port(handler = on_number)]
    numbers: SendServer<u64>,
    noted: Vec<u64>,
    remark: Text,
    at_ns: u64,
    /// It succeeds one that failed.
    is_successor: bool,
}

impl Callbacks for Taker {
    fn initialize(&mut self, _: &mut Context<'_>) -> Outcome {
        // Nothing is allocated later.
        self.noted.reserve(1024);
        Ok(())
    }

    fn recover(&mut self, _: &mut Context<'_>, _: &FaultInfo<'_>) -> Outcome {
        self.is_successor = true;
        Ok(())
    }
}

impl Taker {
    fn on_order(&mut self, cx: &mut Context<'_>, order: &Order) -> Outcome {
        match order.todo {
            todo::SLEEP => _ = cx.sleep(Duration::from_millis(order.number)),
            todo::PANIC => panic!("ordered to"),
            todo::TRAP => trap(),
            todo::TRAP_ONCE if !self.is_successor => trap(),
            todo::HANG => loop {
                black_box(0);
            },
            _ => {}
        }
        self.at_ns = cx.clock().as_nanos();
        if self.noted.len() < self.noted.capacity() {
            self.noted.push(order.number);
        }
        if !order.remark.is_empty() {
            self.remark = order.remark.clone();
        }
        Ok(())
    }

    fn on_report(&mut self, _: &mut Context<'_>, query: Query<'_, u64, Taken>) -> Outcome {
        let (remark, at_ns) = (self.remark.clone(), self.at_ns);
        query.answer(Taken { numbers: self.noted.drain(..).collect(), remark, at_ns })?;
        Ok(())
    }

    fn on_number(&mut self, _: &mut Context<'_>, number: &u64) -> Outcome {
        self.noted.push(*number);
        Ok(())
    }
}

/// A null pointer is written through.
#[allow(unsafe_code, reason = "it is to trap")]
fn trap() {
    // SAFETY: none; this is the fault that the test provokes.
    unsafe { black_box(std::ptr::null_mut::<u8>()).write_volatile(1) };
}

/// Takes orders itself, one after the other, and passes each on.
#[derive(Component)]
#[component(name = "ActiveTaker", version = "1.0", periodic = "2ms")]
pub struct ActiveTaker {
    #[port]
    orders: SendServer<Order>,
    #[port]
    passed: SendClient<Order>,
}

impl Callbacks for ActiveTaker {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        loop {
            match self.orders.next(cx) {
                Ok(order) => self.passed.send(Order::clone(&order))?,
                Err(Status::Cancelled) => break,
                Err(other) => return Err(other.into()),
            }
        }
        info!(cx, "the active taker was cancelled");
        Ok(())
    }
}

/// Answers queries itself, one after the other: with one more, and its own count.
#[derive(Component)]
#[component(name = "ActiveTeller", version = "1.0", periodic = "2ms")]
pub struct ActiveTeller {
    #[port]
    asked: QueryServer<u64, u64>,
    count: u64,
}

impl Callbacks for ActiveTeller {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        while let Ok(query) = self.asked.next(cx) {
            self.count += 1;
            let number = *query;
            query.answer(number * 1000 + self.count)?;
        }
        Ok(())
    }
}
