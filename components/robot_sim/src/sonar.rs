//! The ultrasonic ring: each sensor hears the nearest thing in its cone.

use board_protocol::robot::{MAX_RANGE_MM, MIN_RANGE_MM, RING, RING_RADIUS_M, RING_STEP_RAD};

use crate::geometry::Pose;
use crate::noise::Noise;
use crate::scene::Scene;

/// Half the opening angle of a sensor's cone, in radians (12 degrees).
const HALF_CONE: f64 = 0.21;
/// Rays per cone. Five find a 4 cm post at 1 m; more cost time and find nothing new in a room.
const RAYS: u32 = 5;
/// Standard deviation of a range: this many metres, plus [`NOISE_SHARE`] of the range.
const NOISE_M: f64 = 0.004;
const NOISE_SHARE: f64 = 0.004;
/// One echo in this many is not heard.
const DROPOUT_ONE_IN: f64 = 80.0;

/// What the ring hears from `pose`: millimetres from each sensor, [`MAX_RANGE_MM`] where nothing came back.
#[must_use]
pub fn ring(scene: &Scene, pose: Pose, noise: &mut Noise) -> [u16; RING] {
    std::array::from_fn(|index| {
        let range = echo(scene, pose, index);
        // Both draws happen for every sensor, so that one wall more does not shift the noise of all the rest.
        let (error, heard) = (noise.bell(), noise.unit() >= 1.0 / DROPOUT_ONE_IN);
        range.filter(|_| heard).map_or(MAX_RANGE_MM, |range| measured(range, error))
    })
}

/// Distance from sensor `index` to the nearest thing in its cone, in metres, without noise.
#[must_use]
pub fn echo(scene: &Scene, pose: Pose, index: usize) -> Option<f64> {
    let direction = pose.theta + index as f64 * f64::from(RING_STEP_RAD);
    let sensor = pose.at.towards(direction, f64::from(RING_RADIUS_M));
    let reach = f64::from(MAX_RANGE_MM) / 1000.0;
    let rays = (0..RAYS).map(|ray| direction + HALF_CONE * (2.0 * f64::from(ray) / f64::from(RAYS - 1) - 1.0));
    rays.filter_map(|angle| scene.nearest(sensor, angle, reach)).min_by(f64::total_cmp)
}

fn measured(range: f64, error: f64) -> u16 {
    let millimetres = (range + error * (NOISE_M + NOISE_SHARE * range)) * 1000.0;
    millimetres.clamp(f64::from(MIN_RANGE_MM), f64::from(MAX_RANGE_MM)) as u16
}
