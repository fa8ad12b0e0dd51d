//! Exports the symbols that plugins are to see as the daemon's own (`src/sys/shield`, `src/sys/heap.rs`).

/// Each is defined in `src/sys/shield` or `src/sys/heap.rs`.
const SHIELDED: &[&str] = &[
    // heap
    "free",
    "realloc",
    // descriptors
    "close",
    "dup2",
    "dup3",
    "close_range",
    "closefrom",
    "ftruncate",
    "ftruncate64",
    "shutdown",
    "fcntl",
    "fcntl64",
    "ioctl",
    // leave
    "abort",
    "exit",
    "_exit",
    "_Exit",
    "quick_exit",
    "pause",
    // limits
    "setrlimit",
    "setrlimit64",
    "prlimit",
    "prlimit64",
    "prctl",
    // opens
    "open64",
    "accept4",
    "socket",
    "socketpair",
    "pipe2",
    "memfd_create",
    "opendir",
    "closedir",
    // replace
    "execv",
    "execvp",
    "execve",
    "execvpe",
    "fexecve",
    "daemon",
    "err",
    "errx",
    "verr",
    "verrx",
    "error",
    // send
    "kill",
    "killpg",
    "tgkill",
    "raise",
    "pthread_kill",
    "sigqueue",
    // signals
    "sigaction",
    "signal",
    "bsd_signal",
    "ssignal",
    "sysv_signal",
    "__sysv_signal",
    "sigset",
    "sigignore",
    "sighold",
    "sigprocmask",
    "pthread_sigmask",
    "sigaltstack",
    // threads
    "pthread_create",
    "pthread_exit",
    "pthread_cancel",
    // waits
    "sigsuspend",
    "ppoll",
    "pselect",
    "epoll_pwait",
];

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    for symbol in SHIELDED {
        println!("cargo:rustc-link-arg-bins=-Wl,--export-dynamic-symbol={symbol}");
    }
}
