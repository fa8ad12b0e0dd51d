//! What a callback does: operations drawn by lot, and now and then a fault.

use std::cell::Cell;
use std::sync::Arc;

use component_sdk::abi::calls::Whose;
use component_sdk::status::Status;
use framework_daemon::sys::fiber::{self, Errand, NEVER};

use super::ends::Ends;
use super::model::{PORTS, SENDS};
use super::naive_pushes::READERS;
use super::world::World;
use super::{links, outside};

/// Operations of a callback, at most.
const LENGTH: usize = 6;

/// Which callback it is.
#[derive(Clone, Copy, Debug)]
pub(super) enum Job {
    Execute,
    /// The handler of a question: the server's number, the model's.
    Serve(u64, u64),
    /// Of a message.
    Take(u64, u64),
    /// The server of events is told of that activation.
    Told(u64),
    /// That activation fired, with that event, which lies there.
    Fired(u64, u64, usize),
    /// A cycle begins.
    Tick,
    /// A value arrived, which lies there.
    Value(u64, usize),
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
    /// Until it is over: its fiber outlives the world.
    scene: Option<Scene>,
    way: Way,
}

/// Where it plays.
struct Scene {
    world: Arc<World>,
    slot: usize,
    ends: Arc<Ends>,
    job: Job,
}

impl Script {
    /// What a fiber of that slot is given.
    pub(super) fn new(world: &Arc<World>, slot: usize, job: Job) -> Self {
        let scene = Scene { world: Arc::clone(world), slot, ends: world.ends(slot), job };
        Self { scene: Some(scene), way: Way::Returned }
    }
}

impl Errand for Script {
    type Report = Way;

    fn run(&mut self) {
        self.way = self.scene.as_ref().map_or(self.way, Scene::play);
        self.scene = None;
    }

    fn report(&self) -> Way {
        self.way
    }
}

impl Scene {
    fn play(&self) -> Way {
        let actor = Actor {
            world: &self.world,
            slot: self.slot,
            ends: &self.ends,
            way: Cell::new(Way::Returned),
            depth: Cell::new(0),
            puts: Cell::new(false),
        };
        match self.job {
            Job::Execute => {
                actor.ask_first();
                actor.ramble(1 + self.world.dice.below(LENGTH));
            }
            Job::Serve(id, number) => actor.serve(id, number),
            Job::Take(id, number) => actor.take(id, number),
            Job::Told(number) => actor.hear_of(number),
            Job::Fired(number, event, place) => actor.hear(number, event, place),
            Job::Tick => actor.tick(),
            Job::Value(value, place) => actor.handle(value, place),
        }
        actor.way.get()
    }
}

/// Whoever acts in a callback.
pub(super) struct Actor<'a> {
    pub(super) world: &'a World,
    pub(super) slot: usize,
    pub(super) ends: &'a Ends,
    way: Cell<Way>,
    depth: Cell<u32>,
    /// In the middle of a put of events, whose tests do not put.
    pub(super) puts: Cell<bool>,
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

    /// In a world with lanes: asks while others are at rest still.
    pub(super) fn ask_first(&self) {
        let dice = &self.world.dice;
        if self.world.turns_at_once > 0 && dice.once_in(3) && !self.world.is_quiet() && self.world.step() {
            self.query(dice.below(SENDS));
        }
    }

    fn act(&self) {
        self.look_again();
        let nth = self.world.dice.below(64);
        match self.world.dice.below(16) {
            0..6 => self.act_on_calls(nth),
            6..9 => self.act_on_events(nth),
            9..13 => self.act_on_pushes(),
            13 => self.act_on_connections(),
            _ => self.act_otherwise(nth),
        }
    }

    fn act_on_calls(&self, nth: usize) {
        let dice = &self.world.dice;
        let (port, asks) = (dice.below(PORTS), dice.below(SENDS));
        match dice.below(56) {
            0..8 => self.request(port),
            8..12 => self.request(SENDS),
            12..20 => self.query(asks),
            20..26 => self.receive(nth, false),
            26..36 => self.receive(nth, true),
            36..39 => self.discard(nth),
            39..41 => self.stale(nth),
            41..43 => self.loan_and_discard(port),
            43 => self.answer_stale(nth),
            44..46 => self.pull(false),
            46 => self.pull(true),
            47 => self.finish_kept(nth, Some(Status::NotAllowed)),
            _ => self.finish_kept(nth, None),
        }
    }

    fn act_on_connections(&self) {
        let dice = &self.world.dice;
        let port = dice.below(PORTS);
        match dice.below(8) {
            0..2 => outside::connect(self.world, self.slot, port),
            2 => outside::disconnect(self.world, self.slot, port),
            3 => links::connect_events(self.world, self.slot),
            4 if dice.once_in(2) => links::disconnect_events(self.world, self.slot),
            5 => links::connect_reader(self.world, self.slot, dice.below(READERS)),
            6 if dice.once_in(2) => links::disconnect_reader(self.world, self.slot, dice.below(READERS)),
            7 if dice.once_in(4) => links::disconnect_writer(self.world, self.slot),
            _ => {}
        }
    }

    fn act_otherwise(&self, nth: usize) {
        let dice = &self.world.dice;
        let whose = if dice.once_in(2) { Whose::Port } else { Whose::Component };
        let on = !dice.once_in(3);
        match dice.below(16) {
            0 => self.blocking(dice.below(PORTS), whose, on),
            1 => self.blocking_events(whose, on),
            2 => self.blocking_updates(whose, on),
            3..6 => self.sleep(1 + dice.below(500) as u64),
            6 if dice.once_in(4) => self.end(Way::Panicked),
            7 if dice.once_in(4) => self.end(Way::Trapped),
            8..14 => self.finish_kept(nth, None),
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
