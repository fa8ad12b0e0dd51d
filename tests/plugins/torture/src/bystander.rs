//! Components that do their work and watch that nobody disturbs it.

use std::hint::black_box;

use component_sdk::prelude::*;

/// A number on its way from one bystander to the next.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Beat {
    /// How many were sent before this one.
    pub number: u64,
}

/// Passes a number on each millisecond; counts the periods that it missed; raises a fault when arithmetic or data are wrong.
#[derive(Component)]
#[component(version = "1.0", periodic = "1ms")]
pub struct Bystander {
    #[port]
    heard: DataIn<Beat>,
    #[port]
    said: DataOut<Beat>,
    number: u64,
    last_heard: u64,
    last_ns: u64,
    /// Times at which a period or more was missed.
    gaps: u64,
    /// Most periods missed at once.
    longest: u64,
}

const PERIOD_NS: u64 = 1_000_000;

impl Bystander {
    fn watch_clock(&mut self, now_ns: u64) {
        let late = (now_ns - std::mem::replace(&mut self.last_ns, now_ns)).saturating_sub(PERIOD_NS);
        // Half a period of jitter is not a missed period.
        let missed = (late + PERIOD_NS / 2) / PERIOD_NS;
        self.gaps += u64::from(missed > 0);
        self.longest = self.longest.max(missed);
    }
}

/// As the compiler would compute it: rounded to nearest, small numbers kept.
fn arithmetic_is_sound() -> bool {
    let third = black_box(1.0f64) / black_box(3.0);
    let negative = black_box(-2.0f64) / black_box(3.0);
    let small = black_box(f64::MIN_POSITIVE) / black_box(4.0);
    third.to_bits() == (1.0f64 / 3.0).to_bits() && negative.to_bits() == (-2.0f64 / 3.0).to_bits() && small > 0.0
}

impl Callbacks for Bystander {
    fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
        self.last_ns = cx.now().as_nanos();
        Ok(())
    }

    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        self.watch_clock(cx.now().as_nanos());
        if !arithmetic_is_sound() {
            cx.raise_fault("its arithmetic was changed");
        }
        if let Some(beat) = self.heard.fresh() {
            if beat.number < self.last_heard {
                cx.raise_fault("what it heard went backwards");
            }
            self.last_heard = beat.number;
        }
        self.said.write(Beat { number: self.number });
        self.number += 1;
        Ok(())
    }

    fn stop(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "gaps {} longest {}", self.gaps, self.longest);
        Ok(())
    }
}
