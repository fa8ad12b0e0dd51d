//! The power failure of the paper's figure 10 is found with every window, sooner with a shorter one, and never before it happens.

use navigation_tests::figure10::draw;
use navigation_tests::power_off::{POWER_OFF, THRESHOLD, WINDOWS_MS, experiment};

#[test]
fn every_window_finds_it_after_it_happened_and_a_longer_one_later() {
    for seed in 1..=10 {
        let experiment = experiment(seed);
        let found: Vec<f64> = experiment.windows.iter().map(|window| window.detected.expect("it is found")).collect();
        assert_eq!(found.len(), WINDOWS_MS.len());
        assert!(found.is_sorted() && found[0] > POWER_OFF, "seed {seed}: {found:?}");
        for (window, found) in experiment.windows.iter().zip(&found) {
            let late = found - POWER_OFF;
            // A wheel that stands differs by all it should count: the threshold is that share of the window, and braking takes a while.
            assert!(late < window.window_ms as f64 / 1e3 * 0.5 + 0.1, "seed {seed}: {} ms: {late}", window.window_ms);
            let before = window.readings.iter().filter(|(at, _)| *at < POWER_OFF);
            let worst = before.map(|(_, reading)| reading.difference()).fold(0.0, f64::max);
            assert!(worst < THRESHOLD, "seed {seed}: {worst} before anything failed");
        }
    }
}

#[test]
fn the_drawing_shows_both_signals_every_window_and_both_moments() {
    let experiment = experiment(1);
    let svg = draw(&experiment);
    assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
    assert_eq!(svg.matches("<polyline").count(), 2 + WINDOWS_MS.len());
    assert_eq!(svg.matches(">threshold 800<").count(), WINDOWS_MS.len());
    assert_eq!(svg.matches(">fault after ").count(), WINDOWS_MS.len());
    assert!(WINDOWS_MS.iter().all(|window| svg.contains(&format!(">T = {window} ms<"))) && svg.contains(">power off<"));
    assert_eq!(svg, draw(&experiment), "the same run gives the same picture");
}
