//! Decision beyond the slot: who is stopped and started, in which order, so that nobody runs without what it needs. Pure.

use super::diagnose::Verdict;
use super::graph::{Graph, Number};

/// Slots of one executor, in the order in which it takes them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Batch {
    /// Number of the executor.
    pub executor: usize,
    /// The slots.
    pub slots: Vec<Number>,
}

/// What is done at the same time, one batch for each executor.
pub type Wave = Vec<Batch>;

/// What is to be done, stops before starts, one wave after the other.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Moves {
    /// Stops, dependents first.
    pub stop: Vec<Wave>,
    /// Starts, dependents last.
    pub start: Vec<Wave>,
}

impl Moves {
    /// True where nothing is to be done.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.stop.is_empty() && self.start.is_empty()
    }
}

/// What has to be done where `running` says who runs and `verdicts` who is to.
#[must_use]
pub fn decide(graph: &Graph, running: &[bool], verdicts: &[Verdict]) -> Moves {
    let slots = || running.iter().zip(verdicts);
    let stop: Vec<bool> = slots().map(|(running, verdict)| *running && *verdict != Verdict::Runs).collect();
    let start: Vec<bool> = slots().map(|(running, verdict)| !*running && *verdict == Verdict::Runs).collect();
    let (order, nodes) = (graph.order(), graph.nodes());
    let needed = |number: Number| nodes[number].needs.iter().flat_map(|need| need.on.iter().copied());
    let dependents = |number: Number| graph.dependents(number).iter().copied();
    Moves {
        stop: waves(graph, order.iter().rev().copied(), &stop, dependents),
        start: waves(graph, order.iter().copied(), &start, needed),
    }
}

/// How far those are that must come before a node: the last of their waves, and the executor that all of that wave are on.
#[derive(Clone, Copy, Default)]
struct Behind {
    wave: Option<usize>,
    executor: Option<usize>,
}

impl Behind {
    fn and(self, other: Self) -> Self {
        match self.wave.cmp(&other.wave) {
            std::cmp::Ordering::Less => other,
            std::cmp::Ordering::Greater => self,
            std::cmp::Ordering::Equal => {
                let executor = self.executor.filter(|executor| other.executor == Some(*executor));
                Self { wave: self.wave, executor }
            }
        }
    }

    /// The first wave in which a slot of that executor may be: the same one where its own executor has the others before it.
    fn wave_for(self, executor: usize) -> usize {
        match self.wave {
            None => 0,
            Some(wave) if self.executor == Some(executor) => wave,
            Some(wave) => wave + 1,
        }
    }
}

/// Puts the chosen slots into waves: an executor takes what follows on itself in one go, and only what follows on another one
/// has to wait for it.
fn waves<I: Iterator<Item = Number>>(
    graph: &Graph,
    order: impl Iterator<Item = Number>,
    chosen: &[bool],
    before: impl Fn(Number) -> I,
) -> Vec<Wave> {
    let mut waves: Vec<Wave> = Vec::new();
    if !chosen.contains(&true) {
        return waves;
    }
    let mut behind = vec![Behind::default(); graph.nodes().len()];
    for number in order {
        let mut own = before(number).map(|other| behind[other]).reduce(Behind::and).unwrap_or_default();
        if chosen.get(number) == Some(&true) {
            let executor = graph.nodes()[number].executor;
            let wave = own.wave_for(executor);
            put(&mut waves, wave, executor, number);
            own = Behind { wave: Some(wave), executor: Some(executor) };
        }
        behind[number] = own;
    }
    waves
}

fn put(waves: &mut Vec<Wave>, wave: usize, executor: usize, slot: Number) {
    while waves.len() <= wave {
        waves.push(Wave::new());
    }
    let batches = &mut waves[wave];
    match batches.iter_mut().find(|batch| batch.executor == executor) {
        Some(batch) => batch.slots.push(slot),
        None => batches.push(Batch { executor, slots: vec![slot] }),
    }
}
