//! Redundant outputs, heard where each of them writes; the winner's object goes on to whoever is connected to the voter.
//!
//! The voter has an output as a slot has, but no thread and no instance: it votes in the callback of the member that completes a
//! round, and hands the winner's block on as it is. What its readers find wrong with that is the winner's fault, not that of
//! the member in whose callback it was found.
//!
//! That nobody speaks any more no member's callback can find: a clock looks at the voter, too
//! ([`Voter::look`](crate::port::voter::Voter::look)). As long as members speak that is one word that it reads, and no lock.

use std::array;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use super::block::Sample;
use super::charge::{self, Accused};
use super::check;
use super::output::OutPort;
use super::tap::{Heard, Probe, Tap};
use crate::detect::poll::{Demand, Poll, Vote};
use crate::detect::vote::Members;
use crate::model::chain::Lapse;
use crate::model::fault::{Evidence, Fault, FaultEvent, FaultSender, Label, Outcome, Stage, Times};
use crate::model::ladder::Answer;
use crate::model::limits::VOTERS;
use crate::model::symptom::{Severity, Symptom};

/// What faults of a voter's own are told of as its class.
const CLASS: &str = "voting";

/// One of those who vote.
pub struct Member {
    /// Its slot and port.
    pub port: Label,
    /// Who answers for it.
    pub charges: Arc<dyn Accused>,
}

/// All that a voter is made of.
pub struct Parts {
    /// Its name.
    pub name: &'static str,
    /// What it votes by.
    pub demand: Demand,
    /// Whether silence is a fault, or only left out.
    pub stale: bool,
    /// The field that is compared.
    pub field: Label,
    /// Those who vote, at most [`VOTERS`].
    pub members: Vec<Member>,
    /// Where the winner's objects go.
    pub output: Arc<OutPort>,
    /// To the fault manager.
    pub faults: FaultSender,
    /// What is to be done where too few agree: nothing, a stop of whoever depends on it, or the emergency stop.
    pub severity: Severity,
    /// Raises the emergency stop, of which ports know nothing, for the voter of that name at that time. Called within a
    /// callback of a member: takes no lock and waits for nobody.
    pub alarm: fn(&'static str, u64),
}

/// A voter.
pub struct Voter {
    parts: Parts,
    /// When somebody has been silent for too long, unless he is heard before.
    due_ns: AtomicU64,
    shortfall: Arc<Shortfall>,
    // Held while plain numbers are compared and counts change: no memory of a plugin is touched meanwhile.
    state: Mutex<State>,
}

struct State {
    poll: Poll,
    newest: [Option<Sample>; VOTERS],
    /// How many values each delivered.
    heard: [u64; VOTERS],
    votes: u64,
    last: Option<Vote>,
    /// Whom its readers' waiting was blamed on.
    blamed: Members,
}

/// When too few of its members agreed, for whoever looks for roots beyond it: without a lock, and apart from the voter, which
/// holds objects of plugins.
#[derive(Debug, Default)]
pub struct Shortfall {
    since_ns: AtomicU64,
    until_ns: AtomicU64,
}

impl Shortfall {
    /// The last time.
    #[must_use]
    pub fn lapse(&self) -> Lapse {
        Lapse { since_ns: self.since_ns.load(Ordering::Acquire), until_ns: self.until_ns.load(Ordering::Acquire) }
    }

    /// One thread at a time.
    fn note(&self, few: bool, now_ns: u64) {
        let Lapse { since_ns, until_ns } = if few { self.lapse().begun(now_ns) } else { self.lapse().ended(now_ns) };
        // In this order: who reads in between finds a lapse that had ended.
        self.since_ns.store(since_ns, Ordering::Release);
        self.until_ns.store(until_ns, Ordering::Release);
    }
}

/// What becomes of a voter's own fault.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Quorum {
    /// Too few agree.
    Lost,
    /// Enough agree again.
    Found,
    /// Too few agreed, and that counts no more.
    Forgiven,
}

/// What it did lately.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    /// Votes so far.
    pub votes: u64,
    /// How the last one ended.
    pub last: Option<Vote>,
}

impl Voter {
    /// One that has heard nothing yet.
    #[must_use]
    pub fn new(parts: Parts) -> Arc<Self> {
        let poll = Poll::new(parts.demand, parts.members.len());
        let newest = array::from_fn(|_| None);
        let state =
            Mutex::new(State { poll, newest, heard: [0; VOTERS], votes: 0, last: None, blamed: Members::default() });
        let voter = Arc::new(Self { parts, due_ns: AtomicU64::new(u64::MAX), shortfall: Arc::default(), state });
        voter.parts.output.belong_to(Arc::new(Spokesman(Arc::downgrade(&voter))));
        voter
    }

    /// What it is made of.
    #[must_use]
    pub const fn parts(&self) -> &Parts {
        &self.parts
    }

    /// What it did lately.
    #[must_use]
    pub fn tally(&self) -> Tally {
        let state = self.state();
        Tally { votes: state.votes, last: state.last }
    }

    /// Its ear at the output of a member.
    #[must_use]
    pub fn ear(self: &Arc<Self>, member: usize, probe: Probe) -> Arc<dyn Tap> {
        Arc::new(Ear { voter: Arc::clone(self), member, probe })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Its members are to speak from now on, if that is not known yet.
    pub fn expect(&self, now_ns: u64) {
        let mut state = self.state();
        state.poll.expect(now_ns);
        self.set_due(&state.poll);
    }

    /// Looks who has fallen silent, if it is time; when to look next. On a clock's thread: no component's code runs there.
    pub fn look(&self, now_ns: u64) -> u64 {
        if now_ns >= self.due_ns.load(Ordering::Acquire) {
            self.find_silence(now_ns);
        }
        // Whoever is heard after this is silent for too long no sooner than that.
        self.due_ns.load(Ordering::Acquire).min(now_ns.saturating_add(self.parts.demand.max_age_ns))
    }

    fn find_silence(&self, now_ns: u64) {
        let mut state = self.state();
        let heard_ns = array::from_fn(|member| state.poll.heard_ns(member).unwrap_or(now_ns));
        let changes = state.poll.look(now_ns);
        self.note_few(changes, now_ns);
        state.last = changes.or(state.last);
        self.set_due(&state.poll);
        drop(state);
        if let Some(changes) = changes {
            self.tell(&changes, &heard_ns, now_ns);
        }
    }

    /// Too few of its members agree: it hands nothing on.
    #[must_use]
    pub fn falls_short(&self) -> bool {
        self.state().poll.is_few()
    }

    /// Enough of its members agreed when it voted last. Before its first vote it does not fall short, and they do not agree.
    #[must_use]
    pub fn agrees(&self) -> bool {
        self.state().poll.agrees()
    }

    /// Of each member since when it may be wrong or silent by which too few agree, as was told last; `None`: it is not by that one.
    #[must_use]
    pub fn lost_ns(&self) -> [Option<u64>; VOTERS] {
        *self.state().poll.lost_ns()
    }

    /// That too few agree is forgiven: they have the time again in which each may be silent, or it is told anew. That what was
    /// told before is over is told, too.
    pub fn forgive(&self, now_ns: u64) {
        let mut state = self.state();
        let was_few = state.poll.is_few();
        if was_few {
            self.shortfall.note(false, now_ns);
        }
        state.poll.forgive(now_ns);
        self.set_due(&state.poll);
        let agreeing = state.last.map_or(0, |vote| vote.outcome.agreeing.count());
        drop(state);
        if was_few {
            self.tell_of_itself(agreeing, Quorum::Forgiven, now_ns);
        }
    }

    /// When too few of its members agreed.
    #[must_use]
    pub const fn shortfall(&self) -> &Arc<Shortfall> {
        &self.shortfall
    }

    fn note_few(&self, vote: Option<Vote>, now_ns: u64) {
        vote.and_then(|vote| vote.few).into_iter().for_each(|few| self.shortfall.note(few, now_ns));
    }

    fn set_due(&self, poll: &Poll) {
        self.due_ns.store(poll.due_ns().unwrap_or(u64::MAX), Ordering::Release);
    }

    fn deliver(&self, member: usize, value: f64, heard: &Heard<'_>) {
        let now_ns = heard.at_ns();
        let sample = heard.sample();
        let mut state = self.state();
        state.heard.get_mut(member).into_iter().for_each(|count| *count += 1);
        let before = state.newest.get_mut(member).and_then(|newest| std::mem::replace(newest, sample));
        let vote = state.poll.deliver(member, value, now_ns);
        let winner = vote.and_then(|vote| vote.passes);
        let passes = winner.and_then(|winner| state.newest.get(winner).cloned().flatten());
        if vote.is_some() {
            state.votes += 1;
            state.last = vote;
        }
        self.set_due(&state.poll);
        self.note_few(vote, now_ns);
        let heard_ns = vote.map(|_| array::from_fn(|member| state.poll.heard_ns(member).unwrap_or(now_ns)));
        drop(state);
        // The last holder of an object frees the memory of a plugin.
        drop(before);
        if let (Some(winner), Some(sample)) = (winner, passes) {
            self.pass(winner, &sample, now_ns);
        }
        if let (Some(vote), Some(heard_ns)) = (vote, heard_ns) {
            self.tell(&vote, &heard_ns, now_ns);
        }
    }

    fn pass(&self, winner: usize, sample: &Sample, now_ns: u64) {
        let Some(member) = self.parts.members.get(winner) else { return };
        let charge = |fault: &Fault| member.charges.charge(fault);
        let ((), found) = check::apart(|| _ = self.parts.output.hand_on(sample, now_ns, &charge));
        if let Some(report) = found {
            charge(&Fault::told(report.symptom, now_ns, report.evidence));
        }
    }

    fn tell(&self, vote: &Vote, heard_ns: &[u64; VOTERS], now_ns: u64) {
        if vote.few == Some(true) && self.parts.severity == Severity::Emergency {
            (self.parts.alarm)(self.parts.name, now_ns);
        }
        let changes = [(vote.fell_out, Stage::Confirmed), (vote.came_back, Stage::Healed)];
        for (members, stage) in changes {
            self.charge(members, |member| Fault {
                stage,
                ..Fault::told(Symptom::Vote, now_ns, self.outvoted(vote, member))
            });
        }
        let changes = [(vote.fell_silent, Stage::Confirmed), (vote.spoke, Stage::Healed)];
        for (members, stage) in changes.into_iter().filter(|_| self.parts.stale) {
            let silence = |member: &usize| Evidence::Silence {
                port: self.parts.members.get(*member).map_or(Label::new(""), |member| member.port),
                silent_ns: now_ns.saturating_sub(heard_ns.get(*member).copied().unwrap_or(now_ns)),
                max_age_ns: self.parts.demand.max_age_ns,
            };
            self.charge(members, |member| Fault { stage, ..Fault::told(Symptom::Stale, now_ns, silence(&member)) });
        }
        if let Some(few) = vote.few {
            let quorum = if few { Quorum::Lost } else { Quorum::Found };
            self.tell_of_itself(vote.outcome.agreeing.count(), quorum, now_ns);
        }
    }

    fn outvoted(&self, vote: &Vote, member: usize) -> Evidence {
        Evidence::Vote {
            port: self.parts.members.get(member).map_or(Label::new(""), |member| member.port),
            field: self.parts.field,
            value: vote.values.get(member).copied().flatten().unwrap_or(f64::NAN),
            agreed: vote.outcome.winner.map_or(f64::NAN, |(_, value)| value),
            agreeing: vote.outcome.agreeing.count() as u32,
            tolerance: self.parts.demand.tolerance,
        }
    }

    /// Too few agree, or enough again: nobody else's fault. Its own rule answers it.
    fn tell_of_itself(&self, agreeing: usize, quorum: Quorum, now_ns: u64) {
        let Parts { name, demand, field, members, output, faults, severity, .. } = &self.parts;
        let evidence = Evidence::Quorum {
            port: Label::of(format_args!("{name}.{}", output.name)),
            field: *field,
            agreeing: agreeing as u32,
            require: demand.require as u32,
            members: members.len() as u32,
            forgiven: quorum == Quorum::Forgiven,
        };
        let few = quorum == Quorum::Lost;
        let stage = if few { Stage::Confirmed } else { Stage::Healed };
        let (answer, outcome) = match severity {
            Severity::Stop if few => (Answer::Stop, Outcome::Stopped),
            Severity::Emergency if few => (Answer::Emergency, Outcome::Stopped),
            _ => (Answer::Ignore, Outcome::Ignored),
        };
        let event = FaultEvent {
            slot: name,
            class: CLASS,
            fault: Fault { stage, ..Fault::told(Symptom::Vote, now_ns, evidence) },
            severity: *severity,
            answer,
            successor: None,
            outcome,
            checkpoint_ns: None,
            cause: None,
            times: Times::default(),
        };
        if faults.try_send(event).is_err() {
            charge::count_lost();
        }
    }

    fn accused(&self, fault: &Fault) -> Members {
        let mut state = self.state();
        let winner = state.last.and_then(|vote| vote.outcome.winner).map(|(winner, _)| winner);
        let Evidence::Silence { max_age_ns, .. } = fault.evidence else { return winner.into_iter().collect() };
        if fault.stage != Stage::Confirmed {
            return std::mem::take(&mut state.blamed);
        }
        let is_silent = |member: &usize| {
            let heard_ns = state.poll.heard_ns(*member);
            heard_ns.is_none_or(|heard_ns| fault.detected_ns.saturating_sub(heard_ns) > max_age_ns)
        };
        state.blamed = (0..self.parts.members.len()).filter(is_silent).collect();
        state.blamed
    }

    fn charge(&self, members: Members, fault: impl Fn(usize) -> Fault) {
        for member in members.iter() {
            if let Some(blamed) = self.parts.members.get(member) {
                // One that is lost is counted.
                blamed.charges.charge(&fault(member));
            }
        }
    }
}

/// Answers for what the voter hands on, or does not.
struct Spokesman(Weak<Voter>);

impl Accused for Spokesman {
    /// Silence is the fault of those members that are silent themselves; anything else that of whoever won last.
    fn charge(&self, fault: &Fault) -> bool {
        let Some(voter) = self.0.upgrade() else { return true };
        let members = voter.accused(fault);
        let charge = |member: usize| voter.parts.members.get(member).is_some_and(|member| member.charges.charge(fault));
        // Each of them, also after one that was lost.
        members.iter().filter(|member| !charge(*member)).count() == 0
    }
}

struct Ear {
    voter: Arc<Voter>,
    member: usize,
    probe: Probe,
}

impl Tap for Ear {
    fn name(&self) -> &str {
        self.voter.parts.name
    }

    fn heard(&self, heard: &Heard<'_>) {
        // Before anything is locked. A sequence that is too short votes for nothing that anybody agrees with.
        let value = heard.number(&self.probe).unwrap_or(f64::NAN);
        self.voter.deliver(self.member, value, heard);
    }

    fn begins_anew(&self) {
        let mut state = self.voter.state();
        state.poll.begin(self.member);
        self.voter.set_due(&state.poll);
        let before = state.newest.get_mut(self.member).and_then(Option::take);
        drop(state);
        drop(before);
    }

    fn count(&self) -> u64 {
        self.voter.state().heard.get(self.member).copied().unwrap_or_default()
    }

    fn holds(&self) -> usize {
        1 + self.voter.parts.output.held()
    }
}
