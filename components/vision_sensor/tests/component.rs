//! The component on the bench, with a camera on a real socket that comes, goes and comes again.

use std::io::Write;
use std::os::unix::net::{UnixListener, UnixStream};
use std::time::Duration;

use component_sdk::prelude::*;
use component_sdk::testing::Bench;
use vision_sensor::VisionSensor;

fn frame(sequence: u32) -> Vec<u8> {
    let mut bytes = b"FRAM".to_vec();
    [4, 2, sequence].iter().for_each(|word: &u32| bytes.extend(word.to_le_bytes()));
    bytes.extend(1_500_000_u64.to_le_bytes());
    bytes.extend([sequence as u8; 24]);
    bytes
}

fn execute(bench: &mut Bench<VisionSensor>) -> Option<Image> {
    bench.advance(Duration::from_millis(300));
    bench.execute().expect("a lost camera is told of, not returned");
    bench.take("image")
}

fn send(camera: &mut UnixStream, bytes: &[u8]) {
    camera.write_all(bytes).expect("the sensor is connected");
}

#[test]
fn frames_arrive_and_a_lost_camera_is_found_again() {
    let directory = tempfile::tempdir().expect("a directory");
    let path = directory.path().join("camera.sock");
    let socket = path.display().to_string();
    let mut bench = Bench::<VisionSensor>::with(&[("socket", &socket)]).expect("valid");
    assert_eq!(execute(&mut bench), None);
    assert_eq!(execute(&mut bench), None);
    assert_eq!(Bench::<VisionSensor>::device_news().len(), 1, "one fault for one loss, however long it lasts");

    let listener = UnixListener::bind(&path).expect("the path is free");
    assert_eq!(execute(&mut bench), None);
    let (mut camera, _) = listener.accept().expect("it has connected");
    send(&mut camera, &frame(7)[..30]);
    assert_eq!(execute(&mut bench), None, "half a frame is no image");
    send(&mut camera, &frame(7)[30..]);
    let image = execute(&mut bench).expect("a whole frame is one");
    assert_eq!((image.width, image.height, image.step, &*image.encoding), (4, 2, 12, "rgb8"));
    assert_eq!((&*image.data, image.header.stamp), (&[7; 24][..], Time { sec: 1, nanosec: 500_000_000 }));

    drop(camera);
    assert_eq!(execute(&mut bench), None);
    assert_eq!(Bench::<VisionSensor>::device_news().len(), 2, "found, and lost again");
    assert_eq!(execute(&mut bench), None);
    let (mut camera, _) = listener.accept().expect("it has connected again");
    send(&mut camera, &frame(8));
    assert!(execute(&mut bench).is_some_and(|image| image.data[0] == 8));
}
