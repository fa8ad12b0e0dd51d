//! One server and many clients, each of which is to get its share of the values.

use component_sdk::prelude::*;

/// The last value that is put.
pub const LAST: u64 = 601;

/// Puts the numbers from 1 on.
#[derive(Component)]
#[component(name = "Feeder", version = "1.0", periodic = "1ms")]
pub struct Feeder {
    #[port]
    numbers: PushServer<u64>,
    number: u64,
}

impl Callbacks for Feeder {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        if self.number < LAST {
            self.number += 1;
            self.numbers.put(self.number)?;
        }
        Ok(())
    }
}

/// Counts what arrives: every `prescale`-th number, beginning with the first.
#[derive(Component)]
#[component(name = "Counter", version = "1.0", passive)]
pub struct Counter {
    #[port(handler = on_number, fifo = 1000)]
    numbers: PushClient<u64>,
    /// One of so many arrives.
    #[property(default = 1, range = 1..=1000)]
    prescale: u32,
    arrived: u64,
    wrong: u64,
}

impl Callbacks for Counter {
    fn start(&mut self, _: &mut Context<'_>) -> Outcome {
        self.numbers.subscribe(self.prescale)?;
        Ok(())
    }
}

impl Counter {
    fn on_number(&mut self, cx: &mut Context<'_>, number: &u64) -> Outcome {
        let due = self.arrived * u64::from(self.prescale) + 1;
        self.wrong += u64::from(*number != due);
        self.arrived += 1;
        if *number == LAST {
            info!(cx, "counted {} of every {}, {} wrong", self.arrived, self.prescale, self.wrong);
        }
        Ok(())
    }
}
