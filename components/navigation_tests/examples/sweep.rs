//! Sweep.
use navigation_tests::{Avoider, Scenario, run};
fn main() {
    for clearance in [0.05, 0.07, 0.09, 0.11, 0.13] {
        for (name, avoider) in [
            ("prim", (|_| Avoider::Primary) as fn(f64) -> Avoider),
            ("sec", |_| Avoider::Secondary),
            ("mix", |now| if now % 6.0 < 3.0 { Avoider::Primary } else { Avoider::Secondary }),
        ] {
            let mut line = format!("{clearance:.2} {name:5}");
            for seed in 1..=12 {
                let mut scenario = Scenario::new(seed);
                scenario.avoider = avoider;
                scenario.primary.clearance = clearance;
                scenario.secondary.clearance = clearance + 0.08;
                let report = run(&scenario);
                line += &format!(
                    " {:.0}{}{}({:.0})",
                    report.seconds,
                    if report.reached { "" } else { "!" },
                    if report.collisions > 0 { "X" } else { "" },
                    report.closest * 100.0
                );
            }
            println!("{line}");
        }
    }
}
