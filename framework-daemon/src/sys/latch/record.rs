//! What the file of the latch says: one JSON object, padded to whole blocks, so that it can be written over in place.
//!
//! Whether it is latched comes first and has one length either way: the thread that raises it writes these few bytes, which
//! takes neither allocation nor a new block of the disk. Whatever cannot be read as "not latched" is latched: a robot that
//! stands for nothing is a nuisance, one that drives by mistake is a danger.

use std::fmt;
use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

/// The front of a file that says that it is latched.
pub(super) const LATCHED: &[u8; 17] = b"{\"latched\":true ,";

/// The front of one that says that it is not.
const FREE: &[u8; 17] = b"{\"latched\":false,";

/// What is written is a multiple of this.
const BLOCK: usize = 4096;

/// More than a cause takes, which comes later; and the same again for a later one.
const SPARE: usize = 1024;

/// What the emergency stop was raised for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cause {
    /// Whose fault.
    pub slot: String,
    /// Its symptom.
    pub symptom: String,
    /// Its number in the journal.
    pub fault: u64,
    /// Seconds since 1970.
    pub wall: f64,
}

/// What it was raised for while it was latched already.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Again {
    /// How often.
    pub times: u64,
    /// The newest.
    pub last: Cause,
}

impl fmt::Display for Again {
    /// `raised again for vote of sonars (fault 14, 3 s ago)`.
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.times {
            1 => write!(to, "raised again for {}", self.last),
            times => write!(to, "raised {times} times again, the last time for {}", self.last),
        }
    }
}

impl fmt::Display for Cause {
    /// `crash.segv of sensor (fault 12, 9 h ago)`.
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64();
        write!(to, "{} of {} (fault {}, {})", self.symptom, self.slot, self.fault, ago(now - self.wall))
    }
}

/// How long ago that was, in seconds; a clock that was set back makes it just now.
fn ago(seconds: f64) -> String {
    match seconds.max(0.0) {
        seconds if seconds < 120.0 => format!("{seconds:.0} s ago"),
        seconds if seconds < 7200.0 => format!("{:.0} min ago", seconds / 60.0),
        seconds if seconds < 172_800.0 => format!("{:.0} h ago", seconds / 3600.0),
        seconds => format!("{:.0} days ago", seconds / 86_400.0),
    }
}

/// What the file says but for whether it is latched.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// How it is taken back, for whoever finds the file.
    #[serde(default)]
    pub clear: String,
    /// The profile directory of the run.
    #[serde(default)]
    pub profiles: String,
    /// Slots that get the emergency stop.
    #[serde(default)]
    pub actuators: Vec<String>,
    /// Their classes, in the same order: whoever bears another name by the next run is known by that.
    #[serde(default)]
    pub classes: Vec<String>,
    /// What it was raised for; `None`: it was not, or nobody had written it down yet.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cause: Option<Cause>,
    /// And after that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub again: Option<Again>,
}

impl Record {
    /// Of a run of that profile directory.
    #[must_use]
    pub fn new(profiles: String, actuators: Vec<String>) -> Self {
        Self {
            clear: "framework-daemon fault clear".to_owned(),
            profiles,
            actuators,
            classes: Vec::new(),
            cause: None,
            again: None,
        }
    }

    /// With the classes of its actuators, in their order.
    #[must_use]
    pub fn of_classes(self, classes: Vec<String>) -> Self {
        Self { classes, ..self }
    }

    /// It was raised for this.
    pub(super) fn raised_for(&mut self, cause: Cause) {
        if self.cause.is_none() {
            self.cause = Some(cause);
            return;
        }
        let times = self.again.as_ref().map_or(0, |again| again.times) + 1;
        self.again = Some(Again { times, last: cause });
    }
}

/// The bytes of a file that says this.
pub(super) fn encode(record: &Record, latched: bool) -> Vec<u8> {
    let mut bytes = if latched { LATCHED } else { FREE }.to_vec();
    // Names and numbers: it cannot fail; if it did, the file would not be readable, which is latched.
    let body = serde_json::to_vec(record).unwrap_or_default();
    bytes.extend(body.iter().skip(1));
    let spare = match (&record.cause, &record.again) {
        (_, Some(_)) => 1,
        (Some(_), None) => SPARE,
        (None, None) => 2 * SPARE,
    };
    bytes.resize((bytes.len() + spare).next_multiple_of(BLOCK) - 1, b' ');
    bytes.push(b'\n');
    bytes
}

/// What a file says, and whether it is latched.
pub(super) fn decode(bytes: &[u8]) -> Result<(Record, bool), String> {
    #[derive(Deserialize)]
    struct Whole {
        latched: bool,
        #[serde(flatten)]
        record: Record,
    }
    let whole: Whole = serde_json::from_slice(bytes).map_err(|_| match bytes {
        [] => "it is empty".to_owned(),
        _ => "it is damaged".to_owned(),
    })?;
    Ok((whole.record, whole.latched))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn record() -> impl Strategy<Value = Record> {
        let cause = (".{0,20}", "[a-z.]{1,20}", any::<u64>(), any::<u32>())
            .prop_map(|(slot, symptom, fault, wall)| Cause { slot, symptom, fault, wall: wall.into() });
        let names = proptest::collection::vec(".{1,300}", 0..20);
        (".{0,60}", names, proptest::option::of(cause)).prop_map(|(profiles, actuators, cause)| {
            let classes = actuators.clone();
            let own = Record::new(profiles, actuators).of_classes(classes);
            Record { cause, ..own }
        })
    }

    #[test]
    fn what_happened_long_ago_is_told_in_large_units() {
        assert_eq!(
            [-5.0, 1.6, 121.0, 7300.0, 200_000.0].map(ago),
            ["0 s ago", "2 s ago", "2 min ago", "2 h ago", "2 days ago"]
        );
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(record in record(), latched: bool) {
            let bytes = encode(&record, latched);
            prop_assert_eq!(bytes.len() % BLOCK, 0);
            prop_assert_eq!(decode(&bytes).unwrap(), (record, latched));
        }

        #[test]
        fn the_front_alone_latches_it(record in record()) {
            let mut bytes = encode(&record, false);
            bytes[..LATCHED.len()].copy_from_slice(LATCHED);
            prop_assert_eq!(decode(&bytes).unwrap(), (record, true));
        }

        #[test]
        fn a_cause_takes_no_further_block(mut record in record(), causes in proptest::collection::vec(record(), 0..4)) {
            record.cause = None;
            let before = encode(&record, false).len();
            causes.into_iter().filter_map(|other| other.cause).for_each(|cause| record.raised_for(cause));
            prop_assert!(encode(&record, true).len() <= before);
            prop_assert_eq!(decode(&encode(&record, true)).unwrap(), (record, true));
        }

        #[test]
        fn no_damage_makes_it_free(record in record(), cut in 0_usize..4096, bit in 0_usize..17 * 8) {
            let mut bytes = encode(&record, true);
            prop_assert!(decode(&bytes[..cut.min(bytes.len())]).is_ok_and(|(_, latched)| latched)
                || decode(&bytes[..cut.min(bytes.len())]).is_err());
            bytes[bit / 8] ^= 1 << (bit % 8);
            prop_assert!(decode(&bytes).map_or(true, |(_, latched)| latched));
        }
    }
}
