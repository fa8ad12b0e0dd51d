//! The robot reaches its target, whoever steers and whatever is lost on the way.

use navigation_tests::{Avoider, Report, Scenario, run};

const SEEDS: std::ops::RangeInclusive<u64> = 1..=12;

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
