//! The paper's experiment behind its figure 10: the power of the left wheels fails while the robot drives, and the front left
//! encoder is compared with its reference model, filtered over windows of several lengths.
//!
//! Simulator, model and comparison are those of the robot and the daemon; only the clock is virtual, so that the same seed gives
//! the same figure.

use std::time::Duration;

use board_protocol::{Command, Telemetry, WheelVelocities};
use encoder_model::wheels::Wheels;
use framework_daemon::detect::model_diff::{Change, Comparison, Demand, Measure, Reading, Side};
use motor_control::wheel_control::{Drive, WheelControl};
use robot_objects::motion::Motion;
use robot_sim::{Simulation, World};

/// Lengths of the window, in ms.
pub const WINDOWS_MS: [u64; 5] = [100, 200, 400, 700, 1000];
/// Largest difference of the filtered rates, in ticks/s: about a third of what a wheel counts.
pub const THRESHOLD: f64 = 800.0;
/// When the power fails, in s after the first command to drive.
pub const POWER_OFF: f64 = 1.0;
/// Length of the run after the first command, in s.
pub const LENGTH: f64 = 2.5;

/// The robot stands for as long before: a window of 1 s is to be full when the power fails.
const STANDS_MS: u64 = 300;
const STEP: Duration = Duration::from_millis(10);
/// As the profile says.
const LAG: f64 = 0.04;
const FRONT_LEFT: usize = 0;

/// A window, and what it saw.
#[derive(Clone, Debug)]
pub struct Windowed {
    /// Its length in ms.
    pub window_ms: u64,
    /// Time in s since the first command, and what the comparison said.
    pub readings: Vec<(f64, Reading)>,
    /// When the fault was raised, in s.
    pub detected: Option<f64>,
}

/// What was measured.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// The encoder's rate from one reading to the next: time in s, ticks/s.
    pub encoder: Vec<(f64, f64)>,
    /// The model's, likewise.
    pub model: Vec<(f64, f64)>,
    /// One for each length.
    pub windows: Vec<Windowed>,
}

/// Drives, cuts the power, compares.
#[must_use]
pub fn experiment(seed: u64) -> Experiment {
    let mut robot = Simulation::new(World::warehouse(), seed);
    robot.cut_left_power_after(Duration::from_secs_f64(POWER_OFF));
    let (mut control, mut model) = (WheelControl::default(), Wheels::default());
    let mut watch = Watch::new();
    let end_ms = STANDS_MS + (LENGTH * 1e3) as u64;
    let mut command = [0.0; 2];
    for now_ms in (0..end_ms).step_by(10) {
        let driving = now_ms >= STANDS_MS;
        if now_ms % 20 == 0 {
            // The model runs in its own rhythm, after the board's telemetry has come in.
            model.advance(command, 0.02, LAG);
            watch.note(Side::Model, now_ms, model.ticks()[FRONT_LEFT]);
            // Nobody steers: the turn that the failure makes is not evened out.
            let wanted = Motion { forward: if driving { 0.45 } else { 0.0 }, turn: 0.0 };
            command = control.drive(wanted, 0.02, &Drive::default()).unwrap_or_default();
            let speeds = WheelVelocities { left_rad_s: command[0] as f32, right_rad_s: command[1] as f32 };
            robot.command(Command::WheelVelocities(speeds));
        }
        for telemetry in robot.advance(STEP) {
            if let Telemetry::Encoders(encoders) = telemetry {
                let time = f64::from(encoders.time_us) / 1e6;
                control.observe(encoders.ticks, time, &Drive::default());
                watch.note(Side::Target, now_ms + 10, encoders.ticks[FRONT_LEFT]);
            }
        }
    }
    watch.into_experiment()
}

/// All that listens.
struct Watch {
    last: [Option<(u64, i32)>; 2],
    rates: [Vec<(f64, f64)>; 2],
    windows: Vec<(Comparison, Windowed)>,
}

impl Watch {
    fn new() -> Self {
        let window = |window_ms: u64| {
            let demand = Demand { window_ns: window_ms * 1_000_000, threshold: THRESHOLD, measure: Measure::Rate };
            (Comparison::new(demand), Windowed { window_ms, readings: Vec::new(), detected: None })
        };
        Self { last: [None; 2], rates: Default::default(), windows: WINDOWS_MS.into_iter().map(window).collect() }
    }

    fn note(&mut self, side: Side, now_ms: u64, ticks: i32) {
        let seconds = |at_ms: u64| (at_ms as f64 - STANDS_MS as f64) / 1e3;
        let place = usize::from(side == Side::Model);
        if let Some((then_ms, before)) = self.last[place].replace((now_ms, ticks)) {
            let rate = f64::from(ticks.wrapping_sub(before)) / ((now_ms - then_ms) as f64 / 1e3);
            self.rates[place].push((seconds(now_ms), rate));
        }
        for (comparison, windowed) in &mut self.windows {
            let Some(reading) = comparison.note(side, f64::from(ticks), now_ms * 1_000_000) else { continue };
            windowed.readings.push((seconds(reading.at_ns / 1_000_000), reading));
            if reading.change == Some(Change::Parted) && windowed.detected.is_none() {
                windowed.detected = Some(seconds(now_ms));
            }
        }
    }

    fn into_experiment(self) -> Experiment {
        let [encoder, model] = self.rates;
        Experiment { encoder, model, windows: self.windows.into_iter().map(|(_, windowed)| windowed).collect() }
    }
}
