//! From a wanted motion to wheel velocities: limits first, then a trim from the encoders.
//!
//! Decision: feed-forward with limited acceleration, plus a slow integral trim for each side. The trim only evens out motors that
//! pull unequally, so a lost encoder makes the robot a little less straight and nothing worse. Not chosen: a full velocity
//! controller; its output depends on the encoders so much that one dead encoder sends that side to full power.

use std::f64::consts::TAU;

use board_protocol::robot;
use robot_objects::motion::Motion;

/// The drive's measures and limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Wheel radius in m.
    pub wheel_radius: f64,
    /// Distance between left and right wheels in m, as it works when skidding.
    pub track: f64,
    /// Encoder ticks of one wheel revolution.
    pub ticks_per_turn: f64,
    /// Fastest wheel in rad/s.
    pub max_wheel: f64,
    /// Fastest change of the forward speed in m/s^2 when speeding up; slowing down may be three times as fast.
    pub max_acceleration: f64,
    /// Fastest change of the turn rate in rad/s^2.
    pub max_turn_acceleration: f64,
    /// How fast the trim follows an error, in 1/s; 0: no trim.
    pub trim_gain: f64,
}

impl Default for Drive {
    fn default() -> Self {
        Self {
            wheel_radius: f64::from(robot::WHEEL_RADIUS_M),
            track: f64::from(robot::TRACK_WIDTH_M),
            ticks_per_turn: f64::from(robot::TICKS_PER_REVOLUTION),
            max_wheel: f64::from(robot::MAX_WHEEL_RAD_S),
            max_acceleration: 1.0,
            max_turn_acceleration: 6.0,
            trim_gain: 0.5,
        }
    }
}

/// Braking may be this much harder than speeding up: stopping late is dangerous, starting late is not.
const BRAKING: f64 = 3.0;

/// The trim never adds more than this share of the wanted velocity.
const TRIM_LIMIT: f64 = 0.2;

/// Calls of a new instance that wait for the encoders to tell how the wheels turn.
const TAKE_OVER: u8 = 4;

/// Limiter and trim.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WheelControl {
    now: Motion,
    /// Whether `now` is known: the wheels may turn already when an instance begins, if it succeeds one that failed.
    going: bool,
    waited: u8,
    /// Factor on each side's velocity is `1 + trim`.
    trim: [f64; 2],
    measured: Option<[f64; 2]>,
    last_ticks: Option<([i32; 4], f64)>,
}

impl WheelControl {
    /// Wheel velocities `[left, right]` in rad/s that bring the robot nearer to `wanted` within `elapsed` s. None while a
    /// new instance does not know yet how the wheels turn: the board keeps to its last command for that long.
    pub fn drive(&mut self, wanted: Motion, elapsed: f64, drive: &Drive) -> Option<[f64; 2]> {
        if !self.going && !self.take_over(drive) {
            return None;
        }
        self.now.forward = approach(self.now.forward, wanted.forward, drive.max_acceleration * elapsed);
        self.now.turn = approach(self.now.turn, wanted.turn, drive.max_turn_acceleration * elapsed);
        let feed_forward = wheels_of(self.now, drive);
        self.adapt(feed_forward, elapsed, drive);
        let trimmed = [feed_forward[0] * (1.0 + self.trim[0]), feed_forward[1] * (1.0 + self.trim[1])];
        Some(within(trimmed, drive.max_wheel))
    }

    /// Begins with the motion that the encoders tell; without encoders from standstill, after a while.
    fn take_over(&mut self, drive: &Drive) -> bool {
        self.waited += 1;
        self.now = self.measured.map_or(Motion::STOP, |wheels| motion_of(wheels, drive));
        self.going = self.measured.is_some() || self.waited > TAKE_OVER;
        self.going
    }

    /// Takes an encoder reading, `time` in s.
    pub fn observe(&mut self, ticks: [i32; 4], time: f64, drive: &Drive) {
        if let Some((before, then)) = self.last_ticks {
            let elapsed = time - then;
            self.measured = (elapsed > 0.0).then(|| side_velocities(before, ticks, elapsed, drive));
        }
        self.last_ticks = Some((ticks, time));
    }

    /// Forgets the motion (not the trim): the next start is from standstill.
    pub fn halt(&mut self) {
        (self.now, self.going, self.waited) = (Motion::STOP, false, 0);
        (self.measured, self.last_ticks) = (None, None);
    }

    fn adapt(&mut self, commanded: [f64; 2], elapsed: f64, drive: &Drive) {
        let Some(measured) = self.measured.take() else { return };
        for side in 0..2 {
            // Near standstill the ratio says more about friction than about the motor.
            if commanded[side].abs() > 1.0 && measured[side] * commanded[side] >= 0.0 {
                let error = 1.0 - measured[side] / commanded[side];
                let trim = self.trim[side] + error.clamp(-1.0, 1.0) * drive.trim_gain * elapsed;
                self.trim[side] = trim.clamp(-TRIM_LIMIT, TRIM_LIMIT);
            }
        }
    }
}

/// `wanted`, or as near to it as a change of `step` allows; towards zero `BRAKING` times that.
fn approach(now: f64, wanted: f64, step: f64) -> f64 {
    let wanted = if wanted.is_finite() { wanted } else { 0.0 };
    let slowing = wanted.abs() < now.abs() || wanted * now < 0.0;
    let step = if slowing { step * BRAKING } else { step };
    now + (wanted - now).clamp(-step, step)
}

fn wheels_of(motion: Motion, drive: &Drive) -> [f64; 2] {
    let difference = motion.turn * drive.track / 2.0;
    [(motion.forward - difference) / drive.wheel_radius, (motion.forward + difference) / drive.wheel_radius]
}

fn motion_of([left, right]: [f64; 2], drive: &Drive) -> Motion {
    Motion {
        forward: f64::midpoint(left, right) * drive.wheel_radius,
        turn: (right - left) * drive.wheel_radius / drive.track,
    }
}

/// Both sides scaled alike, so that a limit makes the curve slower and not wider.
fn within([left, right]: [f64; 2], limit: f64) -> [f64; 2] {
    let scale = (limit / left.abs().max(right.abs()).max(f64::MIN_POSITIVE)).min(1.0);
    [left * scale, right * scale]
}

fn side_velocities(before: [i32; 4], after: [i32; 4], elapsed: f64, drive: &Drive) -> [f64; 2] {
    let velocity =
        |wheel: usize| f64::from(after[wheel].wrapping_sub(before[wheel])) * TAU / drive.ticks_per_turn / elapsed;
    [f64::midpoint(velocity(0), velocity(1)), f64::midpoint(velocity(2), velocity(3))]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Past the time of taking over, standing.
    fn standing() -> (WheelControl, Drive) {
        (WheelControl { going: true, ..WheelControl::default() }, Drive::default())
    }

    fn drive(control: &mut WheelControl, wanted: Motion, elapsed: f64, drive: &Drive) -> [f64; 2] {
        control.drive(wanted, elapsed, drive).expect("it has taken over")
    }

    #[test]
    fn speeding_up_is_limited_and_braking_is_faster() {
        let (mut control, limits) = standing();
        let wanted = Motion { forward: 0.5, turn: 0.0 };
        let [left, right] = drive(&mut control, wanted, 0.02, &limits);
        assert!((left - 0.02 / 0.0625).abs() < 1e-9 && (left - right).abs() < 1e-12);
        let steps = (0..100).take_while(|_| drive(&mut control, wanted, 0.02, &limits)[0] < 7.99).count();
        assert!((20..30).contains(&steps), "{steps}");
        let braking = (0..100).take_while(|_| drive(&mut control, Motion::STOP, 0.02, &limits)[0] > 0.01).count();
        assert!(braking < 10, "{braking}");
    }

    #[test]
    fn turning_left_makes_the_right_side_faster() {
        let (mut control, limits) = standing();
        let [left, right] = drive(&mut control, Motion { forward: 0.0, turn: 1.0 }, 1.0, &limits);
        assert!(left < 0.0 && right > 0.0);
    }

    #[test]
    fn a_weak_side_is_trimmed_up_but_not_without_limit() {
        let (mut control, limits) = standing();
        let wanted = Motion { forward: 0.4, turn: 0.0 };
        let mut rolled = [0.0, 0.0];
        for step in 0..2000 {
            let [left, right] = drive(&mut control, wanted, 0.02, &limits);
            assert!(left <= 6.4 * 1.2 + 1e-3 && right <= 6.4 * 1.2 + 1e-3);
            rolled = [rolled[0] + left * 0.5 * 0.02, rolled[1] + right * 0.02];
            let [weak, strong] = rolled.map(|angle: f64| (angle * 2000.0 / TAU) as i32);
            control.observe([weak, weak, strong, strong], f64::from(step) * 0.02, &limits);
        }
        assert!(control.trim[0] > 0.19 && control.trim[1].abs() < 0.02, "{:?}", control.trim);
    }

    #[test]
    fn a_wheel_limit_keeps_the_curve() {
        let [left, right] = within([10.0, 30.0], 15.0);
        assert!((left - 5.0).abs() < 1e-12 && (right - 15.0).abs() < 1e-12);
    }

    #[test]
    fn nonsense_stops_the_robot() {
        let (mut control, limits) = standing();
        let nonsense = Motion { forward: f64::NAN, turn: f64::INFINITY };
        assert_eq!(drive(&mut control, nonsense, 0.02, &limits), [0.0, 0.0]);
    }

    #[test]
    fn a_successor_takes_over_from_turning_wheels() {
        let (mut control, limits) = (WheelControl::default(), Drive::default());
        let wanted = Motion { forward: 0.5, turn: 0.0 };
        control.observe([1000; 4], 1.0, &limits);
        assert_eq!(control.drive(wanted, 0.02, &limits), None, "one reading tells no speed");
        control.observe([1050; 4], 1.02, &limits);
        let [left, right] = drive(&mut control, wanted, 0.02, &limits);
        assert!((left - 8.0).abs() < 0.2 && (right - 8.0).abs() < 0.2, "{left} {right}");
    }

    #[test]
    fn without_encoders_it_begins_all_the_same() {
        let mut control = WheelControl::default();
        let begun = (0..10).position(|_| control.drive(Motion::STOP, 0.02, &Drive::default()).is_some());
        assert_eq!(begun, Some(4));
    }
}
