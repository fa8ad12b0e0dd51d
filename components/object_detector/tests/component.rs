//! The component on the bench: images in, detections out.

use component_sdk::prelude::*;
use component_sdk::testing::Bench;
use object_detector::ColourDetector;
use robot_objects::Detection;

const WIDTH: u32 = 80;
const HEIGHT: u32 = 60;

/// Grey, with a red square of ten pixels whose left edge is at column `left`.
fn image(left: u32) -> Image {
    let pixel = |at: u32| {
        let (u, v) = (at % WIDTH, at / WIDTH);
        if (left..left + 10).contains(&u) && (20..30).contains(&v) { [210, 30, 30] } else { [130, 130, 130] }
    };
    let data: Vec<u8> = (0..WIDTH * HEIGHT).flat_map(pixel).collect();
    Image {
        width: WIDTH,
        height: HEIGHT,
        step: WIDTH * 3,
        encoding: "rgb8".into(),
        data: data.into(),
        ..Image::default()
    }
}

fn look(bench: &mut Bench<ColourDetector>, image: Image) -> Detection {
    bench.put("image", image);
    bench.execute().expect("an RGB image is no error");
    bench.take("target").expect("each image gives a detection")
}

#[test]
fn each_image_gives_a_detection() {
    let mut bench = Bench::<ColourDetector>::new().expect("defaults are valid");
    let ahead = look(&mut bench, image(35));
    assert!(ahead.found && ahead.bearing.abs() < 0.01 && ahead.distance > 1.0, "{ahead:?}");
    assert!(look(&mut bench, image(5)).bearing > 0.2);
    assert!(!look(&mut bench, image(WIDTH)).found);
}

#[test]
fn the_profile_sets_the_colour() {
    let mut bench = Bench::<ColourDetector>::with(&[("hue", "240")]).expect("valid");
    assert!(!look(&mut bench, image(35)).found);
}

#[test]
fn what_it_cannot_read_is_an_error_and_a_short_image_is_none() {
    let mut bench = Bench::<ColourDetector>::new().expect("defaults are valid");
    bench.put("image", Image { encoding: "mono8".into(), ..image(35) });
    assert!(bench.execute().is_err_and(|error| error.to_string().contains("rgb8")));
    assert!(!look(&mut bench, Image { data: vec![1, 2, 3].into(), ..image(35) }).found);
}
