//! Components that pass values on and measure how long that takes: the benchmarks of the data path.
//!
//! Each keeps its figures in memory and writes them to a file when it is stopped, one a line, so that measuring needs
//! nothing beside what every component has.

use std::fmt::Write;
use std::time::Duration;

use component_sdk::prelude::*;

/// Rounds before the first figure is kept.
const WARM_ROUNDS: u64 = 2_000;
/// Most figures kept.
const FIGURES: usize = 200_000;

/// 64 bytes.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Small {
    /// How many were sent before this one.
    pub number: u64,
    /// When it was sent, in nanoseconds.
    pub sent_ns: u64,
    /// Something to carry.
    pub data: [u64; 6],
}

/// 1 MiB, like a picture.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Large {
    /// How many were sent before this one.
    pub number: u64,
    /// When it was sent, in nanoseconds.
    pub sent_ns: u64,
    /// Something to carry.
    pub data: Sequence<u8>,
}

/// Figures on their way to a file.
#[derive(Debug, Default)]
struct Figures(Vec<u64>);

impl Figures {
    fn make_room(&mut self, file: &str) {
        if !file.is_empty() {
            self.0.reserve_exact(FIGURES);
        }
    }

    /// Keeps one, where there is room.
    fn add(&mut self, nanos: u64) {
        if self.0.len() < self.0.capacity() {
            self.0.push(nanos);
        }
    }

    fn write(&self, file: &str) -> Outcome {
        if !file.is_empty() {
            let mut text = String::new();
            self.0.iter().for_each(|figure| _ = writeln!(text, "{figure}"));
            std::fs::write(file, text)?;
        }
        Ok(())
    }
}

/// Nanoseconds from one reading of the clock to the next, as the mean of many.
fn cost_of_the_clock(cx: &Context<'_>) -> u64 {
    const TIMES: u64 = 100_000;
    let began = cx.clock().as_nanos();
    (1..TIMES).for_each(|_| _ = std::hint::black_box(cx.clock()));
    (cx.clock().as_nanos() - began) / TIMES
}

/// Defines a class that passes on what it hears.
macro_rules! hop {
    ($(#[$doc:meta])* $class:ident, $object:ty, $fill:expr) => {
        $(#[$doc])*
        #[derive(Component)]
        #[component(version = "1.0", nonperiodic)]
        pub struct $class {
            #[port]
            heard: DataIn<$object>,
            #[port]
            said: DataOut<$object>,
            /// Sends the first value.
            #[property(default = false)]
            leads: bool,
            /// Values between two readings of the clock; 0: every value tells when it was sent.
            #[property(default = 0, range = 0..=1000000)]
            batch: u64,
            /// With `batch`: the mean from the write to the reader's first instruction, instead of that of a whole turn: both read
            /// the clock, whose cost is taken off.
            #[property(default = false)]
            first: bool,
            /// Microseconds of sleep before a value is passed on, so that whoever waits for it sleeps, too.
            #[property(default = 0, range = 0..=1000000)]
            pause_us: u64,
            /// Where the figures go; empty: none are kept.
            #[property(default = "")]
            file: String,
            figures: Figures,
            rounds: u64,
            since: u64,
            clock_ns: u64,
        }

        impl $class {
            fn send(&mut self, number: u64, sent_ns: impl FnOnce() -> u64) {
                let mut value = self.said.loan();
                value.number = number;
                ($fill)(&mut *value);
                value.sent_ns = sent_ns();
                value.send();
            }

            /// Keeps the mean of a batch that is over.
            fn end_batch(&mut self, cx: &Context<'_>) {
                let (mean_ns, next) = if self.first {
                    ((self.since / self.batch).saturating_sub(self.clock_ns), 0)
                } else {
                    let now = cx.clock().as_nanos();
                    // Two hops a round.
                    ((now - self.since) / (2 * self.batch), now)
                };
                if self.rounds > WARM_ROUNDS {
                    self.figures.add(mean_ns);
                }
                self.since = next;
            }
        }

        impl Callbacks for $class {
            fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
                self.figures.make_room(&self.file);
                self.clock_ns = cost_of_the_clock(cx);
                if self.leads {
                    self.send(0, || 0);
                }
                Ok(())
            }

            fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
                let reads = self.batch == 0 || self.first;
                let heard_ns = if reads { cx.clock().as_nanos() } else { 0 };
                let Some(value) = self.heard.fresh() else { return Ok(()) };
                let (number, sent_ns) = (value.number, value.sent_ns);
                self.rounds += 1;
                if self.first {
                    self.since += heard_ns.saturating_sub(sent_ns);
                }
                if self.batch > 0 && self.rounds.is_multiple_of(self.batch) {
                    self.end_batch(cx);
                }
                if self.batch == 0 {
                    if self.rounds > WARM_ROUNDS {
                        self.figures.add(heard_ns.saturating_sub(sent_ns));
                    }
                    if self.pause_us > 0 && !cx.sleep(Duration::from_micros(self.pause_us)) {
                        return Ok(());
                    }
                }
                self.send(number + 1, || if reads { cx.clock().as_nanos() } else { 0 });
                Ok(())
            }

            fn stop(&mut self, _: &mut Context<'_>) -> Outcome {
                self.figures.write(&self.file)
            }
        }
    };
}

hop!(
    /// Passes 64 bytes on.
    HopSmall,
    Small,
    |_: &mut Small| {}
);

hop!(
    /// Passes 1 MiB on, which is filled once.
    HopLarge,
    Large,
    |large: &mut Large| {
        if large.data.len() != 1 << 20 {
            large.data.resize(1 << 20, 7);
        }
    }
);

/// Writes one value to all its readers whenever one of them answers.
#[derive(Component)]
#[component(version = "1.0", nonperiodic)]
pub struct Caster {
    #[port]
    heard: DataIn<Small>,
    #[port]
    said: DataOut<Small>,
    /// How many readers there are.
    #[property(default = 1, range = 1..=10000)]
    readers: u64,
    /// Where the figures go; empty: none are kept.
    #[property(default = "")]
    file: String,
    figures: Figures,
    rounds: u64,
}

impl Callbacks for Caster {
    fn start(&mut self, _: &mut Context<'_>) -> Outcome {
        self.figures.make_room(&self.file);
        self.said.write(Small::default());
        Ok(())
    }

    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        if self.heard.fresh().is_none() {
            return Ok(());
        }
        self.rounds += 1;
        let began = cx.clock();
        let mut value = self.said.loan();
        value.number = self.rounds;
        value.send();
        let took = cx.clock().since(began).as_nanos() as u64;
        if self.rounds > WARM_ROUNDS {
            self.figures.add(took / self.readers);
        }
        Ok(())
    }

    fn stop(&mut self, _: &mut Context<'_>) -> Outcome {
        self.figures.write(&self.file)
    }
}

/// Hears, and answers where somebody is connected.
#[derive(Component)]
#[component(version = "1.0", nonperiodic)]
pub struct Ear {
    #[port]
    heard: DataIn<Small>,
    #[port]
    said: DataOut<Small>,
    /// Answers each value.
    #[property(default = false)]
    answers: bool,
}

impl Callbacks for Ear {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        let number = self.heard.fresh().map_or(0, |value| value.number);
        if self.answers {
            self.said.write(Small { number, ..Small::default() });
        }
        Ok(())
    }
}

/// Takes a place on an executor and does nothing.
#[derive(Component)]
#[component(version = "1.0", passive)]
pub struct Idler {}

impl Callbacks for Idler {}

/// Asks and waits, again and again.
#[derive(Component)]
#[component(version = "1.0", periodic = "1ms")]
pub struct Caller {
    #[port]
    ask: QueryClient<Small, Small>,
    /// Questions in one callback.
    #[property(default = 1, range = 1..=1000000)]
    batch: u64,
    /// The clock is read for each.
    #[property(default = false)]
    single: bool,
    /// Where the figures go; empty: none are kept.
    #[property(default = "")]
    file: String,
    figures: Figures,
    rounds: u64,
}

impl Callbacks for Caller {
    fn start(&mut self, _: &mut Context<'_>) -> Outcome {
        self.figures.make_room(&self.file);
        Ok(())
    }

    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        let (calls, questions) = if self.single { (self.batch, 1) } else { (1, self.batch) };
        for _ in 0..calls {
            let began = cx.clock();
            for _ in 0..questions {
                let number = self.rounds;
                let answer = self.ask.query(Small { number, ..Small::default() })?;
                if answer.number != number + 1 {
                    return Err(fault!("asked {number}, answered {}", answer.number));
                }
                self.rounds += 1;
            }
            let took = cx.clock().since(began).as_nanos() as u64;
            if self.rounds > WARM_ROUNDS {
                self.figures.add(took / questions);
            }
        }
        Ok(())
    }

    fn stop(&mut self, _: &mut Context<'_>) -> Outcome {
        self.figures.write(&self.file)
    }
}

/// Answers with the next number.
#[derive(Component)]
#[component(version = "1.0", passive)]
pub struct Callee {
    #[port(handler = on_ask)]
    asked: QueryServer<Small, Small>,
}

impl Callbacks for Callee {}

impl Callee {
    fn on_ask(&mut self, _: &mut Context<'_>, query: Query<'_, Small, Small>) -> Outcome {
        let number = query.number + 1;
        query.answer(Small { number, ..Small::default() })?;
        Ok(())
    }
}

export_components!(HopSmall, HopLarge, Caster, Ear, Idler, Caller, Callee);
