//! The same demo with the secondary kept in three ways, and what that does to the recovery time.

use super::journal::Fault;
use super::report::{Report, summary};
use super::table::{aligned, duration};

/// How a secondary may be kept: not at all, its library loaded, its instance initialised.
pub const PRELOADS: [&str; 3] = ["none", "library", "instance"];

/// Recovery times of the replacement, one line per way of preloading. Times count from the faulting instruction; the
/// last is the first completed callback of the secondary.
#[must_use]
pub fn table(runs: &[(&str, Report)]) -> String {
    let heading = [
        "preload",
        "fault",
        "at",
        "detected after",
        "decided after",
        "secondary ready after",
        "recovered after",
        "run",
    ];
    let mut rows = vec![heading.map(String::from).to_vec()];
    for (preload, report) in runs {
        let run = if report.success() { "good".to_owned() } else { report.last_line() };
        rows.push(match replacement(report) {
            Some(fault) => vec![
                (*preload).into(),
                format!("{} {}", fault.slot, fault.symptom),
                format!("{:.2} s", report.seconds(fault.mono_ns)),
                duration(fault.times.detected_ns),
                duration(fault.times.decided_ns),
                duration(fault.times.ready_ns),
                duration(fault.times.first_callback_ns),
                run,
            ],
            None => vec![
                (*preload).into(),
                "no replacement".into(),
                "–".into(),
                "–".into(),
                "–".into(),
                "–".into(),
                "–".into(),
                run,
            ],
        });
    }
    aligned(&rows)
}

/// Whether every run was a success with a replacement whose recovery time is known.
#[must_use]
pub fn success(runs: &[(&str, Report)]) -> bool {
    runs.iter().all(|(_, report)| {
        report.success() && replacement(report).is_some_and(|fault| fault.times.first_callback_ns.is_some())
    })
}

/// The last line for all runs together: the longest time, the sums of the rest.
#[must_use]
pub fn last_line(runs: &[(&str, Report)]) -> String {
    let reports = || runs.iter().map(|(_, report)| report);
    summary(
        reports().all(Report::reached),
        reports().map(Report::duration).fold(0.0, f64::max),
        reports().map(Report::fault_count).sum(),
        reports().map(Report::recovered_count).sum(),
        reports().map(Report::collisions).sum(),
    )
}

fn replacement(report: &Report) -> Option<&Fault> {
    report.faults.iter().find(|fault| fault.replaced_by().is_some())
}
