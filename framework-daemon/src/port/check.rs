//! Range checks on the values of a port or connection, compiled from `<validity>` at load: an offset load and two
//! comparisons each.
//!
//! The value lies in the memory of a component and may hold pointers that lead nowhere: while it is looked at, nothing is
//! locked and nothing is held that a trap would leak.
//!
//! What a check finds is kept for the thread until its callback returns ([`take_report`](crate::port::check::take_report)): the writer's callback runs on
//! this thread, and the writer is to blame for what it wrote.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

use component_sdk::object::TypeDescriptor;
use component_sdk::object::path::{FieldPath, PathError};

use super::block::Sample;
use crate::detect::range::{Bounds, Episode};
use crate::model::fault::{Evidence, Label};
use crate::model::symptom::Symptom;
use crate::model::time::nanoseconds;
use crate::profile::plan::{Limit, OnInvalid, Validity};
use crate::sys::seat::{self, Note};

/// The checks of one port or connection.
#[derive(Default)]
pub struct Checks {
    rules: Vec<Check>,
    /// The next value begins all episodes anew. A flag, because a recovery sets it, which waits for no lock.
    anew: AtomicBool,
    /// The last value that satisfied every rule, where one of them wants it.
    last_valid: Mutex<Option<Sample>>,
}

struct Check {
    field: String,
    path: FieldPath,
    bounds: Bounds,
    delay_ns: u64,
    on_invalid: OnInvalid,
    episode: Mutex<Episode>,
}

/// A value on its way through the checks.
pub(super) struct Candidate<'a> {
    /// Where it lies; whole, as far as its writer is to be trusted.
    pub(super) value: *const u8,
    /// Its block, asked for when the value has been judged.
    pub(super) sample: &'a dyn Fn() -> Option<Sample>,
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
    /// `validity` or `overload`.
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

fn report(symptom: Symptom, port: &str, field: &str, value: f64, limit: f64) {
    // The first one of a callback is kept: what follows it may be its consequence.
    if !seat::leave(Note::Found) {
        return;
    }
    let evidence = Evidence::Value { port: Label::new(port), field: Label::new(field), value, limit };
    REPORT.set(Some(Report { symptom, evidence }));
}

/// Reports that a queue that may lose nothing lost a value.
pub(super) fn report_overload(port: &str) {
    report(Symptom::Overload, port, "", f64::NAN, f64::NAN);
}

impl Checks {
    /// Compiles the constant bounds of `validity` for objects of that type.
    ///
    /// # Errors
    /// The field that is wrong, and why.
    pub fn compile(validity: &[Validity], object: &'static TypeDescriptor) -> Result<Self, (String, PathError)> {
        let compiled = validity.iter().map(|rule| {
            let path = FieldPath::resolve(object, &rule.field).map_err(|error| (rule.field.clone(), error))?;
            let constant = |limit: &Option<Limit>, open| match limit {
                Some(Limit::Constant(bound)) => *bound,
                _ => open,
            };
            Ok(Check {
                field: rule.field.clone(),
                path,
                bounds: Bounds { min: constant(&rule.min, f64::NEG_INFINITY), max: constant(&rule.max, f64::INFINITY) },
                delay_ns: nanoseconds(rule.delay),
                on_invalid: rule.on_invalid,
                episode: Mutex::default(),
            })
        });
        let rules = compiled.collect::<Result<_, (String, PathError)>>()?;
        Ok(Self { rules, ..Self::default() })
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
        let key = |check: &Check| (check.path, check.bounds, check.delay_ns, check.on_invalid);
        self.rules.iter().map(key).eq(other.rules.iter().map(key))
    }

    /// Begins anew: the writer was reset or replaced, and what its successor writes wrongly is another fault.
    pub fn forget_episodes(&self) {
        if !self.is_empty() {
            self.anew.store(true, Ordering::Release);
        }
    }

    /// Judges one value: dropping it weighs more than holding an earlier one, and that more than passing it.
    pub(super) fn judge(&self, port: &str, candidate: &Candidate<'_>, now_ns: u64) -> Verdict {
        if self.anew.load(Ordering::Relaxed) && self.anew.swap(false, Ordering::AcqRel) {
            self.rules.iter().for_each(|check| *lock(&check.episode) = Episode::default());
        }
        let broken = self.rules.iter().filter_map(|check| check.judge(port, candidate.value, now_ns));
        let worst = broken.reduce(|one, other| if weight(one) >= weight(other) { one } else { other });
        match worst {
            None if self.rules.iter().any(|check| check.on_invalid == OnInvalid::Hold) => {
                let valid = (candidate.sample)();
                let before = std::mem::replace(&mut *lock(&self.last_valid), valid);
                drop(before);
                Verdict::Pass
            }
            None | Some(OnInvalid::Pass) => Verdict::Pass,
            Some(OnInvalid::Hold) => lock(&self.last_valid).clone().map_or(Verdict::Withhold, Verdict::Instead),
            Some(OnInvalid::Drop) => Verdict::Withhold,
        }
    }
}

const fn weight(on_invalid: OnInvalid) -> u8 {
    match on_invalid {
        OnInvalid::Pass => 0,
        OnInvalid::Hold => 1,
        OnInvalid::Drop => 2,
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Check {
    /// What the rule wants when the value breaks it.
    fn judge(&self, port: &str, value: *const u8, now_ns: u64) -> Option<OnInvalid> {
        let crossed = self.crossed(value);
        let due = lock(&self.episode).note(crossed.is_some(), now_ns, self.delay_ns);
        let (value, limit) = crossed?;
        if due {
            report(Symptom::Validity, port, &self.field, value, limit);
        }
        Some(self.on_invalid)
    }

    /// The first number that crosses a bound, and that bound.
    #[allow(unsafe_code, reason = "the path was compiled for the type of this port's blocks")]
    fn crossed(&self, value: *const u8) -> Option<(f64, f64)> {
        let mut found = None;
        let mut within = |number: f64| {
            found = self.bounds.crossed(number).map(|limit| (number, limit));
            found.is_none()
        };
        // SAFETY: `compile` resolved the path with the descriptor of this port, connections join equal layouts only,
        // and what a component sends is a valid object; a pointer in it that is not is a trap of that component.
        unsafe { self.path.all(value, &mut within) };
        found
    }
}

#[cfg(test)]
mod tests {
    use component_sdk::object::CommObject;

    use super::super::block::Block;
    use super::*;
    use crate::profile::plan::Location;

    fn rule(max: f64, on_invalid: OnInvalid) -> Validity {
        let (field, location) = (String::new(), Location::default());
        let max = Some(Limit::Constant(max));
        Validity { field, min: None, max, max_rate: None, delay: std::time::Duration::ZERO, on_invalid, location }
    }

    fn judged(checks: &Checks, sample: &Sample, now_ns: u64) -> Verdict {
        let candidate = Candidate { value: sample.value(), sample: &|| Some(Arc::clone(sample)) };
        checks.judge("p", &candidate, now_ns)
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
}
