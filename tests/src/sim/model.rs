//! What must be: every call and message with its end, every queue in its order, who waits for whom.

use std::collections::{BTreeMap, VecDeque};

use component_sdk::status::Status;
use framework_daemon::port::pattern::provider::Openness;

use super::at_once::AtOnce;
use super::awaited::Awaited;
use super::naive_events::{Activation, Listener, Teller};
use super::naive_pushes::{Reader, Writer};

/// Client ports of each slot: those that ask, and the one that sends.
pub(super) const PORTS: usize = 3;
/// The one that sends messages.
pub(super) const SENDS: usize = PORTS - 1;
/// Servers of each slot: who answers, and who takes messages.
pub(super) const SERVERS: usize = 2;

/// Gates of a slot: of its client ports, of its event client, of its subscriber, of the server that takes messages itself.
pub(super) const GATES: usize = PORTS + 3;
pub(super) const EVENT_GATE: usize = PORTS;
pub(super) const PUSH_GATE: usize = PORTS + 1;
pub(super) const PULL_GATE: usize = PORTS + 2;

/// The number of a life's server that a client port leads to.
pub(super) const fn server_of(life: usize, port: usize) -> usize {
    life * SERVERS + (port == SENDS) as usize
}

/// Where a client port leads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Link {
    /// Number of the server.
    pub(super) to: usize,
    /// Its successor is asked again.
    pub(super) retry: bool,
}

/// A question, or a message.
#[derive(Clone, Debug)]
pub(super) struct Call {
    /// Life and port of the client.
    pub(super) from: (usize, usize),
    /// A message: the server's as soon as it is sent.
    pub(super) one_way: bool,
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

/// A server's end of a life of a slot.
#[derive(Debug)]
pub(super) struct Provider {
    pub(super) open: Openness,
    pub(super) room: usize,
    /// It has a handler; one without takes its messages itself.
    pub(super) handled: bool,
    pub(super) queue: VecDeque<u64>,
    pub(super) hands: Vec<InHand>,
}

impl Provider {
    pub(super) fn has_room(&self) -> bool {
        self.hands.len() < self.room
    }

    /// A call could be taken in hand.
    pub(super) fn has_calls(&self) -> bool {
        self.hands.iter().any(|held| held.again) || (!self.queue.is_empty() && self.has_room())
    }

    /// A handler could be entered for one.
    pub(super) fn waits(&self) -> bool {
        self.handled && self.has_calls()
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

/// The order in which a life's servers are asked.
#[derive(Debug)]
pub(super) struct Turns {
    pub(super) room: usize,
    pub(super) order: VecDeque<usize>,
    /// Events had the last turn.
    pub(super) others_first: bool,
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

/// A callback that waits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wait {
    pub(super) what: Awaited,
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
    /// Calls in hand that are to be answered later: the server, its number of it, the model's.
    pub(super) kept: Vec<(usize, u64, u64)>,
    /// Those of them whose answers are written and not sent.
    pub(super) written: Vec<u64>,
    pub(super) stale_kept: Vec<(usize, u64)>,
    /// Activations that it has not given up: the client's number, the model's.
    pub(super) asked: Vec<(u64, u64)>,
    pub(super) stale_asked: Vec<u64>,
    /// What it was shown last and may look at still, by port: where, and what must be there.
    pub(super) looks: [Option<(usize, u64)>; 3],
}

/// A slot.
#[derive(Debug)]
pub(super) struct Slot {
    pub(super) life: usize,
    pub(super) executor: usize,
    pub(super) state: State,
    pub(super) links: [Option<Link>; PORTS],
    pub(super) gates: [Gates; GATES],
    pub(super) instance: Instance,
    pub(super) wait: Option<Wait>,
    /// A question of it that is to be answered at once.
    pub(super) at_once: Option<AtOnce>,
    /// Its callback may not wait any more.
    pub(super) ending: bool,
}

/// Everything that is known.
#[derive(Debug, Default)]
pub(super) struct Model {
    pub(super) slots: Vec<Slot>,
    /// Servers by number, and by life those whose calls came in, in that order.
    pub(super) providers: Vec<Provider>,
    pub(super) turns: Vec<Turns>,
    /// By life: whom it waits for.
    pub(super) waits_for: Vec<Option<usize>>,
    /// By number.
    pub(super) calls: BTreeMap<u64, Call>,
    /// By life.
    pub(super) listeners: Vec<Listener>,
    pub(super) tellers: Vec<Teller>,
    pub(super) writers: Vec<Writer>,
    /// By number, two of each life.
    pub(super) readers: Vec<Reader>,
    /// By number.
    pub(super) activations: BTreeMap<u64, Activation>,
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
        let own = self.calls.values_mut().filter(|call| call.from == from && !call.one_way);
        own.for_each(|call| call.left = true);
    }

    /// All calls of a client port are given up.
    pub(super) fn abandon(&mut self, from: (usize, usize)) {
        self.leave(from);
        let own: Vec<u64> =
            self.calls.iter().filter(|(_, call)| call.from == from).map(|(number, _)| *number).collect();
        own.into_iter().for_each(|number| self.let_go(number));
    }

    fn is_asked_for(&self, number: u64) -> bool {
        self.calls.get(&number).is_some_and(|call| call.one_way || (call.wanted && !call.left))
    }

    /// A call came in at a server.
    pub(super) fn came(&mut self, server: usize, number: u64) {
        self.providers[server].queue.push_back(number);
        let turns = &mut self.turns[server / SERVERS];
        if self.providers[server].handled && turns.order.len() < turns.room {
            turns.order.push_back(server);
        }
    }

    /// The call that a life's handlers are to be entered for next: that of the server whose turn it is.
    pub(super) fn next_of(&mut self, life: usize) -> Option<(usize, u64, Option<u64>)> {
        while let Some(server) = self.turns[life].order.pop_front() {
            if let Some((number, before)) = self.next(server) {
                return Some((server, number, before));
            }
        }
        let mut own = (life * SERVERS..(life + 1) * SERVERS).filter(|server| self.providers[*server].handled);
        let own: Vec<usize> = own.by_ref().collect();
        own.into_iter().find_map(|server| self.next(server).map(|(number, before)| (server, number, before)))
    }

    /// The call that a server is to take in hand next, and where a successor finds it: in its place, or anywhere.
    pub(super) fn next(&mut self, server: usize) -> Option<(u64, Option<u64>)> {
        let mut again: Vec<InHand> = self.providers[server].hands.iter().copied().filter(|held| held.again).collect();
        again.sort_by_key(|held| held.id as u32);
        for held in again {
            if self.is_asked_for(held.number) {
                self.providers[server].hands.retain(|other| other.number != held.number);
                return Some((held.number, Some(held.id)));
            }
            self.drop_hand(server, held.number, Err(Status::Disconnected));
        }
        while self.providers[server].has_room() {
            let number = self.providers[server].queue.pop_front()?;
            if self.is_asked_for(number) {
                return Some((number, None));
            }
            self.end(number, Err(Status::Disconnected));
        }
        None
    }

    /// A call in hand is over.
    pub(super) fn drop_hand(&mut self, server: usize, number: u64, fate: Result<u64, Status>) {
        self.providers[server].hands.retain(|held| held.number != number);
        self.end(number, fate);
    }

    /// The instance of that server failed: what it had in hand is over, or waits for its successor.
    pub(super) fn fail(&mut self, server: usize) {
        let hands = std::mem::take(&mut self.providers[server].hands);
        for held in hands {
            let retry = self.calls.get(&held.number).is_some_and(|call| call.retry);
            if held.again || (retry && self.is_asked_for(held.number)) {
                self.providers[server].hands.push(InHand { again: true, ..held });
            } else {
                self.end(held.number, Err(Status::ProviderGone));
            }
        }
    }

    /// All that a provider has is over.
    pub(super) fn let_all_go(&mut self, server: usize, status: Status) {
        for held in std::mem::take(&mut self.providers[server].hands) {
            self.end(held.number, Err(status));
        }
        self.clear_queue(server, status);
    }

    /// All that waits for a provider is over.
    pub(super) fn clear_queue(&mut self, server: usize, status: Status) {
        for number in std::mem::take(&mut self.providers[server].queue) {
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

/// One of the numbers that are not good any more; the newest 32 are kept.
pub(super) fn old_number<T: Copy>(numbers: &mut Vec<T>, nth: usize) -> Option<T> {
    let excess = numbers.len().saturating_sub(32);
    numbers.drain(..excess);
    numbers.get(nth % numbers.len().max(1)).copied()
}
