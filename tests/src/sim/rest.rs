//! When everything rests: nobody waits for what is there, and whoever waits without a deadline waits for somebody who is
//! free to answer.
#![allow(unsafe_code, reason = "the simulation plays the plugins, which read through the pointers")]

use component_sdk::abi::calls::Wait as Time;
use component_sdk::abi::payload::ReadMode;
use component_sdk::status::Status;
use framework_daemon::port::output::Borrower;

use super::awaited::subscriber;
use super::executors::Executors;
use super::model::{Model, PORTS, Provider, SERVERS, State};
use super::naive_pushes::READERS;

/// Waits with a deadline take at most that long.
const DEADLINE_NS: u64 = 2_000;

impl Executors {
    /// Nothing is to be done at this moment: that must not be for a ring that was lost.
    pub(super) fn check_rest(&mut self) {
        self.come_to_rest();
        for slot in 0..self.world.slots.len() {
            self.check_waiting(slot);
            self.check_serving(slot);
        }
        self.world.count("times at rest");
    }

    fn check_waiting(&self, slot: usize) {
        let (world, model) = (&self.world, self.world.model());
        let Some(wait) = model.slots[slot].wait.filter(|_| self.waits(slot)) else { return };
        let end = model.end_of(model.slots[slot].life, wait.what);
        let lets_wait = model.slots[slot].gates[wait.what.gate()].let_wait(wait.closings);
        let circle = (!world.deadlines).then(|| self.circle(&model, slot)).flatten();
        drop(model);
        world.same(|| format!("what slot {slot} waits for, {:?}", wait.what), end, None);
        world.same(|| format!("slot {slot} may wait for {:?}", wait.what), lets_wait, true);
        if world.deadlines && wait.until_ns > world.now_ns() + DEADLINE_NS {
            world.wrong(format!("slot {slot} waits beyond its deadline"));
        }
        if let Some(problem) = circle {
            world.wrong(problem);
        }
    }

    /// Follows those who wait for each other to somebody who does not.
    fn circle(&self, model: &Model, slot: usize) -> Option<String> {
        let mut at = slot;
        for _ in 0..=model.slots.len() {
            let life = model.waits_for[model.slots[at].life]?;
            let Some(next) = model.slots.iter().position(|slot| slot.life == life) else {
                return Some(format!("slot {at} waits for a slot that is no more"));
            };
            if !self.waits(next) || model.slots[next].wait.is_none() {
                return None;
            }
            at = next;
        }
        Some(format!("slot {slot} waits in a ring"))
    }

    fn check_serving(&self, slot: usize) {
        let (world, ends) = (&self.world, self.world.ends(slot));
        let model = world.model();
        let servers = &model.providers[ends.life * SERVERS..(ends.life + 1) * SERVERS];
        let waits: Vec<_> = servers.iter().map(Provider::waits).collect();
        let counts: Vec<_> = servers.iter().map(|server| (server.queue.len(), server.hands.len() as u32)).collect();
        let handled = model.readers[subscriber(ends.life)].handled.as_ref();
        let has_value = handled.is_some_and(|handled| !handled.queue.is_empty());
        let has_tick = model.writers[ends.life].ticked;
        let has_event = !model.listeners[ends.life].queue.is_empty();
        let has_work = model.has_work(ends.life);
        let is_free = model.slots[slot].state == State::Active && !self.waits(slot);
        drop(model);
        world.same(|| format!("something waits for slot {slot}, which is free"), is_free && has_work, false);
        let really: Vec<_> = ends.providers.iter().map(|port| port.waits()).collect();
        world.same(|| format!("calls are to be served at slot {slot}"), really, waits);
        let really = [ends.subscriber().waits(), ends.output.outlet().has_ticked(), ends.events.clients[0].waits()];
        world.same(|| format!("what came in at slot {slot}"), really, [has_value, has_tick, has_event]);
        let really: Vec<_> =
            ends.providers.iter().map(|port| port.counts()).map(|(queue, hands, _)| (queue, hands)).collect();
        world.same(|| format!("calls that wait for slot {slot} and in its hand"), really, counts);
        self.check_counts(slot);
    }

    /// What was dropped was counted.
    fn check_counts(&self, slot: usize) {
        let (world, ends) = (&self.world, self.world.ends(slot));
        let model = world.model();
        let readers = &model.readers[subscriber(ends.life)..][..READERS];
        let values: Vec<_> = readers.iter().map(|reader| (reader.received, reader.dropped)).collect();
        let queued = readers[1].queued.len();
        let teller = &model.tellers[ends.life];
        let activations = teller.clients.iter().map(|(_, client)| model.active(*client)).sum::<usize>();
        let events = (activations, teller.fired, teller.refused);
        let missed = model.writers[ends.life].missed;
        drop(model);
        let really: Vec<_> = ends.inputs.iter().map(|port| port.counts()).collect();
        world.same(|| format!("values that slot {slot} received and lost"), really, values);
        world.same(|| format!("values that wait in the queue of slot {slot}"), ends.inputs[1].queued(), queued);
        world.same(|| format!("events of slot {slot}"), ends.events.servers[0].counts(), events);
        world.same(|| format!("cycles that slot {slot} left out"), ends.output.outlet().counts().1, missed);
    }

    /// Everything stops: then every question has its end, and every place is free again.
    pub(super) fn settle_all(&mut self) {
        self.come_to_rest();
        self.world.set_quiet(true);
        (0..self.world.slots.len()).for_each(|slot| self.stop(slot));
        self.come_to_rest();
        for slot in 0..self.world.slots.len() {
            self.collect(slot);
            self.check_places(slot);
            self.empty_queue(slot);
        }
        let left = self.world.model().calls.len();
        self.world.same(|| "questions without an end".to_owned(), left, 0);
    }

    fn collect(&self, slot: usize) {
        let (world, ends) = (&self.world, self.world.ends(slot));
        let open = std::mem::take(&mut world.model().slots[slot].instance.open);
        for (port, id, number) in open {
            let must = world.model().calls.get(&number).and_then(super::model::Call::end);
            let nobody = |_: u64| Err(framework_daemon::port::wait::NotHere);
            let lent = ends.requestors[port].receive(id, Time::NONE, &nobody);
            // SAFETY: an answer, lent until it is released.
            let answer = (lent.status == 0).then(|| unsafe { *lent.value.cast::<u64>() });
            let is = answer.ok_or(Status::from_code(lent.status));
            world.same(|| format!("the end of {number}"), Some(is), must);
            ends.requestors[port].release(id);
            world.model().let_go(number);
        }
    }

    /// Every value that was not dropped is there, in order.
    fn empty_queue(&self, slot: usize) {
        let (world, ends) = (&self.world, self.world.ends(slot));
        self.check_counts(slot);
        let must: Vec<u64> = world.model().readers[subscriber(ends.life) + 1].queued.drain(..).collect();
        let next = || ends.inputs[1].read(ReadMode::Take, Borrower::Callback).value.cast::<u64>();
        // SAFETY: a value that was published, shown until the next is.
        let is: Vec<u64> = std::iter::from_fn(|| unsafe { next().as_ref() }.copied()).collect();
        world.same(|| format!("what is left in the queue of slot {slot}"), is, must);
    }

    fn check_places(&self, slot: usize) {
        let (world, ends) = (&self.world, self.world.ends(slot));
        for port in 0..PORTS {
            let loans: Vec<u32> = (0..=world.pending).map(|_| ends.requestors[port].loan().status).collect();
            let must: Vec<u32> =
                (0..=world.pending).map(|nth| if nth < world.pending { 0 } else { Status::Overload.code() }).collect();
            world.same(|| format!("free places of slot {slot} port {port}"), loans, must);
        }
        for provider in &ends.providers {
            let (waiting, in_hand, _) = provider.counts();
            world.same(|| format!("what slot {slot} holds after all"), (waiting, in_hand), (0, 0));
        }
    }
}
