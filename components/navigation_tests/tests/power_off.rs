//! The power failure of the paper's figure 10, in runs of the daemon: found with every window, later with a longer one, and as the
//! recorded signals say. What is drawn is what was recorded.

use navigation_tests::figure10::draw;
use navigation_tests::power_off::{AFTER, POWER_OFF, Programs, Run, measure, rates};

fn runs(windows_ms: &[u64]) -> Vec<Run> {
    let programs = Programs::beside_this().expect("the workspace is built");
    let run = |window_ms: &u64| measure(&programs, *window_ms, &mut |what| eprintln!("{what}"));
    windows_ms.iter().map(|window_ms| run(window_ms).unwrap_or_else(|failure| panic!("{failure}"))).collect()
}

/// What was recorded is what the daemon compared: the same samples, compared anew, part when the journal says, by as much.
fn agrees_with_the_journal(run: &Run) {
    let parted = run.parted().expect("the recorded signals part");
    let (found, reading) = (run.found, parted.reading);
    assert_eq!(parted.at_ns, found.at_ns, "{} ms: {reading:?}, {found:?}", run.window_ms);
    let near = |one: f64, other: f64| (one - other).abs() < 1e-3;
    assert!(near(reading.target, found.target) && near(reading.model, found.model), "{reading:?}, {found:?}");
    assert!(near(reading.difference(), found.difference) && found.difference > found.threshold, "{found:?}");
    assert!(found.at_ns > run.power_off_ns && found.target < found.model, "the wheel lags behind: {found:?}");
}

/// Before the failure the wheel turns, at the end it stands.
fn shows_a_wheel_that_stops(run: &Run) {
    let between = |samples, from: f64, to: f64| {
        let within: Vec<f64> =
            rates(run, samples).iter().filter(|(at, _)| (from..to).contains(at)).map(|(_, rate)| *rate).collect();
        within.iter().sum::<f64>() / within.len() as f64
    };
    let (driving, end) = ((POWER_OFF - 0.3, POWER_OFF), (POWER_OFF + AFTER - 0.3, POWER_OFF + AFTER));
    let at = |samples, (from, to)| between(samples, from, to);
    assert!(at(&run.encoder, driving) > 100.0 && at(&run.model, driving) > 100.0);
    assert!(at(&run.encoder, end) < 10.0);
}

#[test]
fn every_window_finds_it_after_it_happened_and_a_longer_one_later() {
    let found_after = |runs: &[Run]| runs.iter().map(Run::found_after_ms).collect::<Vec<f64>>();
    // Each is a run of its own: one that the machine holds up for half a second may well be found later than the next.
    let in_order = |runs: &Vec<Run>| {
        runs.iter().for_each(agrees_with_the_journal);
        runs.iter().for_each(shows_a_wheel_that_stops);
        eprintln!("found after {:?} ms", found_after(runs));
        found_after(runs).is_sorted()
    };
    let runs = (0..4).map(|_| runs(&[100, 400, 1000])).find(in_order).expect("a longer window finds it later");
    let found = found_after(&runs);
    let svg = draw(&runs);
    assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
    assert_eq!(svg.matches("<polyline").count(), 3 * runs.len());
    assert_eq!(svg.matches(">power off<").count(), runs.len());
    for (run, found) in runs.iter().zip(found) {
        assert!(svg.contains(&format!(">T = {} ms<", run.window_ms)), "{}", run.window_ms);
        assert!(svg.contains(&format!(">fault after {found:.0} ms<")), "{found}");
    }
    assert_eq!(svg, draw(&runs), "the same runs give the same picture");
}
