//! Whatever the echoes and the course: no avoider drives into what it hears.

use avoidance_primary::steering as primary;
use avoidance_secondary::steering as secondary;
use proptest::prelude::*;
use robot_objects::motion::Motion;
use robot_objects::ring::{ECHOES, Ranges};

/// From the ring's radius to the body's, in m: echoes count from the transducers.
const RIM: f32 = 0.05;

fn ranges() -> impl Strategy<Value = Ranges> {
    prop::array::uniform12(prop_oneof![8 => 0.03_f32..3.0, 1 => Just(3.0_f32), 1 => Just(0.0_f32), 1 => Just(f32::NAN)])
}

fn course() -> impl Strategy<Value = Motion> {
    let speed = prop_oneof![8 => -0.5..1.5_f64, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY)];
    let turn = prop_oneof![8 => -4.0..4.0_f64, 1 => Just(f64::NAN)];
    (speed, turn).prop_map(|(forward, turn)| Motion { forward, turn })
}

/// Steers through a whole history and checks every answer.
fn check(history: &[(Ranges, Motion)], stop_distance: f64, mut steer: impl FnMut(&Ranges, Motion) -> Motion) {
    assert_eq!(history[0].0.len(), ECHOES);
    for (ranges, course) in history {
        let Motion { forward, turn } = steer(ranges, *course);
        let context = format!("{ranges:?} {course:?} -> {forward} {turn}");
        assert!(turn.abs() <= 1.8 && forward >= 0.0 && forward.is_finite(), "{context}");
        assert!(forward <= course.forward.max(0.0), "{context}");
        let ahead = f64::from(ranges[0].max(0.0) - RIM);
        assert!(ahead > stop_distance || forward == 0.0, "{context}");
    }
}

proptest! {
    #[test]
    fn the_primary_is_safe(history in prop::collection::vec((ranges(), course()), 1..40)) {
        let (mut steering, settings) = (primary::Steering::default(), primary::Settings::default());
        check(&history, settings.stop_distance, |ranges, course| steering.steer(ranges, course, &settings));
    }

    #[test]
    fn the_secondary_is_safe(history in prop::collection::vec((ranges(), course()), 1..40)) {
        let (mut steering, settings) = (secondary::Steering::default(), secondary::Settings::default());
        check(&history, settings.stop_distance, |ranges, course| steering.steer(ranges, course, &settings));
    }
}
