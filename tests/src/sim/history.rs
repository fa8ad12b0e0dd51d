//! Histories, one after the other. Each has a seed of its own, and comes again with it.

use std::collections::BTreeMap;

use super::executors::Executors;
use super::world::{NO_DEADLINE_NS, World};

/// Steps of a history.
const LENGTH: u64 = 2_000;
/// Lines of a history that are shown when something went wrong.
const SHOWN: usize = 200;

/// What many histories came to.
#[derive(Debug, Default)]
pub struct Report {
    /// How many there were.
    pub histories: u64,
    /// Steps of all of them.
    pub steps: u64,
    /// What happened how often.
    pub counts: BTreeMap<&'static str, u64>,
    /// The first that went wrong.
    pub failure: Option<Failure>,
}

/// A history that went wrong.
#[derive(Debug)]
pub struct Failure {
    /// It comes again with this seed.
    pub seed: u64,
    /// What was wrong.
    pub problem: String,
    /// Its last steps.
    pub lines: Vec<String>,
}

impl Report {
    /// In words.
    #[must_use]
    pub fn text(&self) -> String {
        let counts: Vec<String> = self.counts.iter().map(|(what, count)| format!("{count} {what}")).collect();
        let mut text = format!("{} histories, {} steps: {}", self.histories, self.steps, counts.join(", "));
        if let Some(Failure { seed, problem, lines }) = &self.failure {
            text += &format!("\nthe history with seed {seed} went wrong: {problem}\n{}", lines.join("\n"));
        }
        text
    }
}

/// Histories with seeds from that one on, until there were so many steps or something went wrong.
#[must_use]
pub fn run(steps: u64, seed: u64) -> Report {
    let mut report = Report::default();
    while report.steps < steps.max(1) && report.failure.is_none() {
        let seed = seed.wrapping_add(report.histories);
        let world = live(seed, false);
        let (problem, _, counts) = world.findings();
        report.histories += 1;
        report.steps += world.steps();
        counts.into_iter().for_each(|(what, count)| *report.counts.entry(what).or_default() += count);
        if let Some(problem) = problem {
            let (_, mut lines, _) = live(seed, true).findings();
            lines.drain(..lines.len().saturating_sub(SHOWN));
            report.failure = Some(Failure { seed, problem, lines });
        }
    }
    report
}

/// One life of a small system.
fn live(seed: u64, tells: bool) -> std::sync::Arc<World> {
    // The seeds of two histories are neighbours: what is drawn from them is not.
    let world = World::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15), LENGTH, tells);
    let mut executors = Executors::new(&world);
    let slots: Vec<_> = (0..world.slots.len()).map(|slot| world.model().slots[slot].executor).collect();
    world.tell(|| format!("slots on executors {slots:?}, deadlines: {}, pending: {}", world.deadlines, world.pending));
    executors.set_up();
    while world.goes_on() {
        if executors.go_on_by_lot() {
            world.step();
        }
    }
    executors.settle_all();
    world
}

impl Executors {
    /// Does something; false: there was nothing to it.
    fn go_on_by_lot(&mut self) -> bool {
        let dice = &self.world.dice;
        let slot = dice.below(self.world.slots.len());
        match dice.below(200) {
            0..100 => return self.run(dice.below(self.world.bells.len())),
            100..160 => return self.execute(slot),
            160..178 => return self.end_wait_of(slot),
            178..182 => return self.begin_cycle(slot),
            182..190 => self.let_time_pass(),
            190..199 => return self.interfere(),
            _ => self.check_rest(),
        }
        true
    }

    /// Its waiting time is over, where it is.
    fn end_wait_of(&mut self, slot: usize) -> bool {
        let is_over = self.until_ns(slot).is_some_and(|until_ns| until_ns <= self.world.now_ns());
        let goes_on = is_over && self.is_free(slot);
        if goes_on {
            self.go_on(slot, true);
        }
        goes_on
    }

    /// Its next cycle begins, where it runs.
    fn begin_cycle(&self, slot: usize) -> bool {
        let (ends, is_free) = (self.world.ends(slot), self.is_free(slot));
        let Some(due_ns) = ends.output.outlet().due_ns().filter(|_| is_free) else { return false };
        self.world.take_thread(&self.world.bells[self.executor(slot)]);
        let mut model = self.world.model();
        let writer = &mut model.writers[ends.life];
        writer.missed += u64::from(std::mem::replace(&mut writer.ticked, true));
        drop(model);
        ends.output.outlet().turn(due_ns);
        true
    }

    /// To the end of the next waiting time, or a bit.
    fn let_time_pass(&self) {
        let now_ns = self.world.now_ns();
        let ends = (0..self.world.slots.len()).filter_map(|slot| self.until_ns(slot));
        let next = ends.filter(|until_ns| *until_ns < now_ns + NO_DEADLINE_NS / 2).min();
        let later = now_ns + 1 + self.world.dice.below(200) as u64;
        self.world.advance_to(if self.world.dice.once_in(2) { next.unwrap_or(later) } else { later });
    }
}
