//! The forward camera: one ray per column, things painted from far to near, so that the tall target is seen over low
//! obstacles.
//!
//! Decision: a column renderer in the manner of the early first-person games. It has everything a colour detector can
//! trip over (perspective, occlusion, shading, noise) at half a millisecond a frame; a real renderer would bring a graphics stack
//! into a test program.

use std::time::Duration;

use crate::geometry::{Point, Pose};
use crate::noise::Noise;
use crate::scene::{Hit, Scene};
use crate::world::Colour;

/// Pixels across.
pub const WIDTH: usize = 160;
/// Pixels down.
pub const HEIGHT: usize = 120;
/// Horizontal field of view, in radians (60 degrees).
pub const FIELD_OF_VIEW_RAD: f64 = std::f64::consts::PI / 3.0;
/// Time from frame to frame (15 Hz).
pub const PERIOD: Duration = Duration::from_micros(66_667);
/// How far in front of the robot's centre the camera sits, in metres.
pub const FORWARD_M: f64 = 0.15;
/// How high the camera sits, in metres.
pub const ABOVE_FLOOR_M: f64 = 0.30;

/// Row of the horizon: the camera is level.
const HORIZON: f64 = (HEIGHT as f64 - 1.0) / 2.0;
const REACH_M: f64 = 30.0;
const FLOOR: [Colour; 2] = [[150, 146, 136], [138, 134, 125]];
const TILE_M: f64 = 0.5;
const SKY: Colour = [216, 222, 228];
/// Distance at which a surface has lost half its light, in metres.
const HALF_LIGHT_M: f64 = 14.0;
const PIXEL_NOISE: f64 = 2.0;

/// One picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    /// Counts the frames of a run from 0.
    pub seq: u32,
    /// Time since the simulation began, in microseconds.
    pub time_us: u64,
    /// Rows from the top, each pixel red, green, blue: [`WIDTH`] x [`HEIGHT`] x 3 bytes.
    pub rgb: Vec<u8>,
}

impl Frame {
    /// The colour at column `x` from the left and row `y` from the top.
    ///
    /// # Panics
    /// Outside the picture.
    #[must_use]
    pub fn pixel(&self, x: usize, y: usize) -> Colour {
        let at = (y * WIDTH + x) * 3;
        [self.rgb[at], self.rgb[at + 1], self.rgb[at + 2]]
    }
}

/// Distance of the image plane in pixels: what makes [`WIDTH`] span [`FIELD_OF_VIEW_RAD`].
#[must_use]
pub fn focal_pixels() -> f64 {
    WIDTH as f64 / 2.0 / (FIELD_OF_VIEW_RAD / 2.0).tan()
}

/// What the camera of a robot at `pose` sees.
#[must_use]
pub fn render(scene: &Scene, pose: Pose, noise: &mut Noise) -> Vec<u8> {
    let mut rgb = vec![0; WIDTH * HEIGHT * 3];
    let eye = pose.at.towards(pose.theta, FORWARD_M);
    let mut hits = Vec::new();
    for x in 0..WIDTH {
        let aside = ((WIDTH as f64 - 1.0) / 2.0 - x as f64) / focal_pixels();
        let view = Column { eye, angle: pose.theta + aside.atan(), shortening: aside.atan().cos() };
        scene.along(eye, view.angle, REACH_M, &mut hits);
        for (y, colour) in view.rows(scene, &hits).into_iter().enumerate() {
            let at = (y * WIDTH + x) * 3;
            rgb[at..at + 3].copy_from_slice(&grainy(colour, noise));
        }
    }
    rgb
}

/// One column of the picture.
struct Column {
    eye: Point,
    /// Direction of its ray, in radians.
    angle: f64,
    /// Depth along the optical axis per distance along the ray.
    shortening: f64,
}

impl Column {
    /// The column's pixels from the top; `hits` from far to near.
    fn rows(&self, scene: &Scene, hits: &[Hit]) -> [[f64; 3]; HEIGHT] {
        let mut rows = [SKY.map(f64::from); HEIGHT];
        for (y, row) in rows.iter_mut().enumerate().skip(HEIGHT / 2) {
            let drop_per_metre = (y as f64 - HORIZON) / focal_pixels();
            *row = self.floor(ABOVE_FLOOR_M / drop_per_metre / self.shortening);
        }
        for hit in hits {
            let body = &scene.bodies()[hit.body];
            let pixels_per_metre = focal_pixels() / (hit.distance * self.shortening).max(1e-3);
            let top = HORIZON - (body.height - ABOVE_FLOOR_M) * pixels_per_metre;
            let bottom = HORIZON + ABOVE_FLOOR_M * pixels_per_metre;
            // The casts end at 0; a wall lower than the camera's view begins below the horizon.
            let (top, bottom) = (top.ceil() as usize, (bottom.floor() as usize + 1).min(HEIGHT));
            rows[top.min(bottom)..bottom].fill(shaded(body.colour, hit.distance, 0.6 + 0.4 * hit.squareness));
        }
        rows
    }

    fn floor(&self, distance: f64) -> [f64; 3] {
        let place = self.eye.towards(self.angle, distance);
        let tile = (place.x / TILE_M).floor() as i64 + (place.y / TILE_M).floor() as i64;
        shaded(FLOOR[tile.rem_euclid(2) as usize], distance, 1.0)
    }
}

fn shaded(colour: Colour, distance: f64, light: f64) -> [f64; 3] {
    colour.map(|channel| f64::from(channel) * light * HALF_LIGHT_M / (HALF_LIGHT_M + distance))
}

/// All channels get the same grain, as brightness noise has it; the saturating cast ends at 0 and 255.
fn grainy(colour: [f64; 3], noise: &mut Noise) -> Colour {
    let grain = (noise.unit() - 0.5) * 2.0 * PIXEL_NOISE;
    colour.map(|channel| (channel + grain) as u8)
}
