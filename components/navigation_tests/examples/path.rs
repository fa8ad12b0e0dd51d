//! Prints the robot's path of one run: `cargo run --release -p navigation_tests --example path -- SEED primary|secondary|mixed`.

use navigation_tests::{Avoider, Scenario, run};

fn main() {
    let mut arguments = std::env::args().skip(1);
    let seed = arguments.next().and_then(|text| text.parse().ok()).unwrap_or(1);
    let mut scenario = Scenario::new(seed);
    scenario.avoider = match arguments.next().as_deref() {
        Some("secondary") => |_| Avoider::Secondary,
        Some("mixed") => |now| if now % 6.0 < 3.0 { Avoider::Primary } else { Avoider::Secondary },
        _ => |_| Avoider::Primary,
    };
    let report = run(&scenario);
    println!(
        "reached {} after {:.1} s, collisions {}, closest {:.2} m",
        report.reached, report.seconds, report.collisions, report.closest
    );
    for (x, y) in report.path {
        println!("{x:.2} {y:.2}");
    }
}
