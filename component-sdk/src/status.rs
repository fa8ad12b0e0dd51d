//! What the operations of the communication patterns answer.
//!
//! One enum for all of them, with the codes of SmartSoft's second generation: an author who knows one pattern knows
//! the words of the next, and the tables of the patterns can be read beside it. Each method says which of them it
//! returns. No method panics or throws.

use std::fmt;

macro_rules! statuses {
    ($($(#[$doc:meta])+ $name:ident = $code:literal, $text:literal;)+) => {
        /// Why an operation did not do what was asked. `Result<_, Status>` tells it apart from success, whose code is 0.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[repr(u32)]
        pub enum Status {
            $($(#[$doc])+ $name = $code,)+
        }

        impl Status {
            /// All of them.
            pub const ALL: &'static [Self] = &[$(Self::$name),+];

            /// The status of that code; a code that nobody knows is an [`Status::Error`].
            #[must_use]
            pub const fn from_code(code: u32) -> Self {
                match code {
                    $($code => Self::$name,)+
                    _ => Self::Error,
                }
            }

            const fn text(self) -> &'static str {
                match self {
                    $(Self::$name => $text,)+
                }
            }
        }
    };
}

statuses! {
    /// There is nothing yet; the id stays valid.
    NoData = 1, "nothing is there yet";
    /// Blocking is off, for this port or for the component: a wait was refused or ended.
    Cancelled = 2, "the wait was cancelled: blocking is off";
    /// Connected, but not subscribed.
    Unsubscribed = 3, "not subscribed";
    /// No such id: never given, answered already, received already, or discarded.
    WrongId = 4, "no such id";
    /// No such state.
    UnknownState = 5, "no such state";
    /// Not active, or not any more.
    NotActivated = 6, "not activated";
    /// Too late: active already.
    Activated = 7, "activated already";
    /// Not from here, or not with this.
    NotAllowed = 8, "not allowed here";
    /// An event is armed and has not fired.
    Active = 9, "active, not fired yet";
    /// A single event fired and was consumed.
    Passive = 10, "fired and consumed";
    /// Not connected, or no longer.
    Disconnected = 11, "not connected";
    /// Both ends are there; their patterns or objects do not match.
    IncompatibleService = 12, "the two ends do not match";
    /// A port has that name already.
    PortAlreadyUsed = 13, "the port name is taken";
    /// The component has no such port.
    UnknownPort = 14, "no such port";
    /// The component has no such service, or does not serve it now.
    ServiceUnavailable = 15, "no such service";
    /// No component of that name.
    UnknownComponent = 16, "no such component";
    /// The time that a wait was given is over.
    Timeout = 17, "timed out";
    /// Something went wrong; a query whose server let it go unanswered.
    Error = 512, "it failed";
    /// The transport failed.
    ErrorCommunication = 513, "the transport failed";
    /// The transport failed in an unknown way.
    ErrorUnknown = 514, "it failed in an unknown way";
    /// The transport is broken for good.
    ErrorFatal = 515, "the transport is broken";
    /// The provider failed while the call was with it, or is given up.
    ProviderGone = 1024, "the provider failed";
    /// The provider was stopped.
    ProviderStopped = 1025, "the provider was stopped";
    /// The provider's slot was removed or built anew.
    ProviderReplaced = 1026, "the provider was replaced";
    /// The wait would be for oneself: the components in a ring would all wait for the next.
    Cycle = 1027, "the components would wait for each other";
    /// A bounded table or queue is full.
    Overload = 1028, "a queue or table is full";
    /// The port is closed: its instance was replaced.
    Closed = 1029, "the port is closed";
}

impl Status {
    /// Its number, as SmartSoft's second generation has it; own ones begin at 1024.
    #[must_use]
    pub const fn code(self) -> u32 {
        self as u32
    }

    /// What a function of the daemon returned: 0 is success.
    ///
    /// # Errors
    /// The status of any other code.
    pub(crate) const fn check(code: u32) -> Result<(), Self> {
        if code == 0 { Ok(()) } else { Err(Self::from_code(code)) }
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.text())
    }
}

impl std::error::Error for Status {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_go_there_and_back_and_are_those_of_the_second_generation() {
        for status in Status::ALL {
            assert_eq!(Status::from_code(status.code()), *status);
            assert_eq!(Status::check(status.code()), Err(*status));
        }
        assert_eq!(Status::check(0), Ok(()));
        let first: Vec<u32> = Status::ALL.iter().take(17).map(|status| status.code()).collect();
        assert_eq!(first, (1..=17).collect::<Vec<u32>>());
        assert_eq!(Status::from_code(256), Status::Error, "the marker of the originals means nothing");
    }

    #[test]
    fn a_status_becomes_a_component_error_by_a_question_mark() {
        fn fails() -> crate::component::Outcome {
            Err(Status::Timeout)?
        }
        assert_eq!(fails().unwrap_err().to_string(), "timed out");
    }
}
