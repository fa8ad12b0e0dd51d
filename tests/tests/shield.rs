//! What a component does to the process that it runs in, and on threads of its own: contained, blamed on the right slot,
//! answered by its rules. The others go on.
#![allow(unsafe_code, reason = "a system that permits no filters")]

use tests::asking::ask;
use tests::culprit::{alone, the_other_goes_on};
use tests::running::Running;

/// The daemon outlives the deed each time, blames `culprit` for `symptom`, and stops it in the end; the other slot runs on.
fn contained(deed: &str, symptom: &str) {
    let mut daemon = Running::start(alone(deed).path(), &[]);
    daemon.wait_for("the slot is stopped");
    let faults = daemon.journal("fault", 3);
    for fault in &faults {
        let seen = [&fault["slot"], &fault["symptom"]].map(|field| field.as_str().unwrap_or_default());
        assert_eq!(seen, ["culprit", symptom], "{deed}; the log:\n{}", daemon.log());
    }
    // A thread that is late belongs to an instance that is gone: its fault is only written down.
    let actions = faults.iter().map(|fault| fault["action"].as_str().unwrap_or_default());
    let actions: Vec<_> = actions.filter(|action| *action != "ignore").collect();
    assert_eq!(actions, ["reset", "reset", "stop"], "{deed}");
    the_other_goes_on(&mut daemon);
}

/// The deed is no fault, and the component runs on after it.
fn allowed(deed: &str) {
    let mut daemon = Running::start(alone(deed).path(), &[]);
    daemon.wait_for_lines(&format!("is over: {deed}"), 3);
    let faults = daemon.entries("fault");
    assert!(faults.is_empty(), "{deed}: {faults:?}");
    the_other_goes_on(&mut daemon);
}

#[test]
fn handlers_masks_and_signal_stacks_stay_the_daemons() {
    contained("handler reset", "crash.segv");
    contained("mask", "crash.segv");
    contained("signal stack", "crash.stack");
}

#[test]
fn the_end_of_the_process_is_the_end_of_a_callback() {
    for deed in ["exit", "exit now", "pthread_exit", "exec"] {
        contained(deed, "crash.exit");
    }
}

#[test]
fn a_fatal_signal_to_the_process_is_the_senders_fault() {
    for deed in ["kill", "kill hard", "kill group", "raise", "pthread_kill"] {
        contained(deed, "crash.abort");
    }
    contained("raise segv", "crash.segv");
}

#[test]
fn system_calls_past_the_c_library_are_stopped() {
    for deed in ["syscall exit_group", "syscall exit", "asm exit_group"] {
        contained(deed, "crash.exit");
    }
    for deed in ["syscall kill", "syscall tgkill", "asm kill"] {
        contained(deed, "crash.abort");
    }
    for deed in ["syscall handler reset", "asm handler reset", "asm mask"] {
        contained(deed, "crash.segv");
    }
    contained("asm signal stack", "crash.stack");
}

/// From now on this thread and what it starts may set no filter.
fn refuse_filters() {
    let step = |code: u32, jt: u8, k: u32| libc::sock_filter { code: code as u16, jt, jf: 0, k };
    let filter = [
        step(libc::BPF_LD | libc::BPF_W | libc::BPF_ABS, 0, 0),
        step(libc::BPF_JMP | libc::BPF_JEQ | libc::BPF_K, 1, libc::SYS_seccomp as u32),
        step(libc::BPF_RET | libc::BPF_K, 0, libc::SECCOMP_RET_ALLOW),
        step(libc::BPF_RET | libc::BPF_K, 0, libc::SECCOMP_RET_ERRNO | libc::EPERM as u32),
    ];
    let program = libc::sock_fprog { len: 4, filter: filter.as_ptr().cast_mut() };
    // SAFETY: the kernel reads the program during the call.
    let refused = unsafe {
        libc::prctl(libc::PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
        libc::syscall(libc::SYS_seccomp, libc::SECCOMP_SET_MODE_FILTER, 0, &raw const program)
    };
    assert_eq!(refused, 0, "{}", std::io::Error::last_os_error());
}

#[test]
fn where_no_filter_is_permitted_the_log_says_so_and_all_else_is_contained() {
    refuse_filters();
    contained("exit", "crash.exit");
    contained("thread null", "crash.segv");
    let profiles = alone("syscall exit_group");
    // It may be over before it is ready.
    let mut daemon = Running::spawn(profiles.path(), &[]);
    daemon.wait_for("allow `seccomp` and `no_new_privs`");
    assert_eq!(daemon.wait().code(), Some(0), "what is left");
}

#[test]
fn a_trap_on_another_stack_is_the_callbacks() {
    contained("asm own stack", "crash.segv");
    contained("asm wild stack", "crash.segv");
}

#[test]
fn a_trap_on_a_components_own_thread_ends_that_thread() {
    contained("thread null", "crash.segv");
    contained("thread overflow", "crash.stack");
    contained("thread abort", "crash.abort");
    contained("thread handler reset", "crash.segv");
    contained("thread mask", "crash.segv");
    contained("grandchild null", "crash.segv");
    contained("clone null", "crash.segv");
}

#[test]
fn a_components_own_thread_cannot_end_the_process() {
    for deed in ["thread exit", "thread exit now", "thread syscall exit_group"] {
        contained(deed, "crash.exit");
    }
    contained("thread kill", "crash.abort");
}

#[test]
fn a_components_own_signal_handler_ends_alone_on_whatever_thread() {
    contained("own handler null", "crash.segv");
    contained("own handler null elsewhere", "crash.segv");
    contained("own handler abort", "crash.abort");
    contained("own handler exit", "crash.exit");
}

#[test]
fn a_panic_on_a_components_own_thread_is_told_with_its_place() {
    contained("thread panic", "crash.panic");
    contained("thread double panic", "crash.abort");
    let daemon = Running::start(alone("thread panic").path(), &[]);
    let evidence = daemon.journal("fault", 1).remove(0)["evidence"].take();
    assert_eq!(evidence["message"], "astray");
    assert!(evidence["file"].as_str().is_some_and(|file| file.ends_with("astray.rs")));
}

#[test]
fn children_live_and_end_as_they_like() {
    for deed in ["child", "forked child", "child that is not there", "child that kills itself", "child that comes back"]
    {
        allowed(deed);
    }
}

#[test]
fn what_components_leave_for_the_end_of_a_thread_or_of_the_process_spoils_neither() {
    allowed("destructors");
}

#[test]
fn limits_and_filters_of_the_process_are_not_for_components() {
    allowed("limits");
    allowed("filters");
}

/// The daemon keeps its own: it is asked, reloads, writes its journal from the beginning on, and ends in order.
fn keeps_its_descriptors(deed: &str) {
    let profiles = alone(deed);
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for_lines(&format!("is over: {deed}"), 3);
    for asked in ["component list", "reload", "component list"] {
        let answer = ask(&daemon, asked);
        assert_eq!(answer.code, Some(0), "{deed}: {asked}: {}; the log:\n{}", answer.err, daemon.log());
    }
    let entries = ["fault", "start", "reload"].map(|kind| daemon.entries(kind).len());
    assert_eq!(entries, [0, 1, 1], "{deed}; the log:\n{}", daemon.log());
    the_other_goes_on(&mut daemon);
}

#[test]
fn descriptors_of_the_daemon_are_neither_closed_nor_overwritten() {
    for deed in ["close all", "thread close all", "close ranges", "overwrite all", "overwrite all by dup3"] {
        keeps_its_descriptors(deed);
    }
}

#[test]
fn descriptors_of_the_daemon_are_not_changed() {
    keeps_its_descriptors("change all");
}

#[test]
fn system_calls_past_the_c_library_close_no_descriptor_of_the_daemon() {
    for deed in ["syscall close all", "syscall overwrite all"] {
        keeps_its_descriptors(deed);
    }
}

#[test]
fn signals_are_heard_whatever_becomes_of_the_descriptors_flags() {
    allowed("syscall change all");
}

#[test]
fn descriptors_of_a_components_own_work() {
    allowed("own descriptors");
}

#[test]
fn threads_and_signals_of_a_components_own_work() {
    for deed in ["alarm", "own handler", "threads", "thread that ends itself", "clone exit"] {
        allowed(deed);
    }
}
