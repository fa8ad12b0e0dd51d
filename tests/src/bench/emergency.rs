//! The emergency stop: from the faulting instruction to the actuator's bytes at its serial line, on the thread that saw the
//! fault. The raw limit is a bare signal handler that writes the same bytes to the same line.

use std::io::Read;
use std::os::fd::AsRawFd;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use component_sdk::abi::inject;
use crossbeam_channel::Receiver;
use framework_daemon::exec::emergency::{self, Actuator, Notice};
use framework_daemon::exec::executor::Move;
use framework_daemon::exec::member::{Crew, Member};
use framework_daemon::exec::workshop::Workshop;
use framework_daemon::model::lifecycle::State;
use framework_daemon::model::names;
use framework_daemon::profile::load;
use framework_daemon::supervise::blueprint::draw;
use framework_daemon::supervise::boot;
use framework_daemon::supervise::catalogue::Catalogue;
use framework_daemon::sys::bell::Bell;
use framework_daemon::sys::{carrier, safe_outputs, trap};
use serialport::{SerialPort, TTYPort};

use super::limits;
use super::rig::{PAUSE, PRIORITY, schedule};
use super::stats::Samples;
use crate::profiles::{Profiles, application, plugin_dir, slot};

/// As long as the command that stops the wheels.
const BYTES: [u8; 16] = *b"stop the wheels!";

/// `faults` traps of a slot whose severity is `emergency`, and as many of the limit.
///
/// # Panics
/// When the slot does not come up, or an emergency does not reach the line.
#[must_use]
pub fn measure(policy: &str, faults: usize) -> (Samples, Samples) {
    trap::install();
    let rules = "<fault_tolerance><severity symptom=\"crash\">emergency</severity></fault_tolerance>";
    let profiles = Profiles::new(&application(&[slot("subject", "Beat", rules)], &[]));
    profiles.write(
        "system.xml",
        "<system_profile><name>bench</name><emergency><actuator component=\"subject\"/></emergency></system_profile>",
    );
    let plan = load::load(profiles.path()).expect("the profile is valid").plan;
    let (send, results) = crossbeam_channel::bounded(1);
    // Read by nobody: what is full loses the entry, not the stop.
    let (sender, _events) = crossbeam_channel::bounded(64);
    let workshop = Workshop::start(sender.clone()).expect("a thread");
    let catalogue = Catalogue::default().in_directories(vec![plugin_dir()]);
    let blueprint = draw(&plan.slots, &catalogue).expect("the plugin is there").remove(0);
    let member = Box::new(boot::member(blueprint, &Bell::new(), &workshop));
    let body = move || {
        let mut rig = Rig::new(member, Crew::new(sender));
        let _ = send.send(rig.run(faults));
        emergency::arm(Vec::new());
        rig.member.destroy(&mut rig.crew);
    };
    let thread = carrier::spawn("rig", schedule(policy, PRIORITY), |_| {}, body).expect("a thread");
    let measured = results.recv().expect("the rig measures");
    thread.wait();
    drop(workshop);
    measured
}

struct Rig {
    member: Box<Member>,
    crew: Crew,
    line: TTYPort,
    board: TTYPort,
}

impl Rig {
    fn new(member: Box<Member>, crew: Crew) -> Self {
        let (mut board, line) = TTYPort::pair().expect("the system has pseudo-terminals");
        board.set_timeout(Duration::from_secs(1)).expect("a timeout can be set");
        Self { member, crew, line, board }
    }

    fn run(&mut self, faults: usize) -> (Samples, Samples) {
        let notices = notices();
        let slot = names::intern("subject");
        safe_outputs::set(slot, self.line.as_raw_fd(), &BYTES).expect("there is room");
        emergency::arm(vec![Actuator { slot, signal: Arc::clone(&self.member.signal) }]);
        self.member.install(&mut self.crew).expect("the component comes up");
        self.member.start(&mut self.crew);
        let code = inject::code("crash.segv").expect("it can be provoked");
        let (mut own, mut raw) = (Samples::default(), Samples::default());
        for _ in 0..faults {
            thread::sleep(PAUSE);
            own.add(self.fault(code, &notices));
            thread::sleep(PAUSE);
            raw.add(limits::trap_and_write(self.line.as_raw_fd(), &BYTES));
            self.drain();
        }
        (own, raw)
    }

    fn fault(&mut self, code: u8, notices: &Receiver<Notice>) -> u64 {
        self.member.inject.push_back(code);
        self.member.execute(&mut self.crew);
        let raised = notices.try_iter().find_map(|notice| match notice {
            Notice::Raised { at_ns, written_ns, outputs: 1, .. } => Some(written_ns - at_ns),
            _ => None,
        });
        self.drain();
        assert!(emergency::clear().is_some() && self.member.state() == State::Error);
        assert_eq!(self.member.steer(Move::Raise, &mut self.crew), State::Active);
        raised.expect("its output was written")
    }

    /// The board takes what came.
    fn drain(&mut self) {
        let mut bytes = [0; BYTES.len()];
        self.board.read_exact(&mut bytes).expect("the bytes are there");
        assert_eq!(bytes, BYTES);
    }
}

/// The process has one place for them: the first rig makes it, and all after it share it.
fn notices() -> Receiver<Notice> {
    static NOTICES: std::sync::OnceLock<Receiver<Notice>> = std::sync::OnceLock::new();
    let receiver = NOTICES.get_or_init(|| {
        let (sender, receiver) = crossbeam_channel::bounded(64);
        emergency::listen(sender);
        receiver
    });
    receiver.try_iter().for_each(drop);
    receiver.clone()
}
