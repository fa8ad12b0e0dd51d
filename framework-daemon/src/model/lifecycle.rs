//! The lifecycle of a slot as a written-out table: every state, every event, refused ones too.
//!
//! States and events are OPRoS's (`initialize`: CREATED to READY, ...). What OPRoS never called, `reset` and `recover`,
//! are the two ways out of ERROR. Hidden transitions in method bodies were how OPRoS called `onInitialize` twice and
//! `onStart` never; a table cannot hide one.

use serde::Serialize;

/// State of a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[repr(u8)]
pub enum State {
    /// An instance exists.
    Created,
    /// It is initialised.
    Ready,
    /// It runs.
    Active,
    /// It was stopped.
    Inactive,
    /// A fault was blamed on it.
    Error,
    /// It is gone.
    Destroyed,
}

/// What may happen to a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Event {
    /// Call `initialize`.
    Initialize,
    /// Call `start`.
    Start,
    /// Call `stop`.
    Stop,
    /// Call `destroy`.
    Destroy,
    /// A fault was blamed on the instance.
    Fault,
    /// Call `reset` of the same instance.
    Reset,
    /// Call `recover` of a successor.
    Recover,
}

impl State {
    /// Every state, in table order.
    pub const ALL: [Self; 6] = [Self::Created, Self::Ready, Self::Active, Self::Inactive, Self::Error, Self::Destroyed];

    /// The state after `event`; `None`: refused.
    #[must_use]
    pub const fn after(self, event: Event) -> Option<Self> {
        TABLE[self as usize][event as usize]
    }

    /// The state of that number.
    #[must_use]
    pub fn from_number(number: u8) -> Self {
        Self::ALL.get(usize::from(number)).copied().unwrap_or(Self::Destroyed)
    }

    /// The name used in journal and command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Created => "created",
            Self::Ready => "ready",
            Self::Active => "active",
            Self::Inactive => "inactive",
            Self::Error => "error",
            Self::Destroyed => "destroyed",
        }
    }
}

impl Event {
    /// Every event, in table order.
    pub const ALL: [Self; 7] =
        [Self::Initialize, Self::Start, Self::Stop, Self::Destroy, Self::Fault, Self::Reset, Self::Recover];
}

const NO: Option<State> = None;
const READY: Option<State> = Some(State::Ready);
const ACTIVE: Option<State> = Some(State::Active);
const INACTIVE: Option<State> = Some(State::Inactive);
const ERROR: Option<State> = Some(State::Error);
const GONE: Option<State> = Some(State::Destroyed);

#[rustfmt::skip]
const TABLE: [[Option<State>; 7]; 6] = [
    //               initialize start   stop      destroy fault  reset   recover
    /* created   */ [READY,     NO,     NO,       GONE,   ERROR, NO,     NO   ],
    /* ready     */ [NO,        ACTIVE, NO,       GONE,   ERROR, NO,     NO   ],
    /* active    */ [NO,        NO,     INACTIVE, NO,     ERROR, NO,     NO   ],
    /* inactive  */ [NO,        ACTIVE, NO,       GONE,   ERROR, NO,     NO   ],
    /* error     */ [NO,        NO,     NO,       GONE,   ERROR, ACTIVE, READY],
    /* destroyed */ [NO,        NO,     NO,       NO,     NO,    NO,     NO   ],
];

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn numbers_and_names_fit_the_table() {
        for (index, state) in State::ALL.into_iter().enumerate() {
            assert_eq!(state as usize, index);
            assert_eq!(State::from_number(state as u8), state);
        }
        for (index, event) in Event::ALL.into_iter().enumerate() {
            assert_eq!(event as usize, index);
        }
    }

    #[test]
    fn nothing_leaves_destroyed_and_only_stop_leaves_active_in_order() {
        for event in Event::ALL {
            assert_eq!(State::Destroyed.after(event), None);
        }
        let orderly: Vec<_> = Event::ALL.into_iter().filter(|event| State::Active.after(*event).is_some()).collect();
        assert_eq!(orderly, [Event::Stop, Event::Fault]);
    }

    proptest! {
        /// Whatever happens, each `initialize` comes once, `start` and `stop` take turns unless a fault lies between.
        #[test]
        fn hooks_come_in_order(events in prop::collection::vec(0..7usize, 0..200)) {
            let (mut state, mut initialised, mut running) = (State::Created, 0, false);
            for event in events.into_iter().map(|index| Event::ALL[index]) {
                let Some(next) = state.after(event) else { continue };
                match event {
                    Event::Initialize => initialised += 1,
                    Event::Start => { prop_assert!(!running); running = true; }
                    Event::Stop => { prop_assert!(running); running = false; }
                    Event::Fault => running = false,
                    Event::Reset => { prop_assert!(!running); running = true; }
                    Event::Destroy | Event::Recover => prop_assert!(!running),
                }
                prop_assert_eq!(running, next == State::Active);
                prop_assert!(initialised <= 1);
                state = next;
            }
        }
    }
}
