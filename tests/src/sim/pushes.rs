//! What writers and readers of values do, and what must come of it.
#![allow(unsafe_code, reason = "the simulation plays the plugins, which write and read through the pointers")]

use component_sdk::abi::calls::Wait as Time;
use component_sdk::abi::payload::{ReadMode, ReadResult};
use component_sdk::status::Status;
use framework_daemon::port::output::Borrower;

use super::awaited::{Awaited, subscriber};
use super::script::{Actor, Way};

/// Places in `Instance::looks`: of the subscriber's value, and of the queue's.
const UPDATED: usize = 1;
const TAKEN: usize = 2;

impl Actor<'_> {
    pub(super) fn act_on_pushes(&self) {
        let dice = &self.world.dice;
        match dice.below(32) {
            0..12 => self.put(),
            12..17 => self.subscribe(dice.below(4) as u32),
            17 => self.unsubscribe(),
            18..21 => self.update(false),
            21..24 => self.update(true),
            24..28 => self.take_value(dice.once_in(4)),
            28..30 => self.start_cycle(),
            30 => self.stop_cycle(),
            _ => self.ask_for_info(),
        }
    }

    /// Writes a value; now and then it fails in the middle of it, or gives it up.
    fn put(&self) {
        let output = &self.ends.output;
        let lent = output.loan(Borrower::Callback);
        // SAFETY: lent for a `u64`, to this borrower.
        unsafe { lent.value.cast::<u64>().write(u64::MAX) };
        self.give_way();
        if self.world.dice.once_in(64) {
            return self.end(Way::Trapped);
        }
        let (sent, number) = {
            let mut model = self.world.model();
            model.last += 1;
            let number = model.last;
            (model.put(self.ends.life, number), number)
        };
        // SAFETY: as above.
        unsafe { lent.value.cast::<u64>().write(number) };
        let is = output.publish(lent.value, Borrower::Callback);
        self.world.tell(|| format!("slot {}: puts {number} -> {is:?}", self.slot));
        self.world.count("values");
        self.world.same(|| format!("what came of value {number}"), is, sent);
    }

    fn subscribe(&self, prescale: u32) {
        let must = {
            let mut model = self.world.model();
            let reader = &mut model.readers[subscriber(self.ends.life)];
            let must = match (prescale, reader.from) {
                (0, _) => Err(Status::Error),
                (_, None) => Err(Status::Disconnected),
                _ => Ok(()),
            };
            if must.is_ok() && reader.every == 0 {
                (reader.every, reader.seen) = (u64::from(reader.prescale.unwrap_or(prescale)), 0);
                reader.handled.iter_mut().for_each(|handled| handled.seen = 0);
            }
            must
        };
        let is = self.ends.subscriber().subscribe(prescale);
        self.world.tell(|| format!("slot {}: subscribes every {prescale} -> {is:?}", self.slot));
        self.world.count("subscriptions");
        self.world.same(|| "subscribing".to_owned(), is, must);
    }

    fn unsubscribe(&self) {
        self.world.tell(|| format!("slot {}: unsubscribes", self.slot));
        self.world.model().readers[subscriber(self.ends.life)].unsubscribe(Status::Unsubscribed);
        self.ends.inputs[0].unsubscribe();
    }

    /// The newest value, or the next one.
    fn update(&self, waits: bool) {
        let reader = subscriber(self.ends.life);
        if self.world.model().standing(reader) == Err(Status::Unsubscribed) && !self.world.dice.once_in(4) {
            self.subscribe(1 + self.world.dice.below(3) as u32);
        }
        let time = if waits { self.patience() } else { Time::NONE };
        let what = {
            let reader = &self.world.model().readers[reader];
            Awaited::Update(reader.arrivals, reader.ends)
        };
        let (here, before) = (self.here(), self.before(what, time));
        // What it was shown until now is not to be looked at any more.
        self.world.model().slots[self.slot].instance.looks[UPDATED] = None;
        let is = self.ends.inputs[0].update(time, Borrower::Callback, &here);
        // SAFETY: a value that was published.
        let value = is.as_ref().map(|read| unsafe { *read.value.cast::<u64>() }).map_err(|status| *status);
        self.after(&before, value, &here);
        if let (Ok(read), Ok(value)) = (is, value) {
            self.world.count(if waits { "updates waited for" } else { "updates" });
            self.world.model().slots[self.slot].instance.looks[UPDATED] = Some((read.value.addr(), value));
        }
    }

    /// The next value of the queue, or the newest.
    fn take_value(&self, newest: bool) {
        let reader = subscriber(self.ends.life) + 1;
        let mode = if newest { ReadMode::Newest } else { ReadMode::Take };
        let must = {
            let mut model = self.world.model();
            let reader = &mut model.readers[reader];
            let next = if newest { reader.queued.drain(..).next_back() } else { reader.queued.pop_front() };
            reader.shown = next.or(reader.shown);
            if newest { reader.shown } else { next }
        };
        let ReadResult { value, .. } = self.ends.inputs[1].read(mode, Borrower::Callback);
        // SAFETY: a value that was published, or null.
        let is = unsafe { value.cast::<u64>().as_ref() }.copied();
        self.world.tell(|| format!("slot {}: takes {is:?}", self.slot));
        self.world.count(if is.is_some() { "values taken" } else { "nothing taken" });
        self.world.same(|| format!("slot {}: the value of the queue, {mode:?}", self.slot), is, must);
        if let Some(number) = is {
            self.world.model().slots[self.slot].instance.looks[TAKEN] = Some((value.addr(), number));
        }
    }

    fn start_cycle(&self) {
        let must = self.world.model().start_cycle(self.ends.life);
        self.world.tell(|| format!("slot {}: starts its cycle", self.slot));
        self.world.same(|| "starting a cycle".to_owned(), self.ends.output.start(), must);
    }

    fn stop_cycle(&self) {
        let must = self.world.model().stop_cycle(self.ends.life);
        self.world.tell(|| format!("slot {}: stops its cycle", self.slot));
        self.world.same(|| "stopping a cycle".to_owned(), self.ends.output.stop(), must);
    }

    fn ask_for_info(&self) {
        let model = self.world.model();
        let writer = model.readers[subscriber(self.ends.life)].from.map(|life| &model.writers[life]);
        let must = writer.map(|writer| (writer.timed, writer.is_running())).ok_or(Status::Disconnected);
        drop(model);
        let is = self.ends.subscriber().info().map(|info| (info.period_ns != 0, info.running));
        self.world.same(|| "the server's cycle".to_owned(), is, must);
    }

    /// The handler of a cycle.
    pub(super) fn tick(&self) {
        self.world.count("cycles begun");
        self.put();
        self.ramble(self.world.dice.below(2));
    }

    /// The handler of a value that arrived.
    pub(super) fn handle(&self, value: u64, place: usize) {
        self.world.count("values handled");
        self.world.tell(|| format!("slot {}: handles value {value}", self.slot));
        self.ramble(self.world.dice.below(3));
        self.still(place, value);
    }

    /// What lies there is what lay there.
    pub(super) fn still(&self, place: usize, value: u64) {
        if self.way_is(Way::Trapped) {
            return;
        }
        // SAFETY: shown to this callback, and to be shown until it asks for the next one.
        let is = unsafe { *std::ptr::with_exposed_provenance::<u64>(place) };
        self.world.same(|| format!("slot {}: what it looks at", self.slot), is, value);
    }

    /// What it looked at last is there still.
    pub(super) fn look_again(&self) {
        let looks = self.world.model().slots[self.slot].instance.looks;
        looks.into_iter().flatten().for_each(|(place, value)| self.still(place, value));
    }
}
