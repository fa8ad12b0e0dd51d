//! What a callback is given: clock, log, `raise_fault`, checkpoint regions.
//!
//! A plugin has its own copy of every static, so a plugin's own `tracing` goes nowhere: log through the context.

use std::cell::Cell;
use std::fmt::{self, Write};
use std::marker::PhantomData;
use std::os::fd::AsRawFd;
use std::time::Duration;

use abi_stable::std_types::{RSlice, RStr};

use crate::abi::host::HostApi;
use crate::wiring::Wiring;

/// Longest log or fault text in bytes; what goes beyond is cut at a character border.
pub const TEXT_LIMIT: usize = 400;

/// Most bytes of a safe output.
pub const SAFE_OUTPUT_LIMIT: usize = 64;

/// How important a log record is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Level {
    /// The component cannot do its work.
    Error = 1,
    /// Something is not as it should be.
    Warn = 2,
    /// Worth knowing.
    Info = 3,
    /// For the author.
    Debug = 4,
}

/// A moment on the monotonic clock (`CLOCK_MONOTONIC`), in nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Instant(u64);

impl Instant {
    /// The moment that many nanoseconds after the clock's zero.
    #[must_use]
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// Nanoseconds since the clock's zero.
    #[must_use]
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// Time since `earlier`; zero if it is later.
    #[must_use]
    pub const fn since(self, earlier: Self) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0))
    }
}

/// Passed to every callback.
pub struct Context<'a> {
    /// 0: not asked yet. Most callbacks never do, and to look takes as long as the way into one.
    now: Cell<u64>,
    host: &'a HostApi,
    not_send: PhantomData<*const ()>,
}

impl<'a> Context<'a> {
    pub(crate) fn new(now_ns: u64, host: &'a HostApi) -> Self {
        Self { now: Cell::new(now_ns), host, not_send: PhantomData }
    }

    pub(crate) const fn host(&self) -> &'a HostApi {
        self.host
    }

    /// When this callback was entered, as far as the daemon told; when it was asked first, else.
    #[must_use]
    pub fn now(&self) -> Instant {
        if self.now.get() == 0 {
            self.now.set((self.host.clock)());
        }
        Instant(self.now.get())
    }

    /// The clock itself, where a callback measures something.
    #[must_use]
    pub fn clock(&self) -> Instant {
        Instant((self.host.clock)())
    }

    /// Connects and disconnects ports, this component's and others'.
    #[must_use]
    pub const fn wiring(&self) -> Wiring<'a> {
        Wiring::new(self.host)
    }

    /// Waits, at most a week: the callback, not its thread. The executor runs other components meanwhile, and no other
    /// callback of this one. False: the wait was ended before its time, because the component is to stop, or it may not
    /// wait here: only `on_execute` and the handlers of requests may.
    ///
    /// The time does not count towards the callback's deadline, and each stretch between two waits has the whole of it.
    #[must_use = "a wait that was ended asks the callback to come to its end"]
    pub fn sleep(&self, time: Duration) -> bool {
        (self.host.sleep)(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX))
    }

    /// Writes one record to the daemon's log. Never blocks: a full log drops the record and counts it.
    pub fn log(&self, level: Level, text: &str) {
        (self.host.log)(level as u8, RStr::from_str(text));
    }

    /// Formats into a buffer on the stack and logs it; the macros `info!` and kin call this.
    pub fn log_args(&self, level: Level, text: fmt::Arguments<'_>) {
        let mut line = Line::new();
        // A `Line` never fails: it cuts.
        let _ = line.write_fmt(text);
        self.log(level, line.as_str());
    }

    /// Reports a fault of this component (symptom `raised`); the integrator's rules say what follows.
    pub fn raise_fault(&self, text: &str) {
        (self.host.raise_fault)(RStr::from_str(text));
    }

    /// Registers memory outside the component's own fields as part of its checkpoint (the paper's
    /// `critical(void*, int)`), best in `initialize`. Fields are registered by `#[critical]`.
    ///
    /// With a `<checkpoint>` in the profile the region is copied between callbacks, and put back under the same name
    /// into the instance that succeeds this one: plain data only, no pointers. That one may live in another process, when the
    /// daemon was killed and started again; a field or region that holds an address would lead nowhere there.
    pub fn critical(&self, name: &str, region: &'static mut [u8]) {
        (self.host.critical)(RStr::from_str(name), region.as_mut_ptr(), region.len());
    }

    /// Registers what is to be written to `output` if the daemon itself dies by a crash: an actuator's stop command, ready
    /// to send. Nobody computes anything then.
    ///
    /// The same descriptor or device again replaces the bytes; no bytes take them back, which a component does before it
    /// closes the descriptor. At most [`SAFE_OUTPUT_LIMIT`] bytes, and 64 outputs in a process: what goes beyond is not
    /// registered, and the log says so.
    pub fn safe_output(&self, output: &impl AsRawFd, bytes: &[u8]) {
        (self.host.safe_output)(output.as_raw_fd(), RSlice::from_slice(bytes));
    }
}

/// A fixed buffer that cuts instead of growing: a log line must not allocate.
pub(crate) struct Line {
    bytes: [u8; TEXT_LIMIT],
    len: usize,
}

impl Line {
    pub(crate) const fn new() -> Self {
        Self { bytes: [0; TEXT_LIMIT], len: 0 }
    }

    pub(crate) fn as_str(&self) -> &str {
        std::str::from_utf8(&self.bytes[..self.len]).unwrap_or_default()
    }
}

impl Write for Line {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let mut take = text.len().min(TEXT_LIMIT - self.len);
        while !text.is_char_boundary(take) {
            take -= 1;
        }
        self.bytes[self.len..self.len + take].copy_from_slice(&text.as_bytes()[..take]);
        self.len += take;
        Ok(())
    }
}

/// Logs an error: `error!(cx, "lost {device}")`.
#[macro_export]
macro_rules! error {
    ($cx:expr, $($part:tt)*) => { $cx.log_args($crate::context::Level::Error, format_args!($($part)*)) };
}

/// Logs a warning: `warn!(cx, "no echo for {seconds} s")`.
#[macro_export]
macro_rules! warn {
    ($cx:expr, $($part:tt)*) => { $cx.log_args($crate::context::Level::Warn, format_args!($($part)*)) };
}

/// Logs an information: `info!(cx, "opened {device}")`.
#[macro_export]
macro_rules! info {
    ($cx:expr, $($part:tt)*) => { $cx.log_args($crate::context::Level::Info, format_args!($($part)*)) };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_line_is_cut_at_a_character_border() {
        let mut line = Line::new();
        write!(line, "{}é", "x".repeat(TEXT_LIMIT - 1)).unwrap();
        assert_eq!(line.as_str().len(), TEXT_LIMIT - 1);
    }
}
