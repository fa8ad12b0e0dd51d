//! What a server does that answers or takes messages, and what must come of it.
#![allow(unsafe_code, reason = "the simulation plays the plugins, which write and read through the pointers")]

use component_sdk::abi::calls::Wait as Time;
use component_sdk::status::Status;

use super::awaited::{Awaited, taker};
use super::client::told;
use super::model::{InHand, SERVERS, old_number};
use super::script::{Actor, Way};

/// Place of the server that answers among a slot's, and of the one that takes messages.
const ANSWERS: usize = 0;
const TAKES: usize = 1;

impl Actor<'_> {
    /// The handler of a call.
    pub(super) fn serve(&self, id: u64, number: u64) {
        let dice = &self.world.dice;
        self.world.tell(|| format!("slot {}: serves {number}", self.slot));
        if dice.once_in(8) {
            let is = self.ends.providers[ANSWERS].answer(id);
            self.world.same(|| format!("answering {number} with nothing on loan"), is, Err(Status::NotAllowed));
        }
        self.ask_first();
        self.ramble(dice.below(3));
        if self.is_over() {
            if self.world.is_right() && self.way_is(Way::Panicked) {
                // What is dropped on the way ends the query.
                self.finish(id, number, Some(Status::Error));
            }
            return;
        }
        match dice.below(17) {
            0..10 => self.finish(id, number, None),
            10..13 => self.keep(id, number),
            13 => self.finish(id, number, Some(Status::Error)),
            14 => {
                self.finish(id, number, None);
                self.ramble(2);
            }
            15 if dice.once_in(2) => {
                let _ = self.answer_on_loan(id, number);
                self.end(Way::Trapped);
            }
            16 if dice.once_in(2) => {
                self.end(Way::Panicked);
                self.finish(id, number, Some(Status::Error));
            }
            _ => self.finish(id, number, Some(Status::NotAllowed)),
        }
    }

    /// It is answered later; now and then its answer is written now.
    fn keep(&self, id: u64, number: u64) {
        let value = if self.world.dice.once_in(3) { self.answer_on_loan(id, number) } else { std::ptr::null_mut() };
        let mut model = self.world.model();
        let instance = &mut model.slots[self.slot].instance;
        instance.kept.push((ANSWERS, id, number));
        if !value.is_null() {
            // SAFETY: on loan.
            unsafe { value.cast::<u64>().write(told(number)) };
            instance.written.push(number);
        }
    }

    /// Its answer was written when it was kept.
    fn is_written(&self, number: u64) -> bool {
        let mut model = self.world.model();
        let written = &mut model.slots[self.slot].instance.written;
        let place = written.iter().position(|other| *other == number);
        place.map(|place| written.swap_remove(place)).is_some()
    }

    /// The handler of a message: it may last, and ends with it.
    pub(super) fn take(&self, id: u64, number: u64) {
        self.world.tell(|| format!("slot {}: takes {number}", self.slot));
        self.world.count("messages taken");
        self.ramble(self.world.dice.below(3));
        if !self.way_is(Way::Trapped) {
            self.done(id, number);
        }
    }

    /// Waits for a message, where there is no handler.
    pub(super) fn pull(&self, waits: bool) {
        let server = taker(self.ends.life);
        if self.world.model().providers[server].handled {
            let lent = self.ends.providers[TAKES].pull(Time::NONE, &self.here());
            self.world.same(|| "taking what has a handler".to_owned(), lent.status, Status::NotAllowed.code());
            return;
        }
        let time = if waits { self.patience() } else { Time::NONE };
        self.world.tell(|| format!("slot {}: pulls, {time:?}", self.slot));
        let (here, before) = (self.here(), self.before(Awaited::Message, time));
        let lent = self.ends.providers[TAKES].pull(time, &here);
        // SAFETY: a message in hand.
        let number = (lent.status == 0).then(|| unsafe { *lent.value.cast::<u64>() });
        self.after(&before, number.ok_or(Status::from_code(lent.status)), &here);
        if let Some(number) = number {
            self.world.count("messages pulled");
            let mut model = self.world.model();
            let _ = model.next(server);
            model.providers[server].hands.push(InHand { id: lent.id, number, again: false });
            model.slots[self.slot].instance.kept.push((TAKES, lent.id, number));
        }
    }

    /// A message is done with.
    fn done(&self, id: u64, number: u64) {
        let (provider, server) = (&self.ends.providers[TAKES], taker(self.ends.life));
        // SAFETY: the message of a call in hand.
        let still = unsafe { *provider.opened(id).value.cast::<u64>() };
        self.world.same(|| "a message in hand".to_owned(), still, number);
        let mut model = self.world.model();
        model.drop_hand(server, number, Ok(0));
        model.slots[self.slot].instance.stale_kept.push((TAKES, id));
        drop(model);
        self.world.tell(|| format!("slot {}: is done with {number}", self.slot));
        self.world.same(|| format!("the end of message {number}"), provider.refuse(id, Status::Error), Ok(()));
        let again = provider.refuse(id, Status::Error);
        self.world.same(|| format!("the end of message {number} again"), again, Err(Status::WrongId));
    }

    /// The block for an answer, half written.
    fn answer_on_loan(&self, id: u64, number: u64) -> *mut u8 {
        let provider = &self.ends.providers[ANSWERS];
        let opened = provider.opened(id);
        self.world.same(|| format!("opening {number}"), opened.status, 0);
        if opened.status != 0 {
            return std::ptr::null_mut();
        }
        // SAFETY: the request of a call in hand.
        let request = unsafe { *opened.value.cast::<u64>() };
        self.world.same(|| format!("the request {number}"), request, number);
        let lent = provider.answer_loan(id);
        self.world.same(|| format!("the block for the answer to {number}"), lent.status, 0);
        if lent.status == 0 {
            // SAFETY: lent for a `u64`, to this borrower.
            unsafe { lent.value.cast::<u64>().write(u64::MAX) };
        }
        lent.value
    }

    /// Answers a call in hand, or refuses it.
    fn finish(&self, id: u64, number: u64, refusal: Option<Status>) {
        let provider = &self.ends.providers[ANSWERS];
        if !self.is_written(number) && refusal.is_none() {
            let value = self.answer_on_loan(id, number);
            if value.is_null() {
                return;
            }
            self.give_way();
            // SAFETY: still on loan.
            unsafe { value.cast::<u64>().write(told(number)) };
        }
        let mut model = self.world.model();
        let is_left = model.calls.get(&number).is_some_and(|call| call.left);
        let fate = if is_left { Err(Status::Disconnected) } else { refusal.map_or(Ok(told(number)), Err) };
        model.drop_hand(self.ends.life * SERVERS + ANSWERS, number, fate);
        model.slots[self.slot].instance.stale_kept.push((ANSWERS, id));
        drop(model);
        let is = refusal.map_or_else(|| provider.answer(id), |status| provider.refuse(id, status));
        self.world.tell(|| format!("slot {}: answers {number} with {refusal:?} -> {is:?}", self.slot));
        self.world.same(|| format!("answering {number}"), is, if is_left { Err(Status::Disconnected) } else { Ok(()) });
        self.world.same(|| format!("answering {number} again"), provider.answer(id), Err(Status::WrongId));
    }

    fn kept(&self, nth: usize) -> Option<(usize, u64, u64)> {
        let mut model = self.world.model();
        let kept = &mut model.slots[self.slot].instance.kept;
        (!kept.is_empty()).then(|| kept.remove(nth % kept.len()))
    }

    pub(super) fn finish_kept(&self, nth: usize, refusal: Option<Status>) {
        match self.kept(nth) {
            Some((ANSWERS, id, number)) => self.finish(id, number, refusal),
            Some((_, id, number)) => self.done(id, number),
            None => {}
        }
    }

    /// A number that is not good any more stays so.
    pub(super) fn answer_stale(&self, nth: usize) {
        let id = old_number(&mut self.world.model().slots[self.slot].instance.stale_kept, nth);
        let Some((server, id)) = id else { return };
        let provider = &self.ends.providers[server];
        self.world.same(|| "answering by an old number".to_owned(), provider.answer(id), Err(Status::WrongId));
        self.world.same(
            || "refusing by an old number".to_owned(),
            provider.refuse(id, Status::Error),
            Err(Status::WrongId),
        );
        let statuses = [provider.opened(id).status, provider.answer_loan(id).status];
        self.world.same(|| "opening by an old number".to_owned(), statuses, [Status::WrongId.code(); 2]);
    }
}
