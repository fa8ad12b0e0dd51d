//! Tables in plain text.

use super::report::Report;

/// Rows of equal length, the first is the heading.
#[must_use]
pub fn aligned(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max();
    let widths: Vec<usize> = (0..columns).map(|column| width(column).unwrap_or(0)).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:<width$}"));
        cells.collect::<Vec<_>>().join("  ").trim_end().to_owned()
    };
    let rule = widths.iter().map(|width| "─".repeat(*width)).collect::<Vec<_>>().join("──");
    let mut lines: Vec<String> = rows.iter().map(line).collect();
    lines.insert(1.min(lines.len()), rule);
    lines.join("\n")
}

/// Every fault of a run.
#[must_use]
pub fn faults(report: &Report) -> String {
    let heading = ["#", "at", "slot", "what", "detected after", "recovered after", "how", "outcome", "told by"];
    let mut rows = vec![heading.map(String::from).to_vec()];
    for (index, fault) in report.faults.iter().enumerate() {
        rows.push(vec![
            (index + 1).to_string(),
            format!("{:.2} s", report.seconds(fault.mono_ns)),
            fault.slot.clone(),
            fault.symptom.clone(),
            duration(fault.times.detected_ns),
            duration(fault.times.first_callback_ns),
            fault.how(),
            fault.outcome.clone(),
            fault.told(64),
        ]);
    }
    aligned(&rows)
}

/// Nanoseconds for people: three digits that matter, and a dash for what is not known.
#[must_use]
pub fn duration(nanoseconds: Option<u64>) -> String {
    let Some(nanoseconds) = nanoseconds else { return "–".into() };
    let (value, unit) = match nanoseconds as f64 {
        small if small < 1e3 => return format!("{small} ns"),
        micro if micro < 1e6 => (micro / 1e3, "µs"),
        milli if milli < 1e9 => (milli / 1e6, "ms"),
        long => (long / 1e9, "s"),
    };
    let decimals = if value < 9.995 { 2 } else { usize::from(value < 99.95) };
    format!("{value:.decimals$} {unit}")
}

#[cfg(test)]
mod tests {
    use super::{aligned, duration};

    #[test]
    fn durations_read_well() {
        let shown = [7, 2_345, 18_250, 912_000, 3_400_000, 1_200_000_000].map(|ns| duration(Some(ns)));
        assert_eq!(shown, ["7 ns", "2.35 µs", "18.2 µs", "912 µs", "3.40 ms", "1.20 s"]);
        assert_eq!(duration(None), "–");
    }

    #[test]
    fn columns_line_up() {
        let rows = [vec!["a".into(), "bb".into()], vec!["ccc".into(), "µ".into()], vec!["d".into(), "e".into()]];
        assert_eq!(aligned(&rows), "a    bb\n───────\nccc  µ\nd    e");
    }
}
