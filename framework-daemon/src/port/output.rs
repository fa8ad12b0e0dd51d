//! Output ports: a block is lent, filled by the component, checked, and handed to every connected input by reference.
//!
//! The callbacks of the slot, one thread at a time, lend, fill and send without a lock. Threads that a component started take
//! turns beside them, with blocks of their own, made when they first write.

mod hand_on;
mod readers;

use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use component_sdk::abi::payload::LoanResult;
use component_sdk::object::TypeDescriptor;
use component_sdk::port::Sent;
use component_sdk::status::Status;
use crossbeam_queue::ArrayQueue;

use self::readers::{deliver_one, push, send, worse};
use super::block::Sample;
use super::charge::Accused;
use super::check::{Candidate, Checks, Verdict};
use super::exchange::{Busy, Exchange};
use super::input::InPort;
use super::pattern::outlet::{Cycle, Outlet};
use super::pattern::provider::Openness;
use super::pattern::subscriber::Turn;
use super::pool::{Lost, Pool};
use super::tap::{Heard, Tap, Taps};
use super::wait::Waiter;
use crate::model::fault::Fault;
use crate::model::limits::{SPARE_BLOCKS, SPARE_LINKS};
use crate::sys::clock;

/// One connection: an input port, and the checks on the way to it.
#[derive(Clone)]
pub struct Link {
    /// Where it leads.
    pub target: Arc<InPort>,
    /// Checks of the connection.
    pub checks: Arc<Checks>,
}

impl Link {
    fn way(&self) -> Way {
        let is_judged = !self.checks.is_empty() || !self.target.checks.is_empty();
        match is_judged {
            true => Way::Judged,
            false if self.target.is_plain() => Way::Plain,
            false => Way::Thinned,
        }
    }

    /// Sends a value if it is the reader's turn. `None`: it wants none, or only looks at what passes.
    fn sent(&self, send: impl FnOnce(&Self) -> Sent) -> Option<Sent> {
        if self.target.is_tap() {
            send(self);
            return None;
        }
        let is_next = self.target.turn().map_or(Some(true), Turn::takes)?;
        Some(if is_next { send(self) } else { Sent::Ok })
    }
}

/// What happens to values on their way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
enum Way {
    /// All readers get all of them.
    #[default]
    Plain,
    /// Not all are sent, or not all readers get all of them.
    Thinned,
    /// They are checked besides, or somebody listens.
    Judged,
}

/// Whose call borrows a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Borrower {
    /// A callback of the instance in use: one thread at a time.
    Callback,
    /// A task of the instance in use, whose port it is.
    Task,
    /// A thread that a component started, or a signal handler: it may still write when its instance is gone.
    Other,
}

impl Borrower {
    /// True where the port is this caller's alone, and it may wait.
    pub(super) fn may_call(self) -> bool {
        self != Self::Other
    }
}

/// All connections of an output.
#[derive(Clone, Default)]
struct Table {
    links: Vec<Link>,
    /// Who listens; most have nobody.
    taps: Option<Taps>,
    /// What happens on the way over them.
    way: Way,
}

impl Table {
    /// Blocks that whoever reads or listens may hold at once.
    fn held(&self) -> usize {
        let listening = self.taps.iter().flat_map(|taps| taps.iter()).map(|tap| tap.holds());
        self.links.iter().map(|link| link.target.capacity()).chain(listening).sum()
    }
}

/// What an output does with all that is written to it.
fn own_way(checks: &Checks, outlet: &Outlet) -> Way {
    match (checks.is_empty(), outlet.is_plain()) {
        (false, _) => Way::Judged,
        (true, false) => Way::Thinned,
        (true, true) => Way::Plain,
    }
}

/// Tables kept for the next edit, so that none allocates: as many as are looked at while one is made, as a rule.
const BLANKS: usize = 4;

/// An output port of a slot.
pub struct OutPort {
    /// Name.
    pub name: String,
    /// What it carries.
    pub object: &'static TypeDescriptor,
    /// Checks of the port itself.
    pub checks: Checks,
    outlet: Arc<Outlet>,
    /// Of its slot.
    charges: OnceLock<Arc<dyn Accused>>,
    table: Exchange<Table>,
    blanks: ArrayQueue<Vec<Link>>,
    blocks: Pool,
    // Held for a few instructions in which no memory of a plugin is touched, so that no thread can fault with it.
    aside: Mutex<Pool>,
}

impl OutPort {
    /// An unconnected port.
    #[must_use]
    pub fn new(name: &str, object: &'static TypeDescriptor, checks: Checks) -> Self {
        Self::serving(name, object, checks, Outlet::new(Cycle::default(), Waiter::new()))
    }

    /// An unconnected port that sends when its outlet says so.
    #[must_use]
    pub fn serving(name: &str, object: &'static TypeDescriptor, checks: Checks, outlet: Outlet) -> Self {
        let blocks = Pool::new(object, Lost::Again);
        blocks.grow_to(SPARE_BLOCKS);
        let table = Exchange::new(Table { way: own_way(&checks, &outlet), ..Table::default() });
        let (aside, blanks) = (Mutex::new(Pool::new(object, Lost::Never)), ArrayQueue::new(BLANKS));
        // There is room for each.
        (0..BLANKS).for_each(|_| _ = blanks.push(Vec::with_capacity(SPARE_LINKS)));
        let (name, outlet, charges) = (name.to_owned(), Arc::new(outlet), OnceLock::new());
        Self { name, object, checks, outlet, charges, table, blanks, blocks, aside }
    }

    /// Changes the connections, all at once: a value on its way goes over all old ones or over all new ones, and over those
    /// that stay in any case. Makes blocks for all that the readers can hold, so that no write allocates.
    ///
    /// # Errors
    /// Somebody else changes them all the time.
    pub fn change(&self, change: impl FnOnce(&mut Vec<Link>)) -> Result<(), Busy> {
        let mut links = self.blanks.pop().unwrap_or_default();
        let make = |now: &Table| {
            if links.capacity() <= now.links.len() {
                links.reserve(now.links.len() + SPARE_LINKS);
            }
            links.extend_from_slice(&now.links);
            change(&mut links);
            self.furnish(std::mem::take(&mut links), now.taps.clone())
        };
        let stale = self.table.edit(make);
        // Dropped here, where nothing is held: the last holder of an object frees the memory of a plugin.
        self.keep(links);
        stale?.into_iter().flatten().for_each(|table| self.keep(table.links));
        Ok(())
    }

    /// Changes who listens. Connections are not touched; what is on its way is heard by those before or by these.
    ///
    /// # Errors
    /// Somebody else changes the port all the time.
    pub fn listen(&self, taps: Vec<Arc<dyn Tap>>) -> Result<(), Busy> {
        let mut taps = (!taps.is_empty()).then(|| Taps::from(taps));
        let stale = self.table.edit(|now| self.furnish(now.links.clone(), taps.take()));
        stale?.into_iter().flatten().for_each(|table| self.keep(table.links));
        Ok(())
    }

    /// Who listens.
    #[must_use]
    pub fn taps(&self) -> Option<Taps> {
        self.with_table(Borrower::Other, |table| table.taps.clone()).flatten()
    }

    /// A table of these links, and blocks for it.
    fn furnish(&self, links: Vec<Link>, taps: Option<Taps>) -> Table {
        let ways = links.iter().map(Link::way).chain([own_way(&self.checks, &self.outlet)]);
        let way = ways.chain(taps.as_ref().map(|_| Way::Judged)).max().unwrap_or_default();
        let table = Table { links, taps, way };
        self.blocks.grow_to(table.held() + SPARE_BLOCKS);
        table
    }

    fn keep(&self, mut links: Vec<Link>) {
        links.clear();
        if links.capacity() > 0 {
            // There are enough of them otherwise.
            let _ = self.blanks.push(links);
        }
    }

    /// A reader that is connected.
    ///
    /// # Errors
    /// Too many threads look at the connections.
    pub(super) fn first_target(&self) -> Result<Option<Arc<InPort>>, Busy> {
        self.table.visit(|table| table.links.first().map(|link| Arc::clone(&link.target)))
    }

    /// Says which slot it belongs to; once.
    pub fn belong_to(&self, charges: Arc<dyn Accused>) {
        let _ = self.charges.set(charges);
    }

    /// Who answers for what it sends.
    #[must_use]
    pub fn accused(&self) -> Option<Arc<dyn Accused>> {
        self.charges.get().cloned()
    }

    /// Charges its slot with a fault that somebody else saw. False: it was lost, which is counted, or nobody's.
    pub fn charge(&self, fault: &Fault) -> bool {
        self.charges.get().is_some_and(|charges| charges.charge(fault))
    }

    /// Begins the checks of this port and its connections anew. Called by the thread that enters the slot's callbacks, between
    /// them.
    pub fn forget_episodes(&self) {
        self.with_table(Borrower::Callback, |table| {
            self.checks.forget_episodes();
            for link in &table.links {
                link.checks.forget_episodes();
                link.target.checks.forget_episodes();
                link.target.expect_anew();
            }
            table.taps.iter().flat_map(|taps| taps.iter()).for_each(|tap| tap.begins_anew());
        });
    }

    /// The connections, as they are.
    #[must_use]
    pub fn links(&self) -> Vec<Link> {
        self.with_table(Borrower::Other, |table| table.links.clone()).unwrap_or_default()
    }

    /// Shows the connections; `None`: too many threads look at them.
    #[inline]
    #[allow(unsafe_code, reason = "the callbacks of a slot own its ports")]
    fn with_table<R>(&self, borrower: Borrower, look: impl FnOnce(&Table) -> R) -> Option<R> {
        match borrower {
            // SAFETY: the border calls it so for the instance whose callback runs on this thread, and nothing for a handler that
            // interrupts it; a slot has one such thread at a time. What is done within `look` comes back here for no
            // port of the same slot.
            Borrower::Callback => Some(unsafe { self.table.own(look) }),
            Borrower::Task | Borrower::Other => self.table.visit(look).ok(),
        }
    }

    /// When it sends, and its cycle.
    #[must_use]
    pub const fn outlet(&self) -> &Arc<Outlet> {
        &self.outlet
    }

    /// Begins the cycle of a timed server, and counts anew for every client.
    ///
    /// # Errors
    /// `NotAllowed`: it has none.
    pub fn start(&self) -> Result<(), Status> {
        if self.outlet.start()? {
            self.with_table(Borrower::Other, |table| {
                table.links.iter().filter_map(|link| link.target.turn()).for_each(Turn::reset);
            });
        }
        Ok(())
    }

    /// Ends the cycle of a timed server: its clients are told, and what they have is dropped.
    ///
    /// # Errors
    /// `NotAllowed`: it has none.
    pub fn stop(&self) -> Result<(), Status> {
        if self.outlet.stop()? {
            self.tell(Status::NotActivated);
        }
        Ok(())
    }

    /// Clients that wait for its next value are told why that will not come; those of a cycle that does not run have none any
    /// more.
    pub fn tell(&self, status: Status) {
        let is_running = self.outlet.is_running();
        self.with_table(Borrower::Other, |table| {
            for link in &table.links {
                if !is_running {
                    link.target.forget();
                }
                link.target.end_waits(status);
            }
        });
    }

    /// Whether its slot works from now on. Called by the thread that enters the slot's callbacks, between them.
    pub fn set_open(&self, open: Openness) {
        self.outlet.set_open(open);
        match self.outlet.refusal() {
            Some(status) => {
                // One without a cycle has none to end.
                let _ = self.outlet.stop();
                self.tell(status);
            }
            None if open == Openness::Serving && self.outlet.cycle().started => _ = self.start(),
            None => {}
        }
    }

    /// Its slot is about to be removed or built anew. Any thread.
    pub fn replace(&self) {
        self.outlet.set_open(Openness::Replaced);
        self.tell(Status::ProviderReplaced);
    }

    /// True of what was sent from here.
    pub(super) fn owns(&self, sample: &Sample) -> bool {
        self.blocks.has(sample) || self.aside().has(sample)
    }

    /// Lends a block that no reader holds.
    #[inline]
    pub fn loan(&self, borrower: Borrower) -> LoanResult {
        match borrower {
            Borrower::Callback => self.blocks.lend(),
            Borrower::Task | Borrower::Other => self.aside().lend(),
        }
    }

    /// Takes a block back, unsent; the object in it is whole.
    pub(super) fn give_back(&self, value: *mut u8, borrower: Borrower) {
        let fill = |pool: &Pool| pool.end_loan(value).into_iter().for_each(|sample| sample.fill(0));
        match borrower {
            Borrower::Callback => fill(&self.blocks),
            Borrower::Task | Borrower::Other => fill(&self.aside()),
        }
    }

    /// Sends the block on loan.
    #[inline]
    pub fn publish(&self, value: *mut u8, borrower: Borrower) -> Sent {
        match borrower {
            Borrower::Callback => {
                let send = |table: &Table| match table.way {
                    Way::Plain => self.publish_plainly(&table.links, value),
                    Way::Thinned => self.publish_thinned(&table.links, value),
                    Way::Judged => self.publish_judged(table, value, borrower),
                };
                self.with_table(borrower, send).unwrap_or(Sent::Closed)
            }
            Borrower::Task | Borrower::Other => self.publish_aside(value),
        }
    }

    #[inline]
    fn publish_plainly(&self, links: &[Link], value: *mut u8) -> Sent {
        let Some(sample) = self.blocks.end_loan(value) else { return Sent::Closed };
        // Exact would take longer than all the rest: see `recent_ns` for what an age may be wrong by.
        sample.fill(clock::recent_ns());
        send(links, sample)
    }

    fn publish_thinned(&self, links: &[Link], value: *mut u8) -> Sent {
        if let Some(withheld) = self.outlet.withholds() {
            self.give_back(value, Borrower::Callback);
            return withheld;
        }
        let Some(sample) = self.blocks.end_loan(value) else { return Sent::Closed };
        sample.fill(clock::recent_ns());
        let send = |link: &Link| push(&link.target, Arc::clone(sample));
        links.iter().filter_map(|link| link.sent(send)).reduce(worse).unwrap_or(Sent::Unconnected)
    }

    /// From a thread: with its own count of the connections, so that it may end anywhere.
    fn publish_aside(&self, value: *mut u8) -> Sent {
        let Some(table) = self.with_table(Borrower::Other, Table::clone) else { return Sent::Dropped };
        if table.way != Way::Plain {
            return self.publish_judged(&table, value, Borrower::Other);
        }
        let Some(sample) = self.aside().end_loan(value).cloned() else { return Sent::Closed };
        sample.fill(clock::now_ns());
        send(&table.links, &sample)
    }

    /// Sends the block on loan, judged while it still is: a trap in a check, over a pointer that the component wrote,
    /// leaves no more than a lost loan.
    fn publish_judged(&self, table: &Table, value: *mut u8, borrower: Borrower) -> Sent {
        if let Some(withheld) = self.outlet.withholds() {
            self.give_back(value, borrower);
            return withheld;
        }
        let now_ns = clock::now_ns();
        let share = || match borrower {
            Borrower::Callback => self.blocks.lent(value).cloned(),
            Borrower::Task | Borrower::Other => self.aside().lent(value).cloned(),
        };
        // It holds an object from now on.
        let Some(()) = share().map(|sample| sample.fill(now_ns)) else { return Sent::Closed };
        let charge = |fault: &Fault| self.charge(fault);
        let suspect = |symptom, at_ns| self.charges.get().into_iter().for_each(|slot| slot.suspect(symptom, at_ns));
        let own = Candidate { value, sample: &share, charge: &charge, suspect: &suspect };
        let sent = match table.links.is_empty() && table.taps.is_none() {
            true => Sent::Unconnected,
            false => match self.checks.judge(&self.name, &own, now_ns) {
                Verdict::Pass => self.deliver(table, &own, now_ns),
                Verdict::Instead(held) => self.deliver_held(table, &held, &own, now_ns),
                Verdict::Withhold => Sent::Dropped,
            },
        };
        match borrower {
            Borrower::Callback => _ = self.blocks.end_loan(value),
            Borrower::Task | Borrower::Other => _ = self.aside().end_loan(value),
        }
        sent
    }

    /// Hands an earlier value to every reader and to who listens.
    fn deliver_held(&self, table: &Table, held: &Sample, instead: &Candidate<'_>, now_ns: u64) -> Sent {
        let share = || Some(Arc::clone(held));
        self.deliver(table, &Candidate { value: held.value(), sample: &share, ..*instead }, now_ns)
    }

    /// Hands a value to every reader whose checks let it pass, and then to who listens: what drives something comes first.
    fn deliver(&self, table: &Table, candidate: &Candidate<'_>, now_ns: u64) -> Sent {
        let deliver = |link: &Link| deliver_one(link, candidate, now_ns);
        let sent = table.links.iter().filter_map(|link| link.sent(deliver)).reduce(worse);
        if let Some(taps) = &table.taps {
            let heard = Heard { value: candidate.value, object: self.object, at_ns: now_ns, sample: candidate.sample };
            taps.iter().for_each(|tap| tap.heard(&heard));
        }
        sent.unwrap_or(Sent::Unconnected)
    }

    fn aside(&self) -> MutexGuard<'_, Pool> {
        self.aside.lock().unwrap_or_else(PoisonError::into_inner)
    }
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
        out.change(|links| links.extend(inputs.iter().map(link))).unwrap();
        (out, inputs)
    }

    #[allow(unsafe_code, reason = "the test plays the plugin, which writes and reads through the pointer")]
    fn write(out: &OutPort, number: u64) -> *mut u8 {
        let lent = out.loan(Borrower::Callback);
        // SAFETY: the block on loan is for one u64.
        unsafe { lent.value.cast::<u64>().write(number) };
        assert_eq!(out.publish(lent.value, Borrower::Callback), Sent::Ok);
        lent.value
    }

    #[allow(unsafe_code, reason = "as above")]
    fn read(input: &InPort) -> u64 {
        // SAFETY: a block that was published holds a u64.
        unsafe { *input.read(ReadMode::Newest, Borrower::Callback).value.cast::<u64>() }
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
        assert_eq!(out.publish(lost, Borrower::Callback), Sent::Closed);
        let others: Vec<_> = (0..20).map(|_| out.loan(Borrower::Other).value).collect();
        assert!(!others.contains(&lost));
        assert_eq!(out.publish(lost, Borrower::Other), Sent::Closed);
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
            let mut seen: Vec<_> = inputs.iter().map(|input| (input.read(ReadMode::Newest, Borrower::Callback), 0)).collect();
            let mut number = 0;
            for (reader, count) in writes {
                for _ in 0..count {
                    number += 1;
                    write(&out, number);
                }
                seen[reader] = (inputs[reader].read(ReadMode::Newest, Borrower::Callback), number);
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
