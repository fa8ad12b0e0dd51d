//! Servers that take their time, and the clients that ask them again and again, work themselves, or fail afterwards.

use std::time::{Duration, Instant};

use component_sdk::prelude::*;

/// Works that long.
fn work(time: Duration) {
    let until = Instant::now() + time;
    while Instant::now() < until {
        std::hint::spin_loop();
    }
}

/// Works for as many milliseconds as it is asked to, itself or by asking another one, and answers how often it ran by itself.
#[derive(Component)]
#[component(name = "Busy", version = "1.0", periodic = "1ms")]
pub struct Busy {
    #[port(handler = on_ask)]
    asked: QueryServer<u64, u64>,
    #[port]
    onward: QueryClient<u64, u64>,
    /// It asks another one.
    #[property(default = false)]
    passes: bool,
    cycles: u64,
}

impl Callbacks for Busy {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        self.cycles += 1;
        Ok(())
    }
}

impl Busy {
    fn on_ask(&mut self, _: &mut Context<'_>, query: Query<'_, u64, u64>) -> Outcome {
        if self.passes {
            self.onward.query(*query)?;
        } else {
            work(Duration::from_millis(*query));
        }
        Ok(query.answer(self.cycles)?)
    }
}

/// Asks for 10 ms of work in one callback until the server has run by itself, too.
#[derive(Component)]
#[component(name = "Eager", version = "1.0", periodic = "2ms")]
pub struct Eager {
    #[port]
    ask: QueryClient<u64, u64>,
    is_done: bool,
}

impl Callbacks for Eager {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        if self.is_done {
            return Ok(());
        }
        self.is_done = true;
        let (first, mut times) = (*self.ask.query(10)?, 1);
        while *self.ask.query(10)? == first {
            times += 1;
        }
        info!(cx, "the server had its turn after [{times}]");
        Ok(())
    }
}

/// Asks for 60 ms of work in its second callback and works as long as its property says; if it says 0, it does that in every
/// other callback, and fails.
#[derive(Component)]
#[component(name = "Asker", version = "1.0", periodic = "2ms")]
pub struct Asker {
    #[port]
    ask: QueryClient<u64, u64>,
    /// For so many milliseconds.
    #[property(default = 0)]
    works: u64,
    cycles: u64,
}

impl Callbacks for Asker {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        self.cycles += 1;
        let asks = if self.works == 0 { self.cycles.is_multiple_of(2) } else { self.cycles == 2 };
        if !asks {
            return Ok(());
        }
        self.ask.query(60)?;
        info!(cx, "asked for work");
        work(Duration::from_millis(self.works));
        if self.works == 0 { Err(fault!("as it was asked to")) } else { Ok(()) }
    }
}

/// Works longer than it may, in every callback.
#[derive(Component)]
#[component(name = "Overlong", version = "1.0", periodic = "30ms")]
pub struct Overlong {}

impl Callbacks for Overlong {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        work(Duration::from_millis(20));
        Ok(())
    }
}

/// Answers each number with the next one; fails by a trap now and then, and now and then by a panic.
#[derive(Component)]
#[component(name = "Moody", version = "1.0", passive)]
pub struct Moody {
    #[port(handler = on_ask)]
    asked: QueryServer<u64, u64>,
}

impl Callbacks for Moody {}

impl Moody {
    fn on_ask(&mut self, _: &mut Context<'_>, query: Query<'_, u64, u64>) -> Outcome {
        match *query {
            number if number.is_multiple_of(7_001) => crate::fail("segv")?,
            number if number.is_multiple_of(5_003) => crate::fail("panic")?,
            _ => {}
        }
        let next = *query + 1;
        // Whoever was cut off meanwhile has no use for it.
        let _ = query.answer(next);
        Ok(())
    }
}

/// Asks a hundred times in each callback, whatever it is told, and looks at what is answered.
#[derive(Component)]
#[component(name = "Insistent", version = "1.0", periodic = "1ms")]
pub struct Insistent {
    #[port]
    ask: QueryClient<u64, u64>,
    asked: u64,
    answered: u64,
}

impl Callbacks for Insistent {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        for _ in 0..100 {
            self.asked += 1;
            let Ok(answer) = self.ask.query(self.asked) else { continue };
            if *answer != self.asked + 1 {
                return Err(fault!("{} instead of {}", *answer, self.asked + 1));
            }
            self.answered += 1;
            if self.answered.is_multiple_of(2_000) {
                info!(cx, "two thousand answers");
            }
        }
        Ok(())
    }
}

/// Adds what it is asked to; 0 is its end.
#[derive(Component)]
#[component(name = "Ledger", version = "1.0", passive)]
pub struct Ledger {
    #[port(handler = on_ask)]
    asked: QueryServer<u64, u64>,
    #[critical]
    total: u64,
}

impl Callbacks for Ledger {}

impl Ledger {
    fn on_ask(&mut self, _: &mut Context<'_>, query: Query<'_, u64, u64>) -> Outcome {
        if *query == 0 {
            crate::fail("segv")?;
        }
        self.total += *query;
        Ok(query.answer(self.total)?)
    }
}

/// Has a hundred added, one in each callback, ends the ledger, and says what the next one goes on from.
#[derive(Component)]
#[component(name = "Depositor", version = "1.0", periodic = "2ms")]
pub struct Depositor {
    #[port]
    ask: QueryClient<u64, u64>,
    cycles: u64,
}

impl Callbacks for Depositor {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        self.cycles += 1;
        match self.cycles {
            1..=100 => _ = self.ask.query(1)?,
            101 => _ = self.ask.query(0),
            102 => info!(cx, "the ledger goes on from [{}]", *self.ask.query(1)?),
            _ => {}
        }
        Ok(())
    }
}
