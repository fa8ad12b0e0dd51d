//! Which faults happen when.

use std::fmt;
use std::str::FromStr;

/// What the demo does to the robot if nobody says otherwise: the third fault of the avoider is one too many for its
/// restart intensity, so the secondary takes over; then two components that have no secondary. Each comes while the robot
/// drives at full speed, so that a break would show in the picture.
pub const DEFAULT: [&str; 5] = [
    "avoider:crash.panic@4",
    "avoider:crash.fpe@7",
    "avoider:crash.segv@10",
    "sonar:crash.segv@12",
    "odometry:crash.abort@14.5",
];

/// One fault to inject.
#[derive(Debug, Clone, PartialEq)]
pub struct Injection {
    /// The slot to fail.
    pub slot: String,
    /// How.
    pub symptom: String,
    /// When, in seconds after the daemon is ready.
    pub at: f64,
}

impl FromStr for Injection {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let form = || format!("`{text}` is not SLOT:SYMPTOM@SECONDS, for example avoider:crash.segv@10");
        let (slot, rest) = text.split_once(':').ok_or_else(form)?;
        let (symptom, at) = rest.rsplit_once('@').ok_or_else(form)?;
        let at: f64 = at.parse().map_err(|_| form())?;
        if slot.is_empty() || symptom.is_empty() || !at.is_finite() || at < 0.0 {
            return Err(form());
        }
        Ok(Self { slot: slot.into(), symptom: symptom.into(), at })
    }
}

impl fmt::Display for Injection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}@{}", self.slot, self.symptom, self.at)
    }
}

/// The default schedule.
///
/// # Panics
/// Never: a test parses it.
#[must_use]
pub fn default() -> Vec<Injection> {
    DEFAULT.iter().map(|text| text.parse().expect("the default schedule parses")).collect()
}

#[cfg(test)]
mod tests {
    use super::{DEFAULT, Injection, default};

    #[test]
    fn the_default_comes_back_as_it_is_written() {
        assert_eq!(default().iter().map(ToString::to_string).collect::<Vec<_>>(), DEFAULT);
    }

    #[test]
    fn nonsense_is_refused_with_an_example() {
        for text in ["", "avoider", "avoider:crash.segv", "avoider:@3", ":crash.segv@3", "a:b@-1", "a:b@soon"] {
            assert!(text.parse::<Injection>().unwrap_err().contains("avoider:crash.segv@10"), "{text}");
        }
    }
}
