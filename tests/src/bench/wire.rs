//! A running system of the measuring components, on two executors that stay on a processor each.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicPtr, Ordering};
use std::time::{Duration, Instant};

use framework_daemon::model::fault::FaultEvent;
use framework_daemon::port::wiring::{Name, connect, disconnect};
use framework_daemon::profile::load;
use framework_daemon::supervise::boot::boot;
use framework_daemon::supervise::shutdown::shutdown;
use framework_daemon::supervise::system::System;
use framework_daemon::sys::trap;

use super::rig::PRIORITY;
use super::stats::Samples;
use crate::profiles::{Profiles, application, plugin_dir, slot};

/// A system of these slots, `name class executor properties`, and connections.
pub struct Bench {
    profiles: Profiles,
    system: Option<System>,
    // Nobody answers: the faults of a benchmark are its panics.
    _faults: crossbeam_channel::Receiver<FaultEvent>,
}

/// A slot on the executor of that name.
#[must_use]
pub fn on(executor: &str, name: &str, class: &str, properties: &[(&str, &str, &str)]) -> String {
    let property = |(name, kind, value): &(&str, &str, &str)| {
        format!("<property name=\"{name}\" type=\"{kind}\">{value}</property>")
    };
    let properties: String = properties.iter().map(property).collect();
    slot(name, class, &format!("<executor>{executor}</executor><properties>{properties}</properties>"))
}

impl Bench {
    /// Brings it up; `@` in the slots stands for the directory of the figures.
    ///
    /// # Panics
    /// When it does not come up.
    #[must_use]
    pub fn start(sched: &str, slots: &[String], connections: &[&str]) -> Self {
        trap::install();
        let profiles = Profiles::new("");
        profiles.describe(&plugin_dir().join("libpatterns.so"));
        let here = profiles.path().display().to_string();
        profiles.write("app.xml", &application(slots, connections).replace('@', &here));
        let policy = if sched == "fifo" { format!("policy=\"fifo\" priority=\"{PRIORITY}\"") } else { String::new() };
        let executor = |name: &str, cpu: usize| format!("<executor name=\"{name}\" cpu=\"{cpu}\" {policy}/>");
        let executors = executor("one", 0) + &executor("other", 1);
        profiles.write("system.xml", &format!("<system_profile><name>bench</name>{executors}</system_profile>"));
        let plan = load::load(profiles.path()).expect("the profile is valid").plan;
        let (sender, faults) = crossbeam_channel::bounded(64);
        let system = boot(Arc::new(plan), &[plugin_dir()], sender).expect("the components come up");
        Self { profiles, system: Some(system), _faults: faults }
    }

    /// The running system.
    ///
    /// # Panics
    /// Never: it runs until it is stopped.
    #[must_use]
    pub fn system(&self) -> &System {
        self.system.as_ref().expect("it runs until it is stopped")
    }

    /// Lets it run for that long, stops it, and adds what it measured. False: it measured nothing, which may be so where others
    /// keep all processors busy.
    #[must_use]
    pub fn finish(mut self, run: Duration, into: &mut Samples) -> bool {
        std::thread::sleep(run);
        self.system.take().into_iter().for_each(shutdown);
        let text = std::fs::read_to_string(self.profiles.path().join("figures")).unwrap_or_default();
        text.lines().filter_map(|line| line.parse().ok()).for_each(|figure| into.add(figure));
        !text.is_empty()
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.system.take().into_iter().for_each(shutdown);
    }
}

/// Nanoseconds of connecting a reader and disconnecting it again while its writer passes values on at full speed, and of two
/// exchanges of a pointer that another thread follows all the time.
///
/// # Panics
/// When the system does not come up or a connection is refused.
#[must_use]
pub fn rewire(sched: &str, rounds: usize) -> (Samples, Samples) {
    let slots = [
        on("one", "ping", "HopSmall", &[("leads", "bool", "true"), ("batch", "int", "500")]),
        on("one", "pong", "HopSmall", &[("batch", "int", "500")]),
        on("other", "ear", "Ear", &[]),
    ];
    let bench = Bench::start(sched, &slots, &["ping.said -> pong.heard", "pong.said -> ping.heard"]);
    let registry = &bench.system().registry;
    let (from, to) = (Name { slot: "ping", port: "said" }, Name { slot: "ear", port: "heard" });
    let (mut own, mut raw) = (Samples::default(), Samples::default());
    for round in 0..rounds {
        let began = Instant::now();
        connect(registry, from, to).expect("it fits");
        disconnect(registry, to).expect("it is there");
        let took = began.elapsed();
        if round >= rounds / 10 {
            own.add(took.as_nanos() as u64);
        }
        // The traffic goes on in between.
        std::thread::sleep(Duration::from_micros(50));
    }
    drop(bench);
    let followed = Followed::default();
    (0..rounds).for_each(|_| raw.add(followed.exchange_twice()));
    (own, raw)
}

/// A pointer that a thread follows all the time.
struct Followed(Arc<(AtomicPtr<u64>, AtomicBool)>);

impl Default for Followed {
    fn default() -> Self {
        let shared = Arc::new((AtomicPtr::new(std::ptr::null_mut()), AtomicBool::new(false)));
        let other = Arc::clone(&shared);
        std::thread::spawn(move || {
            while !other.1.load(Ordering::Relaxed) {
                std::hint::black_box(other.0.load(Ordering::Acquire));
            }
        });
        Self(shared)
    }
}

impl Followed {
    fn exchange_twice(&self) -> u64 {
        let began = Instant::now();
        let before = self.0.0.swap(std::ptr::null_mut(), Ordering::SeqCst);
        std::hint::black_box(self.0.0.swap(before, Ordering::SeqCst));
        began.elapsed().as_nanos() as u64
    }
}

impl Drop for Followed {
    fn drop(&mut self) {
        self.0.1.store(true, Ordering::Relaxed);
    }
}
