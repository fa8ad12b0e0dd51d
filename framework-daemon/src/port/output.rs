//! Output ports: a block is lent, filled by the component, checked, and handed to every connected input by reference.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use arc_swap::ArcSwap;
use component_sdk::abi::payload::LoanResult;
use component_sdk::object::TypeDescriptor;
use component_sdk::port::Sent;

use super::block::{Block, Sample};
use super::check::{self, Candidate, Checks, Verdict};
use super::input::{InPort, Pushed};
use crate::model::limits::SPARE_BLOCKS;
use crate::sys::clock;

/// One connection: an input port, and the checks on the way to it.
#[derive(Clone)]
pub struct Link {
    /// Where it leads.
    pub target: Arc<InPort>,
    /// Checks of the connection.
    pub checks: Arc<Checks>,
}

/// Whose call borrows a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Borrower {
    /// A callback of the instance in use.
    Callback,
    /// A thread that a component started: it may still write when its instance is gone.
    Other,
}

/// Makes this thread ready to write to ports: its first look at a set of connections would allocate.
pub fn warm_up() {
    let _ = ArcSwap::from_pointee(()).load();
}

/// An output port of a slot.
pub struct OutPort {
    /// Name.
    pub name: String,
    /// What it carries.
    pub object: &'static TypeDescriptor,
    /// Checks of the port itself.
    pub checks: Checks,
    links: ArcSwap<Vec<Link>>,
    /// Something is checked on the way over them.
    judged: AtomicBool,
    // Held for a few instructions in which no memory of a plugin is touched, so that no thread can fault with it.
    blocks: Mutex<Blocks>,
}

#[derive(Default)]
struct Blocks {
    all: Vec<Sample>,
    cursor: usize,
    on_loan: Option<(usize, Borrower)>,
}

impl OutPort {
    /// An unconnected port.
    #[must_use]
    pub fn new(name: &str, object: &'static TypeDescriptor, checks: Checks) -> Self {
        let (links, judged, blocks) = (ArcSwap::default(), AtomicBool::new(false), Mutex::default());
        let port = Self { name: name.to_owned(), object, checks, links, judged, blocks };
        port.connect(Vec::new());
        port
    }

    /// Replaces all connections at once; values on their way over others are not touched. Makes blocks for all that
    /// the readers can hold, so that no write allocates.
    pub fn connect(&self, links: Vec<Link>) {
        let wanted = links.iter().map(|link| link.target.capacity()).sum::<usize>() + SPARE_BLOCKS;
        let mut blocks = self.blocks();
        while blocks.all.len() < wanted {
            blocks.all.push(Arc::new(Block::new(self.object)));
        }
        drop(blocks);
        let is_judged = |link: &Link| !link.checks.is_empty() || !link.target.checks.is_empty();
        let judged = !self.checks.is_empty() || links.iter().any(is_judged);
        // Never a checked connection over which a value slips unchecked.
        self.judged.fetch_or(judged, Ordering::SeqCst);
        self.links.store(Arc::new(links));
        self.judged.store(judged, Ordering::SeqCst);
    }

    /// Begins the checks of this port and its connections anew. Not inlined: where it is called, the executor may go on
    /// on another thread, with other thread-locals.
    #[inline(never)]
    pub fn forget_episodes(&self) {
        if !self.judged.load(Ordering::SeqCst) {
            return;
        }
        self.checks.forget_episodes();
        for link in self.links.load().iter() {
            link.checks.forget_episodes();
            link.target.checks.forget_episodes();
        }
    }

    /// The connections, as they are.
    #[must_use]
    pub fn links(&self) -> Vec<Link> {
        self.links.load().to_vec()
    }

    /// Lends a block that no reader holds.
    pub(super) fn loan(&self, borrower: Borrower) -> LoanResult {
        let mut blocks = self.blocks();
        blocks.forget_lost_loan(self.object);
        let index = blocks.free(self.object);
        blocks.on_loan = Some((index, borrower));
        let block = &blocks.all[index];
        LoanResult { value: block.value(), initialised: block.is_filled() }
    }

    /// Takes a block back, unsent; the object in it is whole.
    pub(super) fn give_back(&self, value: *mut u8) {
        if let Some(block) = self.end_loan(value) {
            block.fill(0);
        }
    }

    /// Sends the block on loan.
    pub(super) fn publish(&self, value: *mut u8) -> Sent {
        let now_ns = clock::now_ns();
        if self.judged.load(Ordering::SeqCst) {
            return self.publish_judged(value, now_ns);
        }
        let Some(sample) = self.end_loan(value) else { return Sent::Closed };
        sample.fill(now_ns);
        let links = self.links.load();
        if links.is_empty() {
            return Sent::Unconnected;
        }
        let pushed = links.iter().map(|link| push(&link.target, Arc::clone(&sample)));
        pushed.fold(Sent::Ok, worse)
    }

    /// Sends the block on loan, judged while it still is: a trap in a check, over a pointer that the component wrote,
    /// leaves no more than a lost loan.
    fn publish_judged(&self, value: *mut u8, now_ns: u64) -> Sent {
        if !self.stamp(value, now_ns) {
            return Sent::Closed;
        }
        // Counted, because a guard that a trap leaves behind would slow this thread down for ever. A count that it
        // leaves keeps one set of connections, once.
        let links = self.links.load_full();
        if links.is_empty() {
            let _ = self.end_loan(value);
            return Sent::Unconnected;
        }
        let share = || self.share(value);
        let own = Candidate { value, sample: &share };
        let sent = match self.checks.judge(&self.name, &own, now_ns) {
            Verdict::Pass => deliver(&links, &own, now_ns),
            Verdict::Instead(held) => deliver_held(&links, &held, now_ns),
            Verdict::Withhold => Sent::Dropped,
        };
        let _ = self.end_loan(value);
        sent
    }

    /// Says that the block on loan holds an object since `now_ns`; false: this one is not on loan.
    fn stamp(&self, value: *mut u8, now_ns: u64) -> bool {
        let sample = self.share(value);
        sample.iter().for_each(|sample| sample.fill(now_ns));
        sample.is_some()
    }

    /// The block on loan, for a reader.
    fn share(&self, value: *mut u8) -> Option<Sample> {
        let blocks = self.blocks();
        let (index, _) = blocks.on_loan?;
        (blocks.all[index].value() == value).then(|| Arc::clone(&blocks.all[index]))
    }

    fn end_loan(&self, value: *mut u8) -> Option<Sample> {
        let mut blocks = self.blocks();
        let (index, _) = blocks.on_loan.take()?;
        (blocks.all[index].value() == value).then(|| Arc::clone(&blocks.all[index]))
    }

    fn blocks(&self) -> MutexGuard<'_, Blocks> {
        self.blocks.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for OutPort {
    /// A block on loan may hold half an object, which nobody may drop.
    fn drop(&mut self) {
        self.blocks().forget_lost_loan(self.object);
    }
}

impl Blocks {
    /// A loan that was never returned belonged to a callback that a trap ended: what lies in its block is half-written,
    /// so it is neither read nor dropped. A block that another thread may still write is never lent again.
    fn forget_lost_loan(&mut self, object: &'static TypeDescriptor) {
        let Some((index, borrower)) = self.on_loan.take() else { return };
        self.all[index].forget_contents();
        if borrower == Borrower::Other {
            let lost = std::mem::replace(&mut self.all[index], Arc::new(Block::new(object)));
            #[allow(clippy::mem_forget, reason = "a thread that the component started may still write it")]
            std::mem::forget(lost);
        }
    }

    /// Index of a block that only this port holds; a new one where readers hold more than they may.
    fn free(&mut self, object: &'static TypeDescriptor) -> usize {
        let count = self.all.len();
        for step in 0..count {
            let index = (self.cursor + step) % count;
            if Arc::get_mut(&mut self.all[index]).is_some() {
                self.cursor = index + 1;
                return index;
            }
        }
        self.all.push(Arc::new(Block::new(object)));
        count
    }
}

/// Hands an earlier value to every reader.
fn deliver_held(links: &[Link], held: &Sample, now_ns: u64) -> Sent {
    deliver(links, &Candidate { value: held.value(), sample: &|| Some(Arc::clone(held)) }, now_ns)
}

/// Hands a value to every reader whose checks let it pass.
fn deliver(links: &[Link], candidate: &Candidate<'_>, now_ns: u64) -> Sent {
    links.iter().map(|link| deliver_one(link, candidate, now_ns)).fold(Sent::Ok, worse)
}

fn deliver_one(link: &Link, candidate: &Candidate<'_>, now_ns: u64) -> Sent {
    match link.checks.judge(&link.target.name, candidate, now_ns) {
        Verdict::Pass => take_in(&link.target, candidate, now_ns),
        Verdict::Instead(held) => {
            take_in(&link.target, &Candidate { value: held.value(), sample: &|| Some(Arc::clone(&held)) }, now_ns)
        }
        Verdict::Withhold => Sent::Dropped,
    }
}

/// The reader's own checks, then its queue.
fn take_in(target: &InPort, candidate: &Candidate<'_>, now_ns: u64) -> Sent {
    let passed = match target.checks.judge(&target.name, candidate, now_ns) {
        Verdict::Pass => (candidate.sample)(),
        Verdict::Instead(held) => Some(held),
        Verdict::Withhold => None,
    };
    passed.map_or(Sent::Dropped, |sample| push(target, sample))
}

fn push(target: &InPort, sample: Sample) -> Sent {
    match target.push(sample) {
        Pushed::Kept | Pushed::OldestLost => Sent::Ok,
        Pushed::NewestLost => Sent::Dropped,
        Pushed::Overload => {
            check::report_overload(&target.name);
            Sent::Dropped
        }
    }
}

/// One reader that did not get it is told.
fn worse(one: Sent, other: Sent) -> Sent {
    if other == Sent::Ok { one } else { other }
}

#[cfg(test)]
mod tests {
    use component_sdk::abi::payload::ReadMode;
    use component_sdk::object::CommObject;
    use proptest::prelude::*;

    use super::*;
    use crate::profile::plan::Queue;

    fn connected(readers: usize) -> (OutPort, Vec<Arc<InPort>>) {
        let out = OutPort::new("out", u64::DESCRIPTOR, Checks::default());
        let input = |_| Arc::new(InPort::new("in", u64::DESCRIPTOR, Queue::Last, Checks::default()));
        let inputs: Vec<_> = (0..readers).map(input).collect();
        let link = |target: &Arc<InPort>| Link { target: Arc::clone(target), checks: Arc::default() };
        out.connect(inputs.iter().map(link).collect());
        (out, inputs)
    }

    #[allow(unsafe_code, reason = "the test plays the plugin, which writes and reads through the pointer")]
    fn write(out: &OutPort, number: u64) -> *mut u8 {
        let lent = out.loan(Borrower::Callback);
        // SAFETY: the block on loan is for one u64.
        unsafe { lent.value.cast::<u64>().write(number) };
        assert_eq!(out.publish(lent.value), Sent::Ok);
        lent.value
    }

    #[allow(unsafe_code, reason = "as above")]
    fn read(input: &InPort) -> u64 {
        // SAFETY: a block that was published holds a u64.
        unsafe { *input.read(ReadMode::Newest).value.cast::<u64>() }
    }

    #[test]
    fn a_block_that_nobody_holds_is_lent_again_with_its_contents() {
        let (out, inputs) = connected(1);
        let used: std::collections::HashSet<_> = (0..100)
            .map(|number| {
                let block = write(&out, number);
                assert_eq!(read(&inputs[0]), number);
                block
            })
            .collect();
        assert!(used.len() <= inputs[0].capacity() + SPARE_BLOCKS, "{} blocks", used.len());
        assert!(out.loan(Borrower::Callback).initialised);
    }

    #[test]
    fn what_a_thread_left_on_loan_is_never_lent_again_and_what_a_callback_left_is_lent_empty() {
        let (out, _inputs) = connected(1);
        let lost = out.loan(Borrower::Other).value;
        let others: Vec<_> = (0..20).map(|number| write(&out, number)).collect();
        assert!(!others.contains(&lost));
        assert_eq!(out.publish(lost), Sent::Closed);
        let half = out.loan(Borrower::Callback).value;
        let again: Vec<_> = std::iter::from_fn(|| Some(out.loan(Borrower::Callback))).take(20).collect();
        assert!(again.iter().any(|lent| lent.value == half && !lent.initialised));
    }

    proptest! {
        /// Whatever is written in between, a reader that does not read again keeps what it looks at.
        #[test]
        fn a_block_that_is_looked_at_is_not_overwritten(writes in prop::collection::vec((0..3usize, 1..5u64), 1..60)) {
            let (out, inputs) = connected(3);
            write(&out, 0);
            let mut seen: Vec<_> = inputs.iter().map(|input| (input.read(ReadMode::Newest), 0)).collect();
            let mut number = 0;
            for (reader, count) in writes {
                for _ in 0..count {
                    number += 1;
                    write(&out, number);
                }
                seen[reader] = (inputs[reader].read(ReadMode::Newest), number);
                for (result, expected) in &seen {
                    #[allow(unsafe_code, reason = "the reader looks at what it was lent")]
                    // SAFETY: not read again since, so the block is still held.
                    let value = unsafe { *result.value.cast::<u64>() };
                    prop_assert_eq!(value, *expected);
                }
            }
        }
    }
}
