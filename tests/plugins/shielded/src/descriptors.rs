//! Numbers of descriptors that are not this component's: the commonest way there is to close one's own twice.

use std::fs::File;
use std::io::{Read, Seek, Write};
use std::os::fd::{AsRawFd, IntoRawFd};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;

use component_sdk::prelude::*;
use libc::c_uint;

/// More than the daemon has open.
const MANY: i32 = 256;

/// How often a deed is done: then it rests, so that what the daemon does for a moment does not meet it by chance.
const DEEDS: u32 = 3;

static DONE: AtomicU32 = AtomicU32::new(0);

/// `Err`: no deed of this file.
pub(crate) fn commit(deed: &str) -> Result<Outcome, ()> {
    if DONE.load(Ordering::Relaxed) == DEEDS {
        return Ok(own_descriptors());
    }
    let outcome = do_now(deed)?;
    DONE.fetch_add(1, Ordering::Relaxed);
    Ok(outcome)
}

fn do_now(deed: &str) -> Result<Outcome, ()> {
    Ok(match deed {
        "close all" => close_all(),
        "thread close all" => thread::spawn(close_all).join().map_err(|_| ())?,
        "syscall close all" => syscall_close_all(),
        "close ranges" => close_ranges(),
        "overwrite all" => overwrite_all(by_dup2),
        "overwrite all by dup3" => overwrite_all(by_dup3),
        "syscall overwrite all" => overwrite_all(by_system_call),
        "change all" => change_all(),
        "syscall change all" => syscall_change_all(),
        "own descriptors" => own_descriptors(),
        _ => return Err(()),
    })
}

/// What is standard error's must be refused: it is the daemon's, whoever runs it.
fn refused(result: i32) -> Outcome {
    let error = std::io::Error::last_os_error();
    if result == -1 && error.raw_os_error() == Some(libc::EBADF) {
        Ok(())
    } else {
        Err(fault!("not refused: {result}, {error}"))
    }
}

fn close_all() -> Outcome {
    // SAFETY: none; the descriptors are not this component's.
    unsafe {
        refused(libc::close(2))?;
        (0..MANY).for_each(|fd| _ = libc::close(fd));
    }
    own_descriptors()
}

fn syscall_close_all() -> Outcome {
    // SAFETY: as above.
    unsafe {
        refused(libc::syscall(libc::SYS_close, 2) as i32)?;
        (0..MANY).for_each(|fd| _ = libc::syscall(libc::SYS_close, fd));
        libc::syscall(libc::SYS_close_range, 0, c_uint::MAX, 0);
    }
    own_descriptors()
}

unsafe extern "C" {
    fn closefrom(low: i32);
}

fn close_ranges() -> Outcome {
    let own = File::open("/dev/null")?.into_raw_fd();
    // SAFETY: as above. The numbers are beyond what others get meanwhile.
    let open = unsafe {
        let first = libc::fcntl(own, libc::F_DUPFD, MANY);
        libc::close_range(0, c_uint::MAX, 0);
        let second = libc::fcntl(2, libc::F_DUPFD, MANY + 1);
        closefrom(0);
        [first, second].map(|fd| fd < MANY || libc::fcntl(fd, libc::F_GETFD) != -1)
    };
    if open == [false; 2] { own_descriptors() } else { Err(fault!("what is not the daemon's stayed open: {open:?}")) }
}

fn by_dup2(from: i32, to: i32) -> i32 {
    // SAFETY: numbers only.
    unsafe { libc::dup2(from, to) }
}

fn by_dup3(from: i32, to: i32) -> i32 {
    // SAFETY: as above.
    unsafe { libc::dup3(from, to, libc::O_CLOEXEC) }
}

fn by_system_call(from: i32, to: i32) -> i32 {
    // SAFETY: as above.
    unsafe { libc::syscall(libc::SYS_dup3, from, to, 0) as i32 }
}

fn overwrite_all(dup: impl Fn(i32, i32) -> i32) -> Outcome {
    let own = File::open("/dev/null")?;
    refused(dup(own.as_raw_fd(), 2))?;
    let copies = (0..MANY).filter(|fd| *fd != own.as_raw_fd() && dup(own.as_raw_fd(), *fd) == *fd);
    // SAFETY: the copies were made here, whatever was there before.
    copies.collect::<Vec<_>>().into_iter().for_each(|copy| _ = unsafe { libc::close(copy) });
    own_descriptors()
}

/// Not to wait, nothing in it, nobody to talk to.
fn change_all() -> Outcome {
    let mut on = 1;
    // SAFETY: none; the descriptors are not this component's.
    unsafe {
        refused(libc::fcntl(2, libc::F_SETFL, libc::O_NONBLOCK))?;
        refused(libc::ioctl(2, libc::FIONBIO, &raw mut on))?;
        for fd in 0..MANY {
            libc::fcntl(fd, libc::F_SETFL, libc::O_NONBLOCK);
            libc::ioctl(fd, libc::FIONBIO, &raw mut on);
            libc::ftruncate(fd, 0);
            libc::shutdown(fd, libc::SHUT_RDWR);
        }
    }
    own_descriptors()
}

fn syscall_change_all() -> Outcome {
    // SAFETY: as above.
    unsafe { (3..MANY).for_each(|fd| _ = libc::syscall(libc::SYS_fcntl, fd, libc::F_SETFL, libc::O_NONBLOCK)) };
    own_descriptors()
}

/// What a component opens itself it uses and closes as anywhere else.
fn own_descriptors() -> Outcome {
    let path = std::env::temp_dir().join(format!("shielded-{}", std::process::id()));
    let mut file = File::options().read(true).write(true).create(true).truncate(true).open(&path)?;
    std::fs::remove_file(&path)?;
    file.write_all(b"of its own")?;
    file.set_len(6)?;
    file.rewind()?;
    let mut text = String::new();
    file.try_clone()?.read_to_string(&mut text)?;
    let (mut left, right) = UnixStream::pair()?;
    left.set_nonblocking(true)?;
    let would_block = left.read(&mut [0]).is_err_and(|error| error.kind() == std::io::ErrorKind::WouldBlock);
    drop(right);
    let ended = left.read(&mut [0])? == 0;
    // SAFETY: it is nobody else's.
    let closed = unsafe { libc::close(file.into_raw_fd()) } == 0;
    let seen = (text.as_str(), would_block, ended, closed);
    if seen == ("of its", true, true, true) { Ok(()) } else { Err(fault!("its own descriptors: {seen:?}")) }
}
