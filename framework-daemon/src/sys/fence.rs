//! System calls that plugin code makes itself, past the C library's functions that the shield replaces: the kernel stops
//! those that could end the daemon or take its signals (seccomp), and the trap handler decides.
//!
//! A filter looks at where the call comes from: the text of a plugin, or the C library's `syscall`. Not "everything but the
//! daemon": filters are inherited, and a program that a plugin starts must be able to end. Calls that do no harm are
//! allowed by their number alone, so that the kernel keeps them in a table and never runs the filter for them.
#![allow(unsafe_code, reason = "address of unsafe: filters of system calls")]

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use libc::sock_filter as Step;

use super::arch;
use super::shield::{self, Caller};

/// What only the daemon may do.
const FENCED: [i64; 17] = [
    libc::SYS_exit,
    libc::SYS_exit_group,
    libc::SYS_kill,
    libc::SYS_tkill,
    libc::SYS_tgkill,
    libc::SYS_rt_sigqueueinfo,
    libc::SYS_rt_tgsigqueueinfo,
    libc::SYS_rt_sigaction,
    libc::SYS_rt_sigprocmask,
    libc::SYS_sigaltstack,
    libc::SYS_seccomp,
    libc::SYS_setrlimit,
    libc::SYS_prlimit64,
    libc::SYS_close,
    libc::SYS_close_range,
    arch::OVERWRITES[0],
    arch::OVERWRITES[1],
];

static STANDS: AtomicBool = AtomicBool::new(false);

/// Puts the fence around the C library's `syscall`. Where the system refuses, the log says so and everything else works.
pub fn install() {
    if STANDS.load(Ordering::Acquire) {
        return;
    }
    match confine(&[syscall_function()]) {
        Ok(()) => STANDS.store(true, Ordering::Release),
        Err(error) => tracing::warn!(
            "system calls that plugins make themselves are not contained: the system refuses a filter ({error}); \
             allow `seccomp` and `no_new_privs` for this service"
        ),
    }
}

/// Puts the fence around the text of a plugin, if there is one at all.
pub fn enclose(texts: &[Range<usize>]) {
    if STANDS.load(Ordering::Acquire)
        && let Err(error) = confine(texts)
    {
        tracing::warn!(
            "system calls that a plugin makes itself are not contained: the system refuses a filter ({error})"
        );
    }
}

/// Bytes after the beginning of `syscall` that are certainly its own or nobody's: it is shorter, and functions are aligned.
const SYSCALL_BYTES: usize = 64;

/// Asks `dladdr1` for the symbol.
const ASK_SYMBOL: i32 = 1;

fn syscall_function() -> Range<usize> {
    // SAFETY: the name is a C string; the address is only compared.
    let found = unsafe { libc::dlsym(libc::RTLD_DEFAULT, c"syscall".as_ptr()) }.addr();
    let mut symbol: *mut libc::Elf64_Sym = std::ptr::null_mut();
    // SAFETY: an all-zero record is valid and filled by the call, which sets the pointer to a symbol of a library that is
    // never closed, or leaves it null.
    let size = unsafe {
        let mut info: libc::Dl_info = std::mem::zeroed();
        let address = std::ptr::without_provenance(found);
        libc::dladdr1(address, &raw mut info, (&raw mut symbol).cast(), ASK_SYMBOL);
        symbol.as_ref().map_or(0, |symbol| symbol.st_size as usize)
    };
    found..found + if size == 0 { SYSCALL_BYTES } else { size }
}

fn confine(texts: &[Range<usize>]) -> std::io::Result<()> {
    let steps = filter(texts);
    match attach(&steps) {
        // Without the right to filter, the kernel wants the promise that children gain no other rights.
        Err(error) if error.raw_os_error() == Some(libc::EACCES) => {
            nix::sys::prctl::set_no_new_privs()?;
            attach(&steps)
        }
        result => result,
    }
}

/// For every thread of the process, those to come too.
fn attach(steps: &[Step]) -> std::io::Result<()> {
    let program = libc::sock_fprog { len: steps.len() as u16, filter: steps.as_ptr().cast_mut() };
    // The second flag: no slower processor for fear of what the filter might tell.
    let flags = libc::SECCOMP_FILTER_FLAG_TSYNC | libc::SECCOMP_FILTER_FLAG_SPEC_ALLOW;
    let arguments = [libc::SECCOMP_SET_MODE_FILTER as usize, flags as usize, (&raw const program).addr(), 0, 0, 0];
    // SAFETY: the kernel reads the program during the call; it is checked there.
    match unsafe { arch::system_call(libc::SYS_seccomp, arguments) } {
        0 => Ok(()),
        error @ ..0 => Err(std::io::Error::from_raw_os_error(-error as i32)),
        thread => Err(std::io::Error::other(format!("thread {thread} has a filter of its own"))),
    }
}

/// Offsets in what the kernel shows to a filter.
const NUMBER: u32 = 0;
const ARCHITECTURE: u32 = 4;
const ADDRESS_LOW: u32 = 8;
const ADDRESS_HIGH: u32 = 12;

/// Another kind of call of the same processor, told by a bit in the number.
const X32_BIT: u32 = 0x4000_0000;

/// The filter that stops what is fenced where it comes from `texts`.
fn filter(texts: &[Range<usize>]) -> Vec<Step> {
    let fenced = FENCED.len() as u8;
    let mut steps = vec![
        load(ARCHITECTURE),
        // Calls of another architecture have other numbers: all of them are looked at.
        jump(libc::BPF_JEQ, arch::AUDIT_ARCH, 0, fenced + 3),
        load(NUMBER),
        step(libc::BPF_ALU | libc::BPF_AND | libc::BPF_K, !X32_BIT),
    ];
    steps.extend(FENCED.iter().zip((1..=fenced).rev()).map(|(call, left)| jump(libc::BPF_JEQ, *call as u32, left, 0)));
    steps.push(answer(libc::SECCOMP_RET_ALLOW));
    texts.iter().flat_map(|text| windows(text.clone())).for_each(|window| steps.extend(look(&window)));
    steps.push(answer(libc::SECCOMP_RET_ALLOW));
    steps
}

/// The parts of a range whose upper halves do not change: a filter compares 32 bits at a time.
fn windows(text: Range<usize>) -> impl Iterator<Item = (u32, u32, u32)> {
    let last = text.end;
    let (first_half, last_half) = (text.start >> 32, last >> 32);
    (first_half..=last_half).map(move |half| {
        let low = if half == first_half { text.start as u32 } else { 0 };
        let high = if half == last_half { last as u32 } else { u32::MAX };
        (half as u32, low, high)
    })
}

/// Stops a call whose return address lies in the window, its end included: the call may be the last instruction.
fn look(&(half, low, high): &(u32, u32, u32)) -> [Step; 6] {
    [
        load(ADDRESS_HIGH),
        jump(libc::BPF_JEQ, half, 0, 4),
        load(ADDRESS_LOW),
        jump(libc::BPF_JGE, low, 0, 2),
        jump(libc::BPF_JGT, high, 1, 0),
        answer(libc::SECCOMP_RET_TRAP),
    ]
}

const fn step(code: u32, k: u32) -> Step {
    Step { code: code as u16, jt: 0, jf: 0, k }
}

const fn load(offset: u32) -> Step {
    step(libc::BPF_LD | libc::BPF_W | libc::BPF_ABS, offset)
}

const fn jump(test: u32, k: u32, jt: u8, jf: u8) -> Step {
    Step { jt, jf, ..step(libc::BPF_JMP | test | libc::BPF_K, k) }
}

const fn answer(action: u32) -> Step {
    step(libc::BPF_RET | libc::BPF_K, action)
}

/// What becomes of a call that the fence stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It is answered; the code runs on.
    Answered,
    /// It would have ended the process.
    Leaves,
    /// It would have sent this process a fatal signal.
    Kills,
}

/// The kernel's record of a call that a filter stopped, behind the fields that every signal has.
#[repr(C)]
struct Stopped {
    _common: [i32; 4],
    _address: usize,
    number: i32,
    architecture: u32,
}

/// As the kernel says that a filter stopped a call.
const BY_FILTER: i32 = 1;

/// Judges what was stopped; `None`: the signal is of another origin.
pub(super) fn judge(info: &libc::siginfo_t, context: &mut libc::ucontext_t) -> Option<Verdict> {
    if info.si_signo != libc::SIGSYS || info.si_code != BY_FILTER {
        return None;
    }
    // SAFETY: with this signal and code the record has these fields, and its size is that of all records.
    let stopped = unsafe { &*std::ptr::from_ref(info).cast::<Stopped>() };
    if stopped.architecture != arch::AUDIT_ARCH {
        arch::set_result(context, -(libc::ENOSYS as isize));
        return Some(Verdict::Answered);
    }
    let number = i64::from(stopped.number);
    // Another filter, of a plugin's own.
    FENCED.contains(&number).then_some(())?;
    let mut arguments = arch::arguments(context);
    match ask(number, &arguments) {
        Answer::Refused(verdict) => return Some(verdict),
        Answer::Denied(error) => {
            arch::set_result(context, -(error as isize));
            return Some(Verdict::Answered);
        }
        Answer::Spares => {
            let [first, last, flags] = [0, 1, 2].map(|index| arguments[index] as u32);
            arch::set_result(context, shield::descriptors::close_others(first, last, flags));
            return Some(Verdict::Answered);
        }
        Answer::Question(of) => arguments[of] = 0,
        Answer::Passed => {}
    }
    // SAFETY: what the code asked the kernel for, without the part that changes anything of ours.
    arch::set_result(context, unsafe { arch::system_call(number, arguments) });
    Some(Verdict::Answered)
}

enum Answer {
    /// Carried out.
    Passed,
    /// Carried out without the new value, which is that argument: it only asks.
    Question(usize),
    /// Not permitted: that error.
    Denied(i32),
    /// Carried out on descriptors that are not the daemon's.
    Spares,
    /// A fault.
    Refused(Verdict),
}

fn ask(number: i64, arguments: &[usize; 6]) -> Answer {
    let caller = shield::caller();
    if caller == Caller::Daemon {
        return Answer::Passed;
    }
    let refused = |verdict| if caller == Caller::Loader { Answer::Passed } else { Answer::Refused(verdict) };
    let argument = |index: usize| arguments[index] as i32;
    let on_descriptor =
        |fd| if shield::descriptors::refuses(fd) { Answer::Denied(libc::EBADF) } else { Answer::Passed };
    let (process, signal) = match number {
        libc::SYS_close => return on_descriptor(argument(0)),
        libc::SYS_close_range => return Answer::Spares,
        number if arch::OVERWRITES.contains(&number) => return on_descriptor(argument(1)),
        libc::SYS_exit if caller == Caller::Thread => return Answer::Passed,
        libc::SYS_exit | libc::SYS_exit_group => return refused(Verdict::Leaves),
        libc::SYS_rt_sigaction | libc::SYS_rt_sigprocmask => return Answer::Question(1),
        libc::SYS_sigaltstack => return Answer::Question(0),
        // A filter could end the thread, or the process; a limit what the daemon writes.
        libc::SYS_seccomp | libc::SYS_setrlimit => return Answer::Denied(libc::EPERM),
        // Who only asks, or means another process.
        libc::SYS_prlimit64 if arguments[2] == 0 || !shield::is_self(argument(0)) => return Answer::Passed,
        libc::SYS_prlimit64 => return Answer::Denied(libc::EPERM),
        // A thread's number is hardly ever another process's.
        libc::SYS_tkill => (0, argument(1)),
        libc::SYS_tgkill | libc::SYS_rt_tgsigqueueinfo => (argument(0), argument(2)),
        _ => (argument(0), argument(1)),
    };
    if shield::is_self(process) && shield::is_fatal(signal) { Answer::Refused(Verdict::Kills) } else { Answer::Passed }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a filter answers to a call of that number from that address.
    fn run(steps: &[Step], architecture: u32, number: u32, address: usize) -> u32 {
        let (mut at, mut value) = (0, 0);
        loop {
            let Step { code, jt, jf, k } = steps[at];
            let test = u32::from(code) & 0xf0;
            let next = match u32::from(code) & 7 {
                libc::BPF_LD => {
                    value = [number, architecture, address as u32, (address >> 32) as u32][k as usize / 4];
                    0
                }
                libc::BPF_ALU => {
                    value &= k;
                    0
                }
                libc::BPF_RET => return k,
                _ if test == libc::BPF_JEQ => {
                    if value == k {
                        jt
                    } else {
                        jf
                    }
                }
                _ if test == libc::BPF_JGE => {
                    if value >= k {
                        jt
                    } else {
                        jf
                    }
                }
                _ => {
                    if value > k {
                        jt
                    } else {
                        jf
                    }
                }
            };
            at += 1 + usize::from(next);
        }
    }

    #[test]
    fn only_what_is_fenced_is_stopped_and_only_from_the_texts() {
        let texts = [0x5000_0000_1000..0x5000_0000_2000, 0x7fff_ffff_f000..0x8000_0000_1000];
        let steps = filter(&texts);
        let asked = |number: i64, address| run(&steps, arch::AUDIT_ARCH, number as u32, address);
        for call in FENCED {
            for inside in [0x5000_0000_1000, 0x5000_0000_2000, 0x7fff_ffff_f000, 0x7fff_ffff_ffff, 0x8000_0000_1000] {
                assert_eq!(asked(call, inside), libc::SECCOMP_RET_TRAP, "{call} {inside:x}");
            }
            for outside in [0, 0x5000_0000_0fff, 0x5000_0000_2001, 0x5001_0000_1800, 0x8000_0000_1001, usize::MAX] {
                assert_eq!(asked(call, outside), libc::SECCOMP_RET_ALLOW, "{call} {outside:x}");
            }
        }
        for call in [libc::SYS_futex, libc::SYS_write, libc::SYS_clock_nanosleep, libc::SYS_prctl] {
            assert_eq!(asked(call, 0x5000_0000_1800), libc::SECCOMP_RET_ALLOW);
        }
        let other = |address| run(&steps, 0x4000_0003, 1, address);
        assert_eq!((other(0x5000_0000_1800), other(0)), (libc::SECCOMP_RET_TRAP, libc::SECCOMP_RET_ALLOW));
    }
}
