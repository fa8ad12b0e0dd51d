//! A skill: two components can avoid obstacles; who does is changed while the robot drives, by the wiring pattern.

use std::time::Duration;

use component_sdk::prelude::*;
use component_sdk::wiring::Refusal;

/// Lets two avoiders drive in turn. The next one gets the course first and the motors when it knows the way, so that there
/// is no period without a command.
#[derive(Component)]
#[component(name = "SkillSwitch", version = "1.0", periodic = "50ms")]
pub struct SkillSwitch {
    /// Slot that plans: its `course` goes to whoever drives.
    #[property(default = "planner")]
    planner: String,
    /// Slot whose `command` comes from whoever drives.
    #[property(default = "motors")]
    motors: String,
    /// Slot of the avoider that drives first, as the profile wires it.
    #[property(default = "avoider_a")]
    one: String,
    /// Slot of the other avoider.
    #[property(default = "avoider_b")]
    other: String,
    /// How long each drives.
    #[property(default = 2.0, unit = "s", range = 0.5..=100000.0)]
    each: f64,
    /// How long both get the course before the motors are handed over: more than the planner's period.
    #[property(default = 0.2, unit = "s", range = 0.0..=2.0)]
    overlap: f64,
    state: State,
    /// Of the state.
    since: Instant,
}

/// Who drives, and whether the other one is getting ready.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    Begins,
    Drives(Who),
    GetsReady(Who),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Who {
    One,
    Other,
}

impl Who {
    const fn next(self) -> Self {
        match self {
            Self::One => Self::Other,
            Self::Other => Self::One,
        }
    }
}

impl Callbacks for SkillSwitch {
    fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
        self.enter(cx, State::Begins);
        Ok(())
    }

    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        let passed = cx.now().since(self.since);
        match self.state {
            // Whatever was wired before, by a predecessor that failed in the middle of it: now one of them drives.
            State::Begins => self.prepare(cx, Who::One).and_then(|()| self.hand_over(cx, Who::One))?,
            State::Drives(who) if passed >= Duration::from_secs_f64(self.each) => self.prepare(cx, who.next())?,
            State::GetsReady(who) if passed >= Duration::from_secs_f64(self.overlap) => self.hand_over(cx, who)?,
            _ => {}
        }
        Ok(())
    }
}

impl SkillSwitch {
    fn slot(&self, who: Who) -> &str {
        match who {
            Who::One => &self.one,
            Who::Other => &self.other,
        }
    }

    fn enter(&mut self, cx: &Context<'_>, state: State) {
        (self.state, self.since) = (state, cx.now());
    }

    /// Both know the way.
    fn prepare(&mut self, cx: &Context<'_>, who: Who) -> Result<(), Refusal> {
        cx.wiring().connect((self.slot(who), "course"), (&self.planner, "course"))?;
        self.enter(cx, State::GetsReady(who));
        Ok(())
    }

    /// The motors listen to that one from now on, and the other one is told nothing more.
    fn hand_over(&mut self, cx: &Context<'_>, who: Who) -> Result<(), Refusal> {
        cx.wiring().connect((&self.motors, "command"), (self.slot(who), "command"))?;
        let now = cx.clock().as_nanos();
        cx.wiring().disconnect((self.slot(who.next()), "course"))?;
        info!(cx, "{} drives from {}.{:09} s", self.slot(who), now / 1_000_000_000, now % 1_000_000_000);
        self.enter(cx, State::Drives(who));
        Ok(())
    }
}

export_components!(SkillSwitch);
