//! What a callback does: operations drawn by lot, and now and then a fault.

use std::cell::Cell;
use std::sync::Arc;

use component_sdk::abi::calls::Whose;
use framework_daemon::sys::fiber::{self, Errand, NEVER};

use super::model::PORTS;
use super::outside;
use super::world::{Ends, World};

/// Operations of a callback, at most.
const LENGTH: usize = 6;

/// Which callback it is.
#[derive(Clone, Copy, Debug)]
pub(super) enum Job {
    Execute,
    /// The handler of a call: the provider's number, the model's.
    Serve(u64, u64),
}

/// How a callback ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Way {
    Returned,
    /// What it was doing is as it was; the instance is sound.
    Panicked,
    /// Nothing of the instance is used any more.
    Trapped,
}

/// A callback on its fiber.
pub(super) struct Script {
    pub(super) world: Arc<World>,
    pub(super) slot: usize,
    pub(super) ends: Arc<Ends>,
    pub(super) job: Job,
    pub(super) way: Way,
}

impl Errand for Script {
    fn run(&mut self) {
        let actor = Actor {
            world: &self.world,
            slot: self.slot,
            ends: &self.ends,
            way: Cell::new(Way::Returned),
            depth: Cell::new(0),
        };
        match self.job {
            Job::Execute => actor.ramble(1 + self.world.dice.below(LENGTH)),
            Job::Serve(id, number) => actor.serve(id, number),
        }
        self.way = actor.way.get();
    }
}

/// Whoever acts in a callback.
pub(super) struct Actor<'a> {
    pub(super) world: &'a World,
    pub(super) slot: usize,
    pub(super) ends: &'a Ends,
    way: Cell<Way>,
    depth: Cell<u32>,
}

impl Actor<'_> {
    /// Nothing follows any more.
    pub(super) fn is_over(&self) -> bool {
        self.way.get() != Way::Returned || !self.world.is_right()
    }

    /// It ended so.
    pub(super) fn way_is(&self, way: Way) -> bool {
        self.way.get() == way
    }

    /// Does something, that many times.
    pub(super) fn ramble(&self, times: usize) {
        if self.depth.get() > 1 {
            return;
        }
        self.depth.set(self.depth.get() + 1);
        for _ in 0..times {
            if self.is_over() || self.world.is_quiet() || !self.world.step() {
                break;
            }
            self.give_way();
            self.act();
        }
        self.depth.set(self.depth.get() - 1);
    }

    /// Another executor's thread runs first, now and then.
    pub(super) fn give_way(&self) {
        if self.world.dice.once_in(4) && !self.world.is_quiet() {
            self.world.set_gave_way(true);
            if fiber::park(NEVER).is_err() {
                self.world.set_gave_way(false);
            }
        }
    }

    fn act(&self) {
        let dice = &self.world.dice;
        let (port, nth) = (dice.below(PORTS), dice.below(64));
        match dice.below(64) {
            0..10 => self.request(port),
            10..20 => self.query(port),
            20..26 => self.receive(nth, false),
            26..36 => self.receive(nth, true),
            36..39 => self.discard(nth),
            39..41 => self.stale(nth),
            41..43 => self.loan_and_discard(port),
            43 | 44 => {
                let whose = if dice.once_in(2) { Whose::Port } else { Whose::Component };
                self.blocking(port, whose, !dice.once_in(3));
            }
            45..47 => self.sleep(1 + dice.below(500) as u64),
            47..56 => self.answer_kept(nth),
            56 => self.refuse_kept(nth),
            57 => self.answer_stale(nth),
            58..60 => outside::connect(self.world, self.slot, port),
            60 => outside::disconnect(self.world, self.slot, port),
            61 if dice.once_in(4) => self.end(Way::Panicked),
            62 if dice.once_in(4) => self.end(Way::Trapped),
            _ => {}
        }
    }

    /// Comes to an end here.
    pub(super) fn end(&self, way: Way) {
        self.world.tell(|| format!("slot {}: {way:?}", self.slot));
        self.world.count(if way == Way::Trapped { "traps" } else { "panics" });
        self.way.set(way);
    }

    fn sleep(&self, time_ns: u64) {
        let until_ns = self.world.now_ns() + time_ns;
        self.world.tell(|| format!("slot {}: sleeps until {until_ns}", self.slot));
        while self.world.now_ns() < until_ns && fiber::park(until_ns).is_ok() {}
    }
}
