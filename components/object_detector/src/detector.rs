//! From an image to "there is the target": bearing and distance of the largest patch of its colour.

use robot_objects::angle::degrees;

use crate::blob::{Blob, BlobFinder};
use crate::colour::{Camera, Colour};

/// What the target looks like, and through what.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Its colour.
    pub colour: Colour,
    /// Its width in m.
    pub width: f64,
    /// The camera.
    pub camera: Camera,
    /// How far ahead of the robot's centre the camera sits, in m.
    pub camera_forward: f64,
    /// Fewest pixels that count as a sighting.
    pub min_area: u32,
}

impl Default for Settings {
    /// The red post of the default world, through the camera of the default robot.
    fn default() -> Self {
        Self {
            colour: Colour { hue: 0.0, tolerance: 20.0, min_saturation: 0.5, min_value: 0.2 },
            width: 0.3,
            camera: Camera { field_of_view: degrees(60.0) },
            camera_forward: 0.15,
            min_area: 8,
        }
    }
}

/// A sighting of the target, as from the robot's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Direction in rad, left positive.
    pub bearing: f64,
    /// Distance from the robot's centre to its middle, in m, estimated from its apparent width.
    pub distance: f64,
    /// Share of the image that it fills, 0 to 1.
    pub area: f64,
}

/// An RGB image.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Bytes from row to row.
    pub step: u32,
    /// Three bytes a pixel, rows from the top.
    pub data: &'a [u8],
}

/// Looks for the target in `picture`.
pub fn detect(finder: &mut BlobFinder, picture: Picture<'_>, settings: &Settings) -> Option<Sighting> {
    let matcher = settings.colour.matcher();
    let (width, step) = (picture.width as usize, picture.step as usize);
    let blob = finder.largest(picture.data, width, step, |pixel| matcher.matches(pixel))?;
    (blob.area >= settings.min_area).then(|| sighting(&blob, picture, settings))
}

fn sighting(blob: &Blob, picture: Picture<'_>, settings: &Settings) -> Sighting {
    let (camera, width) = (&settings.camera, picture.width);
    let half = blob.width() / 2.0;
    // The angle between the edges, not pixels times a constant: towards the image's sides pixels cover less angle.
    let seen = camera.bearing(blob.column() - half, width) - camera.bearing(blob.column() + half, width);
    let (bearing, distance) =
        (camera.bearing(blob.column(), width), settings.width / 2.0 / (seen / 2.0).sin().max(1e-3));
    let (x, y) = (settings.camera_forward + distance * bearing.cos(), distance * bearing.sin());
    let pixels = f64::from(picture.width) * f64::from(picture.height);
    Sighting { bearing: y.atan2(x), distance: x.hypot(y), area: f64::from(blob.area) / pixels }
}

#[cfg(test)]
mod tests {
    use super::*;

    const W: u32 = 160;
    const H: u32 = 120;

    fn settings() -> Settings {
        Settings { camera: Camera { field_of_view: 1.2 }, ..Settings::default() }
    }

    /// A grey image with a red post between two columns.
    fn post(from: u32, to: u32) -> Option<Sighting> {
        let mut data = vec![120; (W * H * 3) as usize];
        for v in 20..100 {
            for u in from..to {
                let at = ((v * W + u) * 3) as usize;
                data[at..at + 3].copy_from_slice(&[210, 30, 30]);
            }
        }
        detect(&mut BlobFinder::default(), Picture { width: W, height: H, step: W * 3, data: &data }, &settings())
    }

    #[test]
    fn a_post_in_the_middle_is_ahead_at_its_distance() {
        // 0.3 m at 2 m seen by a camera of 117 pixels focal length is about 17.5 pixels wide.
        let seen = post(71, 89).expect("it is there");
        assert!(seen.bearing.abs() < 0.01, "{seen:?}");
        assert!((1.95..2.35).contains(&seen.distance), "{seen:?}");
    }

    #[test]
    fn left_is_positive_and_a_speck_is_nothing() {
        assert!(post(10, 20).is_some_and(|seen| seen.bearing > 0.4));
        assert_eq!(post(0, 0), None);
    }
}
