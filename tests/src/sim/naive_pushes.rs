//! What must be of pushes: who gets which value, what is shown, what is lost and counted.

use std::collections::VecDeque;

use component_sdk::port::Sent;
use component_sdk::status::Status;
use framework_daemon::port::pattern::provider::Openness;

use super::awaited::End;
use super::model::{Model, refusal};

/// Readers of each life: a subscriber, and a queue.
pub(super) const READERS: usize = 2;

/// The output of a life of a slot.
#[derive(Debug)]
pub(super) struct Writer {
    /// It sends while its cycle runs.
    pub(super) timed: bool,
    /// The cycle starts with the slot.
    pub(super) started: bool,
    pub(super) running: bool,
    /// A cycle has begun, and its handler was not entered.
    pub(super) ticked: bool,
    pub(super) missed: u64,
    pub(super) open: Openness,
    /// Numbers of its readers, in the order in which they were connected.
    pub(super) to: Vec<usize>,
}

impl Writer {
    pub(super) const fn is_running(&self) -> bool {
        !self.timed || self.running
    }
}

/// What of its values enters a handler.
#[derive(Debug)]
pub(super) struct Handled {
    pub(super) every: u64,
    pub(super) room: usize,
    /// Values since it was subscribed.
    pub(super) seen: u64,
    pub(super) queue: VecDeque<u64>,
}

/// An input of a life of a slot.
#[derive(Debug)]
pub(super) struct Reader {
    /// Life of its writer.
    pub(super) from: Option<usize>,
    /// Every n-th value; 0: none.
    pub(super) every: u64,
    /// The profile's word on that.
    pub(super) prescale: Option<u32>,
    /// Values sent since it was subscribed, or its server started.
    pub(super) seen: u64,
    /// What it shows: of the present subscription; of a queue, what was taken last.
    pub(super) shown: Option<u64>,
    pub(super) handled: Option<Handled>,
    /// A queue with that room, which drops its oldest value for a new one, or the new one.
    pub(super) queue: Option<(usize, bool)>,
    pub(super) queued: VecDeque<u64>,
    pub(super) received: u64,
    pub(super) dropped: u64,
    /// Values that arrived, and ends of waits.
    pub(super) arrivals: u64,
    pub(super) ends: u64,
    pub(super) end: Status,
}

impl Reader {
    pub(super) const fn new(queue: Option<(usize, bool)>) -> Self {
        Self {
            from: None,
            every: 0,
            prescale: None,
            seen: 0,
            shown: None,
            handled: None,
            queue,
            queued: VecDeque::new(),
            received: 0,
            dropped: 0,
            arrivals: 0,
            ends: 0,
            end: Status::Error,
        }
    }

    /// A value is sent; `None`: it wants none.
    fn send(&mut self, value: u64) -> Option<Sent> {
        if let Some((room, drops_oldest)) = self.queue {
            return Some(self.enqueue(value, room, drops_oldest));
        }
        if self.every == 0 {
            return None;
        }
        let is_turn = self.seen.is_multiple_of(self.every);
        self.seen += 1;
        if is_turn {
            self.arrive(value);
        }
        Some(Sent::Ok)
    }

    fn enqueue(&mut self, value: u64, room: usize, drops_oldest: bool) -> Sent {
        self.received += 1;
        if self.queued.len() == room {
            self.dropped += 1;
            if !drops_oldest {
                return Sent::Dropped;
            }
            self.queued.pop_front();
        }
        self.queued.push_back(value);
        Sent::Ok
    }

    fn arrive(&mut self, value: u64) {
        (self.shown, self.arrivals, self.received) = (Some(value), self.arrivals + 1, self.received + 1);
        let Some(handled) = &mut self.handled else { return };
        let is_turn = handled.seen.is_multiple_of(handled.every);
        handled.seen += 1;
        if !is_turn {
            return;
        }
        if handled.queue.len() == handled.room {
            handled.queue.pop_front();
            self.dropped += 1;
        }
        handled.queue.push_back(value);
    }

    fn forget(&mut self) {
        if self.queue.is_none() {
            self.shown = None;
            self.handled.iter_mut().for_each(|handled| handled.queue.clear());
        }
    }

    fn end_waits(&mut self, status: Status) {
        (self.ends, self.end) = (self.ends + 1, status);
    }

    /// It wants no values any more.
    pub(super) fn unsubscribe(&mut self, status: Status) {
        self.every = 0;
        self.forget();
        self.end_waits(status);
    }
}

impl Model {
    /// What sending a value must come to.
    pub(super) fn put(&mut self, life: usize, value: u64) -> Sent {
        if !self.writers[life].is_running() {
            return Sent::NotActivated;
        }
        let mut sent = None;
        for reader in self.writers[life].to.clone() {
            if let Some(one) = self.readers[reader].send(value) {
                sent = Some(if one == Sent::Ok { sent.unwrap_or(Sent::Ok) } else { one });
            }
        }
        sent.unwrap_or(Sent::Unconnected)
    }

    /// Readers are told why no value will come; those of a cycle that does not run have none any more.
    pub(super) fn tell(&mut self, life: usize, status: Status) {
        let is_running = self.writers[life].is_running();
        for reader in self.writers[life].to.clone() {
            if !is_running {
                self.readers[reader].forget();
            }
            self.readers[reader].end_waits(status);
        }
    }

    /// The cycle begins.
    pub(super) fn start_cycle(&mut self, life: usize) -> Result<(), Status> {
        let writer = &mut self.writers[life];
        if !writer.timed {
            return Err(Status::NotAllowed);
        }
        if !writer.running {
            (writer.running, writer.ticked) = (true, true);
            for reader in writer.to.clone() {
                self.readers[reader].seen = 0;
            }
        }
        Ok(())
    }

    /// The cycle ends.
    pub(super) fn stop_cycle(&mut self, life: usize) -> Result<(), Status> {
        let writer = &mut self.writers[life];
        if !writer.timed {
            return Err(Status::NotAllowed);
        }
        writer.ticked = false;
        if std::mem::take(&mut writer.running) {
            self.tell(life, Status::NotActivated);
        }
        Ok(())
    }

    /// Its slot works, or does not.
    pub(super) fn open_writer(&mut self, life: usize, open: Openness) {
        let writer = &mut self.writers[life];
        if writer.open != Openness::Replaced {
            writer.open = open;
        }
        let (refused, starts) = (refusal(writer.open), open == Openness::Serving && writer.started);
        if let Some(status) = refused {
            let _ = self.stop_cycle(life);
            self.tell(life, status);
        } else if starts {
            let _ = self.start_cycle(life);
        }
    }

    /// A reader hears that writer no longer.
    pub(super) fn part(&mut self, reader: usize) {
        let Some(life) = self.readers[reader].from.take() else { return };
        self.writers[life].to.retain(|other| *other != reader);
        let one = &mut self.readers[reader];
        if one.queue.is_some() {
            return;
        }
        if self.writers[life].open == Openness::Replaced {
            one.forget();
            one.end_waits(Status::ProviderReplaced);
        } else {
            one.unsubscribe(Status::Disconnected);
        }
    }

    /// A reader hears that writer and no other.
    pub(super) fn join(&mut self, reader: usize, life: usize) {
        self.part(reader);
        let one = &mut self.readers[reader];
        if one.queue.is_none() {
            one.unsubscribe(Status::Disconnected);
        }
        one.from = Some(life);
        self.writers[life].to.push(reader);
    }

    /// Whether there is a value to be had.
    pub(super) fn standing(&self, reader: usize) -> Result<usize, Status> {
        let one = &self.readers[reader];
        let life = one.from.ok_or(Status::Disconnected)?;
        match (one.every, self.writers[life].is_running()) {
            (0, _) => Err(Status::Unsubscribed),
            (_, false) => Err(Status::NotActivated),
            _ => Ok(life),
        }
    }

    /// What a reader shows.
    pub(super) fn newest(&self, reader: usize) -> End {
        self.readers[reader].shown.ok_or_else(|| self.standing(reader).err().unwrap_or(Status::NoData))
    }

    /// How a wait for the next value ended that began at these counts.
    pub(super) fn update_end(&self, reader: usize, arrivals: u64, ends: u64) -> Option<End> {
        let one = &self.readers[reader];
        if one.arrivals != arrivals {
            return Some(self.newest(reader));
        }
        (one.ends != ends).then_some(Err(one.end))
    }
}
