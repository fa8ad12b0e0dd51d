//! Faults while others wait: on the same executor, or for the one that fails.

use std::cell::{Cell, RefCell};
use std::time::Duration;

use component_sdk::prelude::*;

use super::bystander::Beat;
use super::memory;

torture! {
    /// Writes to the null page while a neighbour waits.
    FaultBeside => || memory::write(24);

    /// Has its thread taken away, in the C library with its lock held, while a neighbour waits.
    LostBeside => memory::corrupt_heap;
}

thread_local! {
    static PLAIN: Cell<u64> = const { Cell::new(0) };
    /// Made when it is first used, dropped with its thread.
    static LISTED: RefCell<Vec<u64>> = const { RefCell::new(Vec::new()) };
}

/// Waits most of the time, beside whoever is tortured; uses variables of its thread before each wait and after it, when
/// the thread may be another one.
#[derive(Component)]
#[component(version = "1.0", periodic = "1ms")]
pub struct ParkedSleeper {
    naps: u64,
    threads: u64,
}

impl Callbacks for ParkedSleeper {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        let kept = Box::new(self.naps);
        PLAIN.set(self.naps + 1);
        LISTED.with_borrow_mut(|list| {
            list.clear();
            list.extend([self.naps; 8]);
        });
        let slept = cx.sleep(Duration::from_millis(3));
        // On another thread they are as whoever used it last left them, and whole.
        let (plain, listed) = (PLAIN.get(), LISTED.with_borrow(Vec::clone));
        self.threads += u64::from(plain != self.naps + 1);
        if listed.iter().any(|number| *number != listed[0]) || *kept != self.naps {
            cx.raise_fault("what it had before its wait is damaged");
        }
        LISTED.with_borrow_mut(|list| list.push(*list.first().unwrap_or(&0)));
        self.naps += u64::from(slept);
        Ok(())
    }

    fn stop(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "slept {} times, and woke up on another thread {} times", self.naps, self.threads);
        Ok(())
    }
}

/// Asks whoever is tortured, and waits for the answer that does not come.
#[derive(Component)]
#[component(version = "1.0", periodic = "1ms")]
pub struct ParkedAsker {
    #[port]
    ask: QueryClient<Beat, Beat>,
    asked: u64,
    gone: u64,
}

impl Callbacks for ParkedAsker {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        self.asked += 1;
        let number = self.asked;
        let told = self.ask.query_within(Beat { number }, Duration::from_secs(30)).map(|told| told.number);
        match told {
            Ok(told) if told == number + 1 => {}
            Err(Status::ProviderGone) => self.gone += 1,
            // One of them stops.
            Err(Status::Cancelled | Status::ProviderStopped | Status::ProviderReplaced | Status::Disconnected) => {}
            other => cx.raise_fault(&format!("asked {number}, got {other:?}")),
        }
        Ok(())
    }

    fn stop(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "asked {} times, {} of whom was gone", self.asked, self.gone);
        Ok(())
    }
}

/// Answers some, and faults in a handler while the client waits.
#[derive(Component)]
#[component(version = "1.0", passive)]
pub struct FaultInHandler {
    #[port(handler = on_ask)]
    tell: QueryServer<Beat, Beat>,
    /// Good answers before the strike.
    #[property(default = 5)]
    after: u64,
    /// Strikes of this class in a process.
    #[property(default = 1000000000)]
    limit: u64,
    /// `segv` or `lost`.
    #[property(default = "segv")]
    how: String,
    handled: u64,
}

impl Callbacks for FaultInHandler {}

impl FaultInHandler {
    fn on_ask(&mut self, cx: &mut Context<'_>, query: Query<'_, Beat, Beat>) -> Outcome {
        static STRIKES: crate::Strikes = crate::Strikes::new();
        self.handled += 1;
        // The answer is half written then.
        let number = query.number + 1;
        let mut answer = query.loan()?;
        answer.number = u64::MAX;
        if self.handled > self.after && STRIKES.take(self.limit, cx) {
            self.handled = 0;
            if self.how == "lost" { memory::corrupt_heap() } else { memory::write(24) }
        }
        answer.number = number;
        answer.send()?;
        Ok(())
    }
}
