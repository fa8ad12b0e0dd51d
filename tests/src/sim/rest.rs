//! When everything rests: nobody waits for what is there, and whoever waits without a deadline waits for somebody who is
//! free to answer.
#![allow(unsafe_code, reason = "the simulation plays the plugins, which read through the pointers")]

use component_sdk::abi::calls::Wait as Time;
use component_sdk::status::Status;

use super::executors::Executors;
use super::model::{Model, PORTS, State};

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
        let end = model.calls.get(&wait.number).map(super::model::Call::end);
        let lets_wait = model.slots[slot].gates[wait.port].let_wait(wait.closings);
        let circle = (!world.deadlines).then(|| self.circle(&model, slot)).flatten();
        drop(model);
        world.same(|| format!("what slot {slot} waits for, call {}", wait.number), end, Some(None));
        world.same(|| format!("slot {slot} may wait for call {}", wait.number), lets_wait, true);
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
        let provider = &model.providers[ends.life];
        let is_forgotten = model.slots[slot].state == State::Active && !self.waits(slot) && provider.waits();
        let (waits, counts) = (provider.waits(), (provider.queue.len(), provider.hands.len() as u32));
        drop(model);
        world.same(|| format!("something is to be done at slot {slot}"), ends.provider.waits(), waits);
        world.same(|| format!("a call waits for slot {slot}, which is free"), is_forgotten, false);
        let (waiting, in_hand, _) = ends.provider.counts();
        world.same(|| format!("calls that wait for slot {slot} and in its hand"), (waiting, in_hand), counts);
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

    fn check_places(&self, slot: usize) {
        let (world, ends) = (&self.world, self.world.ends(slot));
        for port in 0..PORTS {
            let loans: Vec<u32> = (0..=world.pending).map(|_| ends.requestors[port].loan().status).collect();
            let must: Vec<u32> =
                (0..=world.pending).map(|nth| if nth < world.pending { 0 } else { Status::Overload.code() }).collect();
            world.same(|| format!("free places of slot {slot} port {port}"), loans, must);
        }
        let (waiting, in_hand, _) = ends.provider.counts();
        world.same(|| format!("what slot {slot} holds after all"), (waiting, in_hand), (0, 0));
    }
}
