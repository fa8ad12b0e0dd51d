//! Small components for the black-box tests: something that counts, something that passes on, something that listens.

use component_sdk::prelude::*;

/// A number on its way.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Count {
    /// How many were sent before this one.
    pub number: u64,
    /// Who sent it.
    pub sender: Text,
}

/// Sends the next number each period.
#[derive(Component)]
#[component(name = "Ticker", version = "1.0", periodic = "2ms")]
pub struct Ticker {
    #[port]
    out: DataOut<Count>,
    /// The first number.
    #[property(default = 0, range = 0..=1000000)]
    first: u64,
    #[property(default = "ticker")]
    label: String,
    #[critical]
    sent: u64,
}

impl Callbacks for Ticker {
    fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "starts at {}", self.first);
        Ok(())
    }

    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        let mut count = self.out.loan();
        count.number = self.first + self.sent;
        count.sender.set(&self.label);
        count.send();
        self.sent += 1;
        Ok(())
    }

    fn on_error(&mut self, cx: &mut Context<'_>, fault: &FaultInfo<'_>) -> Outcome {
        warn!(cx, "on_error: {}: {}", fault.symptom, fault.message);
        Ok(())
    }

    fn reset(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "reset");
        Ok(())
    }

    fn recover(&mut self, cx: &mut Context<'_>, fault: &FaultInfo<'_>) -> Outcome {
        info!(cx, "recovers from {}", fault.symptom);
        Ok(())
    }
}

/// The same ports, another way: counts down from a million.
#[derive(Component)]
#[component(name = "Downer", version = "1.0", periodic = "2ms")]
pub struct Downer {
    #[port]
    out: DataOut<Count>,
    sent: u64,
}

impl Callbacks for Downer {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        self.out.write(Count { number: 1_000_000 - self.sent, sender: "downer".into() });
        self.sent += 1;
        Ok(())
    }
}

/// Passes on what it hears.
#[derive(Component)]
#[component(name = "Relay", version = "1.0", nonperiodic)]
pub struct Relay {
    #[port]
    heard: DataIn<Count>,
    #[port]
    said: DataOut<Count>,
}

impl Callbacks for Relay {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        if let Some(count) = self.heard.fresh() {
            self.said.write(count.clone());
        }
        Ok(())
    }
}

/// Logs every hundredth number that it hears.
#[derive(Component)]
#[component(name = "Listener", version = "1.0", nonperiodic)]
pub struct Listener {
    #[port(fifo = 64)]
    heard: DataIn<Count>,
    received: u64,
}

impl Callbacks for Listener {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        while let Some(count) = self.heard.take() {
            self.received += 1;
            if self.received % 100 == 1 {
                info!(cx, "heard {} of {} from {}", self.received, count.number, count.sender);
            }
        }
        Ok(())
    }
}

export_components!(Ticker, Downer, Relay, Listener);
