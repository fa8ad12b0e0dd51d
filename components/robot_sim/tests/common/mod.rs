//! The least a driver of this robot can do; not a test itself.

use board_protocol::robot::{RING, RING_STEP_RAD, TRACK_WIDTH_M, WHEEL_RADIUS_M};
use board_protocol::{Command, WheelVelocities};

/// Wheel set points for `speed` m/s and `turn` rad/s.
pub(crate) fn drive(speed: f64, turn: f64) -> Command {
    let side = |sign: f64| ((speed + sign * turn * f64::from(TRACK_WIDTH_M) / 2.0) / f64::from(WHEEL_RADIUS_M)) as f32;
    Command::WheelVelocities(WheelVelocities { left_rad_s: side(-1.0), right_rad_s: side(1.0) })
}

/// Echoes as places around the robot's centre, x ahead, y left, in metres.
fn echoes(ring: [u16; RING]) -> Vec<(f64, f64)> {
    let heard = ring.iter().enumerate().filter(|(_, mm)| **mm > 0);
    let place = |(index, mm): (usize, &u16)| {
        let (angle, range) = (index as f64 * f64::from(RING_STEP_RAD), f64::from(*mm) / 1000.0 + 0.2);
        (range * angle.cos(), range * angle.sin())
    };
    heard.map(place).collect()
}

/// Drives into the free corridor nearest to the target's bearing: the least an avoider can do.
pub(crate) fn avoid(ring: [u16; RING], bearing: f64, last: &mut f64) -> Command {
    let echoes = echoes(ring);
    let free = |heading: f64| {
        echoes.iter().all(|(x, y)| {
            let along = x * heading.cos() + y * heading.sin();
            let aside = (y * heading.cos() - x * heading.sin()).abs();
            !(0.0..=1.1).contains(&along) || aside > 0.45
        })
    };
    let cost = |heading: &f64| (heading - bearing).abs() + 0.4 * (heading - *last).abs();
    let headings = (-36..=36).map(|step| f64::from(step) * 0.07).filter(|heading| free(*heading));
    let heading = headings.min_by(|a, b| cost(a).total_cmp(&cost(b)));
    *last = heading.unwrap_or(*last);
    heading.map_or(drive(0.0, 0.8), |heading| drive(0.45 * (1.0 - heading.abs()).max(0.1), 1.8 * heading))
}
