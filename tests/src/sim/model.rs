//! What must be: every call with its end, every queue in its order, who waits for whom.

use std::collections::{BTreeMap, VecDeque};

use component_sdk::status::Status;
use framework_daemon::port::pattern::provider::Openness;

/// Client ports of each slot.
pub(super) const PORTS: usize = 2;

/// Where a client port leads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Link {
    /// Life of the provider's slot.
    pub(super) to: usize,
    /// Its successor is asked again.
    pub(super) retry: bool,
}

/// A question.
#[derive(Clone, Debug)]
pub(super) struct Call {
    /// Life and port of the client.
    pub(super) from: (usize, usize),
    pub(super) retry: bool,
    /// The client has left the connection that it was asked over.
    pub(super) left: bool,
    /// The client has not let it go.
    pub(super) wanted: bool,
    /// The provider has not let it go.
    pub(super) ticket: bool,
    /// What the provider made of it.
    pub(super) fate: Option<Result<u64, Status>>,
}

impl Call {
    /// How it ended, as the client sees it.
    pub(super) fn end(&self) -> Option<Result<u64, Status>> {
        self.fate.or(self.left.then_some(Err(Status::Disconnected)))
    }
}

/// A call in a provider's hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct InHand {
    /// Its number at the provider.
    pub(super) id: u64,
    pub(super) number: u64,
    /// It waits for a successor.
    pub(super) again: bool,
}

/// The server's end of a life of a slot.
#[derive(Debug)]
pub(super) struct Provider {
    pub(super) open: Openness,
    pub(super) room: usize,
    pub(super) queue: VecDeque<u64>,
    pub(super) hands: Vec<InHand>,
}

impl Provider {
    pub(super) fn has_room(&self) -> bool {
        self.hands.len() < self.room
    }

    /// A call could be taken in hand.
    pub(super) fn waits(&self) -> bool {
        self.hands.iter().any(|held| held.again) || (!self.queue.is_empty() && self.has_room())
    }
}

/// What a call gets from a provider that is not open.
pub(super) const fn refusal(open: Openness) -> Option<Status> {
    match open {
        Openness::Starting | Openness::Serving => None,
        Openness::Stopped => Some(Status::ProviderStopped),
        Openness::Gone => Some(Status::ProviderGone),
        Openness::Replaced => Some(Status::ProviderReplaced),
    }
}

/// The gates of a client port.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gates {
    pub(super) port: bool,
    pub(super) component: bool,
    pub(super) slot: bool,
    pub(super) closings: u32,
}

impl Gates {
    pub(super) const OPEN: Self = Self { port: true, component: true, slot: true, closings: 0 };

    /// A wait that began at that count may go on.
    pub(super) const fn let_wait(&self, closings: u32) -> bool {
        self.port && self.component && self.slot && self.closings == closings
    }
}

/// What a callback waits for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wait {
    pub(super) port: usize,
    pub(super) number: u64,
    pub(super) until_ns: u64,
    pub(super) closings: u32,
}

/// How far a slot is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum State {
    Stopped,
    Active,
    /// A recovery waits for its next try.
    Breathing,
}

/// What an instance knows of its calls.
#[derive(Debug, Default)]
pub(super) struct Instance {
    /// Open questions: port, the client's number, the model's.
    pub(super) open: Vec<(usize, u64, u64)>,
    /// Answers being read.
    pub(super) lent: Vec<(usize, u64, u64)>,
    /// Requests being filled.
    pub(super) loans: Vec<(usize, u64)>,
    /// Numbers that are not good any more.
    pub(super) stale: Vec<(usize, u64)>,
    /// Calls in hand that are to be answered later: the provider's number, the model's.
    pub(super) kept: Vec<(u64, u64)>,
    pub(super) stale_kept: Vec<u64>,
}

/// A slot.
#[derive(Debug)]
pub(super) struct Slot {
    pub(super) life: usize,
    pub(super) executor: usize,
    pub(super) state: State,
    pub(super) links: [Option<Link>; PORTS],
    pub(super) gates: [Gates; PORTS],
    pub(super) instance: Instance,
    pub(super) wait: Option<Wait>,
    /// Its callback may not wait any more.
    pub(super) ending: bool,
}

/// Everything that is known.
#[derive(Debug, Default)]
pub(super) struct Model {
    pub(super) slots: Vec<Slot>,
    /// By life: its provider, and whom it waits for.
    pub(super) providers: Vec<Provider>,
    pub(super) waits_for: Vec<Option<usize>>,
    /// By number.
    pub(super) calls: BTreeMap<u64, Call>,
    pub(super) last: u64,
}

impl Model {
    /// Calls of a client port that somebody has still.
    pub(super) fn used(&self, from: (usize, usize), loans: usize) -> usize {
        self.calls.values().filter(|call| call.from == from).count() + loans
    }

    /// Whoever has let a call go last makes it free.
    pub(super) fn tidy(&mut self, number: u64) {
        if self.calls.get(&number).is_some_and(|call| !call.wanted && !call.ticket) {
            self.calls.remove(&number);
        }
    }

    /// The provider has let it go, with that end.
    pub(super) fn end(&mut self, number: u64, fate: Result<u64, Status>) {
        if let Some(call) = self.calls.get_mut(&number) {
            (call.ticket, call.fate) = (false, Some(fate));
        }
        self.tidy(number);
    }

    /// The client has let it go.
    pub(super) fn let_go(&mut self, number: u64) {
        if let Some(call) = self.calls.get_mut(&number) {
            call.wanted = false;
        }
        self.tidy(number);
    }

    /// The client port's connection or instance is another one.
    pub(super) fn leave(&mut self, from: (usize, usize)) {
        self.calls.values_mut().filter(|call| call.from == from).for_each(|call| call.left = true);
    }

    /// All calls of a client port are given up.
    pub(super) fn abandon(&mut self, from: (usize, usize)) {
        self.leave(from);
        let own: Vec<u64> =
            self.calls.iter().filter(|(_, call)| call.from == from).map(|(number, _)| *number).collect();
        own.into_iter().for_each(|number| self.let_go(number));
    }

    fn is_asked_for(&self, number: u64) -> bool {
        self.calls.get(&number).is_some_and(|call| call.wanted && !call.left)
    }

    /// The call that a provider is to take in hand next, and where a successor finds it: in its place, or anywhere.
    pub(super) fn next(&mut self, life: usize) -> Option<(u64, Option<u64>)> {
        let mut again: Vec<InHand> = self.providers[life].hands.iter().copied().filter(|held| held.again).collect();
        again.sort_by_key(|held| held.id as u32);
        for held in again {
            if self.is_asked_for(held.number) {
                self.providers[life].hands.retain(|other| other.number != held.number);
                return Some((held.number, Some(held.id)));
            }
            self.drop_hand(life, held.number, Err(Status::Disconnected));
        }
        while self.providers[life].has_room() {
            let number = self.providers[life].queue.pop_front()?;
            if self.is_asked_for(number) {
                return Some((number, None));
            }
            self.end(number, Err(Status::Disconnected));
        }
        None
    }

    /// A call in hand is over.
    pub(super) fn drop_hand(&mut self, life: usize, number: u64, fate: Result<u64, Status>) {
        self.providers[life].hands.retain(|held| held.number != number);
        self.end(number, fate);
    }

    /// The instance of that life failed: what it had in hand is over, or waits for its successor.
    pub(super) fn fail(&mut self, life: usize) {
        let hands = std::mem::take(&mut self.providers[life].hands);
        for held in hands {
            let retry = self.calls.get(&held.number).is_some_and(|call| call.retry);
            if held.again || (retry && self.is_asked_for(held.number)) {
                self.providers[life].hands.push(InHand { again: true, ..held });
            } else {
                self.end(held.number, Err(Status::ProviderGone));
            }
        }
    }

    /// All that a provider has is over.
    pub(super) fn let_all_go(&mut self, life: usize, status: Status) {
        for held in std::mem::take(&mut self.providers[life].hands) {
            self.end(held.number, Err(status));
        }
        self.clear_queue(life, status);
    }

    /// All that waits for a provider is over.
    pub(super) fn clear_queue(&mut self, life: usize, status: Status) {
        for number in std::mem::take(&mut self.providers[life].queue) {
            self.end(number, Err(status));
        }
    }

    /// True where a wait of `life` for `other` would close a ring.
    pub(super) fn is_cycle(&self, life: usize, other: usize) -> bool {
        let mut at = Some(other);
        for _ in 0..=self.waits_for.len() {
            match at {
                Some(other) if other == life => return true,
                Some(other) => at = self.waits_for[other],
                None => return false,
            }
        }
        false
    }
}
