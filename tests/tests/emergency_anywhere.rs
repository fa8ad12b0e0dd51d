//! The emergency stop reaches every actuator: wherever actuators and faults are, whatever fails meanwhile.
//!
//! `ROUNDS=200 cargo test -p tests --test emergency_anywhere` plays that many; `SEED` repeats a run.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use component_sdk::abi::inject;
use framework_daemon::exec::emergency;
use framework_daemon::model::lifecycle::State;
use framework_daemon::profile::load;
use framework_daemon::supervise::boot::boot;
use framework_daemon::supervise::shutdown::shutdown;
use framework_daemon::supervise::system::{Placed, System};
use framework_daemon::sys::trap;
use tempfile::TempDir;
use tests::profiles::{Profiles, application, plugin_dir, slot};

/// Far beyond what anything here needs.
const PATIENCE: Duration = Duration::from_secs(60);

/// Numbers that come again with the same seed (splitmix64).
struct Dice(u64);

impl Dice {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((mixed ^ (mixed >> 31)) % end.max(1) as u64) as usize
    }
}

fn until(what: &str, test: impl Fn() -> bool) {
    let began = Instant::now();
    while !test() {
        assert!(began.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn last_line(path: &Path) -> Option<String> {
    std::fs::read_to_string(path).unwrap_or_default().lines().last().map(str::to_owned)
}

/// A robot drawn by lot.
struct Robot {
    profiles: Profiles,
    lines: TempDir,
    actuators: Vec<(String, usize)>,
    /// The executor on which a callback does not return.
    hung: Option<usize>,
}

const EXECUTORS: usize = 4;

/// It does not return from its tenth callback.
const SLEEPS: &str = "<properties><property name=\"how\" type=\"string\">sleep</property></properties>";

impl Robot {
    fn drawn(dice: &mut Dice) -> Self {
        let lines = TempDir::new().unwrap();
        let rules = |severity: &str| {
            format!("<fault_tolerance><severity symptom=\"crash\">{severity}</severity></fault_tolerance>")
        };
        let on = |executor: usize| format!("<executor>e{executor}</executor>");
        let executors = 1 + dice.below(EXECUTORS);
        let actuators: Vec<(String, usize)> =
            (0..1 + dice.below(8)).map(|number| (format!("wheel_{number}"), dice.below(executors))).collect();
        let wheel = |(name, executor): &(String, usize), severity: &str| {
            let path = lines.path().join(name);
            let line = format!("<property name=\"line\" type=\"string\">{}</property>", path.display());
            slot(name, "Brake", &format!("{}<properties>{line}</properties>{}", on(*executor), rules(severity)))
        };
        let severities = ["reset", "stop", "emergency"];
        let mut slots: Vec<String> = actuators.iter().map(|one| wheel(one, severities[dice.below(3)])).collect();
        // The sensor's executor never hangs: somebody must see the fault.
        slots.push(slot("sensor", "Witness", &format!("<executor>free</executor>{}", rules("emergency"))));
        let hung = (dice.below(4) == 0).then(|| dice.below(executors));
        slots.extend(hung.map(|executor| slot("stuck", "Stuck", &(on(executor) + SLEEPS))));
        let profiles = Profiles::new(&application(&slots, &[]));
        profiles.describe(&plugin_dir().join("libhostile.so"));
        let named: String = (0..EXECUTORS).map(|number| format!("<executor name=\"e{number}\"/>")).collect();
        let told: String = actuators.iter().map(|(name, _)| format!("<actuator component=\"{name}\"/>")).collect();
        profiles.write(
            "system.xml",
            &format!("<system_profile><name>r</name>{named}<executor name=\"free\"/><emergency>{told}</emergency></system_profile>"),
        );
        Self { profiles, lines, actuators, hung }
    }

    fn line(&self, actuator: &str) -> Option<String> {
        last_line(&self.lines.path().join(actuator))
    }
}

fn provoke(placed: &Placed, dice: &mut Dice) {
    let symptoms = ["crash.panic", "crash.segv", "crash.fpe", "crash.abort", "crash.stack"];
    let code = inject::code(symptoms[dice.below(symptoms.len())]).unwrap();
    // One that hangs, or has stopped, does not answer: its faults are not provoked.
    let _ = placed.executor.inject(placed.member, code, Duration::from_millis(20));
}

/// Faults of anybody, at any moment, the sensor's among them: until it is latched, and some more.
fn storm(robot: &Robot, system: &System, dice: &mut Dice) {
    let sensor = system.slot("sensor").unwrap();
    let anybody = |dice: &mut Dice| system.slot(&robot.actuators[dice.below(robot.actuators.len())].0).unwrap();
    std::thread::sleep(Duration::from_millis(dice.below(40) as u64));
    for _ in 0..dice.below(3) {
        provoke(anybody(dice), dice);
        std::thread::sleep(Duration::from_micros(dice.below(3000) as u64));
    }
    provoke(sensor, dice);
    for _ in 0..dice.below(4) {
        provoke(anybody(dice), dice);
        std::thread::sleep(Duration::from_micros(dice.below(300) as u64));
    }
}

fn round(seed: u64) {
    let mut dice = Dice(seed);
    let robot = Robot::drawn(&mut dice);
    let plan = load::load(robot.profiles.path()).unwrap().plan;
    // Nobody reads it: what does not fit is lost, the stop is not.
    let (sender, _events) = crossbeam_channel::bounded(4);
    let system = boot(Arc::new(plan), &[plugin_dir()], sender).unwrap();
    for (name, _) in &robot.actuators {
        until(&format!("seed {seed}: {name} drives"), || robot.line(name).is_some());
    }
    storm(&robot, &system, &mut dice);
    until(&format!("seed {seed}: it is latched"), emergency::latched);
    for (name, executor) in &robot.actuators {
        let state = || system.slot(name).map(|placed| placed.slot.status.state());
        let answers = robot.hung != Some(*executor);
        until(&format!("seed {seed}: {name} is stopped, its last word is safe"), || {
            (!answers || state() != Some(State::Active)) && robot.line(name).as_deref() == Some("stop")
        });
    }
    // It stays so.
    std::thread::sleep(Duration::from_millis(20));
    for (name, _) in &robot.actuators {
        assert_eq!(robot.line(name).as_deref(), Some("stop"), "seed {seed}: {name}");
    }
    assert!(emergency::latched());
    shutdown(system);
    assert!(emergency::clear().is_some());
}

// One test: there is one emergency stop for the process.
#[test]
fn wherever_actuators_and_faults_are_every_safe_output_is_written() {
    let number = |name: &str, default: u64| std::env::var(name).map_or(default, |text| text.parse().unwrap());
    trap::install();
    let seed = number("SEED", 1);
    (seed..seed + number("ROUNDS", 12)).for_each(round);
}
