//! A server's operations, and what must come of them.
#![allow(unsafe_code, reason = "the simulation plays the plugins, which write and read through the pointers")]

use component_sdk::status::Status;

use super::client::told;
use super::script::{Actor, Way};

impl Actor<'_> {
    /// The handler of a call.
    pub(super) fn serve(&self, id: u64, number: u64) {
        let dice = &self.world.dice;
        self.world.tell(|| format!("slot {}: serves {number}", self.slot));
        self.ramble(dice.below(3));
        if self.is_over() {
            if self.world.is_right() && self.way_is(Way::Panicked) {
                // What is dropped on the way ends the query.
                self.finish(id, number, Some(Status::Error));
            }
            return;
        }
        match dice.below(16) {
            0..10 => self.finish(id, number, None),
            10..13 => self.world.model().slots[self.slot].instance.kept.push((id, number)),
            13 => self.finish(id, number, Some(Status::Error)),
            14 => {
                self.finish(id, number, None);
                self.ramble(2);
            }
            _ if dice.once_in(4) => {
                let _ = self.answer_on_loan(id, number);
                self.end(Way::Trapped);
            }
            _ => self.finish(id, number, Some(Status::NotAllowed)),
        }
    }

    /// The block for an answer, half written.
    fn answer_on_loan(&self, id: u64, number: u64) -> *mut u8 {
        let provider = &self.ends.provider;
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
        let provider = &self.ends.provider;
        if refusal.is_none() {
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
        model.drop_hand(self.ends.life, number, fate);
        model.slots[self.slot].instance.stale_kept.push(id);
        drop(model);
        let is = refusal.map_or_else(|| provider.answer(id), |status| provider.refuse(id, status));
        self.world.tell(|| format!("slot {}: answers {number} with {refusal:?} -> {is:?}", self.slot));
        self.world.same(|| format!("answering {number}"), is, if is_left { Err(Status::Disconnected) } else { Ok(()) });
        self.world.same(|| format!("answering {number} again"), provider.answer(id), Err(Status::WrongId));
    }

    fn kept(&self, nth: usize) -> Option<(u64, u64)> {
        let mut model = self.world.model();
        let kept = &mut model.slots[self.slot].instance.kept;
        (!kept.is_empty()).then(|| kept.remove(nth % kept.len()))
    }

    pub(super) fn answer_kept(&self, nth: usize) {
        if let Some((id, number)) = self.kept(nth) {
            self.finish(id, number, None);
        }
    }

    pub(super) fn refuse_kept(&self, nth: usize) {
        if let Some((id, number)) = self.kept(nth) {
            self.finish(id, number, Some(Status::NotAllowed));
        }
    }

    /// A number that is not good any more stays so.
    pub(super) fn answer_stale(&self, nth: usize) {
        let id = {
            let mut model = self.world.model();
            let stale = &mut model.slots[self.slot].instance.stale_kept;
            let excess = stale.len().saturating_sub(32);
            stale.drain(..excess);
            stale.get(nth % stale.len().max(1)).copied()
        };
        let Some(id) = id else { return };
        let provider = &self.ends.provider;
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
