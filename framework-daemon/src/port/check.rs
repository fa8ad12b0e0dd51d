//! Range checks on the values of a port or connection, compiled from `<validity>` at load: an offset load and two
//! comparisons each.
//!
//! What a check finds is kept for the thread until its callback returns ([`take_report`](crate::port::check::take_report)): the writer's callback runs on
//! this thread, and the writer is to blame for what it wrote.

use std::cell::Cell;
use std::sync::{Arc, Mutex, PoisonError};

use component_sdk::object::TypeDescriptor;
use component_sdk::object::path::{FieldPath, PathError};

use super::block::Sample;
use crate::detect::range::{Bounds, Episode};
use crate::model::fault::{Evidence, ShortText};
use crate::model::symptom::Symptom;
use crate::profile::plan::{Limit, OnInvalid, Validity};

/// The checks of one port or connection.
#[derive(Default)]
pub struct Checks(Vec<Check>);

struct Check {
    field: String,
    path: FieldPath,
    bounds: Bounds,
    delay_ns: u64,
    on_invalid: OnInvalid,
    memory: Mutex<Memory>,
}

#[derive(Default)]
struct Memory {
    episode: Episode,
    last_valid: Option<Sample>,
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
    static FOUND: Cell<bool> = const { Cell::new(false) };
    static REPORT: Cell<Option<Report>> = const { Cell::new(None) };
}

/// The first finding since the last call.
#[must_use]
pub fn take_report() -> Option<Report> {
    if FOUND.replace(false) { REPORT.take() } else { None }
}

fn report(symptom: Symptom, port: &str, field: &str, value: f64, limit: f64) {
    // The first one of a callback is kept: what follows it may be its consequence.
    if FOUND.replace(true) {
        return;
    }
    let evidence = Evidence::Value { port: ShortText::new(port), field: ShortText::new(field), value, limit };
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
                delay_ns: u64::try_from(rule.delay.as_nanos()).unwrap_or(u64::MAX),
                on_invalid: rule.on_invalid,
                memory: Mutex::default(),
            })
        });
        compiled.collect::<Result<_, _>>().map(Self)
    }

    /// Judges one value.
    pub(super) fn judge(&self, port: &str, sample: &Sample, now_ns: u64) -> Verdict {
        let mut verdict = Verdict::Pass;
        for check in &self.0 {
            match check.judge(port, sample, now_ns) {
                Verdict::Pass => {}
                other => verdict = other,
            }
        }
        verdict
    }
}

impl Check {
    fn judge(&self, port: &str, sample: &Sample, now_ns: u64) -> Verdict {
        let crossed = self.crossed(sample);
        let mut memory = self.memory.lock().unwrap_or_else(PoisonError::into_inner);
        let due = memory.episode.note(crossed.is_some(), now_ns, self.delay_ns);
        let Some((value, limit)) = crossed else {
            if self.on_invalid == OnInvalid::Hold {
                memory.last_valid = Some(Arc::clone(sample));
            }
            return Verdict::Pass;
        };
        if due {
            report(Symptom::Validity, port, &self.field, value, limit);
        }
        match self.on_invalid {
            OnInvalid::Pass => Verdict::Pass,
            OnInvalid::Drop => Verdict::Withhold,
            OnInvalid::Hold => memory.last_valid.clone().map_or(Verdict::Withhold, Verdict::Instead),
        }
    }

    /// The first number that crosses a bound, and that bound.
    #[allow(unsafe_code, reason = "the path was compiled for the type of this port's blocks")]
    fn crossed(&self, sample: &Sample) -> Option<(f64, f64)> {
        let mut found = None;
        let mut within = |number: f64| {
            found = self.bounds.crossed(number).map(|limit| (number, limit));
            found.is_none()
        };
        // SAFETY: `compile` resolved the path with the descriptor of this port, connections join equal layouts only,
        // and a published block holds a valid object.
        unsafe { self.path.all(sample.value(), &mut within) };
        found
    }
}
