//! Taps: who listens at an output port without being a reader of it: model comparisons, voters.
//!
//! A tap is called on the writer's thread, in the writer's callback, with what has passed the port's own checks. It reads its
//! numbers first, while nothing is locked: a pointer in the value that leads nowhere is the writer's own trap. What it does
//! then touches plain numbers only. A reader with a queue was the alternative: it needs a thread that looks at it, and finds
//! late what is known now.

use std::sync::Arc;

use component_sdk::object::TypeDescriptor;
use component_sdk::object::path::{FieldPath, PathError};

use super::block::Sample;

/// Somebody who listens at an output port.
pub trait Tap: Send + Sync {
    /// Whose ear it is, in words: `model of motors.counts`.
    fn name(&self) -> &str;

    /// A value passed. Called by one thread at a time for each port, unless threads that its component started write, too;
    /// allocates nothing and waits for nobody who may be faulting.
    fn heard(&self, heard: &Heard<'_>);

    /// The writer was reset or replaced: what it writes from now on is its successor's.
    fn begins_anew(&self) {}

    /// How many values it heard at this port.
    fn count(&self) -> u64 {
        0
    }

    /// How many of the port's blocks it may hold at once.
    fn holds(&self) -> usize {
        0
    }
}

/// Those of one port.
pub type Taps = Arc<[Arc<dyn Tap>]>;

/// A value that passes.
pub struct Heard<'a> {
    pub(super) value: *const u8,
    pub(super) object: &'static TypeDescriptor,
    pub(super) at_ns: u64,
    pub(super) sample: &'a dyn Fn() -> Option<Sample>,
}

impl Heard<'_> {
    /// When it was written, in monotonic nanoseconds.
    #[must_use]
    pub const fn at_ns(&self) -> u64 {
        self.at_ns
    }

    /// The number that the probe was made for. `None`: there is none, as in a sequence that is too short, or the probe was
    /// made for another port.
    #[must_use]
    #[allow(unsafe_code, reason = "the path was compiled for the type of this port's blocks")]
    pub fn number(&self, probe: &Probe) -> Option<f64> {
        if !std::ptr::eq(self.object, probe.object) {
            return None;
        }
        // SAFETY: the line above: the path was resolved with the description of what lies there, and what a component sends is
        // a valid object; a pointer in it that is not is a trap of that component.
        unsafe { probe.path.first(self.value) }
    }

    /// Its block, which stays as it is while it is held.
    #[must_use]
    pub fn sample(&self) -> Option<Sample> {
        (self.sample)()
    }
}

/// Where a number lies in the objects of one port.
#[derive(Clone, Copy, Debug)]
pub struct Probe {
    object: &'static TypeDescriptor,
    path: FieldPath,
}

impl Probe {
    /// The number of that field: `linear.x`, `ticks[2]`. The empty path is the object itself.
    ///
    /// # Errors
    /// When the path names no number, or several.
    pub fn new(object: &'static TypeDescriptor, field: &str) -> Result<Self, PathError> {
        let path = FieldPath::resolve(object, field)?;
        if path.is_single() { Ok(Self { object, path }) } else { Err(PathError::Several) }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;

    use component_sdk::abi::payload::ReadMode;
    use component_sdk::object::CommObject;
    use component_sdk::port::Sent;
    use proptest::prelude::*;

    use super::super::check::Checks;
    use super::super::input::InPort;
    use super::super::output::{Borrower, Link, OutPort};
    use super::*;
    use crate::profile::plan::{Limit, Location, OnInvalid, Queue, Validity};

    struct Ear {
        probe: Probe,
        heard: Mutex<Vec<(f64, u64)>>,
        begun: Mutex<usize>,
        kept: Mutex<Option<Sample>>,
    }

    impl Ear {
        fn at(out: &OutPort) -> Arc<Self> {
            let probe = Probe::new(out.object, "").unwrap();
            Arc::new(Self { probe, heard: Mutex::default(), begun: Mutex::default(), kept: Mutex::default() })
        }
    }

    impl Tap for Ear {
        fn name(&self) -> &'static str {
            "ear"
        }

        fn heard(&self, heard: &Heard<'_>) {
            self.heard.lock().unwrap().push((heard.number(&self.probe).unwrap(), heard.at_ns()));
            let before = std::mem::replace(&mut *self.kept.lock().unwrap(), heard.sample());
            drop(before);
        }

        fn begins_anew(&self) {
            *self.begun.lock().unwrap() += 1;
        }

        fn holds(&self) -> usize {
            1
        }
    }

    #[allow(unsafe_code, reason = "the test plays the plugin, which writes through the pointer")]
    fn write(out: &OutPort, number: f64, borrower: Borrower) -> Sent {
        let lent = out.loan(borrower);
        // SAFETY: the block on loan is for one f64.
        unsafe { lent.value.cast::<f64>().write(number) };
        out.publish(lent.value, borrower)
    }

    fn at_most(max: f64) -> Checks {
        let (field, location) = (String::new(), Location::default());
        let (max, delay) = (Some(Limit::Constant(max)), std::time::Duration::ZERO);
        let rule = Validity { field, min: None, max, max_rate: None, delay, on_invalid: OnInvalid::Drop, location };
        Checks::compile(&[rule], f64::DESCRIPTOR).unwrap()
    }

    fn numbers(ear: &Ear) -> Vec<f64> {
        ear.heard.lock().unwrap().iter().map(|(number, _)| *number).collect()
    }

    #[test]
    fn what_passes_the_ports_own_checks_is_heard_though_nobody_reads_it() {
        let out = OutPort::new("out", f64::DESCRIPTOR, at_most(5.0));
        let ear = Ear::at(&out);
        out.listen(vec![Arc::clone(&ear) as Arc<dyn Tap>]).unwrap();
        assert_eq!(write(&out, 1.0, Borrower::Callback), Sent::Unconnected);
        assert_eq!(write(&out, 9.0, Borrower::Callback), Sent::Dropped);
        assert_eq!(write(&out, 2.0, Borrower::Other), Sent::Unconnected);
        assert_eq!(numbers(&ear), [1.0, 2.0]);
        assert!(ear.heard.lock().unwrap().is_sorted_by_key(|(_, at_ns)| *at_ns));
        let _ = crate::port::check::take_report();
    }

    #[test]
    fn who_listens_stays_when_connections_change_and_is_told_of_a_successor() {
        let out = OutPort::new("out", f64::DESCRIPTOR, Checks::default());
        let ear = Ear::at(&out);
        out.listen(vec![Arc::clone(&ear) as Arc<dyn Tap>]).unwrap();
        let reader = Arc::new(InPort::new("in", f64::DESCRIPTOR, Queue::Last, Checks::default()));
        out.change(|links| links.push(Link { target: Arc::clone(&reader), checks: Checks::none() })).unwrap();
        assert_eq!(write(&out, 1.0, Borrower::Callback), Sent::Ok);
        assert!(!reader.read(ReadMode::Newest, Borrower::Callback).value.is_null());
        out.forget_episodes();
        assert_eq!((numbers(&ear), *ear.begun.lock().unwrap()), (vec![1.0], 1));
        out.listen(Vec::new()).unwrap();
        assert_eq!(write(&out, 2.0, Borrower::Callback), Sent::Ok);
        assert_eq!(numbers(&ear), [1.0]);
        assert!(out.taps().is_none() && out.links().len() == 1);
    }

    #[test]
    fn a_probe_reads_nothing_of_a_port_that_it_was_not_made_for() {
        let number = 7u64;
        let probe = Probe::new(f64::DESCRIPTOR, "").unwrap();
        let value = (&raw const number).cast();
        let heard = Heard { value, object: u64::DESCRIPTOR, at_ns: 1, sample: &|| None };
        assert_eq!(heard.number(&probe), None);
        assert!(matches!(Probe::new(f64::DESCRIPTOR, "x"), Err(PathError::Unknown { .. })));
        assert_eq!(Probe::new(<[f64; 2]>::DESCRIPTOR, "").unwrap_err(), PathError::Several);
    }

    proptest! {
        /// A block that a tap holds is not written over, and what readers get is what they would get without it.
        #[test]
        fn a_tap_changes_nothing_for_readers(values in prop::collection::vec(-10.0..10.0f64, 1..60)) {
            let out = OutPort::new("out", f64::DESCRIPTOR, at_most(5.0));
        let ear = Ear::at(&out);
            let plain = OutPort::new("out", f64::DESCRIPTOR, at_most(5.0));
            let reader = || Arc::new(InPort::new("in", f64::DESCRIPTOR, Queue::Last, Checks::default()));
            let readers = [reader(), reader()];
            for (out, reader) in [(&out, &readers[0]), (&plain, &readers[1])] {
                out.change(|links| links.push(Link { target: Arc::clone(reader), checks: Checks::none() })).unwrap();
            }
            out.listen(vec![Arc::clone(&ear) as Arc<dyn Tap>]).unwrap();
            for value in &values {
                prop_assert_eq!(write(&out, *value, Borrower::Callback), write(&plain, *value, Borrower::Callback));
                if let Some(kept) = &*ear.kept.lock().unwrap() {
                    let heard = Heard { value: kept.value(), object: out.object, at_ns: 1, sample: &|| None };
                    prop_assert_eq!(heard.number(&ear.probe), numbers(&ear).last().copied());
                }
            }
            let valid: Vec<f64> = values.into_iter().filter(|value| *value <= 5.0).collect();
            prop_assert_eq!(numbers(&ear), valid);
            let [one, other] = readers.map(|reader| reader.counts());
            prop_assert_eq!(one, other);
            let _ = crate::port::check::take_report();
        }
    }
}
