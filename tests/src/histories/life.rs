//! One history of a small system: faults, orders, lost events and starts that fail, each judged when it is settled.

use framework_daemon::fault::decide::Wave;
use framework_daemon::fault::diagnose::{Own, Recent};
use framework_daemon::fault::graph::{Graph, Link};
use framework_daemon::fault::order::Verb;
use framework_daemon::fault::situation::Situation;
use framework_daemon::model::chain::{self, Lapse, Mark};
use framework_daemon::model::fault::Outcome;
use framework_daemon::model::ladder::{Answer, Ladder};
use framework_daemon::model::limits::CONSEQUENCE_WINDOW;
use framework_daemon::model::symptom::{Severity, Symptom};
use framework_daemon::profile::plan::Coverage;

use super::Counts;
use super::drawn::{Drawn, SYMPTOMS, Voter};
use super::naive::{self, Past};
use crate::sim::dice::Dice;

/// What happened, for whoever looks for the mistake.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Event {
    Fault(usize, Symptom, Outcome),
    Lost(usize),
    Order(Verb, usize, bool),
    Latched,
    Vote(usize, bool),
    Stopped(usize),
    Started(usize),
    Failed(usize),
}

/// A system in the middle of its history.
pub(super) struct Life {
    dice: Dice,
    drawn: Drawn,
    graph: Graph,
    situation: Situation,
    recent: Recent,
    ladders: Vec<Ladder>,
    /// As the naive model has it.
    own: Vec<naive::Own>,
    running: Vec<bool>,
    latched: Option<u64>,
    past: Vec<Past>,
    resets: Vec<Vec<u64>>,
    /// The fault that stopped it was answered by the emergency stop.
    raised: Vec<bool>,
    /// As the executors have them: since when each slot is a root.
    marks: Vec<Mark>,
    /// As the naive model has it.
    roots: Vec<Vec<u64>>,
    /// Of which voters too few members agree, and for whom that means something the fault that told it.
    short: Vec<bool>,
    short_roots: Vec<Option<u64>>,
    /// As the voters have them, and as the naive model has it: when too few agreed.
    lapses: Vec<Lapse>,
    lapsed: Vec<Vec<(u64, Option<u64>)>>,
    /// What was left to a root, and may still be there.
    left: Vec<(usize, Symptom)>,
    now_ns: u64,
    sequence: u64,
    events: Vec<Event>,
    pub(super) counts: Counts,
}

impl PartialEq for Life {
    fn eq(&self, other: &Self) -> bool {
        let parts = |life: &Self| (life.graph.nodes().to_vec(), life.graph.order().to_vec());
        (&self.events, &self.situation) == (&other.events, &other.situation) && parts(self) == parts(other)
    }
}

impl Life {
    /// A whole history.
    pub(super) fn lived(seed: u64) -> Result<Self, String> {
        let dice = Dice::new(seed);
        let mut life = Self::born(dice);
        let told = |life: &Self, wrong: String| format!("{wrong}\n{:?}\n{:#?}", life.events, life.graph.nodes());
        life.settle().map_err(|wrong| told(&life, wrong))?;
        for _ in 0..life.dice.below(40) {
            life.step().map_err(|wrong| told(&life, wrong))?;
        }
        Ok(life)
    }

    fn born(dice: Dice) -> Self {
        let drawn = Drawn::by(&dice);
        let own: Vec<naive::Own> =
            drawn.slots.iter().map(|slot| if slot.autostart { naive::Own::Wanted } else { naive::Own::Off }).collect();
        let real = own.iter().map(|own| if *own == naive::Own::Wanted { Own::Wanted } else { Own::Off });
        let (count, voters) = (own.len(), drawn.voters.len());
        let real = real.chain((0..voters).map(|_| Own::Wanted)).collect();
        Self {
            graph: drawn.graph(),
            situation: Situation::new(real, vec![false; count]),
            recent: Recent::default(),
            ladders: drawn.ladders(),
            own,
            running: vec![false; count],
            latched: None,
            past: Vec::new(),
            resets: vec![Vec::new(); count],
            raised: vec![false; count],
            marks: vec![Mark::NONE; count],
            roots: vec![Vec::new(); count],
            short: vec![false; voters],
            short_roots: vec![None; voters],
            lapses: vec![Lapse::default(); voters],
            lapsed: vec![Vec::new(); voters],
            left: Vec::new(),
            now_ns: 1_000_000_000,
            sequence: 0,
            events: Vec::new(),
            counts: Counts::new(),
            drawn,
            dice,
        }
    }

    fn count(&mut self, what: &'static str) {
        *self.counts.entry(what).or_default() += 1;
    }

    fn step(&mut self) -> Result<(), String> {
        self.now_ns += self.dice.below(400_000_000) as u64;
        let slot = self.dice.below(self.own.len());
        if self.dice.once_in(3)
            && let Some((slot, symptom)) = self.left.pop().filter(|(slot, _)| self.running[*slot])
        {
            self.count("consequences that last");
            return self.fault(slot, symptom);
        }
        match self.dice.below(12) {
            10.. if !self.short.is_empty() => self.vote(self.dice.below(self.short.len())),
            0..5 if self.running[slot] => self.fault(slot, SYMPTOMS[self.dice.below(SYMPTOMS.len())]),
            0..5 => Ok(()),
            5 if self.latched.is_some() => self.clear(),
            5 if self.running[slot] => self.lose(slot),
            _ => self.order(slot),
        }
    }

    /// A slot that runs fails, and its executor answers by its rules; recoveries fail by lot.
    fn fault(&mut self, slot: usize, symptom: Symptom) -> Result<(), String> {
        if self.is_left(slot, symptom)? {
            self.left.push((slot, symptom));
            return self.tell(slot, symptom, Answer::Await, Outcome::Consequence);
        }
        let mut answer = self.ladders[slot].answer(symptom, self.now_ns);
        if answer == Answer::Ignore && symptom.loses_instance() {
            answer = Answer::Stop;
        }
        if answer == Answer::Emergency {
            self.latch();
        }
        for _ in 0..self.drawn.slots[slot].secondaries + 2 {
            let outcome = match answer {
                Answer::Ignore => Outcome::Ignored,
                Answer::Stop | Answer::Emergency | Answer::Await | Answer::Prepare => {
                    return self.fault_stop(slot, symptom, answer);
                }
                Answer::Reset | Answer::Replace => {
                    self.judge_intensity(slot, answer)?;
                    if self.dice.once_in(4) { Outcome::Failed } else { Outcome::Recovered }
                }
            };
            self.tell(slot, symptom, answer, outcome)?;
            if outcome != Outcome::Failed {
                return Ok(());
            }
            answer = self.ladders[slot].further();
        }
        Err(format!("the fault of slot {slot} has no outcome"))
    }

    /// True where a fault is left to the answer to its root; the slot is a root itself else.
    fn is_left(&mut self, slot: usize, symptom: Symptom) -> Result<bool, String> {
        let rules = &self.drawn.slots[slot];
        let answered = chain::answered(&rules.severity) & chain::bit(symptom) != 0;
        let seen = if answered { self.marks[slot].seen(self.now_ns) } else { self.marks[slot] };
        let onset_ns = seen.onset_ns(self.now_ns);
        let waits = chain::may_wait(symptom, rules.severity.get(symptom), rules.coverage == Coverage::System);
        let shows = |voter: &usize| self.lapses[*voter - self.own.len()].reaches(onset_ns);
        let is_root =
            |link: &Link| self.marks[link.slot].root_until_ns(onset_ns).is_some() && link.through.iter().all(shows);
        let is_left = waits && self.graph.chain(slot).iter().any(is_root);
        let wanted = naive::is_left(&self.drawn, &self.roots, &self.lapsed, slot, symptom, self.now_ns);
        if is_left != wanted {
            return Err(format!(
                "{symptom:?} of slot {slot} is left to another slot's fault: {is_left}, must: {wanted}"
            ));
        }
        if is_left {
            self.marks[slot] = seen.left();
            self.count("left to their root");
        } else if answered {
            self.marks[slot] = seen.taken_up(onset_ns);
            self.roots[slot].push(self.now_ns);
        }
        Ok(is_left)
    }

    /// Too few members of a voter agree, or enough again.
    fn vote(&mut self, place: usize) -> Result<(), String> {
        let is_short = !self.short[place];
        self.events.push(Event::Vote(place, is_short));
        self.short[place] = is_short;
        let Voter { severity, .. } = self.drawn.voters[place];
        if !is_short {
            self.end_lapse(place);
            self.count("voters that agree again");
            self.situation.vote(self.own.len() + place, None);
            return self.settle();
        }
        self.lapses[place] = self.lapses[place].begun(self.now_ns);
        self.lapsed[place].push((self.now_ns, None));
        if severity == Severity::Emergency {
            self.latch();
        }
        self.sequence += 1;
        let root = self.place(self.own.len() + place)?;
        if severity == Severity::Ignore {
            return self.judge();
        }
        self.count("voters that stop others");
        self.short_roots[place] = Some(root);
        self.situation.vote(self.own.len() + place, Some(root));
        self.settle()
    }

    fn end_lapse(&mut self, place: usize) {
        self.short_roots[place] = None;
        self.lapses[place] = self.lapses[place].ended(self.now_ns);
        self.lapsed[place].last_mut().into_iter().for_each(|lapse| lapse.1 = Some(self.now_ns));
    }

    /// The root of the newest fault, of a slot or a voter: an earlier one, or itself.
    fn place(&mut self, number: usize) -> Result<u64, String> {
        // All of a voter's members are presumed to have agreed until the window began.
        let since_ns = self.now_ns.saturating_sub(CONSEQUENCE_WINDOW.as_nanos() as u64);
        let members = self.graph.nodes()[number].needs.iter().flat_map(|need| &need.on);
        let lost: Vec<_> = members.map(|member| (*member, since_ns)).collect();
        let root = if self.graph.is_voter(number) {
            self.recent.root_of_loss(&self.graph, number, &lost, self.now_ns)
        } else {
            self.recent.root_of(&self.graph, number, self.now_ns)
        };
        let wanted = naive::root_of(&self.drawn, &self.past, number, self.now_ns);
        if root != wanted {
            return Err(format!("the fault of {number} is told to be a consequence of {root:?}, not of {wanted:?}"));
        }
        self.count(if root.is_some() { "consequences" } else { "roots" });
        let root = root.unwrap_or(self.sequence);
        self.recent.remember(number, Symptom::CrashSegv, self.now_ns, root);
        self.past.push(Past { slot: number, at_ns: self.now_ns, root });
        Ok(root)
    }

    /// Never more resets in the window than the rules allow.
    fn judge_intensity(&mut self, slot: usize, answer: Answer) -> Result<(), String> {
        if answer == Answer::Replace {
            self.count("replacements");
            self.resets[slot].clear();
            return Ok(());
        }
        self.count("resets");
        self.resets[slot].push(self.now_ns);
        let rules = &self.drawn.slots[slot];
        let from_ns = self.now_ns.saturating_sub(rules.within.as_nanos() as u64);
        let recent = self.resets[slot].iter().filter(|at| **at >= from_ns).count();
        if recent > rules.limit as usize {
            return Err(format!("slot {slot} was reset {recent} times of at most {}", rules.limit));
        }
        Ok(())
    }

    fn fault_stop(&mut self, slot: usize, symptom: Symptom, answer: Answer) -> Result<(), String> {
        let mut answer = answer;
        if answer != Answer::Emergency && self.drawn.slots[slot].coverage == Coverage::System {
            self.latch();
            answer = Answer::Emergency;
        }
        self.running[slot] = false;
        self.tell(slot, symptom, answer, Outcome::Stopped)
    }

    /// Every actuator is told at once, by its executor.
    fn latch(&mut self) {
        self.count("emergencies");
        self.events.push(Event::Latched);
        for (number, slot) in self.drawn.slots.iter().enumerate() {
            self.running[number] &= !slot.is_actuator;
        }
        self.latched.get_or_insert(self.sequence + 1);
    }

    /// The fault manager learns of it.
    fn tell(&mut self, slot: usize, symptom: Symptom, answer: Answer, outcome: Outcome) -> Result<(), String> {
        self.sequence += 1;
        self.events.push(Event::Fault(slot, symptom, outcome));
        let root = self.place(slot)?;
        if outcome == Outcome::Stopped {
            self.own[slot] = naive::Own::Failed(root);
            self.raised[slot] = answer == Answer::Emergency;
        }
        let follows = self.situation.fault(slot, outcome, root);
        if answer == Answer::Emergency {
            self.situation.raise(slot);
        }
        if follows || outcome == Outcome::Stopped { self.settle() } else { self.judge() }
    }

    /// A slot stops for a fault whose event is lost; the fault manager looks around.
    fn lose(&mut self, slot: usize) -> Result<(), String> {
        self.events.push(Event::Lost(slot));
        self.count("lost events");
        self.running[slot] = false;
        (self.own[slot], self.raised[slot]) = (naive::Own::Failed(0), false);
        if self.situation.own(slot) == Own::Wanted {
            self.situation.find(slot, Own::Faulty(0), false);
        }
        self.settle()
    }

    fn order(&mut self, slot: usize) -> Result<(), String> {
        let verb = [Verb::Start, Verb::Stop, Verb::Reset, Verb::Reset][self.dice.below(4)];
        if verb != Verb::Stop && self.latched.is_some() {
            return Ok(());
        }
        let (before, taken) = (self.own[slot], self.situation.order(slot, verb).is_ok());
        let has_failed = matches!(before, naive::Own::Failed(_));
        self.events.push(Event::Order(verb, slot, taken));
        let makes_sense = match verb {
            Verb::Start => !has_failed,
            Verb::Reset => has_failed,
            Verb::Stop | Verb::Clear => true,
        };
        if taken != makes_sense {
            return Err(format!("{verb:?} of slot {slot}, which is {before:?}, was taken: {taken}"));
        }
        self.own[slot] = match verb {
            Verb::Start | Verb::Reset if taken => naive::Own::Wanted,
            Verb::Stop if !has_failed => naive::Own::Off,
            _ => before,
        };
        self.count("orders");
        self.settle()
    }

    fn clear(&mut self) -> Result<(), String> {
        self.count("clears");
        self.events.push(Event::Order(Verb::Clear, 0, true));
        self.latched = None;
        self.situation.clear(&self.graph);
        for place in 0..self.short.len() {
            if self.short[place] && self.drawn.voters[place].severity == Severity::Emergency {
                // As if their members could not work without the actuators.
                self.short[place] = false;
                self.end_lapse(place);
                self.situation.vote(self.own.len() + place, None);
            }
        }
        for (number, slot) in self.drawn.slots.iter().enumerate() {
            if slot.is_actuator && matches!(self.own[number], naive::Own::Failed(_)) && self.raised[number] {
                self.own[number] = naive::Own::Wanted;
            }
        }
        self.settle()
    }

    /// Carries out what is decided, until nothing is left to do; then all must be as it must be.
    fn settle(&mut self) -> Result<(), String> {
        for _ in 0..=self.own.len() {
            self.situation.latch(&self.graph, self.latched.is_some(), self.latched);
            let (verdicts, moves) = self.situation.settle(&self.graph);
            if self.situation.settle(&self.graph) != (verdicts.clone(), moves.clone()) {
                return Err("equal input gave another output".to_owned());
            }
            let mut failed = Vec::new();
            // What is done at the same time may come in any order.
            for wave in moves.stop {
                self.stop(&self.in_any_order(wave))?;
            }
            for wave in moves.start {
                self.start(&self.in_any_order(wave), &mut failed)?;
            }
            let _ = self.situation.hold(&verdicts);
            if failed.is_empty() {
                return self.judge();
            }
            for slot in failed {
                self.sequence += 1;
                (self.own[slot], self.raised[slot]) = (naive::Own::Failed(self.sequence), false);
                let _ = self.situation.fault(slot, Outcome::Stopped, self.sequence);
            }
        }
        Err("it does not settle".to_owned())
    }

    /// Of which voters too few agree, where their rule is to stop others.
    fn stopping(&self) -> Vec<bool> {
        let voters = self.short.iter().zip(&self.drawn.voters);
        voters.map(|(is_short, voter)| *is_short && voter.severity != Severity::Ignore).collect()
    }

    fn in_any_order(&self, mut wave: Wave) -> Wave {
        let first = self.dice.below(wave.len());
        wave.rotate_left(first);
        if self.dice.once_in(2) {
            wave.reverse();
        }
        wave
    }

    /// Dependents first: nobody who runs loses what it needs by a stop.
    fn stop(&mut self, wave: &Wave) -> Result<(), String> {
        for batch in wave {
            for slot in &batch.slots {
                if self.drawn.slots[*slot].executor != batch.executor || !self.running[*slot] {
                    return Err(format!("slot {slot} is stopped where it does not run"));
                }
                let had = |life: &Self| -> Vec<bool> {
                    (0..life.own.len())
                        .map(|other| {
                            life.running[other] && !naive::lacks(&life.drawn, &life.running, &life.stopping(), other)
                        })
                        .collect()
                };
                let before = had(self);
                self.running[*slot] = false;
                let after = had(self);
                if let Some(other) = (0..before.len()).find(|other| other != slot && before[*other] && !after[*other]) {
                    return Err(format!("slot {slot} is stopped before slot {other}, which needs it"));
                }
                self.events.push(Event::Stopped(*slot));
                self.count("stops");
            }
            self.situation.stopped(batch);
        }
        Ok(())
    }

    /// Needed ones first: nobody starts without what it needs, but for what failed to start just now.
    fn start(&mut self, wave: &Wave, failed: &mut Vec<usize>) -> Result<(), String> {
        for batch in wave {
            for slot in &batch.slots {
                if self.running[*slot] || matches!(self.own[*slot], naive::Own::Failed(_)) {
                    return Err(format!("slot {slot} is started where it runs, or has failed"));
                }
                if failed.is_empty() && naive::lacks(&self.drawn, &self.running, &self.stopping(), *slot) {
                    return Err(format!("slot {slot} is started before what it needs"));
                }
                let fails = self.dice.once_in(12);
                self.running[*slot] = !fails;
                self.situation.started(*slot, fails);
                self.events.push(if fails { Event::Failed(*slot) } else { Event::Started(*slot) });
                self.count(if fails { "starts that failed" } else { "starts" });
                failed.extend(fails.then_some(*slot));
            }
        }
        Ok(())
    }

    /// Never a stopped one that could run, never a running one that could not, no actuator in an emergency; and whoever is
    /// held has a reason that exists.
    fn judge(&mut self) -> Result<(), String> {
        let wanted = naive::runs(&self.drawn, &self.own, &self.stopping(), self.latched.is_some());
        for (slot, wanted) in wanted.into_iter().enumerate() {
            if self.running[slot] != wanted || self.situation.runs(slot) != wanted {
                return Err(format!("slot {slot} runs: {}, must: {}", self.running[slot], wanted));
            }
            let is_held = self.own[slot] == naive::Own::Wanted && !wanted;
            let reason = self.situation.held(slot);
            if reason.is_some() != is_held {
                return Err(format!("slot {slot} is held: {is_held}, but told: {reason:?}"));
            }
            if let Some(root) = reason.and_then(|reason| reason.root) {
                let exists = self.own.contains(&naive::Own::Failed(root))
                    || self.latched == Some(root)
                    || self.short_roots.contains(&Some(root));
                if !exists {
                    return Err(format!("slot {slot} is held for fault {root}, which nobody has"));
                }
            }
            if is_held {
                self.count("held");
            }
        }
        Ok(())
    }
}
