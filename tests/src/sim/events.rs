//! What a client and a server of events do, and what must come of it.
#![allow(unsafe_code, reason = "the simulation plays the plugins, which write and read through the pointers")]

use component_sdk::abi::calls::Wait as Time;
use component_sdk::abi::events::{Mode, Testing, Which};
use component_sdk::status::Status;
use framework_daemon::port::pattern::event_client::EventClient;
use framework_daemon::port::pattern::event_server::EventServer;

use super::awaited::Awaited;
use super::model::old_number;
use super::naive_events::Activation;
use super::script::{Actor, Way};

/// What a parameter says: whose it is, and how often a test has changed it.
const fn parameter(number: u64, tests: u64) -> u64 {
    number << 20 | tests
}

/// The place in `Instance::looks` of what was fetched.
const FETCHED: usize = 0;

impl Actor<'_> {
    fn client(&self) -> &EventClient {
        &self.ends.events.clients[0]
    }

    fn teller(&self) -> &EventServer {
        &self.ends.events.servers[0]
    }

    pub(super) fn act_on_events(&self, nth: usize) {
        match self.world.dice.below(16) {
            0..4 => self.activate(),
            4..6 => self.deactivate(nth),
            6 => self.try_event(nth),
            7 => self.ask_by_old_number(nth),
            8..10 => self.fetch(nth, false),
            10..12 => self.fetch(nth, true),
            _ => self.put_events(),
        }
    }

    /// Asks for events.
    fn activate(&self) {
        let (life, client) = (self.ends.life, self.client());
        let must = self.world.model().asking(life);
        let lent = client.loan();
        let code = must.map_or_else(Status::code, |()| 0);
        self.world.same(|| format!("slot {}: a loan of a parameter", self.slot), lent.status, code);
        if lent.status != 0 || must.is_err() {
            self.world.count("activations refused");
            return;
        }
        let number = {
            let mut model = self.world.model();
            (model.last, model.listeners[life].loans) = (model.last + 1, model.listeners[life].loans + 1);
            model.last
        };
        self.give_way();
        // SAFETY: lent for a `u64`, to this borrower.
        unsafe { lent.value.cast::<u64>().write(parameter(number, 0)) };
        if self.world.dice.once_in(64) {
            return self.end(Way::Trapped);
        }
        self.begin(lent.id, number);
    }

    fn begin(&self, id: u64, number: u64) {
        let life = self.ends.life;
        let mode = if self.world.dice.once_in(3) { Mode::Single } else { Mode::Continuous };
        let mut model = self.world.model();
        model.listeners[life].loans -= 1;
        let server = model.listeners[life].server;
        if let Some(server) = server {
            let announced = !model.tellers[server].hooked;
            let one = Activation {
                client: life,
                index: id as u32,
                mode,
                tests: 0,
                firings: 0,
                event: None,
                announced,
                held: false,
                end: None,
            };
            model.activations.insert(number, one);
            model.slots[self.slot].instance.asked.push((id, number));
        } else {
            model.slots[self.slot].instance.stale_asked.push(id);
        }
        drop(model);
        self.world.tell(|| format!("slot {}: activates {number}, {mode:?}", self.slot));
        self.world.count("activations");
        let is = self.client().activate(id, mode);
        self.world.same(|| format!("activating {number}"), is, server.map(|_| ()).ok_or(Status::Disconnected));
    }

    fn asked(&self, nth: usize) -> Option<(u64, u64)> {
        let model = self.world.model();
        let asked = &model.slots[self.slot].instance.asked;
        asked.get(nth % asked.len().max(1)).copied()
    }

    /// Its number is not good any more.
    fn drop_number(&self, id: u64) {
        let mut model = self.world.model();
        let instance = &mut model.slots[self.slot].instance;
        instance.asked.retain(|asked| asked.0 != id);
        instance.stale_asked.push(id);
    }

    fn deactivate(&self, nth: usize) {
        let Some((id, number)) = self.asked(nth) else { return };
        let must = {
            let mut model = self.world.model();
            let one = model.activations.get_mut(&number).filter(|one| one.end.is_none());
            one.map(|one| one.over(Status::NotActivated)).ok_or(Status::WrongId)
        };
        self.drop_number(id);
        self.world.tell(|| format!("slot {}: deactivates {number}", self.slot));
        self.world.count("deactivations");
        self.world.same(|| format!("deactivating {number}"), self.client().deactivate(id), must);
    }

    fn try_event(&self, nth: usize) {
        let Some((id, number)) = self.asked(nth) else { return };
        let must = self.world.model().event_state(number);
        self.world.same(|| format!("how far {number} is"), self.client().state(id), must);
    }

    /// A number that is not good any more stays so.
    fn ask_by_old_number(&self, nth: usize) {
        let id = old_number(&mut self.world.model().slots[self.slot].instance.stale_asked, nth);
        let Some(id) = id else { return };
        let client = self.client();
        let fetched = client.fetch(id, Which::Present, self.patience(), &self.here()).status;
        self.world.same(|| "fetching by an old number".to_owned(), fetched, Status::WrongId.code());
        self.world.same(|| "an old number's state".to_owned(), client.state(id), Err(Status::WrongId));
        self.world.same(|| "deactivating by an old number".to_owned(), client.deactivate(id), Err(Status::WrongId));
    }

    /// Fetches an event, or waits for one.
    fn fetch(&self, nth: usize, waits: bool) {
        let Some((id, number)) = self.asked(nth) else { return };
        let which = if self.world.dice.once_in(2) { Which::Present } else { Which::Next };
        let time = if waits { self.patience() } else { Time::NONE };
        let firings = self.world.model().activations.get(&number).map_or(0, |one| one.firings);
        self.world.tell(|| format!("slot {}: fetches {which:?} of {number}, {time:?}", self.slot));
        let (here, before) = (self.here(), self.before(Awaited::Event(number, which, firings), time));
        let lent = self.client().fetch(id, which, time, &here);
        // SAFETY: an event is lent with status 0.
        let event = (lent.status == 0).then(|| unsafe { *lent.value.cast::<u64>() });
        self.after(&before, event.ok_or(Status::from_code(lent.status)), &here);
        let Some(event) = event else { return self.forget_if_over(id, number) };
        self.world.count("events fetched");
        let mut model = self.world.model();
        if let Some(one) = model.activations.get_mut(&number) {
            one.event = None;
        }
        model.slots[self.slot].instance.looks[FETCHED] = Some((lent.value.addr(), event));
    }

    fn forget_if_over(&self, id: u64, number: u64) {
        let is_over = self.world.model().activations.get(&number).is_none_or(|one| one.end.is_some());
        if is_over {
            self.drop_number(id);
        }
    }

    /// A state: every activation is tested, and some fire.
    fn put_events(&self) {
        if self.puts.replace(true) {
            return;
        }
        self.world.count("puts of events");
        self.world.model().tellers[self.ends.life].lost = false;
        let mut next = self.take_into_test((0, 0));
        let mut testing = self.teller().first();
        while let Some((connection, number)) = self.tested(&testing, next) {
            let Some(fires) = self.test(&testing, number) else { break };
            // What follows is looked for in the same step.
            let index = self.end_test(number);
            self.fire(number, fires);
            next = self.take_into_test((connection, index + 1));
            testing = self.teller().next(testing.id, fires.is_some());
        }
        self.puts.set(false);
    }

    /// The next activation is in the server's hands, if there is one.
    fn take_into_test(&self, from: (u64, u32)) -> Option<(u64, u64)> {
        let (mut model, life) = (self.world.model(), self.ends.life);
        let next = model.next_activation(life, from, true);
        if let Some((_, number)) = next {
            model.tellers[life].tested = Some(number);
            model.activations.get_mut(&number).into_iter().for_each(|one| one.held = true);
        }
        next
    }

    /// That test is of that activation, or there is none.
    fn tested(&self, is: &Testing, next: Option<(u64, u64)>) -> Option<(u64, u64)> {
        let lost = next.is_none() && std::mem::take(&mut self.world.model().tellers[self.ends.life].lost);
        let over = if lost { Status::Overload } else { Status::NoData };
        let must = next.map_or(over.code(), |_| 0);
        self.world.same(|| format!("slot {}: the next test, of {next:?}", self.slot), is.status, must);
        next.filter(|_| is.status == 0)
    }

    /// Tests one; `None`: it came to no end.
    fn test(&self, testing: &Testing, number: u64) -> Option<Option<u64>> {
        let (tests, event) = {
            let mut model = self.world.model();
            model.last += 1;
            let event = model.last;
            let one = model.activations.get_mut(&number)?;
            one.tests += 1;
            (one.tests, event)
        };
        let place = testing.parameter.cast::<u64>();
        // SAFETY: shown with status 0, this test's until it is over; so is the block for its event.
        let is = unsafe {
            testing.event.cast::<u64>().write(event);
            place.read()
        };
        self.world.same(|| format!("the parameter of {number}"), is, parameter(number, tests - 1));
        // SAFETY: as above.
        unsafe { place.write(parameter(number, tests)) };
        self.ramble(self.world.dice.below(2));
        if self.is_over() {
            if self.way_is(Way::Panicked) {
                self.end_test(number);
                self.teller().leave_test(testing.id);
            }
            return None;
        }
        self.give_way();
        Some((!self.world.dice.once_in(3)).then_some(event))
    }

    /// Out of the server's hands; its place.
    fn end_test(&self, number: u64) -> u32 {
        let mut model = self.world.model();
        model.tellers[self.ends.life].tested = None;
        model.put_down(number);
        model.activations.get(&number).map_or(0, |one| one.index)
    }

    fn fire(&self, number: u64, fires: Option<u64>) {
        let Some(event) = fires else { return };
        self.world.tell(|| format!("slot {}: fires {number} with {event}", self.slot));
        self.world.count("firings");
        self.world.model().fire(self.ends.life, number, event);
    }

    /// It is told of an activation.
    pub(super) fn hear_of(&self, number: u64) {
        self.world.count("activations told of");
        self.world.tell(|| format!("slot {}: is told of {number}", self.slot));
        self.ramble(self.world.dice.below(2));
    }

    /// The handler of a firing.
    pub(super) fn hear(&self, number: u64, event: u64, place: usize) {
        self.world.count("firings handled");
        self.world.tell(|| format!("slot {}: handles {event} of {number}", self.slot));
        self.ramble(self.world.dice.below(3));
        self.still(place, event);
    }
}
