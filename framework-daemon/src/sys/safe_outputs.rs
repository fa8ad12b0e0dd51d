//! Safe outputs: what is written to actuators when the process dies, or when the robot is brought to its safe state.
//!
//! A table of atomics, not a list behind a lock: who reads it is a signal handler, on a thread that may have been struck
//! while it wrote. An output that is replaced is live in two cells for a moment, and the later ticket holds.
#![allow(unsafe_code, reason = "address of unsafe: system calls on descriptors of components")]

use std::sync::atomic::{AtomicI32, AtomicU64, AtomicUsize, Ordering, fence};
use std::time::Duration;

use super::clock;
use crate::model::limits::{ACTUATORS, SAFE_OUTPUT_BYTES, SAFE_OUTPUT_WAIT, SAFE_OUTPUTS};
use crate::model::time::nanoseconds;

/// Why an output was not registered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refused {
    /// Half a command is none.
    #[error("a safe output has at most {SAFE_OUTPUT_BYTES} bytes: not registered")]
    TooLong,
    /// The table is full.
    #[error("{SAFE_OUTPUTS} safe outputs are registered already: not registered")]
    Full,
    /// Nothing is open under that number.
    #[error("the descriptor of a safe output is not open: not registered")]
    NotOpen,
}

const WORDS: usize = SAFE_OUTPUT_BYTES / 8;
/// Some more than may be live: for replacements, and for a cell whose writer never came back.
const CELLS: usize = SAFE_OUTPUTS + 16;

const FREE: u64 = 0;
const FILLING: u64 = 1;
const LIVE: u64 = 2;
const TAG: u64 = 3;

/// Which file a descriptor leads to: device and inode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Identity(u64, u64);

/// A registered output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Output {
    /// Address of the name of the slot that registered it; names are interned, so that one name has one address.
    owner: usize,
    fd: i32,
    identity: Identity,
    bytes: [u8; SAFE_OUTPUT_BYTES],
    len: usize,
}

/// A place in the table: `ticket << 2 | tag`, and the output.
struct Cell {
    state: AtomicU64,
    owner: AtomicUsize,
    fd: AtomicI32,
    device: AtomicU64,
    inode: AtomicU64,
    len: AtomicU64,
    words: [AtomicU64; WORDS],
}

impl Cell {
    const fn new() -> Self {
        Self {
            state: AtomicU64::new(FREE),
            owner: AtomicUsize::new(0),
            fd: AtomicI32::new(-1),
            device: AtomicU64::new(0),
            inode: AtomicU64::new(0),
            len: AtomicU64::new(0),
            words: [const { AtomicU64::new(0) }; WORDS],
        }
    }

    fn fill(&self, output: &Output) {
        // Whoever reads a word of this output sees that the cell is being filled.
        fence(Ordering::Release);
        self.owner.store(output.owner, Ordering::Relaxed);
        self.fd.store(output.fd, Ordering::Relaxed);
        self.device.store(output.identity.0, Ordering::Relaxed);
        self.inode.store(output.identity.1, Ordering::Relaxed);
        self.len.store(output.len as u64, Ordering::Relaxed);
        for (word, bytes) in self.words.iter().zip(output.bytes.chunks_exact(8)) {
            word.store(u64::from_le_bytes(std::array::from_fn(|index| bytes[index])), Ordering::Relaxed);
        }
    }

    /// The output, if it is live and nobody changed it meanwhile.
    fn read(&self) -> Option<(u64, Output)> {
        // In one order with the stores of others: of two that register the same, one sees the other.
        let state = self.state.load(Ordering::SeqCst);
        if state & TAG != LIVE {
            return None;
        }
        let mut bytes = [0; SAFE_OUTPUT_BYTES];
        for (word, bytes) in self.words.iter().zip(bytes.chunks_exact_mut(8)) {
            bytes.copy_from_slice(&word.load(Ordering::Relaxed).to_le_bytes());
        }
        let output = Output {
            owner: self.owner.load(Ordering::Relaxed),
            fd: self.fd.load(Ordering::Relaxed),
            identity: Identity(self.device.load(Ordering::Relaxed), self.inode.load(Ordering::Relaxed)),
            bytes,
            len: (self.len.load(Ordering::Relaxed) as usize).min(SAFE_OUTPUT_BYTES),
        };
        fence(Ordering::Acquire);
        (self.state.load(Ordering::Relaxed) == state).then_some((state, output))
    }

    fn free(&self, state: u64) {
        let _ = self.state.compare_exchange(state, FREE, Ordering::SeqCst, Ordering::Relaxed);
    }
}

/// All outputs.
struct Table {
    cells: [Cell; CELLS],
    tickets: AtomicU64,
}

static TABLE: Table = Table::new();

/// Addresses of the names of those that get the emergency stop; 0: none.
static ARMED: [AtomicUsize; ACTUATORS] = [const { AtomicUsize::new(0) }; ACTUATORS];

/// Registers `bytes` for `fd`, by the slot of that interned name; none: no longer.
///
/// # Errors
/// When they do not fit, or nothing is open there.
pub fn set(slot: &'static str, fd: i32, bytes: &[u8]) -> Result<(), Refused> {
    TABLE.set(slot, fd, bytes)
}

/// From now on the outputs of these slots, of interned names, are those of [`write_armed`].
pub fn arm(slots: &[&'static str]) {
    let addresses = slots.iter().map(|slot| address(slot)).chain(std::iter::repeat(0));
    ARMED.iter().zip(addresses).for_each(|(armed, address)| armed.store(address, Ordering::Release));
}

/// Writes the outputs of all slots that are armed, while the process lives; returns how many were taken whole, at once: what
/// does not is not waited for. Takes no lock
/// and allocates nothing: the caller may be any thread in any state.
#[must_use]
pub fn write_armed() -> u32 {
    TABLE.write(Duration::ZERO, |owner| owner != 0 && ARMED.iter().any(|armed| armed.load(Ordering::Acquire) == owner))
}

/// As [`write_armed`], the outputs of the slot of that interned name; waits for those that do not take their bytes at once,
/// [`SAFE_OUTPUT_WAIT`] for all together.
#[must_use]
pub fn write_of(slot: &'static str) -> u32 {
    TABLE.write(SAFE_OUTPUT_WAIT, |owner| owner == address(slot))
}

fn address(slot: &'static str) -> usize {
    slot.as_ptr().addr()
}

/// Writes all outputs; returns how many were taken whole. Async-signal-safe; `sink` is open to nowhere, or negative.
pub(super) fn write_all(sink: i32) -> u32 {
    TABLE.live().filter(|(_, output)| deliver(output, sink)).count() as u32
}

impl Table {
    const fn new() -> Self {
        Self { cells: [const { Cell::new() }; CELLS], tickets: AtomicU64::new(1) }
    }

    fn live(&self) -> impl Iterator<Item = (u64, Output)> {
        // A cell that changes while it is read is read again, but not for ever.
        self.cells.iter().filter_map(|cell| (0..4).find_map(|_| cell.read()))
    }

    /// Those that take their bytes at once first: one that is stuck holds up only those that are, too.
    fn write(&self, patience: Duration, which: impl Fn(usize) -> bool) -> u32 {
        let mut written = [false; CELLS];
        let limit_ns = clock::now_ns() + nanoseconds(patience);
        for pass in 0..2 {
            for (cell, written) in self.cells.iter().zip(&mut written).filter(|(_, written)| !**written) {
                let wait_ns = if pass == 0 { 0 } else { limit_ns.saturating_sub(clock::now_ns()) };
                let output = (0..4).find_map(|_| cell.read()).filter(|(_, output)| which(output.owner));
                *written = output.is_some_and(|(_, output)| write_now(&output, (wait_ns / 1_000_000) as i32));
            }
        }
        written.iter().filter(|written| **written).count() as u32
    }

    fn set(&self, slot: &'static str, fd: i32, bytes: &[u8]) -> Result<(), Refused> {
        if bytes.is_empty() {
            self.clear(u64::MAX, |output| output.fd == fd);
            return Ok(());
        }
        self.enter(&Output::new(slot, fd, bytes)?)
    }

    fn enter(&self, output: &Output) -> Result<(), Refused> {
        let others = self.live().filter(|(_, other)| !other.is_same(output)).count();
        if others >= SAFE_OUTPUTS {
            return Err(Refused::Full);
        }
        let ticket = self.tickets.fetch_add(1, Ordering::SeqCst);
        let free = |cell: &&Cell| {
            cell.state.compare_exchange(FREE, ticket << 2 | FILLING, Ordering::SeqCst, Ordering::Relaxed).is_ok()
        };
        let cell = self.cells.iter().find(free).ok_or(Refused::Full)?;
        cell.fill(output);
        cell.state.store(ticket << 2 | LIVE, Ordering::SeqCst);
        // Somebody else may register the same at this moment: whoever has the later ticket stays.
        let same = |(_, other): &(u64, Output)| other.is_same(output);
        let newest = self.live().filter(same).map(|(state, _)| state >> 2).max().unwrap_or(ticket);
        self.clear(newest, |other| other.is_same(output));
        Ok(())
    }

    /// Frees those with an earlier ticket.
    fn clear(&self, before: u64, which: impl Fn(&Output) -> bool) {
        for cell in &self.cells {
            if let Some((state, _)) = cell.read().filter(|(state, output)| state >> 2 < before && which(output)) {
                cell.free(state);
            }
        }
    }
}

impl Output {
    fn new(slot: &'static str, fd: i32, bytes: &[u8]) -> Result<Self, Refused> {
        if bytes.len() > SAFE_OUTPUT_BYTES {
            return Err(Refused::TooLong);
        }
        let mut kept = [0; SAFE_OUTPUT_BYTES];
        kept[..bytes.len()].copy_from_slice(bytes);
        let identity = identity(fd).ok_or(Refused::NotOpen)?;
        Ok(Self { owner: address(slot), fd, identity, bytes: kept, len: bytes.len() })
    }

    /// The same descriptor, or another one of the same device: a component that trapped keeps its own open for ever, and
    /// its successor opens a new one.
    fn is_same(&self, other: &Self) -> bool {
        self.fd == other.fd || self.identity == other.identity
    }
}

fn identity(fd: i32) -> Option<Identity> {
    // SAFETY: an all-zero `stat` is valid, and `fstat` fills it.
    let (result, stat) = unsafe {
        let mut stat: libc::stat = std::mem::zeroed();
        (libc::fstat(fd, &raw mut stat), stat)
    };
    (result == 0).then_some(Identity(stat.st_dev, stat.st_ino))
}

/// Writes one output, where its descriptor still leads to the same device; true when all of it was taken.
///
/// The device gets a descriptor of our own and the component's one leads to nowhere from then on: its thread still runs, and
/// the stop must be the last word.
fn deliver(output: &Output, sink: i32) -> bool {
    if identity(output.fd) != Some(output.identity) {
        return false;
    }
    // SAFETY: system calls on descriptors; nothing but numbers is passed.
    let own = unsafe {
        let own = libc::fcntl(output.fd, libc::F_DUPFD_CLOEXEC, 0);
        if own >= 0 && sink >= 0 {
            libc::dup2(sink, output.fd);
        }
        if own >= 0 { own } else { output.fd }
    };
    // SAFETY: as above. A device that takes nothing must not stop the others' outputs; the flag is given back, because the
    // open file may be shared with another process.
    unsafe {
        let flags = libc::fcntl(own, libc::F_GETFL);
        libc::fcntl(own, libc::F_SETFL, flags | libc::O_NONBLOCK);
        let taken = write_within(own, &output.bytes[..output.len]);
        libc::fcntl(own, libc::F_SETFL, flags);
        taken
    }
}

/// Writes to a descriptor that does not block, waiting for room no longer than [`SAFE_OUTPUT_WAIT`].
fn write_within(fd: i32, bytes: &[u8]) -> bool {
    let limit = clock::now_ns() + nanoseconds(SAFE_OUTPUT_WAIT);
    let mut rest = bytes;
    loop {
        // SAFETY: the slice is valid for its length.
        let written = unsafe { libc::write(fd, rest.as_ptr().cast(), rest.len()) };
        rest = &rest[usize::try_from(written).unwrap_or(0).min(rest.len())..];
        if rest.is_empty() || clock::now_ns() > limit {
            return rest.is_empty();
        }
        let mut wait = libc::pollfd { fd, events: libc::POLLOUT, revents: 0 };
        // SAFETY: one valid `pollfd`.
        unsafe { libc::poll(&raw mut wait, 1, 5) };
    }
}

/// True when the descriptor takes bytes within that time.
fn has_room(fd: i32, wait_ms: i32) -> bool {
    let mut wait = libc::pollfd { fd, events: libc::POLLOUT, revents: 0 };
    // SAFETY: one valid `pollfd`.
    unsafe { libc::poll(&raw mut wait, 1, wait_ms) > 0 && wait.revents & libc::POLLOUT != 0 }
}

/// Writes one output where its descriptor still leads to the same device and takes it within that time; true when all of it
/// was taken. The component's descriptor and its flags stay as they are: it lives on.
fn write_now(output: &Output, wait_ms: i32) -> bool {
    if identity(output.fd) != Some(output.identity) || !has_room(output.fd, wait_ms) {
        return false;
    }
    let bytes = &output.bytes[..output.len];
    // SAFETY: the slice is valid for its length.
    let written = unsafe { libc::write(output.fd, bytes.as_ptr().cast(), bytes.len()) };
    usize::try_from(written) == Ok(bytes.len())
}

#[cfg(test)]
mod tests {
    use std::io::{PipeReader, Read};
    use std::os::fd::AsRawFd;

    use super::*;

    fn outputs(table: &Table) -> Vec<(i32, Vec<u8>)> {
        let mut outputs: Vec<_> =
            table.live().map(|(_, output)| (output.fd, output.bytes[..output.len].to_vec())).collect();
        outputs.sort();
        outputs
    }

    fn read(mut pipe: PipeReader, count: usize) -> Vec<u8> {
        let mut bytes = vec![0; count];
        pipe.read_exact(&mut bytes).unwrap();
        bytes
    }

    #[test]
    fn the_same_descriptor_replaces_and_nothing_takes_back() {
        let (table, pipe, other) = (Table::new(), std::io::pipe().unwrap(), std::io::pipe().unwrap());
        let (fd, second) = (pipe.1.as_raw_fd(), other.1.as_raw_fd());
        for bytes in [&b"stop"[..], b"halt"] {
            table.set("s", fd, bytes).unwrap();
        }
        table.set("s", second, b"down").unwrap();
        let mut wanted = vec![(fd, b"halt".to_vec()), (second, b"down".to_vec())];
        wanted.sort();
        assert_eq!(outputs(&table), wanted);
        table.set("s", fd, b"").unwrap();
        assert_eq!(outputs(&table), [(second, b"down".to_vec())]);
    }

    #[test]
    fn another_descriptor_of_the_same_device_replaces_too() {
        let (table, pipe) = (Table::new(), std::io::pipe().unwrap());
        let again = pipe.1.try_clone().unwrap();
        table.set("s", pipe.1.as_raw_fd(), b"old").unwrap();
        table.set("s", again.as_raw_fd(), b"new").unwrap();
        assert_eq!(outputs(&table), [(again.as_raw_fd(), b"new".to_vec())]);
        table.set("s", pipe.1.as_raw_fd(), b"").unwrap();
        assert_eq!(outputs(&table).len(), 1, "what the successor registered is not its predecessor's to take back");
    }

    #[test]
    fn the_table_says_when_it_is_full() {
        let (table, pipes) = (Table::new(), Vec::from_iter((0..=SAFE_OUTPUTS).map(|_| std::io::pipe().unwrap())));
        let results: Vec<_> = pipes.iter().map(|(_, writer)| table.set("s", writer.as_raw_fd(), b"x")).collect();
        assert!(results[..SAFE_OUTPUTS].iter().all(Result::is_ok));
        assert_eq!(results[SAFE_OUTPUTS], Err(Refused::Full));
        assert_eq!(table.set("s", pipes[3].1.as_raw_fd(), b"y"), Ok(()), "a replacement always finds room");
    }

    #[test]
    fn what_is_too_long_or_not_open_is_refused() {
        let (table, pipe) = (Table::new(), std::io::pipe().unwrap());
        assert_eq!(table.set("s", pipe.1.as_raw_fd(), &[0; SAFE_OUTPUT_BYTES + 1]), Err(Refused::TooLong));
        assert_eq!(table.set("s", -1, b"x"), Err(Refused::NotOpen));
    }

    #[test]
    fn the_stop_is_the_last_word() {
        let (reader, writer) = std::io::pipe().unwrap();
        let sink = std::fs::OpenOptions::new().write(true).open("/dev/null").unwrap();
        let output = Output::new("s", writer.as_raw_fd(), b"stop").unwrap();
        assert!(deliver(&output, sink.as_raw_fd()));
        std::io::Write::write_all(&mut &writer, b"drive").unwrap();
        drop(writer);
        assert_eq!(read(reader, 4), b"stop");
    }

    #[test]
    fn the_outputs_of_a_slot_are_written_while_it_lives_on_and_a_stuck_one_holds_nobody_up() {
        let (table, own, other, stuck) =
            (Table::new(), std::io::pipe().unwrap(), std::io::pipe().unwrap(), std::io::pipe().unwrap());
        let motors = crate::model::names::intern("motors");
        let filler = Output::new("filler", stuck.1.as_raw_fd(), &[7; SAFE_OUTPUT_BYTES]).unwrap();
        while write_now(&filler, 0) {}
        table.set(motors, stuck.1.as_raw_fd(), b"stop").unwrap();
        table.set(motors, own.1.as_raw_fd(), b"stop").unwrap();
        table.set("camera", other.1.as_raw_fd(), b"shut").unwrap();
        assert_eq!(table.write(Duration::from_millis(3), |owner| owner == address(motors)), 1);
        std::io::Write::write_all(&mut &own.1, b"more").unwrap();
        drop((own.1, other.1));
        assert_eq!(read(own.0, 8), b"stopmore");
        let mut others = Vec::new();
        { other.0 }.read_to_end(&mut others).unwrap();
        assert!(others.is_empty());
    }

    #[test]
    fn a_descriptor_that_leads_elsewhere_by_now_is_left_alone() {
        let (pipe, other) = (std::io::pipe().unwrap(), std::io::pipe().unwrap());
        let output = Output::new("s", pipe.1.as_raw_fd(), b"stop").unwrap();
        let moved = Output { fd: other.1.as_raw_fd(), ..output };
        assert!(!deliver(&moved, -1));
    }

    #[test]
    fn a_device_that_takes_nothing_does_not_hold_up_the_end() {
        let (_reader, writer) = std::io::pipe().unwrap();
        let output = Output::new("s", writer.as_raw_fd(), &[7; SAFE_OUTPUT_BYTES]).unwrap();
        let filled = (0..100_000).take_while(|_| deliver(&output, -1)).count();
        assert!(filled > 0 && filled < 100_000);
    }

    /// Without system calls, so that an interpreter can follow it.
    #[test]
    fn many_threads_leave_one_output_for_each_device() {
        let (table, rounds) = (Table::new(), if cfg!(miri) { 10 } else { 2_000 });
        let output = |round: u64| {
            let bytes = [round as u8; SAFE_OUTPUT_BYTES];
            Output { owner: 1, fd: (round % 8) as i32, identity: Identity(1, round % 8), bytes, len: SAFE_OUTPUT_BYTES }
        };
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| (0..rounds).for_each(|round| _ = table.enter(&output(round))));
            }
            for _ in 0..rounds {
                assert!(table.live().all(|(_, output)| output.bytes.iter().all(|byte| *byte == output.bytes[0])));
            }
        });
        assert_eq!(outputs(&table).len(), 8);
    }
}
