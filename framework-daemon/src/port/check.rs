//! Checks on the values of a port or connection, compiled from `<validity>` at load: an offset load and two comparisons
//! for a range, and one word for all of them that says that all was well before. Only a value that fails this first look, or
//! follows one that did, is put to each rule by itself.
//!
//! The value lies in the memory of a component and may hold pointers that lead nowhere: while it is looked at, nothing is
//! locked and nothing is held that a trap would leak.
//!
//! What a check finds is kept for the thread until its callback returns ([`take_report`](crate::port::check::take_report)): the writer's callback runs on
//! this thread, and the writer is to blame for what it wrote. That it is over nobody has to answer: it waits in the queue of the
//! writer's slot.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

use component_sdk::object::TypeDescriptor;
use component_sdk::object::path::PathError;

use super::block::Sample;
use super::rule::{self, Found, Plain, Rule};
use crate::model::fault::{Evidence, Fault, Label, Stage};
use crate::model::symptom::Symptom;
use crate::profile::plan::{OnInvalid, Validity};
use crate::sys::seat::{self, Note};

/// The checks of one port or connection.
#[derive(Default)]
pub struct Checks {
    rules: Vec<Rule>,
    /// Those of constant bounds, side by side, for the first look.
    plain: Vec<Plain>,
    /// The places of the others in `rules`.
    others: Vec<usize>,
    /// So many rules remember a bad value.
    restless: AtomicUsize,
    /// One of them holds the last valid value.
    holds: bool,
    /// The next value begins all episodes anew. A flag, because a recovery sets it, which waits for no lock.
    anew: AtomicBool,
    /// The last value that satisfied every rule, where one of them wants it.
    last_valid: Mutex<Option<Sample>>,
}

/// A value on its way through the checks.
pub(super) struct Candidate<'a> {
    /// Where it lies; whole, as far as its writer is to be trusted.
    pub(super) value: *const u8,
    /// Its block, asked for when the value has been judged.
    pub(super) sample: &'a dyn Fn() -> Option<Sample>,
    /// Charges its writer; false: that was lost.
    pub(super) charge: &'a dyn Fn(&Fault) -> bool,
    /// Says at once of which fault its writer will hear when its callback returns: what comes of it may be quicker.
    pub(super) suspect: &'a dyn Fn(Symptom, u64),
}

/// What the reader gets.
pub enum Verdict {
    /// The value as it is.
    Pass,
    /// An earlier one.
    Instead(Sample),
    /// Nothing.
    Withhold,
}

/// What a check found.
#[derive(Clone, Copy, Debug)]
pub struct Report {
    /// `validity`, `rate` or `overload`.
    pub symptom: Symptom,
    /// Port, field, value, limit.
    pub evidence: Evidence,
}

thread_local! {
    static REPORT: Cell<Option<Report>> = const { Cell::new(None) };
}

/// The first finding since the last call.
#[must_use]
pub fn take_report() -> Option<Report> {
    if seat::take(Note::Found) { REPORT.take() } else { None }
}

/// What is found in the meantime, apart from what was found before: somebody else's.
pub(super) fn apart<R>(act: impl FnOnce() -> R) -> (R, Option<Report>) {
    let before = take_report();
    let result = act();
    let found = take_report();
    if let Some(before) = before {
        seat::leave(Note::Found);
        REPORT.set(Some(before));
    }
    (result, found)
}

/// False: there is one already. The first one of a callback is kept: what follows it may be its consequence.
fn report(symptom: Symptom, evidence: Evidence) -> bool {
    let is_first = seat::leave(Note::Found);
    if is_first {
        REPORT.set(Some(Report { symptom, evidence }));
    }
    is_first
}

/// Reports that a queue that may lose nothing lost a value.
pub(super) fn report_overload(port: &str) {
    let (port, field) = (Label::new(port), Label::EMPTY);
    report(Symptom::Overload, Evidence::Value { port, field, value: f64::NAN, limit: f64::NAN });
}

impl Checks {
    /// Compiles `validity` for objects of that type.
    ///
    /// # Errors
    /// The field that is wrong, and why.
    pub fn compile(validity: &[Validity], object: &'static TypeDescriptor) -> Result<Self, (String, PathError)> {
        let compiled = validity.iter().map(|rule| rule::compile(rule, object));
        let rules: Vec<Rule> = compiled.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect();
        let holds = rules.iter().any(|rule| rule.on_invalid == OnInvalid::Hold);
        let plain = rules.iter().filter_map(Rule::plain).collect();
        let others = (0..rules.len()).filter(|place| rules[*place].plain().is_none()).collect();
        Ok(Self { rules, plain, others, holds, ..Self::default() })
    }

    /// Those of a connection without any: one for all.
    #[must_use]
    pub fn none() -> Arc<Self> {
        static NONE: LazyLock<Arc<Checks>> = LazyLock::new(Arc::default);
        Arc::clone(&NONE)
    }

    /// True when nothing is checked.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.rules.is_empty()
    }

    /// True when both ask the same.
    #[must_use]
    pub fn same_rules(&self, other: &Self) -> bool {
        self.rules.len() == other.rules.len()
            && self.rules.iter().zip(&other.rules).all(|(one, other)| one.is_same(other))
    }

    /// Begins anew: the writer was reset or replaced, and what its successor writes wrongly is another fault.
    pub fn forget_episodes(&self) {
        if !self.is_empty() {
            self.anew.store(true, Ordering::Release);
        }
    }

    /// Judges a value that lies in its block, whose writer nobody charges.
    #[must_use]
    pub fn judge_block(&self, port: &str, sample: &Sample, now_ns: u64) -> Verdict {
        let (share, charge) = (|| Some(Arc::clone(sample)), |_: &Fault| true);
        self.judge(
            port,
            &Candidate { value: sample.value(), sample: &share, charge: &charge, suspect: &|_, _| {} },
            now_ns,
        )
    }

    /// Judges one value: dropping it weighs more than holding an earlier one, and that more than passing it.
    #[inline]
    #[allow(unsafe_code, reason = "the rules were compiled for the type of this port's blocks")]
    pub(super) fn judge(&self, port: &str, candidate: &Candidate<'_>, now_ns: u64) -> Verdict {
        if self.anew.load(Ordering::Relaxed) && self.anew.swap(false, Ordering::AcqRel) {
            self.rules.iter().for_each(|rule| rule.begin_anew(&self.restless));
        }
        // SAFETY: `compile` resolved the fields with the descriptor of this port, connections join equal layouts only, and what a
        // component sends is a valid object; a pointer in it that is not is a trap of that component.
        let mut plain = self.plain.iter().map(|rule| unsafe { rule.holds(candidate.value) });
        let worst = if self.restless.load(Ordering::Relaxed) == 0 && plain.all(|holds| holds) {
            self.worst(self.others.iter().map(|place| &self.rules[*place]), port, candidate, now_ns)
        } else {
            self.worst(self.rules.iter(), port, candidate, now_ns)
        };
        match worst {
            None if self.holds => self.keep((candidate.sample)()),
            None | Some(PASS) => Verdict::Pass,
            Some(HOLD) => lock(&self.last_valid).clone().map_or(Verdict::Withhold, Verdict::Instead),
            Some(_) => Verdict::Withhold,
        }
    }

    /// Puts a value to these rules: what the gravest of those that it breaks asks for.
    #[inline]
    #[allow(unsafe_code, reason = "as `judge`")]
    fn worst<'a>(
        &self,
        rules: impl Iterator<Item = &'a Rule>,
        port: &str,
        candidate: &Candidate<'_>,
        now_ns: u64,
    ) -> Option<u8> {
        let mut worst = None;
        for rule in rules {
            // SAFETY: as in `judge`.
            let found = unsafe { rule.find(candidate.value, now_ns) };
            if found.is_none() && rule.is_calm() {
                continue;
            }
            note(rule, port, found.as_ref(), candidate, now_ns, &self.restless);
            if found.is_some() {
                worst = worst.max(Some(weight(rule.on_invalid)));
            }
        }
        worst
    }

    fn keep(&self, valid: Option<Sample>) -> Verdict {
        let before = std::mem::replace(&mut *lock(&self.last_valid), valid);
        // Outside the lock: the last holder of an object frees the memory of a plugin.
        drop(before);
        Verdict::Pass
    }
}

const PASS: u8 = 0;
const HOLD: u8 = 1;

const fn weight(on_invalid: OnInvalid) -> u8 {
    match on_invalid {
        OnInvalid::Pass => PASS,
        OnInvalid::Hold => HOLD,
        OnInvalid::Drop => 2,
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A bad value, or one that ends a time of bad ones.
#[cold]
fn note(
    rule: &Rule,
    port: &str,
    found: Option<&Found>,
    candidate: &Candidate<'_>,
    now_ns: u64,
    restless: &AtomicUsize,
) {
    rule.note(found.is_some(), now_ns, restless, |stage| {
        let evidence = evidence(rule, port, found);
        match stage {
            Stage::Confirmed => {
                (candidate.suspect)(rule.symptom(), now_ns);
                report(rule.symptom(), evidence)
            }
            stage => (candidate.charge)(&Fault { stage, ..Fault::told(rule.symptom(), now_ns, evidence) }),
        }
    });
}

/// Of a value that breaks the rule, or of one that keeps it again.
fn evidence(rule: &Rule, port: &str, found: Option<&Found>) -> Evidence {
    let field = match found.filter(|_| !rule.is_single()) {
        None => Label::new(&rule.field),
        Some(found) => Label::of(format_args!("{}[{}]", rule.field, found.place)),
    };
    let (value, limit) = found.map_or((f64::NAN, f64::NAN), |found| (found.value, found.limit));
    Evidence::Value { port: Label::new(port), field, value, limit }
}

#[cfg(test)]
mod tests {
    use component_sdk::object::CommObject;

    use super::super::block::Block;
    use super::*;
    use crate::profile::plan::{Limit, Location};

    fn rule(max: f64, on_invalid: OnInvalid) -> Validity {
        let (field, location) = (String::new(), Location::default());
        let max = Some(Limit::Constant(max));
        Validity { field, min: None, max, max_rate: None, delay: std::time::Duration::ZERO, on_invalid, location }
    }

    fn judged(checks: &Checks, sample: &Sample, now_ns: u64) -> Verdict {
        checks.judge_block("p", sample, now_ns)
    }

    #[allow(unsafe_code, reason = "the test plays the plugin, which fills blocks")]
    fn sample(value: f64) -> Sample {
        let block = Block::new(f64::DESCRIPTOR);
        // SAFETY: the block is for one f64.
        unsafe { block.value().cast::<f64>().write(value) };
        block.fill(1);
        Arc::new(block)
    }

    #[test]
    fn what_one_rule_drops_no_other_rule_holds() {
        let rules = [rule(5.0, OnInvalid::Drop), rule(3.0, OnInvalid::Hold)];
        let checks = Checks::compile(&rules, f64::DESCRIPTOR).unwrap();
        let good = sample(1.0);
        assert!(matches!(judged(&checks, &good, 1), Verdict::Pass));
        assert!(matches!(judged(&checks, &sample(9.0), 2), Verdict::Withhold));
        match judged(&checks, &sample(4.0), 3) {
            Verdict::Instead(held) => assert!(Arc::ptr_eq(&held, &good)),
            _ => panic!("the last good value is held"),
        }
        let _ = take_report();
    }

    /// What was told of, and whether the value passed.
    fn run(checks: &Checks, values: &[(u64, f64)]) -> Vec<(bool, Option<(Symptom, Stage)>)> {
        let told = Cell::new(None);
        let tell = |fault: &Fault| {
            told.set(Some((fault.symptom, fault.stage)));
            true
        };
        let judge = |(now_ns, value): &(u64, f64)| {
            let sample = sample(*value);
            let share = || Some(Arc::clone(&sample));
            let candidate = Candidate { value: sample.value(), sample: &share, charge: &tell, suspect: &|_, _| {} };
            let passed = !matches!(checks.judge("p", &candidate, *now_ns), Verdict::Withhold);
            let found = take_report().map(|report| (report.symptom, Stage::Confirmed));
            (passed, found.or(told.take()))
        };
        values.iter().map(judge).collect()
    }

    #[test]
    fn a_time_of_bad_values_is_told_of_when_it_is_certain_and_when_it_is_over() {
        let delayed = Validity { delay: std::time::Duration::from_nanos(50), ..rule(5.0, OnInvalid::Drop) };
        let checks = Checks::compile(&[delayed], f64::DESCRIPTOR).unwrap();
        let told = run(
            &checks,
            &[(10, 9.0), (40, 1.0), (50, 9.0), (100, 9.0), (110, 9.0), (120, 1.0), (150, 9.0), (160, 1.0), (210, 1.0)],
        );
        let stage = |stage| Some((Symptom::Validity, stage));
        let stages: Vec<_> = told.iter().map(|(_, told)| *told).collect();
        assert_eq!(stages[..4], [None, None, None, stage(Stage::Confirmed)]);
        assert_eq!(stages[4..], [None, stage(Stage::Healed), None, None, stage(Stage::Cleared)]);
        let passed: Vec<_> = told.iter().map(|(passed, _)| *passed).collect();
        assert_eq!(passed, [false, true, false, false, false, true, false, true, true]);
    }

    #[test]
    fn the_first_value_and_the_first_of_a_successor_have_no_rate() {
        let rate = Validity { max: None, max_rate: Some(2.0), ..rule(0.0, OnInvalid::Drop) };
        let checks = Checks::compile(&[rate], f64::DESCRIPTOR).unwrap();
        let second = 1_000_000_000;
        let told = run(&checks, &[(second, 100.0), (2 * second, 101.5), (3 * second, 104.0), (4 * second, 105.0)]);
        let too_fast = Some((Symptom::Rate, Stage::Confirmed));
        assert_eq!(told, [(true, None), (true, None), (false, too_fast), (true, Some((Symptom::Rate, Stage::Healed)))]);
        checks.forget_episodes();
        assert_eq!(run(&checks, &[(5 * second, 0.0), (6 * second, f64::NAN), (7 * second, 50.0)]), [(true, None); 3]);
    }

    #[allow(unsafe_code, reason = "as above")]
    fn filled<T: CommObject + Copy>(value: T) -> Sample {
        let block = Block::new(T::DESCRIPTOR);
        // SAFETY: the block is for one T.
        unsafe { block.value().cast::<T>().write(value) };
        block.fill(1);
        Arc::new(block)
    }

    #[test]
    fn a_limit_may_be_a_line_over_another_field_and_each_element_is_held_to_it() {
        // The first may be at most twice the second plus one.
        let line = Limit::Linear { slope: 2.0, of: "[1]".into(), offset: 1.0 };
        let field =
            |field: &str| Validity { field: field.into(), max: Some(line.clone()), ..rule(0.0, OnInvalid::Drop) };
        let passes = |field: Validity, value: [f64; 3]| {
            let checks = Checks::compile(&[field], <[f64; 3]>::DESCRIPTOR).unwrap();
            let passes = matches!(judged(&checks, &filled(value), 1), Verdict::Pass);
            (passes, take_report().map(|report| report.evidence))
        };
        assert!(passes(field("[0]"), [7.0, 3.0, 99.0]).0);
        assert!(!passes(field("[0]"), [7.1, 3.0, 0.0]).0);
        assert!(!passes(field("[0]"), [0.0, f64::NAN, 0.0]).0, "a limit that is no number is kept by nothing");
        match passes(field(""), [7.0, 3.0, 7.5]) {
            (false, Some(Evidence::Value { field, value, limit, .. })) => {
                assert_eq!((field.as_str(), value, limit), ("[2]", 7.5, 7.0));
            }
            other => panic!("{other:?}"),
        }
        let over_all = Limit::Linear { slope: 1.0, of: String::new(), offset: 0.0 };
        let several = Validity { max: Some(over_all), ..rule(0.0, OnInvalid::Drop) };
        assert!(Checks::compile(&[several], <[f64; 3]>::DESCRIPTOR).is_err());
    }

    #[test]
    fn the_rate_of_each_element_is_its_own() {
        let rate = Validity { max: None, max_rate: Some(2.0), ..rule(0.0, OnInvalid::Drop) };
        let checks = Checks::compile(&[rate], <[f64; 3]>::DESCRIPTOR).unwrap();
        for (at, value, expected) in
            [(1, [0.0, 10.0, 0.0], None), (2, [1.0, 9.0, 1.0], None), (3, [1.0, 9.0, 4.0], Some("[2]"))]
        {
            let _ = judged(&checks, &filled(value), at * 1_000_000_000);
            let field = take_report().map(|report| report.evidence.text().to_owned());
            assert_eq!(field.as_deref(), expected);
        }
    }
}
