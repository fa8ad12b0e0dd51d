//! Dead reckoning of a skid-steered robot from four wheel encoders.
//!
//! Decision: both wheels of a side are averaged and the track is an *effective* one, wider than the real: skidding wheels turn the
//! robot less than their speed difference says. Not chosen: modelling the slip; it needs the floor's friction, which nobody has.

use board_protocol::robot;
use robot_objects::angle;

/// Encoder ticks in the order front left, rear left, front right, rear right; they wrap around at 32 bits.
pub type Ticks = [i32; 4];

/// The drive's measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Wheel radius in m.
    pub wheel_radius: f64,
    /// Distance between left and right wheels in m, as it works when skidding.
    pub track: f64,
    /// Encoder ticks of one wheel revolution.
    pub ticks_per_turn: f64,
    /// Fastest believable wheel rim speed in m/s; a faster step is taken for a restart of the board's counters.
    pub top_speed: f64,
}

/// How much wider than measured the track works when all four wheels skid in turns.
pub const SKID: f64 = 1.03;

impl Default for Drive {
    fn default() -> Self {
        Self {
            wheel_radius: f64::from(robot::WHEEL_RADIUS_M),
            track: SKID * f64::from(robot::TRACK_WIDTH_M),
            ticks_per_turn: f64::from(robot::TICKS_PER_REVOLUTION),
            top_speed: 5.0,
        }
    }
}

/// Where the robot believes to be, and how it moves.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Odometer {
    /// Position along the start's forward axis, in m.
    pub x: f64,
    /// Position to the left of the start, in m.
    pub y: f64,
    /// Heading relative to the start, in rad, in `-PI..=PI`.
    pub heading: f64,
    /// Forward speed in m/s.
    pub forward: f64,
    /// Turn rate in rad/s.
    pub turn: f64,
    last: Option<(Ticks, f64)>,
}

impl Odometer {
    /// Takes one reading, `time` in s. True when the reading moved the estimate; false for the first one and for one that cannot be
    /// a step from the last (counters restarted, no time passed).
    pub fn advance(&mut self, ticks: Ticks, time: f64, drive: &Drive) -> bool {
        let Some((before, then)) = self.last else {
            self.last = Some((ticks, time));
            return false;
        };
        let elapsed = time - then;
        if elapsed == 0.0 {
            return false;
        }
        self.last = Some((ticks, time));
        let [left, right] = side_steps(before, ticks, drive);
        if elapsed < 0.0 || left.abs().max(right.abs()) > drive.top_speed * elapsed.max(0.02) {
            return false;
        }
        self.step(left, right, elapsed, drive.track);
        true
    }

    /// Along the chord of the arc: exact for a circle, and it needs no case for straight lines.
    fn step(&mut self, left: f64, right: f64, elapsed: f64, track: f64) {
        let along = f64::midpoint(left, right);
        let about = (right - left) / track;
        let half = about / 2.0;
        let chord = if half.abs() < 1e-6 { along } else { along * half.sin() / half };
        self.x += chord * (self.heading + half).cos();
        self.y += chord * (self.heading + half).sin();
        self.heading = angle::wrap(self.heading + about);
        self.forward = along / elapsed;
        self.turn = about / elapsed;
    }
}

/// How far each side's rims rolled, in m.
fn side_steps(before: Ticks, after: Ticks, drive: &Drive) -> [f64; 2] {
    let per_tick = std::f64::consts::TAU * drive.wheel_radius / drive.ticks_per_turn;
    let rolled = |wheel: usize| f64::from(after[wheel].wrapping_sub(before[wheel])) * per_tick;
    [f64::midpoint(rolled(0), rolled(1)), f64::midpoint(rolled(2), rolled(3))]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{PI, TAU};

    fn drive() -> Drive {
        Drive { wheel_radius: 1.0 / TAU, track: 0.5, ticks_per_turn: 1000.0, top_speed: 50.0 }
    }

    #[test]
    fn straight_ahead() {
        let mut odometer = Odometer::default();
        assert!(!odometer.advance([0; 4], 0.0, &drive()));
        assert!(odometer.advance([500; 4], 1.0, &drive()));
        assert!((odometer.x - 0.5).abs() < 1e-9 && odometer.y.abs() < 1e-9);
        assert!((odometer.forward - 0.5).abs() < 1e-9);
    }

    #[test]
    fn a_circle_closes() {
        let (mut odometer, mut ticks) = (Odometer::default(), [0; 4]);
        for step in 0..=360 {
            odometer.advance(ticks, f64::from(step), &drive());
            // One degree a step on a circle of 1 m: left rim at 0.75 m, right rim at 1.25 m.
            let rim = |radius: f64| ((f64::from(step + 1) * radius * PI / 180.0) * 1000.0).round() as i32;
            ticks = [rim(0.75), rim(0.75), rim(1.25), rim(1.25)];
        }
        assert!(odometer.x.abs() < 0.01 && odometer.y.abs() < 0.01, "{odometer:?}");
    }

    #[test]
    fn counters_wrap_around() {
        let mut odometer = Odometer::default();
        odometer.advance([i32::MAX - 99; 4], 0.0, &drive());
        odometer.advance([i32::MIN + 100; 4], 1.0, &drive());
        assert!((odometer.x - 0.2).abs() < 1e-9);
    }

    #[test]
    fn a_board_that_restarts_does_not_move_the_robot() {
        let mut odometer = Odometer::default();
        odometer.advance([2_000_000; 4], 0.0, &drive());
        assert!(!odometer.advance([0; 4], 0.02, &drive()));
        assert!(odometer.advance([10; 4], 0.04, &drive()));
        assert!((odometer.x - 0.01).abs() < 1e-9);
    }
}
