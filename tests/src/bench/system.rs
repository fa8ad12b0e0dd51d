//! One slot on one executor, in this process: what recoveries are measured on.

use std::sync::Arc;
use std::time::Duration;

use crossbeam_channel::Receiver;
use framework_daemon::model::fault::FaultEvent;
use framework_daemon::profile::load;
use framework_daemon::supervise::boot::boot;
use framework_daemon::supervise::shutdown::shutdown;
use framework_daemon::supervise::system::{Placed, System};
use framework_daemon::sys::trap;
use serde_json::{Value, json};

use super::stats::Samples;
use crate::profiles::{Profiles, application, plugin_dir, slot};

/// Longest time that anything may take.
pub const PATIENCE: Duration = Duration::from_secs(10);
/// Priority of executor and yardstick under `fifo`.
pub const PRIORITY: i32 = 50;

/// What takes the place of the instance that failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Payload {
    /// One that is made at the moment of the fault; the same one after a panic.
    Fresh,
    /// One that was made before, of the same class.
    Spare,
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
            Self::Fresh => "",
            Self::Spare => "<spare count=\"4\" preload=\"instance\"/>",
        }
    }
}

/// Nanoseconds from the fault to each step of its recovery.
#[derive(Debug, Default)]
pub struct Steps {
    /// The executor knew of it.
    pub detected: Samples,
    /// The answer was looked up.
    pub decided: Samples,
    /// The successor was started.
    pub ready: Samples,
    /// Its first callback was completed: what is compared with the limit.
    pub first_callback: Samples,
}

impl Steps {
    /// The medians of those before the last.
    #[must_use]
    pub fn medians(&mut self) -> Value {
        json!({"detected": self.detected.at(0.5), "decided": self.decided.at(0.5), "ready": self.ready.at(0.5)})
    }
}

/// A system of one slot, `subject`.
pub struct OneSlot {
    system: System,
    events: Receiver<FaultEvent>,
}

/// The profiles of a slot of that class that is reset whatever happens.
#[must_use]
pub fn profiles(class: &str, properties: &str, payload: Payload, policy: &str) -> Profiles {
    let rules = format!(
        "<executor>main</executor>{properties}<fault_tolerance><severity>reset</severity>\
         <reset limit=\"1000\" within=\"1ms\"/>{}</fault_tolerance>",
        payload.rule()
    );
    let profiles = Profiles::new(&application(&[slot("subject", class, &rules)], &[]));
    let priority = if policy == "fifo" { format!(" policy=\"fifo\" priority=\"{PRIORITY}\"") } else { String::new() };
    let executor = format!("<executor name=\"main\"{priority}/>");
    profiles.write("system.xml", &format!("<system_profile><name>bench</name>{executor}</system_profile>"));
    profiles
}

impl OneSlot {
    /// Boots it.
    ///
    /// # Panics
    /// When it does not come up.
    #[must_use]
    pub fn boot(profiles: &Profiles) -> Self {
        let plan = load::load(profiles.path()).expect("the profile is valid").plan;
        let (sender, events) = crossbeam_channel::bounded(64);
        trap::install();
        let system = boot(Arc::new(plan), &[plugin_dir()], sender).expect("the system comes up");
        Self { system, events }
    }

    /// The slot.
    ///
    /// # Panics
    /// Never: it is there.
    #[must_use]
    pub fn subject(&self) -> Placed {
        self.system.slot("subject").expect("the slot is there").clone()
    }

    /// Waits for the next fault and adds its recovery.
    ///
    /// # Panics
    /// When none comes, or it is not recovered.
    pub fn recovered(&self, steps: &mut Steps) {
        let event = self.events.recv_timeout(PATIENCE).expect("a fault event comes");
        let times = event.times;
        steps.detected.add(times.detected_ns);
        steps.decided.add(times.decided_ns);
        steps.ready.add(times.ready_ns.expect("it is recovered"));
        steps.first_callback.add(times.first_callback_ns.expect("it is recovered"));
    }

    /// Ends it in order.
    pub fn shutdown(self) {
        shutdown(self.system);
    }
}
