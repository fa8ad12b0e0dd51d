//! Components that ask and tell each other whatever comes to their minds, over connections that they make and cut
//! themselves, fail now and then, and count: nothing is to be lost or doubled.

use std::hint::black_box;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use component_sdk::prelude::*;

use crate::{Ask, Told, ledger};

/// Numbers of questions: each is given once in a process.
static NUMBERS: AtomicU64 = AtomicU64::new(1);
/// When the crowd began.
static BEGAN: OnceLock<Instant> = OnceLock::new();
/// Questions that a port may have open, where its profile says nothing.
const PENDING: usize = 8;
const PATIENCE: Duration = Duration::from_secs(20);
const CLIENTS: [&str; 4] = ["one", "two", "sends", "hears"];
/// Callbacks from one look at the places to the next.
const BETWEEN_LOOKS: u32 = 50;

/// How far one is on its way to rest. Each step is a callback of its own: nobody is served in the middle of one, and two
/// that waited for each other there would wait for ever.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
enum Rest {
    /// It asks and answers.
    #[default]
    No,
    /// It asks no more; some of its questions are open.
    Settles,
    /// All had their ends. Servers may still have what was given up. So many callbacks ago.
    Waits(u32),
    /// All its places were free again, or its patience ended.
    Full,
}

/// One of many.
#[derive(Component)]
#[component(name = "Member", version = "1.0", periodic = "1ms")]
pub struct Member {
    #[port]
    one: QueryClient<Ask, Told>,
    #[port]
    two: QueryClient<Ask, Told>,
    #[port(handler = on_ask)]
    tells: QueryServer<Ask, Told>,
    #[port]
    sends: SendClient<Ask>,
    #[port(handler = on_note)]
    notes: SendServer<Ask>,
    #[port]
    says: PushServer<Told>,
    #[port(handler = on_told, fifo = 8)]
    hears: PushClient<Told>,
    /// Number of this one; its slot is called `member` and that.
    #[property(default = 0)]
    me: u64,
    /// How many there are.
    #[property(default = 1)]
    members: u64,
    /// How long they are busy.
    #[property(default = 1000)]
    busy_ms: u64,
    /// Draws once in so many end with a trap; 0: none.
    #[property(default = 0)]
    traps: u64,
    dice: u64,
    open: Vec<(bool, u64, QueryId<Told>)>,
    kept: Vec<Pending<Ask, Told>>,
    acts: u64,
    asked: u64,
    answered: u64,
    heard: u64,
    rest: Rest,
}

/// What the answer to a question is.
const fn answer_to(number: u64) -> u64 {
    number * 3 + 1
}

/// What may come of a question besides its answer.
const fn is_expected(status: Status) -> bool {
    matches!(
        status,
        Status::Disconnected
            | Status::ProviderGone
            | Status::ProviderStopped
            | Status::ProviderReplaced
            | Status::NotAllowed
            | Status::Error
            | Status::Overload
            | Status::Cycle
            | Status::Cancelled
            | Status::Timeout
    )
}

impl Callbacks for Member {
    fn initialize(&mut self, _: &mut Context<'_>) -> Outcome {
        // Another one after each fault.
        self.dice = (self.me + 1) * 0x9e37_79b9 + NUMBERS.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }

    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        let busy = Duration::from_millis(self.busy_ms);
        let elapsed = BEGAN.get_or_init(Instant::now).elapsed();
        let is_last = elapsed > busy + PATIENCE;
        match self.rest {
            Rest::No if elapsed < busy => (0..8).for_each(|_| self.act(cx)),
            Rest::No | Rest::Settles => self.settle(is_last, cx),
            Rest::Waits(callbacks) => {
                self.rest = Rest::Waits(callbacks + 1);
                if callbacks.is_multiple_of(BETWEEN_LOOKS) {
                    self.look_at_places(is_last, cx);
                }
            }
            Rest::Full => {}
        }
        Ok(())
    }
}

impl Member {
    fn below(&mut self, end: u64) -> u64 {
        self.dice ^= self.dice << 13;
        self.dice ^= self.dice >> 7;
        self.dice ^= self.dice << 17;
        self.dice % end
    }

    fn port(&mut self, first: bool) -> &mut QueryClient<Ask, Told> {
        if first { &mut self.one } else { &mut self.two }
    }

    fn on_ask(&mut self, cx: &mut Context<'_>, query: Query<'_, Ask, Told>) -> Outcome {
        let told = Told { number: answer_to(query.number), handled: 0 };
        let draw = if self.rest == Rest::No { self.below(16) } else { 0 };
        match draw {
            // More than it may hold would keep others from being heard.
            10..13 if self.kept.len() < 16 => self.kept.push(query.keep()),
            13 => drop(query),
            14 => {
                self.trap();
                let _ = query.refuse(Status::NotAllowed);
            }
            15 => {
                self.act(cx);
                let _ = query.answer(told);
            }
            // Its client may have left.
            _ => _ = query.answer(told),
        }
        Ok(())
    }

    /// Taken once it is here: whatever becomes of this instance, it does not come again.
    fn on_note(&mut self, cx: &mut Context<'_>, note: &Ask) -> Outcome {
        self.right(cx, note.number, "a message came twice", |_| ledger::taken(note.number));
        if self.rest == Rest::No {
            self.act(cx);
        }
        Ok(())
    }

    fn on_told(&mut self, cx: &mut Context<'_>, told: &Told) -> Outcome {
        self.heard += 1;
        self.right(cx, told.number, "half a value", |_| told.handled == answer_to(told.number));
        Ok(())
    }

    fn send(&mut self) {
        let note = self.ask();
        if self.sends.send(note).is_ok() {
            ledger::sent();
        }
    }

    fn say(&mut self) {
        let number = self.ask().number;
        let _ = (self.hears.subscribe(1), self.says.put(Told { number, handled: answer_to(number) }));
    }

    fn act(&mut self, cx: &mut Context<'_>) {
        self.acts += 1;
        let first = self.below(2) == 0;
        match self.below(44) {
            0..7 => self.request(first),
            7..13 => self.query(first, cx),
            13..20 => self.receive(cx),
            20 => {
                if let Some((first, _, id)) = self.open.pop() {
                    self.right(cx, self.me, "a discard", |this| this.port(first).discard(id).is_ok());
                }
            }
            21 => {
                let on = self.below(3) > 0;
                let _ = self.port(first).blocking(on);
            }
            22..27 => self.answer_kept(),
            27..30 => {
                let other = self.below(self.members);
                self.connect(first, other, cx);
            }
            30 => {
                let port = *CLIENTS.get(self.below(4) as usize).unwrap_or(&"one");
                let _ = cx.wiring().disconnect((&self.name(), port));
            }
            31..37 => self.send(),
            37..41 => self.say(),
            41 => {
                let other = self.below(self.members);
                self.join("sends", other, "notes", cx);
            }
            42 => {
                let other = self.below(self.members);
                self.join("hears", other, "says", cx);
            }
            _ => self.trap(),
        }
    }

    fn name(&self) -> String {
        format!("member{}", self.me)
    }

    fn connect(&self, first: bool, other: u64, cx: &Context<'_>) {
        self.join(if first { "one" } else { "two" }, other, "tells", cx);
    }

    fn join(&self, port: &str, other: u64, server: &str, cx: &Context<'_>) {
        let end = cx.wiring().connect((&self.name(), port), (&format!("member{other}"), server));
        // Another one is at it, and has lost its processor: nobody waits for it.
        if let Some(refusal) = end.err().filter(|refusal| refusal.status != Status::Error) {
            error!(cx, "wrong: {refusal}");
        }
    }

    fn right(&mut self, cx: &Context<'_>, number: u64, what: &str, is: impl FnOnce(&mut Self) -> bool) {
        if !is(self) {
            error!(cx, "wrong: {what}, {number}");
        }
    }

    fn ask(&mut self) -> Ask {
        self.asked += 1;
        Ask { todo: 0, number: NUMBERS.fetch_add(1, Ordering::Relaxed) }
    }

    fn request(&mut self, first: bool) {
        let ask = self.ask();
        let number = ask.number;
        if let Ok(id) = self.port(first).request(ask) {
            self.open.push((first, number, id));
        }
    }

    fn query(&mut self, first: bool, cx: &Context<'_>) {
        let (ask, time) = (self.ask(), Duration::from_micros(1 + self.below(2_000)));
        let number = ask.number;
        let end = self.port(first).query_within(ask, time).map(|told| told.number);
        self.judge(number, end, cx);
    }

    fn judge(&mut self, number: u64, end: Result<u64, Status>, cx: &Context<'_>) {
        match end {
            Ok(answer) if answer == answer_to(number) => self.answered += 1,
            Err(status) if is_expected(status) => {}
            end => error!(cx, "wrong: {number} came to {end:?}"),
        }
    }

    fn receive(&mut self, cx: &Context<'_>) {
        if self.open.is_empty() {
            return;
        }
        let nth = self.below(self.open.len() as u64) as usize;
        let (first, number, id) = self.open.swap_remove(nth);
        let time = Duration::from_micros(1 + self.below(1_000));
        let waits = self.below(2) == 0;
        let port = self.port(first);
        let end = if waits { port.receive_wait_within(id, time) } else { port.receive(id) }.map(|told| told.number);
        match end {
            // It is still open.
            Err(Status::NoData | Status::Cancelled | Status::Timeout | Status::Cycle) => {
                self.open.push((first, number, id));
            }
            end => self.judge(number, end, cx),
        }
    }

    fn answer_kept(&mut self) {
        if self.kept.is_empty() {
            return;
        }
        let nth = self.below(self.kept.len() as u64) as usize;
        let pending = self.kept.swap_remove(nth);
        if let Ok(number) = pending.request().map(|ask| ask.number) {
            // Its client may have left.
            let _ = pending.answer(Told { number: answer_to(number), handled: 0 });
        }
    }

    #[allow(unsafe_code, reason = "the write faults, which is its purpose")]
    fn trap(&mut self) {
        // A successor that fails at once would be a recovery that failed, after which the slot stops.
        if self.acts > 20 && self.traps > 0 && self.below(self.traps) == 0 {
            // SAFETY: none.
            unsafe { black_box(8 as *mut u32).write_volatile(1) };
        }
    }

    /// Every question comes to its end.
    fn settle(&mut self, is_last: bool, cx: &Context<'_>) {
        while !self.kept.is_empty() {
            self.answer_kept();
        }
        let _ = (self.one.blocking(true), self.two.blocking(true));
        for (first, number, id) in std::mem::take(&mut self.open) {
            let end = self.port(first).receive_wait_within(id, Duration::from_millis(1)).map(|told| told.number);
            if !matches!(end, Err(Status::Timeout | Status::Cycle)) {
                self.judge(number, end, cx);
            } else if is_last {
                error!(cx, "wrong: a question without an end, {number}: {end:?}");
            } else {
                self.open.push((first, number, id));
            }
        }
        self.rest = if self.open.is_empty() { Rest::Waits(1) } else { Rest::Settles };
    }

    /// Whether every place is free again, and every message was taken.
    fn look_at_places(&mut self, is_last: bool, cx: &Context<'_>) {
        let free = [true, false].map(|first| self.free_places(first, cx));
        let (sent, taken) = ledger::both();
        let is_full = free == [PENDING; 2] && sent == taken;
        if !is_full && is_last {
            error!(cx, "wrong: {free:?} places instead of {PENDING}, {taken} of {sent} messages taken");
        }
        if is_full || is_last {
            self.rest = Rest::Full;
            info!(cx, "settled: {} asked, {} answered, {} heard", self.asked, self.answered, self.heard);
        }
    }

    fn free_places(&mut self, first: bool, cx: &Context<'_>) -> usize {
        self.connect(first, self.me, cx);
        let ids: Vec<_> =
            (0..=PENDING).filter_map(|_| self.port(first).request(Ask { todo: 0, number: 0 }).ok()).collect();
        let free = ids.len();
        for id in ids {
            self.right(cx, 0, "a discard", |this| this.port(first).discard(id).is_ok());
        }
        free
    }
}
