//! The robot reaches its target, whoever steers and whatever is lost on the way.

use navigation_tests::{Avoider, Report, Scenario, run};
use robot_sim::World;

/// Without optimisation a run takes ten times as long, so fewer must do; `cargo test --release` runs all.
const SEEDS: std::ops::RangeInclusive<u64> = if cfg!(debug_assertions) { 1..=3 } else { 1..=12 };

fn every_seed(change: impl Fn(&mut Scenario)) {
    let mut failed = Vec::new();
    for seed in SEEDS {
        let mut scenario = Scenario::new(seed);
        change(&mut scenario);
        let report = run(&scenario);
        let Report { reached, seconds, collisions, closest, .. } = &report;
        println!(
            "seed {seed:2}: reached {reached} in {seconds:5.1} s, collisions {collisions}, closest {closest:.2} m"
        );
        if !reached || *collisions > 0 {
            failed.push((seed, report));
        }
    }
    assert!(failed.is_empty(), "{failed:?}");
}

#[test]
fn primary_avoidance_reaches_the_target() {
    every_seed(|_| ());
}

#[test]
fn secondary_avoidance_reaches_the_target() {
    every_seed(|scenario| scenario.avoider = |_| Avoider::Secondary);
}

#[test]
fn so_do_both_with_a_change_mid_way() {
    every_seed(|scenario| scenario.avoider = |now| if now < 8.0 { Avoider::Primary } else { Avoider::Secondary });
}

#[test]
fn so_do_both_with_a_change_to_and_fro() {
    every_seed(|scenario| {
        scenario.avoider = |now| if now % 6.0 < 3.0 { Avoider::Primary } else { Avoider::Secondary };
    });
}

#[test]
fn gaps_of_100_ms_in_the_commands_do_no_harm() {
    every_seed(|scenario| scenario.commands_pass = |now| now % 1.5 > 0.1);
}

#[test]
fn an_odometry_that_starts_anew_costs_nothing() {
    every_seed(|scenario| scenario.odometry_restarts = |now| (now * 20.0).round() as u32 % 97 == 96);
}

/// A pocket between start and target, open towards the robot and deeper than its echoes look: a local minimum for any avoider.
const DEAD_END: &str = r#"{
  "name": "dead end",
  "walls": [[[0, 0], [8, 0], [8, 6], [0, 6], [0, 0]]],
  "wall_height": 0.7,
  "obstacles": [
    { "shape": { "box": { "x": 4.6, "y": 3.0, "width": 0.2, "depth": 2.2 } }, "height": 0.4, "colour": [128, 130, 134] },
    { "shape": { "box": { "x": 3.9, "y": 4.0, "width": 1.4, "depth": 0.2 } }, "height": 0.4, "colour": [128, 130, 134] },
    { "shape": { "box": { "x": 3.9, "y": 2.0, "width": 1.4, "depth": 0.2 } }, "height": 0.4, "colour": [128, 130, 134] }
  ],
  "target": { "x": 7.0, "y": 3.0, "radius": 0.15, "height": 1.2, "colour": [214, 32, 32] },
  "start": { "x": 1.0, "y": 3.0, "theta": 0 }
}"#;

fn in_the_dead_end(scenario: &mut Scenario) {
    scenario.world = World::parse(DEAD_END).expect("the world is valid");
    scenario.planner.goal = Some((6.0, 0.0));
}

#[test]
fn primary_avoidance_leaves_a_dead_end() {
    every_seed(in_the_dead_end);
}

#[test]
fn secondary_avoidance_leaves_a_dead_end() {
    every_seed(|scenario| {
        in_the_dead_end(scenario);
        scenario.avoider = |_| Avoider::Secondary;
    });
}

#[test]
fn without_a_hint_the_robot_finds_its_target_by_itself() {
    every_seed(|scenario| scenario.planner.goal = None);
}

#[test]
fn it_does_not_depend_on_the_speed_or_the_start() {
    every_seed(|scenario| {
        // 0.3 to 0.6 m/s, half a metre to either side, looking up to 90 degrees aside.
        let share = (scenario.seed as f64 * 0.618) % 1.0;
        scenario.planner.cruise = 0.3 + 0.3 * share;
        scenario.world.start.y += share - 0.5;
        scenario.world.start.theta = 180.0 * (share - 0.5);
        scenario.planner.goal = None;
        scenario.avoider = |now| if now < 10.0 { Avoider::Primary } else { Avoider::Secondary };
    });
}
