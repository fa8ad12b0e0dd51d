//! Handling beyond the slot: `event or order -> diagnose -> decide -> executors' commands`. In the fault manager's thread; what
//! an executor does not answer in time is left behind and named.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use crossbeam_channel::Receiver;
use serde_json::{Map, Value, json};

use super::decide::{Batch, Wave};
use super::diagnose::{Own, Recent, Verdict, Why, diagnose};
use super::graph::{Graph, Number};
use super::order::{Order, Refused, Verb};
use super::quorum;
use super::raises::Raises;
use super::situation::{Senseless, Situation};
use crate::exec::emergency::{self, Notice};
use crate::exec::executor::{Executor, Move};
use crate::exec::follow::Upstream;
use crate::exec::slot::Slot;
use crate::model::fault::{FaultEvent, Outcome, Stage};
use crate::model::ladder::Answer;
use crate::model::lifecycle::State;
use crate::model::limits::{BOOT_STEP, HANDLING_STEP};
use crate::port::voter::Voter;
use crate::profile::plan::Plan;
use crate::sys::latch::Mark;
use crate::sys::{clock, latch};

/// A slot as it is handled.
#[derive(Clone)]
pub struct Hand {
    /// The slot.
    pub slot: Arc<Slot>,
    /// Its executor.
    pub executor: Arc<Executor>,
    /// Its number there.
    pub member: usize,
    /// It is started at boot.
    pub autostart: bool,
}

/// All that runs, as it is handled: the plan's slots and voters, in its order.
pub struct Cast {
    pub(super) graph: Graph,
    hands: Vec<Hand>,
    pub(super) voters: Vec<Arc<Voter>>,
    executors: Vec<Arc<Executor>>,
}

impl Cast {
    /// The slots.
    #[must_use]
    pub fn slots(&self) -> Vec<Arc<Slot>> {
        self.hands.iter().map(|hand| Arc::clone(&hand.slot)).collect()
    }

    /// Of that plan, whose slots and voters these are, in its order.
    #[must_use]
    pub fn new(plan: &Plan, hands: Vec<Hand>, voters: Vec<Arc<Voter>>) -> Self {
        let mut executors: Vec<Arc<Executor>> = Vec::new();
        let mut places: HashMap<*const Executor, usize> = HashMap::new();
        let mut number = |executor: &Arc<Executor>| {
            *places.entry(Arc::as_ptr(executor)).or_insert_with(|| {
                executors.push(Arc::clone(executor));
                executors.len() - 1
            })
        };
        let numbers: Vec<usize> = hands.iter().map(|hand| number(&hand.executor)).collect();
        let mut graph = Graph::compile(plan, &numbers);
        let besides = latch::besides();
        graph.hold(|name| besides.iter().any(|held| held.slot == name));
        Self { graph, hands, voters, executors }
    }

    /// Starts those that are new and start by themselves, needed ones first; those that lack what they need stay as they
    /// are. Returns the first that does not return from `start`.
    #[must_use]
    pub fn start(&self, is_new: impl Fn(&str) -> bool) -> Option<&'static str> {
        let state = |hand: &Hand| hand.slot.status.state();
        let own = |hand: &Hand| match state(hand) {
            State::Active => Own::Wanted,
            State::Error => Own::Faulty(0),
            _ if hand.autostart && is_new(hand.slot.name) => Own::Wanted,
            _ => Own::Off,
        };
        let voters = self.voters.iter().map(|voter| quorum::own_of(voter, None));
        let mut own: Vec<Own> = self.hands.iter().map(own).chain(voters).collect();
        let mut verdicts = self.look(&own);
        for number in self.graph.order().iter().copied().filter(|number| self.graph.is_slot(*number)) {
            let hand = &self.hands[number];
            if state(hand) == State::Active || verdicts[number] != Verdict::Runs {
                continue;
            }
            match hand.executor.start_member(hand.member, BOOT_STEP) {
                Ok(State::Active) => {}
                Ok(_) => {
                    own[number] = Own::Faulty(0);
                    verdicts = self.look(&own);
                }
                Err(_) => return Some(hand.slot.name),
            }
        }
        None
    }

    /// Tells executors whose faults those of their slots may be consequences of.
    fn tell_chains(&self) {
        let mut chains: Vec<Vec<_>> = self.executors.iter().map(|_| Vec::new()).collect();
        for (number, hand) in self.hands.iter().enumerate() {
            let through = |voter: Number| Arc::clone(self.voters[voter - self.graph.slots()].shortfall());
            let upstream = self.graph.chain(number).into_iter().map(|link| Upstream {
                charges: Arc::clone(&self.hands[link.slot].slot.charges),
                through: link.through.into_iter().map(through).collect(),
            });
            chains[self.graph.nodes()[number].executor].push((hand.member, upstream.collect()));
        }
        self.executors.iter().zip(chains).for_each(|(executor, chains)| executor.follow(chains));
    }

    fn look(&self, own: &[Own]) -> Vec<Verdict> {
        diagnose(&self.graph, own, emergency::latched().then_some(None))
    }
}

/// How a slot is by itself, as its state shows it; `before`: how it was when it was looked at last.
fn own_of(hand: &Hand, before: Option<Own>) -> Own {
    match (hand.slot.status.state(), before) {
        (State::Active, _) => Own::Wanted,
        (State::Error, Some(Own::Faulty(root))) => Own::Faulty(root),
        (State::Error, _) => Own::Faulty(0),
        (_, Some(own @ (Own::Wanted | Own::Off))) => own,
        _ if hand.autostart => Own::Wanted,
        _ => Own::Off,
    }
}

/// Why slots do not run, by name, for whoever looks.
#[derive(Debug, Default)]
pub struct Reasons(Mutex<HashMap<&'static str, String>>);

impl Reasons {
    /// Why that slot does not run; `None`: it does, or nobody knows.
    #[must_use]
    pub fn of(&self, slot: &str) -> Option<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get(slot).cloned()
    }

    fn replace(&self, reasons: HashMap<&'static str, String>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = reasons;
    }
}

/// A line for the journal: its kind and its fields.
pub type Line = (&'static str, Map<String, Value>);

/// The fault manager's hands.
#[derive(Default)]
pub struct Handler {
    pub(super) cast: Option<Cast>,
    pub(super) situation: Situation,
    /// Something changed that who looks on is to know.
    has_news: bool,
    /// How slots and voters were before a reload took the cast away.
    pub(super) before: HashMap<&'static str, Own>,
    pub(super) recent: Recent,
    /// The fault that the emergency stop is latched for.
    emergency: Option<u64>,
    pub(super) raises: Raises,
}

impl Handler {
    /// Takes up what runs now; returns lines about whom that changes.
    pub fn adopt(&mut self, cast: Cast) -> Vec<Line> {
        let own = cast.hands.iter().map(|hand| own_of(hand, self.before.get(hand.slot.name).copied()));
        let voters =
            cast.voters.iter().map(|voter| quorum::own_of(voter, self.before.get(voter.parts().name).copied()));
        let own = own.chain(voters).collect();
        let running = cast.hands.iter().map(|hand| hand.slot.status.state() == State::Active).collect();
        self.situation = Situation::new(own, running);
        self.recent.forget();
        cast.tell_chains();
        self.cast = Some(cast);
        self.settle()
    }

    /// Lets go of all that runs: it is about to change, or to end.
    pub fn withdraw(&mut self) {
        if let Some(cast) = self.cast.take() {
            let names = cast.hands.iter().map(|hand| hand.slot.name);
            let names = names.chain(cast.voters.iter().map(|voter| voter.parts().name)).enumerate();
            self.before = names.map(|(number, name)| (name, self.situation.own(number))).collect();
        }
    }

    /// Of which earlier fault this one is a consequence.
    #[must_use]
    pub fn root_of(&self, event: &FaultEvent) -> Option<u64> {
        let cast = self.cast.as_ref().filter(|_| event.fault.stage == Stage::Confirmed)?;
        if let Some(cause) = event.cause {
            return self.recent.root_at(cast.graph.slot(cause)?, event.fault.at_ns);
        }
        if quorum::is_its_own(event) {
            return self.root_of_quorum(cast, event);
        }
        self.recent.root_of(&cast.graph, cast.graph.slot(event.slot)?, event.fault.at_ns)
    }

    /// True where a fault is left to another one that has not been told of yet: the recovery of that slot comes first.
    #[must_use]
    pub fn waits_for_root(&self, event: &FaultEvent) -> bool {
        event.cause.is_some() && self.cast.is_some() && self.root_of(event).is_none()
    }

    /// Takes note of a fault that was journaled under that sequence number; returns lines about what follows.
    pub fn take(&mut self, event: &FaultEvent, sequence: u64, root: Option<u64>) -> Vec<Line> {
        if quorum::is_its_own(event) {
            return self.take_quorum(event, sequence, root);
        }
        if event.fault.stage != Stage::Confirmed {
            return Vec::new();
        }
        self.note_emergency(event, sequence);
        let Some(slot) = self.cast.as_ref().and_then(|cast| cast.graph.slot(event.slot)) else {
            // Nothing is handled at this moment: the state of the slot will tell.
            if event.outcome == Outcome::Stopped {
                self.before.insert(event.slot, Own::Faulty(sequence));
            }
            return Vec::new();
        };
        if event.answer != Answer::Prepare {
            self.recent.remember(slot, event.fault.symptom, event.fault.at_ns, root.unwrap_or(sequence));
        }
        let follows = self.situation.fault(slot, event.outcome, root.unwrap_or(sequence));
        if event.answer == Answer::Emergency {
            self.situation.raise(slot);
        }
        if follows { self.settle() } else { Vec::new() }
    }

    pub(super) fn note_emergency(&mut self, event: &FaultEvent, sequence: u64) {
        if event.answer == Answer::Emergency {
            self.raises.record(event.slot, event.fault.at_ns, sequence);
        }
        if event.answer == Answer::Emergency && emergency::latched() && self.emergency.is_none() {
            self.emergency = Some(sequence);
        }
    }

    /// Events were lost: the states of the slots and voters tell what they said.
    pub fn look_around(&mut self) -> Vec<Line> {
        self.look_at_voters();
        let Some(cast) = &self.cast else { return Vec::new() };
        for (number, hand) in cast.hands.iter().enumerate() {
            match hand.slot.status.state() {
                State::Error if self.situation.own(number) == Own::Wanted => {
                    self.situation.find(number, Own::Faulty(0), false);
                }
                State::Active => self.situation.find(number, Own::Wanted, true),
                _ => {}
            }
        }
        self.settle()
    }

    /// True when it is known for which fault the emergency stop was raised: that comes a little later than the stop.
    #[must_use]
    pub fn knows_root_of(&self, notice: &Notice) -> bool {
        let is_open = matches!(notice, Notice::Raised { slot, at_ns, .. } if self.raises.is_open(slot, *at_ns));
        self.emergency.is_some() && !is_open
    }

    /// A line about the emergency stop.
    #[must_use]
    pub fn describe(&self, notice: Notice) -> Line {
        let fields = match notice {
            Notice::Raised { slot, at_ns, written_ns, outputs, is_first, .. } => {
                let after_ns = written_ns.saturating_sub(at_ns);
                let latched = if is_first { "; latched until `fault clear`" } else { "" };
                tracing::error!("EMERGENCY STOP for a fault of {slot}: {outputs} safe outputs written{latched}");
                json!({"step": "raised", "slot": slot, "outputs": outputs, "after_ns": after_ns, "root": self.raises.number_of(slot, at_ns).or(self.emergency)})
            }
            Notice::Stopped { slot, state, outputs, at_ns } => {
                tracing::error!("emergency stop: actuator {slot} is {}, {outputs} safe outputs written", state.name());
                json!({"step": "stopped", "slot": slot, "state": state, "outputs": outputs, "at_ns": at_ns, "root": self.emergency})
            }
        };
        ("emergency", fields.as_object().cloned().unwrap_or_default())
    }

    /// Carries out an order; returns lines about it.
    ///
    /// # Errors
    /// When it is refused.
    pub fn obey(&mut self, order: &Order) -> Result<(Value, Vec<Line>), Refused> {
        let busy = || Refused::Busy("the daemon reloads or ends: ask again".to_owned());
        let cast = self.cast.as_ref().ok_or_else(busy)?;
        if order.verb == Verb::Clear {
            return self.clear();
        }
        let unknown = || Refused::NoSuchSlot(order.slot.clone());
        let number = cast.graph.slot(&order.slot).ok_or_else(unknown)?;
        if order.verb != Verb::Stop && emergency::latched() && !self.is_missed(cast, number) {
            return Err(Refused::latched());
        }
        let state = cast.hands[number].slot.status.state();
        self.situation.order(number, order.verb).map_err(|senseless| match senseless {
            Senseless::Failed => Refused::failed(&order.slot),
            Senseless::Sound => Refused::sound(&order.slot, state),
        })?;
        let mut lines = vec![ordered(order)];
        lines.extend(self.settle());
        Ok((self.answer(number), lines))
    }

    /// The operator takes the emergency stop back: actuators start again.
    fn clear(&mut self) -> Result<(Value, Vec<Line>), Refused> {
        self.refuse_while_voters_fall_short()?;
        let nothing = || Refused::Other("no emergency stop is latched: there is nothing to clear".to_owned());
        let mark = latch::mark().ok_or_else(nothing)?;
        let unseen = || Refused::raised_again(self.raises.newest());
        // Raised again in this very moment, too.
        let cleared = Some(mark).filter(|mark| self.may_clear(*mark)).and_then(latch::clear).ok_or_else(unseen)?;
        let waited = self.release();
        let cause = cleared.cause.or_else(|| self.raises.first().cloned());
        let mut fields = Map::new();
        fields.insert("root".into(), self.emergency.take().into());
        let mut lines = vec![("clear", fields)];
        self.cast.iter().for_each(|cast| self.situation.clear(&cast.graph));
        self.forgive_voters();
        lines.extend(self.settle());
        let slots: Vec<Value> = waited.into_iter().map(|number| self.answer(number)).collect();
        Ok((json!({"actuators": slots, "cause": cause, "again": cleared.again, "failure": latch::failure()}), lines))
    }

    /// Nobody is held any more but actuators, by the next raise; returns all who were.
    fn release(&mut self) -> Vec<Number> {
        let Some(cast) = &mut self.cast else { return Vec::new() };
        let nodes = cast.graph.nodes().iter().enumerate();
        let waited = nodes.filter(|(_, node)| node.waits_for_clear()).map(|(number, _)| number).collect();
        cast.graph.hold(|_| false);
        waited
    }

    /// True where an operator can know of all that the latch, as it is, was raised for. The first raise may come with its order,
    /// which it is then for.
    #[must_use]
    pub fn may_clear(&self, mark: Mark) -> bool {
        mark.is_first() || self.raises.are_told(mark)
    }

    /// A slot, and why it does not run.
    fn answer(&self, number: Number) -> Value {
        let Some(cast) = &self.cast else { return Value::Null };
        let slot = &cast.hands[number].slot;
        json!({"slot": slot.name, "state": slot.status.state(), "reason": self.reason(cast, number)})
    }

    fn reason(&self, cast: &Cast, number: Number) -> Option<String> {
        match (self.situation.held(number), self.situation.own(number)) {
            (Some(reason), _) if reason.why == Why::Emergency => Some(held_by_latch(&cast.graph.nodes()[number].name)),
            (Some(reason), _) => Some(reason.text(&cast.graph, number)),
            (None, Own::Faulty(0)) => Some("a fault stopped it".to_owned()),
            (None, Own::Faulty(root)) => Some(format!("fault {root} stopped it")),
            (None, Own::Off) if cast.hands[number].autostart => Some("told to stop".to_owned()),
            _ => None,
        }
    }

    /// Why slots do not run.
    pub fn publish(&mut self, reasons: &Reasons) {
        let Some(cast) = self.cast.as_ref().filter(|_| self.has_news) else { return };
        let names = cast.hands.iter().enumerate();
        reasons
            .replace(names.filter_map(|(number, hand)| Some((hand.slot.name, self.reason(cast, number)?))).collect());
        self.has_news = false;
    }

    /// Brings what runs to what is to run.
    pub(super) fn settle(&mut self) -> Vec<Line> {
        let Some(cast) = self.cast.take() else { return Vec::new() };
        self.situation.latch(&cast.graph, emergency::latched(), self.emergency);
        let (verdicts, moves) = self.situation.settle(&cast.graph);
        let began_ns = clock::now_ns();
        for (act, waves) in [(Move::Stop, &moves.stop), (Move::Raise, &moves.start)] {
            waves.iter().for_each(|wave| self.carry_out(&cast, act, wave));
        }
        let lines = self.tell(&cast, &verdicts, clock::now_ns() - began_ns);
        self.cast = Some(cast);
        self.has_news = true;
        lines
    }

    /// One batch for each executor, all at once; then their answers.
    fn carry_out(&mut self, cast: &Cast, act: Move, wave: &Wave) {
        let members = |batch: &Batch| batch.slots.iter().map(|slot| cast.hands[*slot].member).collect();
        let asked: Vec<(&Batch, Receiver<Vec<State>>)> =
            wave.iter().map(|batch| (batch, cast.executors[batch.executor].steer(act, members(batch)))).collect();
        for (batch, answer) in asked {
            let states = answer.recv_timeout(HANDLING_STEP).unwrap_or_else(|_| {
                let name = &cast.executors[batch.executor].name;
                tracing::error!("executor {name} does not answer: slots that it should {} wait for it", act.name());
                Vec::new()
            });
            if act == Move::Stop {
                self.situation.stopped(batch);
                continue;
            }
            for (place, slot) in batch.slots.iter().enumerate() {
                self.situation.started(*slot, states.get(place) == Some(&State::Error));
            }
        }
    }

    /// Lines about those who are held now, or no longer.
    fn tell(&mut self, cast: &Cast, verdicts: &[Verdict], took_ns: u64) -> Vec<Line> {
        let mut lines = Vec::new();
        for (number, before, now) in self.situation.hold(verdicts) {
            let slot = &cast.hands[number].slot;
            if let Some(reason) = now {
                lines.push(line("held", slot, &reason.text(&cast.graph, number), reason.root, took_ns));
            } else if let Some(reason) = before.filter(|_| verdicts[number] == Verdict::Runs) {
                lines.push(line("returned", slot, &reason.text(&cast.graph, number), reason.root, took_ns));
            }
        }
        lines
    }
}

/// Where the profiles do not say why the emergency stop holds it, that is said as well.
fn held_by_latch(slot: &str) -> String {
    let besides = latch::besides().into_iter().find(|held| held.slot == slot);
    besides.map_or_else(|| "emergency stop".to_owned(), |held| format!("emergency stop: {}", held.reason))
}

/// Says in the log what a line says in the journal, behind the fault that it follows from.
pub(super) fn log(kind: &str, fields: &Map<String, Value>) {
    let text = |name: &str| fields.get(name).and_then(Value::as_str).unwrap_or_default();
    let root = fields.get("root").and_then(Value::as_u64);
    let told = root.map(|root| format!(", a consequence of fault {root}")).unwrap_or_default();
    match kind {
        "held" => tracing::warn!("slot {}: stopped: {}{told}", text("slot"), text("reason")),
        "returned" => tracing::info!("slot {}: {} again", text("slot"), text("state")),
        _ => {}
    }
}

fn line(kind: &'static str, slot: &Slot, reason: &str, root: Option<u64>, took_ns: u64) -> Line {
    let fields =
        json!({"slot": slot.name, "state": slot.status.state(), "reason": reason, "root": root, "took_ns": took_ns});
    (kind, fields.as_object().cloned().unwrap_or_default())
}

fn ordered(order: &Order) -> Line {
    tracing::info!("slot {}: {} by an operator", order.slot, order.verb.name());
    let fields = json!({"slot": order.slot, "verb": order.verb.name()});
    ("order", fields.as_object().cloned().unwrap_or_default())
}
