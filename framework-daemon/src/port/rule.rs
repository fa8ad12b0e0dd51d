//! One compiled rule of a `<validity>`: where the numbers lie, what holds of them, and what it remembers.
//!
//! What it remembers are plain words, written by whichever thread writes the value: no lock. Two threads that write at the
//! same moment may each take the other's value for the one before; neither tells of the same stage twice.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};

use component_sdk::object::TypeDescriptor;
use component_sdk::object::path::{FieldPath, PathError};

use crate::detect::episode::Episode;
use crate::detect::range::{Bounds, Linear};
use crate::detect::rate;
use crate::model::fault::Stage;
use crate::model::limits::RATE_ELEMENTS;
use crate::model::symptom::Symptom;
use crate::model::time::nanoseconds;
use crate::profile::plan::{Limit, OnInvalid, Validity};

/// A rule.
pub(super) struct Rule {
    /// As the profile names it.
    pub(super) field: String,
    /// What the reader gets instead of a value that breaks it.
    pub(super) on_invalid: OnInvalid,
    path: FieldPath,
    test: Test,
    delay_ns: u64,
    /// An [`Episode`].
    episode: AtomicU64,
}

/// A rule with constant bounds for a number that lies in place, as it is looked at first: an offset load and two comparisons.
pub(super) struct Plain {
    path: FieldPath,
    bounds: Bounds,
}

/// What holds of a number.
enum Test {
    /// Constant bounds.
    Constant(Bounds),
    /// Bounds of which one depends on another field.
    Linear(Edge, Edge),
    /// Largest change per second.
    Rate(Rates),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Edge {
    Constant(f64),
    Linear(Linear, FieldPath),
}

/// The value before.
struct Rates {
    max: f64,
    at_ns: AtomicU64,
    /// So many of `last` are known.
    known: AtomicUsize,
    last: Box<[AtomicU64]>,
}

/// A number that breaks a rule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Found {
    /// Which of several.
    pub(super) place: usize,
    /// The number, or its change per second.
    pub(super) value: f64,
    /// What it may be at most, or at least.
    pub(super) limit: f64,
}

/// All rules of one `<validity>`: its bounds, its rate.
pub(super) fn compile(validity: &Validity, object: &'static TypeDescriptor) -> Result<Vec<Rule>, (String, PathError)> {
    let resolve = |field: &str| FieldPath::resolve(object, field).map_err(|error| (field.to_owned(), error));
    let path = resolve(&validity.field)?;
    let edge = |limit: &Option<Limit>, open: f64| match limit {
        None => Ok(Edge::Constant(open)),
        Some(Limit::Constant(bound)) => Ok(Edge::Constant(*bound)),
        Some(Limit::Linear { slope, of, offset }) => match resolve(of)? {
            on if on.is_single() => Ok(Edge::Linear(Linear { slope: *slope, offset: *offset }, on)),
            // It would not be known which of them.
            _ => Err((of.clone(), PathError::Several)),
        },
    };
    let (min, max) = (edge(&validity.min, f64::NEG_INFINITY)?, edge(&validity.max, f64::INFINITY)?);
    let bounds = match (min, max) {
        (Edge::Constant(min), Edge::Constant(max)) => Test::Constant(Bounds { min, max }),
        (min, max) => Test::Linear(min, max),
    };
    let has_bounds = validity.min.is_some() || validity.max.is_some();
    let rate = validity.max_rate.map(|max| Test::Rate(Rates::new(max, path.count().unwrap_or(RATE_ELEMENTS))));
    let rule = |test| Rule {
        field: validity.field.clone(),
        on_invalid: validity.on_invalid,
        path,
        test,
        delay_ns: nanoseconds(validity.delay),
        episode: AtomicU64::new(0),
    };
    Ok(has_bounds.then_some(bounds).into_iter().chain(rate).map(rule).collect())
}

impl Rule {
    /// What it finds.
    pub(super) const fn symptom(&self) -> Symptom {
        match self.test {
            Test::Rate(_) => Symptom::Rate,
            _ => Symptom::Validity,
        }
    }

    /// True where it names one number.
    pub(super) const fn is_single(&self) -> bool {
        self.path.is_single()
    }

    /// True when both ask the same.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        let same_test = match (&self.test, &other.test) {
            (Test::Constant(one), Test::Constant(two)) => one == two,
            (Test::Linear(min, max), Test::Linear(least, most)) => (min, max) == (least, most),
            (Test::Rate(one), Test::Rate(two)) => one.max == two.max,
            _ => false,
        };
        let key = |rule: &Self| (rule.path, rule.delay_ns, rule.on_invalid);
        same_test && key(self) == key(other)
    }

    /// The rule as it is looked at first, where that is all of it.
    pub(super) const fn plain(&self) -> Option<Plain> {
        match self.test {
            Test::Constant(bounds) if self.path.is_in_place() => Some(Plain { path: self.path, bounds }),
            _ => None,
        }
    }

    /// What comes next is another writer's.
    pub(super) fn begin_anew(&self, restless: &AtomicUsize) {
        self.put(0, restless);
        if let Test::Rate(rates) = &self.test {
            rates.known.store(0, Relaxed);
        }
    }

    /// True where no bad value is remembered.
    #[inline]
    pub(super) fn is_calm(&self) -> bool {
        self.episode.load(Relaxed) == 0
    }

    /// The first number of the object that breaks the rule.
    ///
    /// # Safety
    /// `object` points to a valid object of the description that the rule was compiled for.
    #[inline]
    #[allow(unsafe_code, reason = "the path was compiled for the type of this port's blocks")]
    pub(super) unsafe fn find(&self, object: *const u8, now_ns: u64) -> Option<Found> {
        match &self.test {
            // SAFETY: by contract.
            Test::Constant(bounds) => unsafe { self.outside(object, bounds) },
            // SAFETY: by contract.
            Test::Linear(min, max) => unsafe {
                let bounds = Bounds { min: min.at(object), max: max.at(object) };
                self.outside(object, &bounds)
            },
            // SAFETY: by contract.
            Test::Rate(rates) => unsafe { self.too_fast(object, rates, now_ns) },
        }
    }

    /// # Safety
    /// As [`Self::find`].
    #[inline]
    #[allow(unsafe_code, reason = "as `find`")]
    unsafe fn outside(&self, object: *const u8, bounds: &Bounds) -> Option<Found> {
        let (mut found, mut place) = (None, 0);
        let mut within = |value: f64| {
            found = bounds.crossed(value).map(|limit| Found { place, value, limit });
            place += 1;
            found.is_none()
        };
        // SAFETY: by contract.
        unsafe { self.path.all(object, &mut within) };
        found
    }

    /// # Safety
    /// As [`Self::find`].
    #[allow(unsafe_code, reason = "as `find`")]
    unsafe fn too_fast(&self, object: *const u8, rates: &Rates, now_ns: u64) -> Option<Found> {
        let elapsed_ns = now_ns.saturating_sub(rates.at_ns.swap(now_ns, Relaxed));
        let known = rates.known.load(Relaxed);
        let (mut found, mut place) = (None, 0);
        // All of them, whatever is found: each is the one before the next.
        let mut note = |value: f64| {
            let Some(last) = rates.last.get(place) else { return false };
            let before = f64::from_bits(last.load(Relaxed));
            last.store(value.to_bits(), Relaxed);
            if found.is_none() && place < known {
                let rate = rate::per_second(before, value, elapsed_ns).filter(|rate| *rate > rates.max);
                found = rate.map(|value| Found { place, value, limit: rates.max });
            }
            place += 1;
            true
        };
        // SAFETY: by contract.
        unsafe { self.path.all(object, &mut note) };
        rates.known.store(place, Relaxed);
        found
    }

    /// Takes note of a value; what is to be told, if `tell` takes it. One that is not taken is asked again with the next value.
    pub(super) fn note(&self, is_bad: bool, now_ns: u64, restless: &AtomicUsize, tell: impl FnOnce(Stage) -> bool) {
        let before = self.episode.load(Relaxed);
        let (after, stage) = Episode::from_word(before).after(is_bad, now_ns, self.delay_ns);
        let after = after.to_word();
        let Some(stage) = stage else { return self.put(after, restless) };
        // Whoever else writes at the same moment has told of it.
        if self.episode.compare_exchange(before, after, Relaxed, Relaxed).is_ok() {
            count(before, after, restless);
            if !tell(stage) {
                self.put(before, restless);
            }
        }
    }

    /// The episode goes on as `word`.
    fn put(&self, word: u64, restless: &AtomicUsize) {
        count(self.episode.swap(word, Relaxed), word, restless);
    }
}

impl Plain {
    /// True when the number keeps the rule.
    ///
    /// # Safety
    /// As [`Rule::find`].
    #[inline]
    #[allow(unsafe_code, reason = "as `find`")]
    pub(super) unsafe fn holds(&self, object: *const u8) -> bool {
        // SAFETY: by contract; it lies in place.
        self.bounds.hold(unsafe { self.path.in_place(object) })
    }
}

/// Counts the rules that remember a bad value: of each word that took the place of another, so that it is exact whoever writes.
fn count(before: u64, after: u64, restless: &AtomicUsize) {
    match (before, after) {
        (0, 0) => {}
        (0, _) => drop(restless.fetch_add(1, Relaxed)),
        (_, 0) => drop(restless.fetch_sub(1, Relaxed)),
        _ => {}
    }
}

impl Edge {
    /// # Safety
    /// As [`Rule::find`].
    #[allow(unsafe_code, reason = "as `find`")]
    unsafe fn at(&self, object: *const u8) -> f64 {
        match self {
            Self::Constant(bound) => *bound,
            // SAFETY: by contract; a sequence that is too short gives no limit that anything keeps.
            Self::Linear(line, of) => line.at(unsafe { of.first(object) }.unwrap_or(f64::NAN)),
        }
    }
}

impl Rates {
    fn new(max: f64, places: usize) -> Self {
        let last = (0..places).map(|_| AtomicU64::new(0)).collect();
        Self { max, at_ns: AtomicU64::new(0), known: AtomicUsize::new(0), last }
    }
}
