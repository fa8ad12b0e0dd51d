//! Rays against analytic cases; the camera shows what is there.

use std::f64::consts::PI;
use std::time::Duration;

use board_protocol::{Command, Telemetry, WheelVelocities};
use robot_sim::camera::{Frame, HEIGHT, WIDTH, focal_pixels};
use robot_sim::geometry::{Point, Pose};
use robot_sim::scene::Scene;
use robot_sim::world::WorldError;
use robot_sim::{Simulation, SonarFaults, World, sonar};

/// A room from (0, 0) to (6, 4) with a round thing at (3, 2) and a square one, turned by 45 degrees, at (1, 3).
const ROOM: &str = r#"{ "name": "room", "walls": [[[0,0],[6,0],[6,4],[0,4],[0,0]]], "wall_height": 1.0,
    "obstacles": [
        { "shape": { "round": { "x": 3, "y": 2, "radius": 0.5 } }, "height": 0.4, "colour": [70, 90, 160] },
        { "shape": { "box": { "x": 1, "y": 3, "width": 0.5, "depth": 0.5, "turn": 45 } },
          "height": 0.4, "colour": [120, 120, 120] }],
    "target": { "x": 5, "y": 2, "radius": 0.2, "height": 1.2, "colour": [220, 20, 20] },
    "start": { "x": 1, "y": 2, "theta": 0 } }"#;

fn room() -> World {
    World::parse(ROOM).unwrap()
}

fn close(got: f64, wanted: f64) {
    assert!((got - wanted).abs() < 1e-4, "got {got}, wanted {wanted}");
}

#[test]
fn rays_end_where_geometry_says() {
    let scene = Scene::new(&room());
    let from = |x, y, degrees: f64| scene.nearest(Point { x, y }, degrees.to_radians(), 10.0).unwrap();
    close(from(1.0, 2.0, 0.0), 1.5);
    close(from(1.0, 2.0, 180.0), 1.0);
    close(from(1.0, 2.0, 270.0), 2.0);
    close(from(1.0, 2.0, 90.0), 1.0 - 0.25 * 2.0_f64.sqrt());
    close(from(1.0, 1.0, -45.0), 2.0_f64.sqrt());
    close(from(3.0, 0.5, 90.0), 1.0);
    assert_eq!(scene.nearest(Point { x: 1.0, y: 2.0 }, 0.0, 1.4), None, "out of reach");
}

#[test]
fn clearance_is_signed() {
    let scene = Scene::new(&room());
    close(scene.clearance(Point { x: 1.0, y: 1.5 }), 1.0);
    close(scene.clearance(Point { x: 3.0, y: 1.2 }), 0.3);
    close(scene.clearance(Point { x: 3.0, y: 1.9 }), -0.4);
}

#[test]
fn the_ring_counts_from_the_sensor_counter_clockwise() {
    let scene = Scene::new(&room());
    let pose = Pose { at: Point { x: 1.0, y: 1.0 }, theta: 0.0 };
    let echo = |index| sonar::echo(&scene, pose, index);
    close(echo(9).unwrap(), 0.8);
    close(echo(6).unwrap(), 0.8);
    assert!(echo(3).unwrap() < 1.5, "the turned box on the left");
    // Turned by 90 degrees, what was on the right is ahead.
    let turned = Pose { theta: -PI / 2.0, ..pose };
    close(sonar::echo(&scene, turned, 0).unwrap(), 0.8);
}

#[test]
fn an_unplugged_sensor_says_nothing_and_a_plugged_one_always_something() {
    let mut robot = Simulation::new(room(), 5);
    let pulled = Duration::from_secs(30);
    robot.unplug(3, pulled);
    for message in robot.advance(2 * pulled) {
        if let Telemetry::Ultrasonic(ring) = message {
            let is_out = ring.time_us >= pulled.as_micros() as u32;
            assert_eq!(ring.ranges_mm[3] == 0, is_out, "{ring:?}");
            assert!(ring.ranges_mm.iter().enumerate().all(|(sensor, mm)| sensor == 3 || *mm > 0), "{ring:?}");
        }
    }
}

#[test]
fn ring_telemetry_is_noisy_in_range_and_drops_out_now_and_then() {
    let mut robot = Simulation::new(room(), 3);
    let (mut ahead, mut silent) = (Vec::new(), 0);
    for message in robot.advance(Duration::from_secs(60)) {
        if let Telemetry::Ultrasonic(ring) = message {
            assert!(ring.ranges_mm.iter().all(|mm| (30..=3000).contains(mm)));
            silent += ring.ranges_mm.iter().filter(|mm| **mm == 3000).count();
            ahead.push(f64::from(ring.ranges_mm[0]));
        }
    }
    ahead.retain(|mm| *mm < 3000.0);
    let mean = ahead.iter().sum::<f64>() / ahead.len() as f64;
    assert!((mean - 1300.0).abs() < 3.0, "{mean}");
    assert!(ahead.iter().any(|mm| (mm - mean).abs() > 5.0), "noise");
    assert!((60..400).contains(&silent), "one echo in eighty of 14400 lost, got {silent}");
}

/// Whether the target is seen in column `x`, in a row above the obstacles.
fn is_red(picture: &Frame, x: usize) -> bool {
    let [red, green, blue] = picture.pixel(x, HEIGHT / 2 - 15);
    red / 2 > green.max(blue)
}

#[test]
fn the_camera_sees_the_target_over_the_obstacle() {
    let mut robot = Simulation::new(room(), 1);
    let picture = robot.camera_frame().unwrap();
    let red: Vec<usize> = (0..WIDTH).filter(|x| is_red(&picture, *x)).collect();
    let centre = red.iter().sum::<usize>() as f64 / red.len() as f64;
    assert!((centre - (WIDTH as f64 - 1.0) / 2.0).abs() < 1.0, "straight ahead, got {centre}");
    let width = 2.0 * 0.2 / (5.0 - 1.15) * focal_pixels();
    assert!((red.len() as f64 - width).abs() <= 2.0, "{} columns, geometry says {width:.1}", red.len());
    // Below the horizon the blue obstacle in front hides it.
    let [r, _, b] = picture.pixel(WIDTH / 2, HEIGHT / 2 + 10);
    assert!(b > r);
}

#[test]
fn a_target_on_the_left_is_on_the_left_of_the_picture() {
    let mut world = room();
    world.start.theta = -20.0;
    let picture = Simulation::new(world, 1).camera_frame().unwrap();
    let red = (0..WIDTH).find(|x| is_red(&picture, *x));
    assert!(red.is_some_and(|x| x < WIDTH / 2));
}

#[test]
fn frames_come_at_fifteen_hertz() {
    let mut robot = Simulation::new(room(), 1);
    let mut frames = Vec::new();
    for _ in 0..500 {
        frames.extend(robot.camera_frame());
        robot.advance(Duration::from_millis(2));
    }
    assert_eq!(frames.len(), 15);
    assert!(frames.iter().enumerate().all(|(index, frame)| frame.seq as usize == index));
}

#[test]
fn a_bad_world_says_what_is_wrong() {
    let complaint = |from: &str, to: &str| World::parse(&ROOM.replace(from, to)).unwrap_err();
    let inside = complaint(r#""start": { "x": 1, "y": 2"#, r#""start": { "x": 3, "y": 2"#);
    assert!(inside.to_string().contains("starts 0.75 m inside"), "{inside}");
    assert!(complaint(r#""radius": 0.5"#, r#""radius": 0"#).to_string().contains("obstacle 0"));
    assert!(matches!(complaint("wall_height", "wallheight"), WorldError::Syntax(_)));
}

#[test]
fn further_rings_hear_the_same_until_one_falls_silent_and_one_drifts() {
    let mut robot = Simulation::new(room(), 7);
    let after = |seconds| Some(Duration::from_secs(seconds));
    robot.add_sonar(SonarFaults::default());
    robot.add_sonar(SonarFaults { silent_after: after(1), ..SonarFaults::default() });
    robot.add_sonar(SonarFaults { drifts_after: after(2), ..SonarFaults::default() });
    let first_sensor = |robot: &mut Simulation, seconds| {
        robot.advance(Duration::from_secs(seconds));
        let mut heard: [Vec<u16>; 3] = Default::default();
        for (ring, round) in robot.sonar_rounds() {
            let Telemetry::Ultrasonic(round) = round else { panic!("a ring says nothing else") };
            heard[ring].extend(Some(round.ranges_mm[0]).filter(|mm| *mm < 3000));
        }
        heard
    };
    // Nothing goes wrong before it is to drive.
    let near = |mm: &u16| mm.abs_diff(1300) < 60;
    let heard = first_sensor(&mut robot, 5);
    assert!(heard.iter().all(|ring| ring.len() > 90 && ring.iter().all(near)), "{heard:?}");
    assert!(heard[0] != heard[1] && heard[1] != heard[2], "each has its own noise");
    // It is told to, and stands all the same: the board stops it for want of further commands.
    robot.command(Command::WheelVelocities(WheelVelocities { left_rad_s: 0.001, right_rad_s: 0.001 }));
    let [well, silent, drifting] = first_sensor(&mut robot, 4);
    assert!(well.iter().all(near) && well.len() > 70, "{well:?}");
    assert!((15..=20).contains(&silent.len()), "{silent:?}");
    assert!(drifting.iter().take(30).all(near), "{drifting:?}");
    assert!(drifting.last().is_some_and(|mm| mm.abs_diff(900) < 60), "0.2 m/s for 2 s: {drifting:?}");
}
