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

/// Sleeps in each callback, once in `initialize` where nobody may, and says how it went.
#[derive(Component)]
#[component(name = "Sleeper", version = "1.0", periodic = "10ms")]
pub struct Sleeper {
    /// How long, in milliseconds.
    #[property(default = 15, range = 0..=3600000, unit = "ms")]
    sleep: u64,
    slept: u64,
}

impl Callbacks for Sleeper {
    fn initialize(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "may sleep here: {}", cx.sleep(std::time::Duration::from_millis(1)));
        Ok(())
    }

    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        let whole = cx.sleep(std::time::Duration::from_millis(self.sleep));
        self.slept += 1;
        info!(cx, "slept {}: {}", self.slept, if whole { "whole" } else { "ended" });
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
        while let Some(count) = self.heard.take() {
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

/// Connects a reader to one writer and then to another, by turns, and says what is refused.
#[derive(Component)]
#[component(name = "Switch", version = "1.0", periodic = "5ms")]
pub struct Switch {
    /// The reader: slot and port.
    #[property(default = "listener.heard")]
    reader: String,
    /// Writers, and what is none.
    #[property(default = "one.out two.out")]
    writers: String,
    turn: usize,
}

impl Callbacks for Switch {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        let split = |text: &str| text.split_once('.').map(|(slot, port)| (slot.to_owned(), port.to_owned()));
        let writers: Vec<&str> = self.writers.split_whitespace().collect();
        let (Some(reader), Some(writer)) = (split(&self.reader), split(writers[self.turn % writers.len()])) else {
            return Err(fault!("a port is named slot.port"));
        };
        self.turn += 1;
        if let Err(refusal) = cx.wiring().connect((&reader.0, &reader.1), (&writer.0, &writer.1)) {
            warn!(cx, "{:?}: {refusal}", refusal.status);
        }
        Ok(())
    }

    fn stop(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "switched {} times", self.turn);
        Ok(())
    }
}

/// Logs each of its callbacks, the frequent ones once.
#[derive(Component)]
#[component(name = "Diary", version = "1.0", periodic = "5ms")]
pub struct Diary {
    executed: bool,
    updated: bool,
}

impl Callbacks for Diary {
    fn initialize(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "hook initialize");
        Ok(())
    }
    fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "hook start");
        Ok(())
    }
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        if !std::mem::replace(&mut self.executed, true) {
            info!(cx, "hook execute");
        }
        Ok(())
    }
    fn update(&mut self, cx: &mut Context<'_>) -> Outcome {
        if !std::mem::replace(&mut self.updated, true) {
            info!(cx, "hook update");
        }
        Ok(())
    }
    fn stop(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "hook stop");
        Ok(())
    }
    fn destroy(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "hook destroy");
        Ok(())
    }
    fn on_error(&mut self, cx: &mut Context<'_>, fault: &FaultInfo<'_>) -> Outcome {
        info!(cx, "hook error {}", fault.symptom);
        Ok(())
    }
    fn reset(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "hook reset");
        Ok(())
    }
    fn recover(&mut self, cx: &mut Context<'_>, fault: &FaultInfo<'_>) -> Outcome {
        info!(cx, "hook recover {}", fault.symptom);
        Ok(())
    }
}

/// Sends a distance that is out of range every now and then.
#[derive(Component)]
#[component(name = "Sonar", version = "1.0", periodic = "2ms")]
pub struct Sonar {
    #[port]
    out: DataOut<Range>,
    /// Every so many readings are zero.
    #[property(default = 10, range = 1..=1000)]
    bad_every: u64,
    sent: u64,
}

impl Callbacks for Sonar {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        self.sent += 1;
        let range = if self.sent.is_multiple_of(self.bad_every) { 0.0 } else { 1.0 + self.sent as f32 / 1e6 };
        self.out.write(Range { range, ..Range::default() });
        Ok(())
    }
}

/// Counts the distances that it hears, zeros apart.
#[derive(Component)]
#[component(name = "Gauge", version = "1.0", nonperiodic)]
pub struct Gauge {
    #[port]
    heard: DataIn<Range>,
    good: u64,
    zeros: u64,
}

impl Callbacks for Gauge {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        match self.heard.fresh() {
            Some(range) if range.range == 0.0 => self.zeros += 1,
            Some(_) => self.good += 1,
            None => {}
        }
        Ok(())
    }

    fn stop(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "good {} zeros {}", self.good, self.zeros);
        Ok(())
    }
}

/// Raises faults: while it is initialised, in its third cycle, when it is stopped.
#[derive(Component)]
#[component(name = "Moaner", version = "1.0", periodic = "5ms")]
pub struct Moaner {
    cycles: u64,
}

impl Callbacks for Moaner {
    fn initialize(&mut self, cx: &mut Context<'_>) -> Outcome {
        cx.raise_fault("in initialize");
        Ok(())
    }
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        self.cycles += 1;
        if self.cycles == 3 {
            cx.raise_fault("in on_execute");
        }
        Ok(())
    }
    fn stop(&mut self, cx: &mut Context<'_>) -> Outcome {
        cx.raise_fault("in stop");
        Ok(())
    }
}

/// Takes one value a call, however many wait.
#[derive(Component)]
#[component(name = "Nibbler", version = "1.0", nonperiodic)]
pub struct Nibbler {
    #[port(fifo = 500)]
    heard: DataIn<Count>,
    received: u64,
}

impl Callbacks for Nibbler {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        if let Some(count) = self.heard.take() {
            self.received += 1;
            if self.received.is_multiple_of(100) {
                info!(cx, "nibbled {} of {}", self.received, count.number);
            }
        }
        Ok(())
    }
}

/// Sends ten numbers at once.
#[derive(Component)]
#[component(name = "Burst", version = "1.0", periodic = "20ms")]
pub struct Burst {
    #[port]
    out: DataOut<Count>,
    sent: u64,
}

impl Callbacks for Burst {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        for _ in 0..10 {
            self.sent += 1;
            self.out.write(Count { number: self.sent, ..Count::default() });
        }
        Ok(())
    }
}

/// Does not return from `stop`.
#[derive(Component)]
#[component(name = "Stubborn", version = "1.0", passive)]
pub struct Stubborn {}

impl Callbacks for Stubborn {
    fn stop(&mut self, _: &mut Context<'_>) -> Outcome {
        loop {
            std::thread::sleep(std::time::Duration::from_secs(1));
        }
    }
}

/// Counts its periods and does nothing else.
#[derive(Component)]
#[component(name = "Beat", version = "1.0", periodic = "2ms")]
pub struct Beat {
    cycles: u64,
}

impl Callbacks for Beat {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        self.cycles += 1;
        Ok(())
    }
}

/// Fails in each of its callbacks, and counts them in what it says.
#[derive(Component)]
#[component(name = "Wreck", version = "1.0", periodic = "1ms")]
pub struct Wreck {
    #[critical]
    failures: u64,
}

impl Callbacks for Wreck {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        self.failures += 1;
        Err(ComponentError::new(format!("failure {}", self.failures)))
    }
}

/// Takes its time until it is ready.
#[derive(Component)]
#[component(name = "Sluggard", version = "1.0", passive)]
pub struct Sluggard {}

impl Callbacks for Sluggard {
    fn initialize(&mut self, _: &mut Context<'_>) -> Outcome {
        std::thread::sleep(std::time::Duration::from_millis(1500));
        Ok(())
    }
}

export_components!(
    Beat, Ticker, Downer, Sleeper, Relay, Listener, Diary, Sonar, Gauge, Moaner, Nibbler, Burst, Stubborn, Wreck,
    Sluggard, Switch
);
