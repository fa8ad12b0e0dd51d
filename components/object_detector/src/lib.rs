//! Coloured-object detector: images in, where the target is out.

use component_sdk::prelude::*;
use robot_objects::Detection;
use robot_objects::angle::degrees;

pub mod blob;
pub mod colour;
pub mod detector;

use blob::BlobFinder;
use colour::{Camera, Colour};
use detector::{Picture, Settings, Sighting, detect};

/// Finds the coloured target in camera images.
#[derive(Component)]
#[component(name = "ColourDetector", version = "1.0", nonperiodic)]
pub struct ColourDetector {
    /// RGB images.
    #[port]
    image: DataIn<Image>,
    /// One for each image, also when the target is not in it.
    #[port]
    target: DataOut<Detection>,
    /// The target's hue: 0 red, 120 green, 240 blue.
    #[property(default = 0.0, unit = "deg", range = 0.0..=360.0)]
    hue: f64,
    /// Farthest from that hue.
    #[property(default = 20.0, unit = "deg", range = 0.0..=180.0)]
    hue_tolerance: f64,
    /// Least saturation.
    #[property(default = 0.5, unit = "1", range = 0.0..=1.0)]
    min_saturation: f64,
    /// Least brightness.
    #[property(default = 0.2, unit = "1", range = 0.0..=1.0)]
    min_value: f64,
    /// Fewest pixels that count.
    #[property(default = 8, unit = "px", range = 1..=1_000_000)]
    min_area: u32,
    /// The target's width.
    #[property(default = 0.3, unit = "m", range = 0.01..=10.0)]
    target_width: f64,
    /// The camera's horizontal field of view.
    #[property(default = 60.0, unit = "deg", range = 10.0..=160.0)]
    field_of_view: f64,
    /// How far ahead of the robot's centre the camera sits.
    #[property(default = 0.15, unit = "m", range = -2.0..=2.0)]
    camera_forward: f64,
    finder: BlobFinder,
}

impl Callbacks for ColourDetector {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        let settings = self.settings();
        if let Some(image) = self.image.fresh() {
            if &*image.encoding != "rgb8" {
                return Err(fault!("the image is `{}`, not `rgb8`: set the camera to RGB", image.encoding));
            }
            let &Image { width, height, step, .. } = image;
            let seen = detect(&mut self.finder, Picture { width, height, step, data: &image.data }, &settings);
            self.target.write(detection(image.header.stamp, seen));
        }
        Ok(())
    }
}

impl ColourDetector {
    fn settings(&self) -> Settings {
        Settings {
            colour: Colour {
                hue: self.hue,
                tolerance: self.hue_tolerance,
                min_saturation: self.min_saturation,
                min_value: self.min_value,
            },
            width: self.target_width,
            camera: Camera { field_of_view: degrees(self.field_of_view) },
            camera_forward: self.camera_forward,
            min_area: self.min_area,
        }
    }
}

fn detection(stamp: Time, seen: Option<Sighting>) -> Detection {
    let nothing = Detection { stamp, ..Detection::default() };
    seen.map_or(nothing, |Sighting { bearing, distance, area }| Detection {
        stamp,
        found: true,
        bearing,
        distance,
        area,
    })
}

export_components!(ColourDetector);
