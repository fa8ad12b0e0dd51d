//! One client: bytes in, one call at a time, bytes out. It reads nothing while an answer is on its way, and makes nothing more
//! while the client does not read: so all that it holds is bounded.

use std::io::{self, Read};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::time::Instant;

use nix::errno::Errno;
use nix::poll::PollFlags;
use nix::sys::socket::{MsgFlags, send};
use serde_json::Value;

use super::Answered;
use super::answer::Sight;
use super::echo::Echo;
use super::interface::{Method, Refusal};
use super::stream::{Follow, Hz};
use super::wire::{self, Call, Inbox};
use crate::fault::order::Verb;
use crate::model::limits::{CONTROL_IDLE, CONTROL_PATIENCE, CONTROL_REQUEST_BYTES, CONTROL_STREAM_BYTES};

/// Bytes that are read at once.
const CHUNK_BYTES: usize = 64 << 10;

/// A client.
pub(super) struct Session {
    stream: UnixStream,
    inbox: Inbox,
    outbox: Vec<u8>,
    /// Bytes of the outbox that are sent.
    sent: usize,
    doing: Doing,
    more: bool,
    oneway: bool,
    input: Input,
    gone: bool,
    /// When it last came, asked or took something.
    progress: Instant,
}

/// What is on its way.
enum Doing {
    Nothing,
    Follow(Follow),
    Hz(Hz),
    Echo(Echo),
    /// The main loop, or the fault manager, will answer.
    Order,
}

/// What is still to be read.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Input {
    Open,
    /// The client sends no more.
    Ended,
    /// Nothing more is taken from it: it is closed when it has read what it gets.
    Refused,
}

/// What a turn asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Wish {
    /// Nothing.
    None,
    /// A reload.
    Reload,
    /// The fault manager is to do that, to that slot.
    Order(Verb, String),
}

impl Session {
    pub(super) const fn new(stream: UnixStream, now: Instant) -> Self {
        Self {
            stream,
            inbox: Inbox::new(CONTROL_REQUEST_BYTES),
            outbox: Vec::new(),
            sent: 0,
            doing: Doing::Nothing,
            more: false,
            oneway: false,
            input: Input::Open,
            gone: false,
            progress: now,
        }
    }

    pub(super) fn fd(&self) -> BorrowedFd<'_> {
        self.stream.as_fd()
    }

    /// What it waits for; a hang-up is always told.
    pub(super) fn events(&self) -> PollFlags {
        if !self.is_flushed() {
            PollFlags::POLLOUT
        } else if self.is_idle() && self.input == Input::Open {
            PollFlags::POLLIN
        } else {
            PollFlags::empty()
        }
    }

    /// What the system said of its stream.
    pub(super) fn note(&mut self, events: PollFlags, now: Instant) {
        let hung_up = events.intersects(PollFlags::POLLHUP | PollFlags::POLLERR | PollFlags::POLLNVAL);
        let listens = self.is_flushed() && self.is_idle() && self.input == Input::Open;
        if listens && (hung_up || events.contains(PollFlags::POLLIN)) {
            self.receive(now);
        } else if hung_up {
            // Nobody is there who could read an answer.
            self.gone = true;
        }
    }

    fn receive(&mut self, now: Instant) {
        let mut chunk = [0; CHUNK_BYTES];
        match self.stream.read(&mut chunk) {
            Ok(0) => self.input = Input::Ended,
            Ok(count) => {
                self.progress = now;
                self.inbox.put(chunk.get(..count).unwrap_or_default());
            }
            Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => {}
            Err(_) => self.gone = true,
        }
    }

    /// Goes on with what it is at, by at most one call.
    pub(super) fn turn(&mut self, sight: &Sight, now: Instant) -> Wish {
        self.flush(now);
        self.keep_up(sight, now);
        let wish = if self.is_flushed() { self.proceed(sight, now) } else { Wish::None };
        self.flush(now);
        wish
    }

    /// While its client does not read, an echo goes with its port all the same.
    fn keep_up(&mut self, sight: &Sight, now: Instant) {
        let flushed = self.is_flushed();
        let Doing::Echo(echo) = &mut self.doing else { return };
        if flushed || now < echo.due() {
            return;
        }
        let slot = echo.slot().to_owned();
        if let Err(refusal) = sight.directory(&slot).and_then(|directory| echo.follow(&directory, now)) {
            self.doing = Doing::Nothing;
            self.put(Err(refusal), false);
        }
    }

    fn proceed(&mut self, sight: &Sight, now: Instant) -> Wish {
        match &mut self.doing {
            Doing::Nothing => return self.next_call(sight, now),
            Doing::Order => {}
            Doing::Follow(follow) => {
                while self.outbox.len() < CONTROL_STREAM_BYTES
                    && let Some(parameters) = follow.next(sight.outlook.feed())
                {
                    self.outbox.extend(wire::reply(&parameters, true));
                }
            }
            Doing::Hz(hz) if now >= hz.due() => {
                let slot = hz.slot().to_owned();
                let rate = sight.directory(&slot).and_then(|directory| hz.measure(&directory, now));
                let goes_on = rate.is_ok() && self.more;
                self.put(rate, goes_on);
                if !goes_on {
                    self.doing = Doing::Nothing;
                }
            }
            Doing::Hz(_) => {}
            Doing::Echo(echo) if now >= echo.due() => {
                let slot = echo.slot().to_owned();
                match sight.directory(&slot).and_then(|directory| echo.look(&directory, now)) {
                    Ok(values) => values.into_iter().for_each(|value| self.put(Ok(value), true)),
                    Err(refusal) => {
                        self.doing = Doing::Nothing;
                        self.put(Err(refusal), false);
                    }
                }
            }
            Doing::Echo(_) => {}
        }
        Wish::None
    }

    fn next_call(&mut self, sight: &Sight, now: Instant) -> Wish {
        if self.input == Input::Refused {
            return Wish::None;
        }
        let message = match self.inbox.take() {
            Ok(None) => return Wish::None,
            Ok(Some(message)) => message,
            Err(too_long) => {
                self.refuse(Refusal::BadRequest(format!("a request has at most {} bytes", too_long.limit)));
                return Wish::None;
            }
        };
        self.progress = now;
        match Call::parse(&message) {
            Ok(call) => self.obey(&call, sight, now),
            Err(reason) => {
                self.refuse(Refusal::BadRequest(reason));
                Wish::None
            }
        }
    }

    fn obey(&mut self, call: &Call, sight: &Sight, now: Instant) -> Wish {
        (self.more, self.oneway) = (call.more, call.oneway);
        let method = Method::of(call).and_then(|method| sight.admit(&method).map(|()| method));
        let wish = match &method {
            Ok(Method::Reload) => Wish::Reload,
            Ok(Method::Order(verb, slot)) => Wish::Order(*verb, slot.clone()),
            _ => Wish::None,
        };
        if wish != Wish::None {
            self.doing = if self.oneway { Doing::Nothing } else { Doing::Order };
            return wish;
        }
        match method.and_then(|method| Ok((sight.answer(&method)?, method))) {
            Ok((Some(answer), _)) => self.put(Ok(answer), false),
            Ok((None, method)) => self.begin(method, sight, now),
            Err(refusal) => self.put(Err(refusal), false),
        }
        Wish::None
    }

    /// Begins what is answered bit by bit.
    fn begin(&mut self, method: Method, sight: &Sight, now: Instant) {
        // Nobody reads what a call without a reply would give.
        if self.oneway {
            return;
        }
        match method {
            Method::Follow(slot, last) => {
                self.doing = Doing::Follow(Follow::new(sight.outlook.feed(), slot, last));
            }
            Method::Hz(name, window) => {
                let directory = sight.directory(&name.slot);
                match directory.and_then(|directory| Hz::new(&directory, name, window, now)) {
                    Ok(hz) => self.doing = Doing::Hz(hz),
                    Err(refusal) => self.put(Err(refusal), false),
                }
            }
            Method::Echo(name) => {
                let directory = sight.directory(&name.slot);
                match directory.and_then(|directory| Echo::new(directory, name, now)) {
                    Ok(echo) => self.doing = Doing::Echo(echo),
                    Err(refusal) => self.put(Err(refusal), false),
                }
            }
            _ => {}
        }
    }

    /// How that ended which somebody else did for it.
    pub(super) fn answered(&mut self, answer: Answered) {
        if matches!(self.doing, Doing::Order) {
            self.doing = Doing::Nothing;
            self.put(answer, false);
        }
    }

    /// Answers a last time.
    pub(super) fn refuse(&mut self, refusal: Refusal) {
        (self.input, self.oneway) = (Input::Refused, false);
        self.put(Err(refusal), false);
    }

    fn put(&mut self, answer: Result<Value, Refusal>, continues: bool) {
        if self.oneway {
            return;
        }
        self.outbox.extend(match answer {
            Ok(parameters) => wire::reply(&parameters, continues),
            Err(refusal) => wire::error(&refusal.name(), &refusal.parameters()),
        });
    }

    /// Sends what fits.
    pub(super) fn flush(&mut self, now: Instant) {
        while let Some(rest) = self.outbox.get(self.sent..).filter(|rest| !rest.is_empty()) {
            match send(self.stream.as_raw_fd(), rest, MsgFlags::MSG_NOSIGNAL | MsgFlags::MSG_DONTWAIT) {
                Ok(count) => (self.sent, self.progress) = (self.sent + count, now),
                Err(Errno::EINTR) => {}
                Err(Errno::EAGAIN) => return,
                Err(_) => {
                    self.gone = true;
                    return;
                }
            }
        }
        // What one long answer took is given back.
        (self.outbox, self.sent) = (Vec::new(), 0);
    }

    fn is_flushed(&self) -> bool {
        self.outbox.is_empty()
    }

    const fn is_idle(&self) -> bool {
        matches!(self.doing, Doing::Nothing)
    }

    /// Nothing is left to be done for it. Asked after a turn.
    pub(super) fn is_over(&self) -> bool {
        let asks_no_more = match self.input {
            Input::Open => false,
            // After a turn there is no whole call left, or there would be another one.
            Input::Ended => !self.has_call(),
            Input::Refused => true,
        };
        self.gone || (asks_no_more && self.is_idle() && self.is_flushed())
    }

    /// Another call waits already.
    pub(super) fn has_call(&self) -> bool {
        self.is_idle() && self.is_flushed() && self.input != Input::Refused && self.inbox.has_message()
    }

    /// When it wants a turn by itself.
    pub(super) fn due(&self) -> Option<Instant> {
        match &self.doing {
            Doing::Hz(hz) if self.is_flushed() => Some(hz.due()),
            // Also while its client does not read: what it holds belongs to what runs.
            Doing::Echo(echo) => Some(echo.due()),
            _ => None,
        }
    }

    /// Waits for faults, and asks to be woken by the next; true: there is one already.
    pub(super) fn awaits_line(&self, sight: &Sight) -> bool {
        matches!(&self.doing, Doing::Follow(follow) if self.is_flushed() && follow.await_line(sight.outlook.feed()))
    }

    /// Since when it makes room for others, or will; `None`: it has a right to stay.
    pub(super) fn expendable(&self) -> Option<Instant> {
        match (self.is_flushed(), self.is_idle()) {
            (false, _) => Some(self.progress + CONTROL_PATIENCE),
            (true, true) => Some(self.progress + CONTROL_IDLE),
            (true, false) => None,
        }
    }
}
