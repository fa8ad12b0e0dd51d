//! The loop: take an event, count it, do what follows for others, find its place in the code, write it down, tell it. Recovery never
//! waits for it, so it is no real-time thread: a flood of faults must not take a processor from those who work. Those who depend on
//! a faulty one wait for it to be stopped, so it goes before all others that are none.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, Sender, bounded, select, unbounded};
use serde_json::{Map, Value};

use super::feed::Feed;
use super::handle::{self, Cast, Handler, Line, Reasons};
use super::journal::Journal;
use super::latchkeeper::Latchkeeper;
use super::ledger::{Ledger, Verdict};
use super::order::{Order, Refused, Verb};
use super::{ports, quorum, words};
use crate::exec::emergency::{self, Notice};
use crate::exec::recover::lost_events;
use crate::exec::slot::Slot;
use crate::model::fault::{Evidence, Fault, FaultEvent, FaultSender, Memory, Outcome, RestartRequest, Stage};
use crate::model::ladder::Answer;
use crate::model::limits::{CONSEQUENCE_LINES, CONSEQUENCE_WINDOW, EMERGENCY_KNOWN, EMERGENCY_NOTICES, FAULT_EVENTS};
use crate::model::symptom::Symptom;
use crate::model::time::nanoseconds;
use crate::plugin::symbols::{Origin, Symbols};
use crate::sys::latch::Cause;
use crate::sys::{clock, foreign, latch, thread, trap};

/// The journal, shared with those who note starts, reloads and stops.
pub type SharedJournal = Arc<Mutex<Journal>>;

/// The fault manager's thread, and what it shares with the main loop.
#[derive(Debug)]
pub struct Manager {
    thread: JoinHandle<()>,
    restarts: Receiver<RestartRequest>,
    wishes: Sender<Wish>,
    shared: Arc<Shared>,
}

/// What the fault manager is asked for.
enum Wish {
    /// To handle what runs now; answered when that is settled.
    Adopt(Box<Cast>, Sender<()>),
    /// To let go of it.
    Withdraw(Sender<()>),
    /// To carry out an operator's order.
    Obey(Order),
}

#[derive(Debug, Default)]
struct Shared {
    restart_on_taint: AtomicBool,
    ledger: Mutex<Ledger>,
    feed: Feed,
    reasons: Reasons,
}

impl Shared {
    fn ledger(&self) -> Ledger {
        *self.ledger.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What the fault manager knows, for whoever looks on.
#[derive(Clone, Debug)]
pub struct Outlook(Arc<Shared>, Sender<Wish>);

impl Outlook {
    /// What faults have cost so far.
    #[must_use]
    pub fn ledger(&self) -> Ledger {
        self.0.ledger()
    }

    /// Its newest lines.
    #[must_use]
    pub fn feed(&self) -> &Feed {
        &self.0.feed
    }

    /// Why that slot does not run; `None`: it does, or nobody knows.
    #[must_use]
    pub fn reason(&self, slot: &str) -> Option<String> {
        self.0.reasons.of(slot)
    }

    /// Posts an order; who gave it is told how it ended. Does not wait.
    pub fn order(&self, order: Order) {
        // A fault manager that is gone answers nobody: the daemon ends.
        let _ = self.1.send(Wish::Obey(order));
    }
}

/// Starts the fault manager; returns it and where executors put their events.
///
/// # Errors
/// When the system has no thread left.
pub fn start(journal: SharedJournal) -> std::io::Result<(Manager, FaultSender)> {
    let (sender, inbox) = bounded(FAULT_EVENTS);
    let (listener, notices) = bounded(EMERGENCY_NOTICES);
    emergency::listen(listener);
    let (wishes, wished) = unbounded();
    // One request is enough: the main loop ends at the first.
    let (asks, restarts) = bounded(1);
    let shared = Arc::new(Shared::default());
    let desk = Desk {
        asks,
        shared: Arc::clone(&shared),
        symbols: Symbols::default(),
        handler: Handler::default(),
        slots: Vec::new(),
        notices: Vec::new(),
        consequences: VecDeque::new(),
        latch: Latchkeeper::start(Arc::clone(&journal))?,
        journal,
        lost: lost_events(),
    };
    let thread = thread::spawn("fault-manager", move || {
        thread::hurry();
        desk.serve(&inbox, &notices, &wished);
    })?;
    Ok((Manager { thread, restarts, wishes, shared }, sender))
}

impl Manager {
    /// Waits until all events are written: until every executor is gone, but no longer than `limit`, because one that hangs
    /// in a callback never goes. Returns what faults have cost.
    pub fn finish(self, limit: Duration) -> Ledger {
        let began = Instant::now();
        while !self.thread.is_finished() && began.elapsed() < limit {
            std::thread::sleep(Duration::from_millis(1));
        }
        self.ledger()
    }

    /// Where requests for a restart come.
    #[must_use]
    pub const fn restarts(&self) -> &Receiver<RestartRequest> {
        &self.restarts
    }

    /// From now on suspect memory asks for a restart, or no longer.
    pub fn restart_on_taint(&self, wanted: bool) {
        self.shared.restart_on_taint.store(wanted, Ordering::Relaxed);
    }

    /// What faults have cost so far.
    #[must_use]
    pub fn ledger(&self) -> Ledger {
        self.shared.ledger()
    }

    /// What it knows, for whoever looks on.
    #[must_use]
    pub fn outlook(&self) -> Outlook {
        Outlook(Arc::clone(&self.shared), self.wishes.clone())
    }

    /// Has it handle what runs now; returns when slots that may not run are stopped.
    pub fn adopt(&self, cast: Cast) {
        self.ask(|done| Wish::Adopt(Box::new(cast), done));
    }

    /// Has it let go of what runs, because that is about to change or to end.
    pub fn withdraw(&self) {
        self.ask(Wish::Withdraw);
    }

    fn ask(&self, wish: impl FnOnce(Sender<()>) -> Wish) {
        let (done, answer) = bounded(1);
        if self.wishes.send(wish(done)).is_ok() {
            // It may wait for executors itself, each for a bounded time.
            let _ = answer.recv();
        }
    }
}

/// How long the loop waits where nothing is to be done.
const IDLE: Duration = Duration::from_secs(3600);

/// How long a consequence still waits to be written down behind its root.
fn patience_with(event: &FaultEvent) -> Duration {
    let until_ns = event.fault.detected_ns.saturating_add(nanoseconds(CONSEQUENCE_WINDOW));
    Duration::from_nanos(until_ns.saturating_sub(clock::now_ns()))
}

/// The thread's side.
struct Desk {
    journal: SharedJournal,
    asks: Sender<RestartRequest>,
    shared: Arc<Shared>,
    symbols: Symbols,
    handler: Handler,
    /// What runs, as far as it is handled.
    slots: Vec<Arc<Slot>>,
    notices: Vec<Notice>,
    /// Consequences whose root is not written down yet.
    consequences: VecDeque<FaultEvent>,
    latch: Latchkeeper,
    lost: u64,
}

impl Desk {
    /// Until the last executor is gone.
    fn serve(mut self, inbox: &Receiver<FaultEvent>, notices: &Receiver<Notice>, wishes: &Receiver<Wish>) {
        let (mut notices, mut wishes) = (notices.clone(), wishes.clone());
        loop {
            select! {
                recv(inbox) -> event => match event {
                    Ok(event) => self.receive(event),
                    Err(_) => break,
                },
                recv(ports::shared().rung()) -> _ => self.hear(),
                recv(notices) -> notice => match notice {
                    Ok(notice) => self.note(notice),
                    // Another fault manager of this process hears of the emergency stop.
                    Err(_) => notices = crossbeam_channel::never(),
                },
                recv(wishes) -> wish => match wish {
                    Ok(wish) => self.grant(wish, inbox, &notices),
                    Err(_) => wishes = crossbeam_channel::never(),
                },
                default(self.patience()) => self.take_consequences(),
            }
        }
        while let Some(event) = self.consequences.pop_front() {
            self.take(&event);
        }
        self.latch.finish();
    }

    /// Until when consequences wait to be written down behind their root.
    fn patience(&self) -> Duration {
        self.consequences.front().map_or(IDLE, patience_with)
    }

    /// What is the consequence of a fault that is being answered is written down behind it.
    fn receive(&mut self, event: FaultEvent) {
        if self.handler.waits_for_root(&event) && self.consequences.len() < CONSEQUENCE_LINES {
            self.consequences.push_back(event);
            return;
        }
        self.take(&event);
        self.take_consequences();
    }

    fn take_consequences(&mut self) {
        while let Some(event) = self.consequences.pop_front() {
            if !patience_with(&event).is_zero() && self.handler.waits_for_root(&event) {
                self.consequences.push_front(event);
                return;
            }
            self.take(&event);
        }
    }

    fn grant(&mut self, wish: Wish, inbox: &Receiver<FaultEvent>, notices: &Receiver<Notice>) {
        match wish {
            Wish::Adopt(cast, done) => {
                self.slots = cast.slots();
                let lines = self.handler.adopt(*cast);
                self.follow(lines);
                self.hear();
                let _ = done.send(());
            }
            Wish::Withdraw(done) => {
                self.handler.withdraw();
                self.slots.clear();
                let _ = done.send(());
            }
            Wish::Obey(order) => {
                let allowed = match order.verb {
                    Verb::Clear => self.look_before_clearing(inbox, notices),
                    _ => Ok(()),
                };
                let obeyed = allowed.and_then(|()| self.handler.obey(&order)).map(|(answer, lines)| {
                    self.follow(lines);
                    answer
                });
                (order.answer)(obeyed);
            }
        }
    }

    /// What the emergency stop was raised for is taken note of before it is taken back, or its slot would stay stopped for a fault
    /// that nobody had cleared. It is on its way. Where it had been raised before, whoever wants to clear that knows nothing of
    /// this one: it is named, and stays.
    fn look_before_clearing(
        &mut self,
        inbox: &Receiver<FaultEvent>,
        notices: &Receiver<Notice>,
    ) -> Result<(), Refused> {
        let is_known = latch::mark().is_none_or(|mark| self.handler.may_clear(mark));
        self.catch_up(inbox, notices);
        match latch::mark() {
            Some(mark) if !is_known => {
                self.handler.raises.show(mark);
                Err(Refused::raised_again(self.handler.raises.newest()))
            }
            _ => Ok(()),
        }
    }

    fn catch_up(&mut self, inbox: &Receiver<FaultEvent>, notices: &Receiver<Notice>) {
        let until = Instant::now() + EMERGENCY_KNOWN;
        while latch::mark().is_some_and(|mark| !self.handler.raises.are_told(mark)) {
            select! {
                recv(inbox) -> event => match event {
                    Ok(event) => self.receive(event),
                    Err(_) => return,
                },
                recv(notices) -> notice => match notice {
                    Ok(notice) => self.note(notice),
                    Err(_) => return,
                },
                default(until.saturating_duration_since(Instant::now())) => return,
            }
        }
    }

    /// Passes on what components report; as long as nothing is known of what runs, it waits.
    fn hear(&self) {
        if !self.slots.is_empty() {
            ports::shared().hear(&self.slots);
        }
    }

    /// Writes down what was done about others.
    fn follow(&mut self, lines: Vec<Line>) {
        self.handler.publish(&self.shared.reasons);
        for (kind, fields) in lines {
            handle::log(kind, &fields);
            let written = self.journal.lock().unwrap_or_else(PoisonError::into_inner).tell(kind, fields);
            self.publish(written);
        }
    }

    /// What is told of the emergency stop waits for the fault that it was raised for.
    fn note(&mut self, notice: Notice) {
        if let Notice::Raised { slot, at_ns, is_first, mark, .. } = notice {
            emergency::ring();
            self.handler.raises.hear(mark, slot, at_ns);
            if is_first {
                self.latch.tell(None);
            }
        }
        self.notices.push(notice);
        self.tell_notices();
    }

    fn tell_notices(&mut self) {
        let told = std::mem::take(&mut self.notices);
        let (told, open) = told.into_iter().partition(|notice| self.handler.knows_root_of(notice));
        self.notices = open;
        let told: Vec<Notice> = told;
        let lines = told.into_iter().map(|notice| self.handler.describe(notice)).collect();
        self.follow(lines);
    }

    /// Those who depend on the slot are stopped before anybody looks for the names of functions in files, which takes a hundred
    /// milliseconds the first time, and before anything is written.
    fn take(&mut self, event: &FaultEvent) {
        self.note_lost();
        // Whoever reads of a fault finds it counted.
        let verdict = self.count(event);
        let root = self.handler.root_of(event);
        let sequence = self.journal.lock().unwrap_or_else(PoisonError::into_inner).number();
        let lines = self.handler.take(event, sequence, root);
        let origin = match &event.fault.evidence {
            Evidence::Trap(trap) => self.symbols.origin(trap),
            _ => Origin::default(),
        };
        let written = self.journal.lock().unwrap_or_else(PoisonError::into_inner).fault(sequence, event, &origin, root);
        self.explain_emergency(event, sequence, &written.0);
        self.publish(written);
        tell(event, &origin);
        ports::shared().tell(event, sequence, &describe(&event.fault, &origin));
        self.tell_notices();
        self.follow(lines);
        verdict.into_iter().for_each(|verdict| self.obey(verdict));
    }

    /// What the emergency stop was raised for, for whoever starts the robot anew.
    fn explain_emergency(&mut self, event: &FaultEvent, sequence: u64, line: &Map<String, Value>) {
        let is_cause = event.answer == Answer::Emergency && event.fault.stage == Stage::Confirmed;
        if let Some(mark) = latch::mark().filter(|_| is_cause) {
            let (slot, symptom) = (event.slot.to_owned(), event.fault.symptom.name().to_owned());
            let wall = line.get("wall").and_then(Value::as_f64).unwrap_or_default();
            let cause = Cause { slot, symptom, fault: sequence, wall };
            self.handler.raises.explain(mark, &cause);
            self.latch.tell(Some((mark, cause)));
        }
    }

    fn note_lost(&mut self) {
        let (now, before) = (lost_events(), self.lost);
        if now > before {
            tracing::error!("{} faults came faster than they could be written down", now - before);
            let count = Map::from_iter([("count".into(), (now - before).into())]);
            let written = self.journal.lock().unwrap_or_else(PoisonError::into_inner).tell("lost", count);
            self.publish(written);
            self.lost = now;
            self.handler.raises.give_up();
            let lines = self.handler.look_around();
            self.follow(lines);
        }
    }

    /// Whoever follows the faults sees them also where the journal's disk is full.
    fn publish(&self, (line, written): (Map<String, Value>, std::io::Result<()>)) {
        if let Err(error) = written {
            tracing::error!("the journal cannot be written: {error}");
        }
        if !line.is_empty() {
            self.shared.feed.push(line);
        }
    }

    fn count(&self, event: &FaultEvent) -> Option<Verdict> {
        let on_taint = self.shared.restart_on_taint.load(Ordering::Relaxed);
        let threads = trap::threads_lost() + foreign::lost_threads();
        self.shared.ledger.lock().unwrap_or_else(PoisonError::into_inner).note(event, threads, on_taint)
    }

    fn obey(&self, verdict: Verdict) {
        match verdict {
            // A request waits already, or nobody listens any more: either way the daemon ends.
            Verdict::Restart(request) => _ = self.asks.try_send(request),
            Verdict::Warn(text) => tracing::warn!("{text}; beyond it the daemon asks for a restart"),
        }
    }
}

fn tell(event: &FaultEvent, origin: &Origin) {
    let FaultEvent { slot, class, fault, .. } = event;
    let symptom = fault.symptom.name();
    let message = describe(fault, origin);
    if fault.stage != Stage::Confirmed {
        return tracing::info!("slot {slot} ({class}): {symptom} {}: {message}", fault.stage.kind());
    }
    match event.outcome {
        Outcome::Recovered => {
            let took = event.times.first_callback_ns.unwrap_or_default() as f64 / 1e3;
            let successor = event.successor.unwrap_or_default();
            tracing::warn!(
                "slot {slot} ({class}): {symptom}: {message}; {} -> {successor} works again after {took:.1} us",
                action(event)
            );
        }
        Outcome::Stopped if event.answer == Answer::Emergency => {
            tracing::error!("slot {slot} ({class}): {symptom}: {message}; emergency stop");
        }
        Outcome::Stopped if quorum::is_its_own(event) => {
            tracing::error!("voter {slot}: {symptom}: {message}; whoever depends on it is stopped");
        }
        Outcome::Stopped => tracing::error!("slot {slot} ({class}): {symptom}: {message}; the slot is stopped"),
        Outcome::Failed => tracing::error!("slot {slot} ({class}): {symptom}: {message}; its {} failed", action(event)),
        Outcome::Consequence => {
            let cause = event.cause.unwrap_or_default();
            tracing::warn!(
                "slot {slot} ({class}): {symptom}: {message}; a consequence of what {cause} has, left to that"
            );
        }
        Outcome::Ignored => tracing::info!("slot {slot} ({class}): {symptom}: {message}; ignored, as its rules say"),
    }
}

/// What happened, in words: `SIGSEGV at 0x8 in ticker::step+0x12 (libticker.so), memory suspect`.
fn describe(fault: &Fault, origin: &Origin) -> String {
    let mut text = fault.evidence.text().to_owned();
    match &fault.evidence {
        Evidence::Value { port, field, value, limit } if fault.symptom != Symptom::Overload => {
            text = value_in_words(port.as_str(), field.as_str(), *value, *limit);
        }
        Evidence::Device { .. } => text = words::of_device(&fault.evidence, fault.stage),
        Evidence::Model { .. } | Evidence::Vote { .. } | Evidence::Quorum { .. } => {
            text = words::of_helper(&fault.evidence).unwrap_or(text);
        }
        Evidence::Silence { silent_ns, max_age_ns, .. } => {
            text.push_str(&format!(" heard nothing for {}, at most {}", time(*silent_ns), time(*max_age_ns)));
        }
        _ => {}
    }
    if let Evidence::Trap(trap) = &fault.evidence
        && matches!(trap.signal, libc::SIGSEGV | libc::SIGBUS)
    {
        text.push_str(&format!(" at {:#x}", trap.address));
    }
    if let Evidence::Recovery { took_ns, declared_ns } = &fault.evidence {
        text.push_str(&format!(": {:.3} ms instead of {:.3} ms", *took_ns as f64 / 1e6, *declared_ns as f64 / 1e6));
    }
    let places = [("in", origin.at.as_ref().map(ToString::to_string)), ("called by", origin.caller.clone())];
    for (word, place) in places {
        text.extend(place.map(|place| format!(" {word} {place}")));
    }
    if fault.memory == Memory::Suspect {
        text.push_str(", memory suspect");
    }
    text
}

fn value_in_words(port: &str, field: &str, value: f64, limit: f64) -> String {
    let place = if field.is_empty() { port.to_owned() } else { format!("{port}, field {field}") };
    match (value.is_nan(), limit.is_nan()) {
        (true, true) => place,
        (_, true) => format!("{place}: {value}"),
        _ => format!("{place}: {value}, limit {limit}"),
    }
}

fn time(ns: u64) -> String {
    format!("{:.1} ms", ns as f64 / 1e6)
}

fn action(event: &FaultEvent) -> &'static str {
    match event.answer {
        Answer::Replace => "replacement",
        Answer::Prepare => "spare",
        _ => "reset",
    }
}
