//! One schedule: which members, in which order, until told to stop.
//!
//! A cycle: commands, then the members whose period began, in the order of data flow, each followed by the chain of
//! nonperiodic members that its data woke; then `update` of all that ran; then a wait on absolute time.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crossbeam_channel::{Receiver, SendError, Sender};

use super::follow::{Chain, Upstream};
use super::kept::Kept;
use super::member::{Crew, Member};
use super::strand::Job;
use crate::model::fault::FaultSender;
use crate::model::lifecycle::State;
use crate::model::schedule::Schedule;
use crate::model::time::nanoseconds;
use crate::profile::plan::Trigger;
use crate::sys::bell::{Bell, Ring};
use crate::sys::carrier::{self, Carried};
use crate::sys::foreign::Report;
use crate::sys::{clock, watchdog};

/// What an executor may be told. Each is answered when it is done.
enum Command {
    Install(Box<Member>, Sender<Result<usize, String>>),
    Steer(Move, Vec<usize>, Sender<Vec<State>>),
    Remove(usize, Sender<()>),
    Rank(Vec<(usize, u32)>, Sender<()>),
    Inject(usize, u8, Sender<bool>),
    HandOver(usize, Sender<Option<Box<Kept>>>),
    Inherit(usize, Box<Kept>, Sender<Result<(), String>>),
    Blame(usize, Box<Report>),
    Follow(Vec<(usize, Box<[Upstream]>)>),
    Quit,
}

/// What is to become of members.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Move {
    /// `start`, from ready or inactive.
    Start,
    /// `stop`.
    Stop,
    /// `start`; or, after a fault-stop, back to work.
    Raise,
}

impl Move {
    /// Its name in messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Start | Self::Raise => "start",
            Self::Stop => "stop",
        }
    }
}

/// An executor as others see it.
pub struct Executor {
    /// Its name.
    pub name: String,
    bell: Arc<Bell>,
    commands: Sender<Command>,
    thread: Option<Carried>,
    schedule: Schedule,
    stuck: AtomicBool,
}

/// The executor did not answer in time: a callback does not return.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the executor does not answer: one of its callbacks does not return")]
pub struct Stuck;

impl Executor {
    /// Starts an executor thread.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub fn start(name: &str, schedule: Schedule, faults: FaultSender) -> std::io::Result<Self> {
        let (commands, inbox) = crossbeam_channel::unbounded();
        let bell = Bell::new();
        let own = Arc::clone(&bell);
        let title = name.to_owned();
        let kept = schedule.clone();
        let refused = move |reason: &str| tracing::warn!("executor {title}: {reason}");
        let body = move || Run::new(own, inbox, faults).until_quit();
        let thread = carrier::spawn(name, schedule, refused, body)?;
        Ok(Self {
            name: name.to_owned(),
            bell,
            commands,
            thread: Some(thread),
            schedule: kept,
            stuck: AtomicBool::new(false),
        })
    }

    /// True while it can take new members: it answers, and its thread is scheduled as wanted. A thread keeps its schedule
    /// for life.
    #[must_use]
    pub fn serves(&self, schedule: &Schedule) -> bool {
        self.schedule == *schedule && !self.stuck.load(Ordering::Relaxed)
    }

    /// How its thread is scheduled.
    #[must_use]
    pub const fn schedule(&self) -> &Schedule {
        &self.schedule
    }

    /// What wakes it: for the signals of its members.
    #[must_use]
    pub const fn bell(&self) -> &Arc<Bell> {
        &self.bell
    }

    /// Creates and initialises a member; returns its number.
    ///
    /// # Errors
    /// In words, when its constructor or `initialize` failed, or nothing came back within `limit`.
    pub fn install(&self, member: Member, limit: Duration) -> Result<usize, String> {
        let slot = member.slot.name;
        self.ask(limit, |reply| Command::Install(Box::new(member), reply))
            .unwrap_or_else(|stuck| Err(format!("slot {slot}: {stuck}")))
    }

    /// Starts a member; returns the state it is in then.
    ///
    /// # Errors
    /// When nothing came back within `limit`.
    pub fn start_member(&self, member: usize, limit: Duration) -> Result<State, Stuck> {
        let states = self.ask(limit, |reply| Command::Steer(Move::Start, vec![member], reply));
        states.map(|states| states.first().copied().unwrap_or(State::Destroyed))
    }

    /// Stops a member.
    ///
    /// # Errors
    /// When nothing came back within `limit`.
    pub fn stop_member(&self, member: usize, limit: Duration) -> Result<State, Stuck> {
        let states = self.ask(limit, |reply| Command::Steer(Move::Stop, vec![member], reply));
        states.map(|states| states.first().copied().unwrap_or(State::Destroyed))
    }

    /// Starts or stops members, one after the other; the answer, the states that they are in then, comes when it is done.
    #[must_use]
    pub fn steer(&self, act: Move, members: Vec<usize>) -> Receiver<Vec<State>> {
        let (reply, answer) = crossbeam_channel::bounded(1);
        // An executor that is gone answers by hanging up.
        let _ = self.commands.send(Command::Steer(act, members, reply));
        self.bell.wake();
        answer
    }

    /// Destroys a member.
    ///
    /// # Errors
    /// When nothing came back within `limit`.
    pub fn remove(&self, member: usize, limit: Duration) -> Result<(), Stuck> {
        self.ask(limit, |reply| Command::Remove(member, reply))
    }

    /// Sets places in the order of data flow.
    ///
    /// # Errors
    /// When nothing came back within `limit`.
    pub fn rank(&self, ranks: Vec<(usize, u32)>, limit: Duration) -> Result<(), Stuck> {
        self.ask(limit, |reply| Command::Rank(ranks, reply))
    }

    /// Provokes a fault in the member's next `on_execute`; false: it does not run.
    ///
    /// # Errors
    /// When nothing came back within `limit`.
    pub fn inject(&self, member: usize, code: u8, limit: Duration) -> Result<bool, Stuck> {
        self.ask(limit, |reply| Command::Inject(member, code, reply))
    }

    /// What whoever takes the member's slot over is to go on from.
    ///
    /// # Errors
    /// When nothing came back within `limit`.
    pub fn hand_over(&self, member: usize, limit: Duration) -> Result<Option<Box<Kept>>, Stuck> {
        self.ask(limit, |reply| Command::HandOver(member, reply))
    }

    /// Has a member that was not started yet go on from that.
    ///
    /// # Errors
    /// Why it cannot.
    pub fn inherit(&self, member: usize, kept: Box<Kept>, limit: Duration) -> Result<(), String> {
        self.ask(limit, |reply| Command::Inherit(member, kept, reply)).unwrap_or_else(|stuck| Err(stuck.to_string()))
    }

    /// Tells a member what happened on a thread that it started.
    pub fn blame(&self, member: usize, report: Report) {
        // An executor that is gone has no members any more.
        let _ = self.commands.send(Command::Blame(member, Box::new(report)));
        self.bell.wake();
    }

    /// Tells members who may be the root of their faults, nearest first.
    pub fn follow(&self, chains: Vec<(usize, Box<[Upstream]>)>) {
        // As above.
        let _ = self.commands.send(Command::Follow(chains));
        self.bell.wake();
    }

    fn ask<T>(&self, limit: Duration, command: impl FnOnce(Sender<T>) -> Command) -> Result<T, Stuck> {
        // Once it did not answer, nobody waits for it again: a shutdown would take a time-out for each of its slots.
        let limit = if self.stuck.load(Ordering::Relaxed) { Duration::from_millis(1) } else { limit };
        let (reply, answer) = crossbeam_channel::bounded(1);
        self.commands.send(command(reply)).map_err(|_| Stuck)?;
        self.bell.wake();
        let answered = answer.recv_timeout(limit).map_err(|_| Stuck);
        self.stuck.store(answered.is_err(), Ordering::Relaxed);
        answered
    }
}

impl Drop for Executor {
    /// Tells the thread to end; one that hangs in a callback is left behind.
    fn drop(&mut self) {
        let _ = self.commands.send(Command::Quit);
        self.bell.wake();
        let Some(thread) = self.thread.take() else { return };
        let limit = clock::now_ns() + 100_000_000;
        while !thread.is_over() && clock::now_ns() < limit {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

/// The thread's side.
struct Run {
    bell: Arc<Bell>,
    inbox: Receiver<Command>,
    crew: Crew,
    members: Vec<Option<Box<Member>>>,
    order: Vec<usize>,
    ran: Vec<usize>,
    /// Those with timed servers.
    timed: Vec<usize>,
    /// Those that look for silence.
    watchful: Vec<usize>,
}

impl Run {
    fn new(bell: Arc<Bell>, inbox: Receiver<Command>, faults: FaultSender) -> Self {
        let crew = Crew::new(faults);
        let [order, ran, timed, watchful] = [const { Vec::new() }; 4];
        Self { bell, inbox, crew, members: Vec::new(), order, ran, timed, watchful }
    }

    fn until_quit(mut self) {
        loop {
            // The thread may be another one than before.
            self.bell.adopt();
            while let Ok(command) = self.inbox.try_recv() {
                if !self.obey(command) {
                    return;
                }
            }
            self.cycle();
            // Whatever follows may have taken its time.
            self.crew.ended_ns = 0;
            if self.inbox.is_empty() {
                self.bell.wait_until(self.next_due());
            }
        }
    }

    fn obey(&mut self, command: Command) -> bool {
        // Whoever asked may have given up waiting; the command was carried out all the same.
        match command {
            Command::Install(member, reply) => {
                // Whoever asked gave up: what came too late must not stay behind.
                if let Err(SendError(Ok(number))) = reply.send(self.install(member)) {
                    self.remove(number);
                }
            }
            Command::Steer(act, numbers, reply) => {
                let steer = |number: &usize| self.with(*number, |member, crew| _ = member.steer(act, crew));
                let states = numbers.iter().map(steer).collect();
                _ = reply.send(states);
            }
            Command::Remove(number, reply) => {
                self.remove(number);
                _ = reply.send(());
            }
            Command::Rank(ranks, reply) => {
                for (number, rank) in ranks {
                    if let Some(Some(member)) = self.members.get_mut(number) {
                        member.rank = rank;
                    }
                }
                self.sort();
                _ = reply.send(());
            }
            Command::Inject(number, code, reply) => _ = reply.send(self.inject(number, code)),
            Command::HandOver(number, reply) => {
                let mut kept = None;
                self.with(number, |member, crew| kept = member.hand_over(crew).map(Box::new));
                _ = reply.send(kept);
            }
            Command::Inherit(number, kept, reply) => {
                let mut inherited = Ok(());
                self.with(number, |member, _| inherited = member.inherit(&kept));
                _ = reply.send(inherited);
            }
            Command::Blame(number, report) => _ = self.with(number, |member, crew| member.blame(&report, crew)),
            Command::Follow(chains) => chains.into_iter().for_each(|(number, upstream)| self.follow(number, upstream)),
            Command::Quit => return false,
        }
        true
    }

    fn install(&mut self, mut member: Box<Member>) -> Result<usize, String> {
        watchdog::expect(self.crew.fibers.pulse(), member.shelf.shortest_ns());
        if let Err(reason) = member.install(&mut self.crew) {
            member.destroy(&mut self.crew);
            return Err(reason);
        }
        let number = self.members.iter().position(Option::is_none).unwrap_or_else(|| {
            self.members.push(None);
            self.members.len() - 1
        });
        member.signal.assign(number);
        self.members[number] = Some(member);
        self.sort();
        Ok(number)
    }

    fn remove(&mut self, number: usize) {
        self.with(number, Member::destroy);
        if let Some(place) = self.members.get_mut(number) {
            *place = None;
        }
        self.sort();
    }

    fn with(&mut self, number: usize, act: impl FnOnce(&mut Member, &mut Crew)) -> State {
        match self.members.get_mut(number) {
            Some(Some(member)) => {
                act(member, &mut self.crew);
                member.offer(&mut self.crew);
                member.state()
            }
            _ => State::Destroyed,
        }
    }

    fn inject(&mut self, number: usize, code: u8) -> bool {
        match self.members.get_mut(number) {
            Some(Some(member)) if member.state() == State::Active && member.trigger != Trigger::Passive => {
                member.inject.push_back(code);
                true
            }
            _ => false,
        }
    }

    /// Members in the order of data flow.
    fn sort(&mut self) {
        self.order = (0..self.members.len()).filter(|number| self.members[*number].is_some()).collect();
        self.order.sort_by_key(|number| self.members[*number].as_ref().map(|member| member.rank));
        self.ran.reserve(self.members.len());
        let those = |is: fn(&Member) -> bool| {
            let is_one = |number: &usize| self.members[*number].as_deref().is_some_and(is);
            self.order.iter().copied().filter(is_one).collect()
        };
        (self.timed, self.watchful) = (those(Member::is_timed), those(Member::is_watchful));
    }

    fn cycle(&mut self) {
        let now = clock::now_ns();
        if self.crew.look_again_ns <= now {
            self.look_again(now);
        }
        self.go_on_recovering(now);
        self.end_waits(now);
        self.tick(now);
        self.look_for_silence(now);
        for place in 0..self.order.len() {
            let number = self.order[place];
            if self.is_due(number, now) {
                self.execute(number);
                self.chain();
            }
        }
        self.chain();
        while let Some(number) = self.ran.pop() {
            if let Some(member) = &mut self.members[number] {
                member.ran = false;
                member.update(&mut self.crew);
                member.offer(&mut self.crew);
            }
        }
    }

    fn follow(&mut self, number: usize, upstream: Box<[Upstream]>) {
        let Some(Some(member)) = self.members.get_mut(number) else { return };
        match &mut member.chain {
            Some(chain) => chain.change(upstream),
            None => member.chain = (!upstream.is_empty()).then(|| Box::new(Chain::new(upstream))),
        }
    }

    /// Consequences whose root had time to be answered.
    fn look_again(&mut self, now_ns: u64) {
        self.crew.look_again_ns = u64::MAX;
        for member in self.members.iter_mut().flatten() {
            member.look_again(now_ns, &mut self.crew);
            member.offer(&mut self.crew);
            let next_ns = member.chain.as_ref().and_then(|chain| chain.until_ns());
            let next_ns = next_ns.map_or(u64::MAX, |until_ns| until_ns.saturating_add(1));
            self.crew.look_again_ns = self.crew.look_again_ns.min(next_ns);
        }
    }

    /// Cycles of timed servers that are due.
    fn tick(&self, now_ns: u64) {
        self.active_timed().for_each(|member| member.tick(now_ns));
    }

    /// Inputs whose newest value may be too old by now.
    fn look_for_silence(&mut self, now_ns: u64) {
        for place in 0..self.watchful.len() {
            if let Some(Some(member)) = self.members.get_mut(self.watchful[place])
                && member.next_look_ns().is_some_and(|due_ns| due_ns <= now_ns)
            {
                member.look_for_silence(now_ns);
            }
        }
    }

    fn active_timed(&self) -> impl Iterator<Item = &Member> {
        let members = self.timed.iter().filter_map(|number| self.members[*number].as_deref());
        members.filter(|member| member.state() == State::Active)
    }

    /// Recoveries that failed and whose pause is over.
    fn go_on_recovering(&mut self, now_ns: u64) {
        for member in self.members.iter_mut().flatten() {
            if member.breath.as_ref().is_some_and(|breath| breath.until_ns() <= now_ns) {
                member.breathe_out(&mut self.crew);
                member.offer(&mut self.crew);
            }
        }
    }

    /// Members that were rung for, and those that theirs wake.
    fn chain(&mut self) {
        // Bounded, so that a loop of writers cannot starve commands and periods.
        for _ in 0..=self.order.len() * 4 {
            let Some(number) = self.bell.next_ready() else { return };
            self.look(number);
        }
    }

    /// Looks at a member that was rung for.
    fn look(&mut self, number: usize) {
        let Some(Some(member)) = self.members.get_mut(number) else { return };
        let rings = member.signal.take();
        if rings.has_news() {
            member.hear(rings, &mut self.crew);
            member.offer(&mut self.crew);
        }
        if member.strand.waits() {
            member.strand.hold(rings.without(Ring::Wait));
            if rings.has(Ring::Wait) {
                self.go_on(number);
            }
            return;
        }
        if rings.has(Ring::Serve) && member.state() == State::Active {
            self.enter(number, Member::serve);
        }
        let Some(Some(member)) = self.members.get_mut(number) else { return };
        if rings.has(Ring::Data) && member.trigger == Trigger::Nonperiodic {
            if member.strand.waits() {
                member.strand.hold(Ring::Data.into());
            } else {
                self.execute(number);
            }
        }
    }

    fn execute(&mut self, number: usize) {
        if let Some(Some(member)) = self.members.get(number)
            && member.state() == State::Active
        {
            self.enter(number, Member::execute);
        }
    }

    fn go_on(&mut self, number: usize) {
        self.enter(number, Member::go_on);
    }

    /// Enters a callback of a member, from which others of this executor may be asked at once.
    fn enter(&mut self, number: usize, callback: fn(&mut Member, &mut Crew)) {
        let Some(Some(member)) = self.members.get_mut(number) else { return };
        if let Some(limit_ns) = member.asks_at_once() {
            self.crew.aside.enter(number, limit_ns);
        }
        callback(member, &mut self.crew);
        self.crew.aside.leave();
        if self.crew.aside.take_news() {
            self.take_up_aside();
        }
        self.executed(number);
    }

    /// What handlers came to that were entered from within a callback: those first that were entered from within others.
    #[cold]
    fn take_up_aside(&mut self) {
        let next = |members: &[Option<Box<Member>>]| {
            let lanes = members
                .iter()
                .enumerate()
                .filter_map(|(number, member)| Some((member.as_ref()?.lane.as_ref()?.news()?, number)));
            lanes.min()
        };
        while let Some((_, number)) = next(&self.members) {
            if let Some(member) = &mut self.members[number] {
                member.take_up_aside(&mut self.crew);
            }
            self.executed(number);
        }
    }

    /// A member's callback is done, or waits: then its `update` waits as well, and what was rung for.
    fn executed(&mut self, number: usize) {
        let Some(Some(member)) = self.members.get_mut(number) else { return };
        member.offer(&mut self.crew);
        if member.strand.waits() {
            return;
        }
        member.let_in();
        if member.strand.job != Job::Serve && !member.ran {
            member.ran = true;
            self.ran.push(number);
        }
    }

    /// Callbacks whose waiting time is over.
    fn end_waits(&mut self, now_ns: u64) {
        for number in 0..self.members.len() {
            let until_ns = self.members[number].as_ref().and_then(|member| member.strand.until_ns());
            if until_ns.is_some_and(|until_ns| until_ns <= now_ns) {
                self.go_on(number);
            }
        }
    }

    /// True when a period of this member has begun; sets the next one. Periods that are over already are left out and
    /// counted.
    fn is_due(&mut self, number: usize, now_ns: u64) -> bool {
        let Some(member) = &mut self.members[number] else { return false };
        let Trigger::Periodic(period) = member.trigger else { return false };
        if member.state() != State::Active || member.next_due_ns > now_ns {
            return false;
        }
        let period = nanoseconds(period);
        let missed = (now_ns - member.next_due_ns) / period;
        member.next_due_ns += (missed + 1) * period;
        // One that still waits misses this period, too.
        let waits = member.strand.waits();
        member.slot.status.missed.fetch_add(missed + u64::from(waits), Ordering::Relaxed);
        !waits
    }

    fn next_due(&self) -> Option<u64> {
        let members = self.members.iter().flatten();
        let periodic =
            members.filter(|member| member.state() == State::Active && matches!(member.trigger, Trigger::Periodic(_)));
        let breaths = self.members.iter().flatten().filter_map(|member| member.breath.as_ref());
        let waits = self.members.iter().flatten().filter_map(|member| member.strand.until_ns());
        let breaths = breaths.map(|breath| breath.until_ns());
        let ticks = self.active_timed().filter_map(Member::next_tick_ns);
        let watchful = self.watchful.iter().filter_map(|number| self.members[*number].as_deref());
        let looks = watchful.filter_map(Member::next_look_ns);
        let again = Some(self.crew.look_again_ns).filter(|look_again_ns| *look_again_ns != u64::MAX);
        periodic
            .map(|member| member.next_due_ns)
            .chain(breaths)
            .chain(waits)
            .chain(ticks)
            .chain(looks)
            .chain(again)
            .min()
    }
}
