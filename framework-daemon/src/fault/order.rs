//! What an operator may have done to slots, and how it is refused.

use serde_json::Value;

use crate::model::lifecycle::State;
use crate::sys::latch::Cause;

/// What is to be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verb {
    /// A slot is to run.
    Start,
    /// A slot is not to run.
    Stop,
    /// A slot that a fault stopped is to run again.
    Reset,
    /// The emergency stop is taken back.
    Clear,
}

impl Verb {
    /// Its name in the journal.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Stop => "stop",
            Self::Reset => "reset",
            Self::Clear => "clear",
        }
    }
}

/// Why an order is refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Refused {
    /// There is no such slot.
    NoSuchSlot(String),
    /// The emergency stop is latched.
    Latched(String),
    /// Not now.
    Busy(String),
    /// For this reason.
    Other(String),
}

impl Refused {
    /// Nothing starts before an operator has looked.
    #[must_use]
    pub fn latched() -> Self {
        Self::Latched(
            "the emergency stop is latched: see what is wrong, then `framework-daemon fault clear`".to_owned(),
        )
    }

    /// Nobody has seen yet what it was raised for.
    pub(super) fn raised_again(newest: Option<&Cause>) -> Self {
        let cause = newest.map_or_else(|| "a fault that is not written down yet".to_owned(), ToString::to_string);
        Self::Latched(format!(
            "the emergency stop is not cleared, because it was raised again at this moment, for {cause}: see what is wrong, then \
             `framework-daemon fault clear` again"
        ))
    }

    pub(super) fn failed(slot: &str) -> Self {
        Self::Other(format!("a fault stopped `{slot}`: `component reset {slot}` brings it back"))
    }

    /// Too few of these members of a voter agree.
    pub(super) fn short(voter: &str, require: usize, members: &[&str]) -> Self {
        let members = members.join(", ");
        Self::Other(format!(
            "the emergency stop stays: too few members of the voter `{voter}` agree, {require} of {members} must; its slots \
             can be reset and started meanwhile"
        ))
    }

    /// Whether enough of these members of a voter agree is not known yet.
    pub(super) fn without_vote(voter: &str, require: usize, members: &[&str]) -> Self {
        let members = members.join(", ");
        Self::Other(format!(
            "the emergency stop stays: {require} of {members} must agree, and the voter `{voter}` has not heard that yet in this \
             run; its slots can be reset and started meanwhile"
        ))
    }

    pub(super) fn sound(slot: &str, state: State) -> Self {
        let state = state.name();
        Self::Other(format!(
            "`{slot}` is {state}: only what a fault stopped is reset; else `component start` or `stop`"
        ))
    }
}

/// How an order ended.
pub type Obeyed = Result<Value, Refused>;

/// An order with who is told how it ended.
pub struct Order {
    /// What is to be done.
    pub verb: Verb,
    /// To which slot; empty for [`Verb::Clear`].
    pub slot: String,
    /// Told how it ended.
    pub answer: Box<dyn FnOnce(Obeyed) + Send>,
}
