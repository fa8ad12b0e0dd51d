//! What callbacks wait for: what must come of a wait when it begins, and when it ends.

use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering;

use component_sdk::abi::calls::Wait as Time;
use component_sdk::abi::events::Which;
use component_sdk::status::Status;

use super::model::{Call, EVENT_GATE, Model, PULL_GATE, PUSH_GATE, SERVERS, Wait};
use super::naive_pushes::READERS;
use super::script::Actor;
use super::world::{Here, NO_DEADLINE_NS, World};

/// What a wait must end with.
pub(super) type End = Result<u64, Status>;

/// What a callback waits for.
#[derive(Clone, Copy, Debug)]
pub(super) enum Awaited {
    /// The answer to that question of that port.
    Answer(usize, u64),
    /// A firing of that activation, which had fired that often.
    Event(u64, Which, u64),
    /// A value, or an end, beyond these counts.
    Update(u64, u64),
    /// A message.
    Message,
}

impl Awaited {
    /// The gate that it goes through.
    pub(super) const fn gate(self) -> usize {
        match self {
            Self::Answer(port, _) => port,
            Self::Event(..) => EVENT_GATE,
            Self::Update(..) => PUSH_GATE,
            Self::Message => PULL_GATE,
        }
    }
}

/// The number of a life's server that takes messages.
pub(super) const fn taker(life: usize) -> usize {
    life * SERVERS + 1
}

/// The number of a life's subscriber.
pub(super) const fn subscriber(life: usize) -> usize {
    life * READERS
}

impl Model {
    /// How it ended, if it did.
    pub(super) fn end_of(&self, life: usize, what: Awaited) -> Option<End> {
        match what {
            Awaited::Answer(_, number) => self.calls.get(&number).and_then(Call::end),
            Awaited::Event(number, which, before) => self.event_end(life, number, which, before),
            Awaited::Update(arrivals, ends) => self.update_end(subscriber(life), arrivals, ends),
            Awaited::Message => {
                let taker = &self.providers[taker(life)];
                match taker.has_room() {
                    _ if taker.has_calls() => Some(Ok(self.first_in(taker))),
                    true => None,
                    false => Some(Err(Status::Overload)),
                }
            }
        }
    }

    fn first_in(&self, taker: &super::model::Provider) -> u64 {
        let again = taker.hands.iter().filter(|held| held.again).min_by_key(|held| held.id as u32);
        again.map(|held| held.number).or_else(|| taker.queue.front().copied()).unwrap_or_default()
    }

    /// What must come of it at once; `None`: it begins to wait.
    fn at_once(&self, life: usize, what: Awaited, waits: bool) -> Option<End> {
        let nothing = (!waits).then_some(Err(Status::NoData));
        match what {
            Awaited::Event(number, which, before) => {
                if self.activations.get(&number).is_none_or(|one| one.end.is_some()) {
                    return Some(Err(Status::WrongId));
                }
                if !waits {
                    return self.event_there(number, which, before).or(nothing);
                }
                self.end_of(life, what)
            }
            Awaited::Update(..) => {
                let standing = self.standing(subscriber(life));
                if !waits {
                    return Some(standing.and_then(|_| self.newest(subscriber(life))));
                }
                match standing {
                    Err(status) => Some(Err(status)),
                    Ok(writer) => super::model::refusal(self.writers[writer].open).map(Err),
                }
            }
            Awaited::Answer(..) | Awaited::Message => self.end_of(life, what).or(nothing),
        }
    }

    /// The life of whoever is waited for.
    fn peer(&self, slot: usize, life: usize, what: Awaited) -> Option<usize> {
        match what {
            Awaited::Answer(port, _) => self.slots[slot].links[port].map(|link| link.to / SERVERS),
            Awaited::Event(..) => self.listeners[life].server,
            Awaited::Update(..) => self.readers[subscriber(life)].from,
            Awaited::Message => None,
        }
    }
}

/// What is known when a wait begins.
#[derive(Clone, Copy, Debug)]
pub(super) struct Before {
    pub(super) at_once: Option<End>,
    what: Awaited,
    closings: u32,
    until_ns: u64,
}

impl World {
    /// What must come of a wait that begins now; where it was asked for earlier, when its gate had been closed that often.
    pub(super) fn before(&self, (slot, life): (usize, usize), what: Awaited, time: Time, asked: Option<u32>) -> Before {
        let mut model = self.model();
        let state = &model.slots[slot];
        let (gates, ending) = (state.gates[what.gate()], state.ending);
        let closings = asked.unwrap_or(gates.closings);
        let peer = model.peer(slot, life, what);
        let at_once = if let Some(end) = model.at_once(life, what, time != Time::NONE) {
            Some(end)
        } else if !gates.let_wait(closings) {
            Some(Err(Status::Cancelled))
        } else if peer.is_some_and(|peer| model.is_cycle(life, peer)) {
            Some(Err(Status::Cycle))
        } else if ending {
            Some(Err(Status::Cancelled))
        } else {
            None
        };
        let until_ns = self.now_ns().saturating_add(time.0);
        if at_once.is_none() {
            model.waits_for[life] = peer;
            model.slots[slot].wait = Some(Wait { what, until_ns, closings });
        }
        Before { at_once, what, closings, until_ns }
    }
}

impl Actor<'_> {
    /// How long to wait.
    pub(super) fn time(&self) -> Time {
        if self.world.deadlines { self.short_time() } else { Time(NO_DEADLINE_NS) }
    }

    /// How long to wait where nobody owes an answer.
    pub(super) fn patience(&self) -> Time {
        if self.world.dice.once_in(4) { self.time() } else { self.short_time() }
    }

    fn short_time(&self) -> Time {
        Time(1 + self.world.dice.below(2_000) as u64)
    }

    /// What must come of a wait that begins now.
    pub(super) fn before(&self, what: Awaited, time: Time) -> Before {
        self.world.before((self.slot, self.ends.life), what, time, None)
    }

    /// What came of it, compared with what must come of it now.
    pub(super) fn after(&self, before: &Before, is: End, here: &Here<'_>) {
        let mut model = self.world.model();
        model.waits_for[self.ends.life] = None;
        model.slots[self.slot].wait = None;
        let (what, slot) = (before.what, &model.slots[self.slot]);
        let (gates, ending) = (slot.gates[what.gate()], slot.ending);
        let end_now = model.end_of(self.ends.life, what);
        drop(model);
        let must = before.at_once.or(end_now).unwrap_or_else(|| {
            if !gates.let_wait(before.closings) {
                return Err(Status::Cancelled);
            }
            if self.world.now_ns() >= before.until_ns {
                return Err(Status::Timeout);
            }
            Err(if ending { Status::Cancelled } else { Status::NoData })
        });
        self.world.tell(|| format!("slot {}: {what:?} -> {is:?}", self.slot));
        self.world.same(|| format!("what came of {what:?}"), is, must);
        let waited = here.waited.load(Ordering::Relaxed);
        if before.at_once.is_some() && waited && must != Err(Status::Cancelled) {
            self.world.wrong(format!("{what:?} was waited for, though {must:?} was known"));
        }
        self.world.count(outcome(is));
    }

    /// A place to wait in.
    pub(super) fn here(&self) -> Here<'_> {
        Here { world: self.world, slot: self.slot, waited: AtomicBool::new(false) }
    }
}

const fn outcome(end: End) -> &'static str {
    match end {
        Ok(_) => "answers",
        Err(Status::NoData) => "no data",
        Err(Status::Cancelled) => "cancelled",
        Err(Status::Timeout) => "timeouts",
        Err(Status::Cycle) => "cycles",
        Err(Status::Disconnected) => "disconnected",
        Err(Status::ProviderGone) => "provider gone",
        Err(Status::ProviderStopped) => "provider stopped",
        Err(Status::ProviderReplaced) => "provider replaced",
        Err(Status::NotActivated) => "not activated",
        Err(Status::Unsubscribed) => "unsubscribed",
        Err(Status::Passive) => "passive",
        Err(Status::Error) => "unanswered",
        Err(_) => "others",
    }
}
