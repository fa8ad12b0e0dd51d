//! What the process still says when it dies by a trap outside any guard: safe outputs, then a crash record at the end of the
//! journal. Then it ends by the signal, so that its supervisor sees what happened and starts it again.
//!
//! All in the signal handler, with system calls only: no allocation, no lock, nothing of the daemon that may be broken.
#![allow(unsafe_code, reason = "address of unsafe: system calls of a dying process")]

use std::fmt::Write;
use std::os::fd::{AsRawFd, BorrowedFd, IntoRawFd, OwnedFd};
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};

use super::{arch, clock, latch, safe_outputs};

/// How the process ends, as the journal's record names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// By a trap, or a fatal signal that somebody sent.
    Crash,
    /// At once, because it was told so twice.
    Left,
}

/// What the process dies of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Death {
    /// How it ends.
    pub end: End,
    /// Signal number.
    pub signal: i32,
    /// Address that was accessed; 0 where the signal carries none.
    pub address: usize,
    /// Program counter.
    pub pc: usize,
    /// The process that sent the signal, where it was sent.
    pub sender: Option<i32>,
}

/// The journal's own descriptor.
static JOURNAL: AtomicI32 = AtomicI32::new(-1);
/// Where the record goes: another one of the same file.
static RECORD: AtomicI32 = AtomicI32::new(-1);
/// Open to `/dev/null`.
static SINK: AtomicI32 = AtomicI32::new(-1);
/// The thread that speaks.
static SPEAKER: AtomicI32 = AtomicI32::new(0);
static SPOKEN: AtomicBool = AtomicBool::new(false);

impl Death {
    /// Nobody waits for the components any more.
    pub const LEFT: Self = Self { end: End::Left, signal: libc::SIGKILL, address: 0, pc: 0, sender: None };
}

/// Opens all that a dying process cannot open any more. The journal is open for appending and reading, as long as the
/// process lives.
///
/// # Errors
/// When there is no `/dev/null`, or the process has no descriptor left.
pub fn prepare(journal: BorrowedFd<'_>) -> std::io::Result<()> {
    let record = journal.try_clone_to_owned()?;
    let sink = std::fs::OpenOptions::new().write(true).open("/dev/null")?;
    SINK.store(OwnedFd::from(sink).into_raw_fd(), Ordering::Release);
    JOURNAL.store(journal.as_raw_fd(), Ordering::Release);
    RECORD.store(record.into_raw_fd(), Ordering::Release);
    // The first use looks the processor's instructions up.
    std::hint::black_box(crc32fast::hash(b"ready"));
    Ok(())
}

/// The journal goes on in that file, under the descriptors that [`prepare`] knows.
///
/// # Errors
/// When nothing was prepared.
pub fn move_journal(file: BorrowedFd<'_>) -> std::io::Result<()> {
    for old in [&RECORD, &JOURNAL].map(|known| known.load(Ordering::Acquire)) {
        // SAFETY: a system call on descriptors that stay open; it refuses -1.
        if unsafe { libc::dup3(file.as_raw_fd(), old, libc::O_CLOEXEC) } < 0 {
            return Err(std::io::Error::last_os_error());
        }
    }
    Ok(())
}

/// Writes all safe outputs and the crash record, once in the life of a process.
pub fn speak(death: &Death) {
    // SAFETY: a system call without arguments.
    let own = unsafe { libc::gettid() };
    match SPEAKER.compare_exchange(0, own, Ordering::AcqRel, Ordering::Acquire) {
        Ok(_) => {
            let sink = SINK.load(Ordering::Acquire);
            close_journal(sink);
            let outputs = safe_outputs::write_all(sink);
            if latch::is_set() {
                latch::store();
            }
            record(death, outputs, own);
            SPOKEN.store(true, Ordering::Release);
        }
        // A trap in here: there is nothing left to say.
        Err(speaker) if speaker == own => {}
        // Another thread is at it: whoever ends the process now would cut it short.
        Err(_) => wait_until_spoken(),
    }
}

/// Whatever other threads still write goes nowhere: the record is the last line.
fn close_journal(sink: i32) {
    let journal = JOURNAL.load(Ordering::Acquire);
    if sink >= 0 && journal >= 0 {
        // Not by the C library's function: the shield refuses it where a component's code was interrupted.
        // SAFETY: a system call on descriptors that stay open.
        unsafe { arch::system_call(libc::SYS_dup3, [sink as usize, journal as usize, 0, 0, 0, 0]) };
    }
}

fn wait_until_spoken() {
    for _ in 0..1_000 {
        if SPOKEN.load(Ordering::Acquire) {
            return;
        }
        let pause = clock::timespec(1_000_000);
        // SAFETY: a valid time; the rest is not asked for.
        unsafe { libc::nanosleep(&raw const pause, std::ptr::null_mut()) };
    }
}

fn record(death: &Death, outputs: u32, thread: i32) {
    let fd = RECORD.load(Ordering::Acquire);
    let mut line = Line::new();
    if fd < 0 || compose(&mut line, death, outputs, thread).is_err() {
        return;
    }
    let line = line.sealed(ends_torn(fd));
    // SAFETY: the slice is valid for its length. One call, so that no other line is written into this one.
    unsafe { libc::write(fd, line.as_ptr().cast(), line.len()) };
}

fn compose(line: &mut Line, death: &Death, outputs: u32, thread: i32) -> std::fmt::Result {
    let Death { end, signal, address, pc, sender } = death;
    let kind = if *end == End::Crash { "crash" } else { "left" };
    let (now, wall) = (clock::now_ns(), clock::wall());
    write!(line, "{{\"kind\":\"{kind}\",\"mono_ns\":{now},\"wall\":{}.{:03},", wall.tv_sec, wall.tv_nsec / 1_000_000)?;
    write!(line, "\"signal\":{signal},\"address\":{address},\"pc\":{pc},\"base\":{},\"thread\":{thread},", base())?;
    if let Some(sender) = sender {
        write!(line, "\"sender\":{sender},")?;
    }
    write!(line, "\"safe_outputs\":{outputs}")
}

/// Where this program was loaded: `pc` less `base` is a place in its file.
fn base() -> u64 {
    // SAFETY: reads a value that the kernel gave the process; its program headers lie in its first page.
    unsafe { libc::getauxval(libc::AT_PHDR) & !0xfff }
}

/// True when the journal's last line is incomplete: the record must not be glued to it.
fn ends_torn(fd: i32) -> bool {
    let mut last = b'\n';
    // SAFETY: `lseek` moves nothing that matters, because every write appends; `pread` fills one byte.
    unsafe {
        let end = libc::lseek(fd, 0, libc::SEEK_END);
        end > 0 && libc::pread(fd, (&raw mut last).cast(), 1, end - 1) == 1 && last != b'\n'
    }
}

/// A line of fixed size.
struct Line {
    bytes: [u8; 512],
    len: usize,
}

impl Line {
    /// The first byte is kept for the line break after a torn line.
    const fn new() -> Self {
        Self { bytes: [b'\n'; 512], len: 1 }
    }

    /// The whole line with its checksum, as `fault::journal` seals its own.
    fn sealed(&mut self, after_torn: bool) -> &[u8] {
        let checksum = crc32fast::hash(&self.bytes[1..self.len]);
        // A line that is full stays without: it reads as incomplete, which it is.
        let _ = writeln!(self, ",\"crc\":\"{checksum:08x}\"}}");
        &self.bytes[usize::from(!after_torn)..self.len]
    }
}

impl Write for Line {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        let end = self.len + text.len();
        self.bytes.get_mut(self.len..end).ok_or(std::fmt::Error)?.copy_from_slice(text.as_bytes());
        self.len = end;
        Ok(())
    }
}

/// Writes to the null page: a daemon whose own code traps, for drills.
pub fn trap() {
    // SAFETY: none; the write faults, which is its purpose.
    unsafe { std::hint::black_box(8 as *mut u32).write_volatile(1) };
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEATH: Death =
        Death { end: End::Crash, signal: libc::SIGSEGV, address: usize::MAX, pc: usize::MAX, sender: Some(i32::MAX) };

    #[test]
    fn the_longest_record_fits() {
        let mut line = Line::new();
        compose(&mut line, &DEATH, u32::MAX, i32::MAX).unwrap();
        let text = std::str::from_utf8(line.sealed(false)).unwrap();
        assert!(text.starts_with("{\"kind\":\"crash\"") && text.ends_with("\"}\n"), "{text}");
    }

    #[test]
    fn a_record_after_a_torn_line_begins_a_new_one() {
        let mut line = Line::new();
        compose(&mut line, &DEATH, 0, 1).unwrap();
        assert!(line.sealed(true).starts_with(b"\n{"));
    }
}
