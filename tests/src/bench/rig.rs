//! One slot, driven by one thread, with nothing around it: recoveries and their raw limit are measured on the very same
//! thread, in turns, each after a pause in which the caches may cool down and the scheduler may run others.

use std::sync::Arc;
use std::time::Duration;

use crossbeam_channel::Receiver;
use framework_daemon::exec::member::{Crew, Member};
use framework_daemon::exec::workshop::Workshop;
use framework_daemon::model::fault::{FaultEvent, Outcome};
use framework_daemon::model::lifecycle::State;
use framework_daemon::model::limits::SECONDARIES;
use framework_daemon::model::schedule::{Policy, Schedule};
use framework_daemon::profile::load;
use framework_daemon::supervise::blueprint::draw;
use framework_daemon::supervise::boot;
use framework_daemon::supervise::catalogue::Catalogue;
use framework_daemon::sys::bell::Bell;
use framework_daemon::sys::carrier;
use framework_daemon::sys::trap;
use serde_json::{Value, json};

use super::stats::Samples;
use crate::profiles::{Profiles, application, plugin_dir, slot};

/// Longest time that a spare may take.
const PATIENCE: Duration = Duration::from_secs(10);
/// Priority of the measuring thread under `fifo`.
pub const PRIORITY: i32 = 50;
/// Between two measurements.
pub const PAUSE: Duration = Duration::from_millis(1);

/// What takes the place of the instance that failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Payload {
    /// One that was made before, of the same class.
    Spare,
    /// One that is made at the moment of the fault.
    Fresh,
}

impl Payload {
    /// `fresh instance`, `spare`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fresh => "fresh instance",
            Self::Spare => "spare",
        }
    }

    const fn rule(self) -> &'static str {
        match self {
            Self::Fresh => "<spare count=\"1\" preload=\"library\"/>",
            Self::Spare => "<spare count=\"1\" preload=\"instance\"/>",
        }
    }
}

/// The profiles of a slot of that class that is reset whatever happens.
#[must_use]
pub fn profiles(class: &str, properties: &str, payload: Payload) -> Profiles {
    let rules = format!(
        "{properties}<fault_tolerance><severity>reset</severity>\
         <severity symptom=\"overrun\">ignore</severity><reset limit=\"1000\" within=\"1ms\"/>{}{}</fault_tolerance>",
        payload.rule(),
        // Where a recovery fails because the machine is busy, the next one goes on.
        format!("<secondary reference=\"{class}.xml\" preload=\"library\"/>").repeat(SECONDARIES)
    );
    Profiles::new(&application(&[slot("subject", class, &rules)], &[]))
}

/// The schedule of that name: `other`, `fifo`.
#[must_use]
pub fn schedule(policy: &str, priority: i32) -> Schedule {
    let policy = if policy == "fifo" { Policy::Fifo } else { Policy::Other };
    Schedule { policy, priority, cpus: Vec::new() }
}

/// Nanoseconds from the fault to each step of its recovery.
#[derive(Debug, Default)]
pub struct Steps {
    detected: Samples,
    decided: Samples,
    ready: Samples,
    /// The successor's first callback was completed: what is compared with the limit.
    pub first_callback: Samples,
}

impl Steps {
    fn add(&mut self, event: &FaultEvent) {
        let times = event.times;
        self.detected.add(times.detected_ns);
        self.decided.add(times.decided_ns);
        self.ready.add(times.ready_ns.unwrap_or_default());
        self.first_callback.add(times.first_callback_ns.unwrap_or_default());
    }

    /// The medians of those before the last.
    #[must_use]
    pub fn medians(&mut self) -> Value {
        json!({"detected": self.detected.at(0.5), "decided": self.decided.at(0.5), "ready": self.ready.at(0.5)})
    }
}

/// `faults` faults of the slot, provoked by `inject` (0: by its component itself), and as many tries of `limit`.
///
/// # Panics
/// When the slot does not come up or a fault is not recovered.
#[must_use]
pub fn measure(profiles: &Profiles, policy: &str, inject: u8, faults: usize, limit: fn() -> u64) -> (Steps, Samples) {
    trap::install();
    let plan = load::load(profiles.path()).expect("the profile is valid").plan;
    let (send, results) = crossbeam_channel::bounded(1);
    let (sender, events) = crossbeam_channel::bounded(64);
    let workshop = Workshop::start(sender.clone()).expect("a thread");
    let catalogue = Catalogue::default().in_directories(vec![plugin_dir()]);
    let blueprint = draw(&plan.slots, &catalogue).expect("the plugin is there").remove(0);
    // Boxed: what a coroutine begins with must be small.
    let member = Box::new(boot::member(blueprint, &Bell::new(), &workshop));
    let workshop = Arc::new(workshop);
    let kept = Arc::clone(&workshop);
    let body = move || {
        let mut rig = Rig { member, events, crew: Crew::new(sender), workshop };
        let _ = send.send(rig.run(inject, faults, limit));
        rig.member.destroy(&mut rig.crew);
    };
    let schedule = Schedule { cpus: vec![0], ..schedule(policy, PRIORITY) };
    let thread = carrier::spawn("rig", schedule, |_| {}, body).expect("a thread");
    let measured = results.recv().expect("the rig measures");
    thread.wait();
    drop(kept);
    measured
}

struct Rig {
    member: Box<Member>,
    events: Receiver<FaultEvent>,
    crew: Crew,
    workshop: Arc<Workshop>,
}

impl Rig {
    fn run(&mut self, inject: u8, faults: usize, limit: fn() -> u64) -> (Steps, Samples) {
        let Self { member, crew, .. } = self;
        member.install(crew).expect("the component comes up");
        member.start(crew);
        let (mut own, mut raw) = (Steps::default(), Samples::default());
        for _ in 0..faults {
            own.add(&self.fault(inject));
            self.calm_down(inject);
            raw.add(limit());
        }
        (own, raw)
    }

    /// The same before both, so that neither finds the processor warmer.
    fn calm_down(&mut self, inject: u8) {
        // What stands ready is what is measured, not how fast it is made.
        self.workshop.settle(PATIENCE);
        if inject != 0 {
            // A cycle in which nothing happens, as there are many between two faults: the spare is picked up in it.
            self.member.execute(&mut self.crew);
            self.workshop.settle(PATIENCE);
        }
        std::thread::sleep(PAUSE);
    }

    fn fault(&mut self, inject: u8) -> FaultEvent {
        self.calm_down(inject);
        self.member.inject.extend((inject != 0).then_some(inject));
        loop {
            self.member.execute(&mut self.crew);
            // A callback that lost its core for too long is late, too, and a recovery may fail by that: not what is measured.
            let recovered = |event: &FaultEvent| event.outcome == Outcome::Recovered;
            if let Some(event) = self.events.try_iter().find(recovered) {
                return event;
            }
            self.member.breathe_out(&mut self.crew);
            assert!(self.member.state() == State::Active, "too many recoveries failed");
        }
    }
}
