//! The server's side: does what it is asked to do.

use component_sdk::prelude::*;

use crate::{Ask, Crossing, Threshold, Told, todo};

/// Puts values, and sends events.
#[derive(Component)]
#[component(name = "Measurer", version = "1.0", periodic = "5ms")]
pub struct Measurer {
    /// What it is asked to do.
    #[port(handler = on_ask)]
    told: QueryServer<Ask, Told>,
    /// Tells of values.
    #[port(on_activation = on_activation)]
    levels: EventServer<Threshold, Crossing, f64>,
    /// Sends events.
    #[port]
    tells: EventOut<u64>,
    /// Asked for, and done in `on_execute` some periods later.
    later: Option<(u32, Ask)>,
    /// What is done in a test.
    in_test: u32,
    activations: u64,
}

/// Periods between an answer and what is done later: into the middle of a wait.
const PERIODS: u32 = 10;

impl Callbacks for Measurer {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        let Some((periods, ask)) = self.later.take() else { return Ok(()) };
        if periods > 0 {
            self.later = Some((periods - 1, ask));
            return Ok(());
        }
        match ask.todo {
            todo::CUT_LATER => cx.wiring().disconnect(("watcher", "level"))?,
            todo::TRAP_LATER => {
                // The successor goes on where it finds this.
                HEIR.store(ask.value as u64, std::sync::atomic::Ordering::SeqCst);
                trap();
            }
            _ => _ = self.put(ask.value)?,
        }
        Ok(())
    }

    fn reset(&mut self, _: &mut Context<'_>) -> Outcome {
        self.in_test = 0;
        Ok(())
    }

    fn start(&mut self, _: &mut Context<'_>) -> Outcome {
        let value = HEIR.swap(0, std::sync::atomic::Ordering::SeqCst);
        self.later = (value > 0).then_some((PERIODS, Ask { todo: todo::PUT, value: value as f64 }));
        Ok(())
    }
}

static HEIR: std::sync::atomic::AtomicU64 = std::sync::atomic::AtomicU64::new(0);

#[inline(never)]
#[allow(unsafe_code, reason = "a fault on purpose")]
pub(crate) fn trap() {
    // SAFETY: none; the write faults, which is its purpose.
    unsafe { std::hint::black_box(8 as *mut u32).write_volatile(1) };
}

impl Measurer {
    fn on_activation(&mut self, _: &mut Context<'_>, parameter: &Threshold) -> Outcome {
        self.activations += u64::from(parameter.label.as_str() != "uncounted");
        Ok(())
    }

    fn on_ask(&mut self, _: &mut Context<'_>, query: Query<'_, Ask, Told>) -> Outcome {
        let ask = (*query).clone();
        let mut told = Told { activations: self.activations, ..Told::default() };
        match ask.todo {
            todo::PUT => match self.put(ask.value) {
                Ok(tests) => told.tests = tests,
                Err(status) => told.status = status.code(),
            },
            todo::SEND => (1..=ask.value as u64).for_each(|number| _ = self.tells.send(number)),
            todo::PANIC_IN_TEST | todo::TRAP_IN_TEST => {
                self.in_test = ask.todo;
                self.put(ask.value)?;
            }
            todo::TRAP => trap(),
            _ => self.later = Some((PERIODS, ask)),
        }
        query.answer(told)?;
        Ok(())
    }

    /// Tells how many tests ran.
    fn put(&mut self, value: f64) -> Result<u64, Status> {
        let (mut tests, in_test) = (0, self.in_test);
        self.levels.put(&value, |parameter, event, value| {
            tests += 1;
            match in_test {
                todo::PANIC_IN_TEST => panic!("in a test"),
                todo::TRAP_IN_TEST => trap(),
                _ => {}
            }
            let now = *value > parameter.above;
            let fires = now && (parameter.always || !parameter.was);
            parameter.was = now;
            event.before = event.value;
            event.value = *value;
            event.label = parameter.label.clone();
            fires
        })?;
        Ok(tests)
    }
}

/// Tells of other things.
#[derive(Component)]
#[component(name = "OtherMeasurer", version = "1.0", passive)]
pub struct OtherMeasurer {
    /// Asked for with another object.
    #[port]
    levels: EventServer<f64, Crossing>,
}

impl Callbacks for OtherMeasurer {
    fn start(&mut self, _: &mut Context<'_>) -> Outcome {
        self.levels.put(&Crossing::default(), |_, _, _| false)?;
        Ok(())
    }
}

/// Sends a plain event in each period.
#[derive(Component)]
#[component(name = "Chime", periodic = "2ms")]
pub struct Chime {
    #[port]
    strikes: EventOut<u64>,
    struck: u64,
}

impl Callbacks for Chime {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        self.struck += 1;
        self.strikes.send(self.struck);
        Ok(())
    }
}
