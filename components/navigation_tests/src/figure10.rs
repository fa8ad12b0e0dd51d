//! The experiment as a drawing: a row for each length of the window; on the left what encoder and model count, on the right their
//! filtered difference and the threshold; in both when the power failed and when the fault was raised.

use std::fmt::Write;

use crate::power_off::{AFTER, POWER_OFF, Run, rates};

const WIDTH: f64 = 1080.0;
/// Left edges of the two columns, and how wide each is.
const COLUMNS: [f64; 2] = [76.0, 602.0];
const COLUMN: f64 = 452.0;
const TOP: f64 = 138.0;
/// Height of a panel, and what is between two.
const PANEL: f64 = 106.0;
const GAP: f64 = 24.0;
/// Where time begins and ends, in s.
const BEGIN: f64 = -0.1;
const END: f64 = POWER_OFF + AFTER;

/// Values that come as near to each other count as one in the curve of the difference.
const TOGETHER_NS: u64 = 5_000_000;

const STYLE: &str = "text{font-family:'Inter','Segoe UI','DejaVu Sans',sans-serif;font-size:12px;fill:#1f2937}\
.title{font-size:20px;font-weight:600}.quiet{fill:#6b7280}.small{font-size:11px;fill:#6b7280}.end{text-anchor:end}\
.middle{text-anchor:middle}.head{font-weight:600}.found{font-weight:600;fill:#b91c1c}.off{font-size:11px;fill:#b45309}";
const ENCODER: &str = "stroke:#2563eb;stroke-width:1.9";
const MODEL: &str = "stroke:#475569;stroke-width:1.6;stroke-dasharray:5 3";
const DIFFERENCE: &str = "stroke:#0f766e;stroke-width:1.9";
const LIMIT: &str = "stroke:#b91c1c;stroke-width:1.1;stroke-dasharray:2 3";
const OFF: &str = "stroke:#d97706;stroke-width:1.3";
const FOUND: &str = "stroke:#b91c1c;stroke-width:1.3";
const GRID: &str = "stroke:#eef0f3;stroke-width:1";
const AXIS: &str = "stroke:#9ca3af;stroke-width:1";

/// The drawing as an SVG document.
#[must_use]
pub fn draw(runs: &[Run]) -> String {
    let rows: Vec<Row<'_>> = runs.iter().map(Row::of).collect();
    let largest = |curves: Vec<&Curve>| round_up(curves.into_iter().map(peak).fold(0.0, f64::max));
    let scales = [
        largest(rows.iter().flat_map(|row| [&row.encoder, &row.model]).collect()),
        largest(rows.iter().map(|row| &row.difference).collect()),
    ];
    let mut canvas = Canvas(String::new());
    head(&mut canvas);
    let tops = (0..rows.len()).map(|row| TOP + row as f64 * (PANEL + GAP));
    for (row, top) in rows.iter().zip(tops.clone()) {
        signals(&mut canvas, row, Frame { left: COLUMNS[0], top, max: scales[0] });
        difference(&mut canvas, row, Frame { left: COLUMNS[1], top, max: scales[1] });
    }
    let bottom = tops.clone().next_back().unwrap_or(TOP) + PANEL;
    COLUMNS.iter().for_each(|left| time(&mut canvas, *left, bottom));
    let height = bottom + 58.0;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{height:.0}\" viewBox=\"0 0 {WIDTH} {height:.0}\">\n\
         <style>{STYLE}</style>\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n{}</svg>\n",
        canvas.0
    )
}

type Curve = Vec<(f64, f64)>;

/// What one run gives.
struct Row<'a> {
    run: &'a Run,
    encoder: Curve,
    model: Curve,
    difference: Curve,
}

impl<'a> Row<'a> {
    fn of(run: &'a Run) -> Self {
        let shown = |curve: Curve| curve.into_iter().filter(|(at, _)| (BEGIN..=END).contains(at)).collect();
        let mut compared = run.compared();
        // Encoder and model are heard one right after the other; what is said in between would only draw stairs.
        compared.reverse();
        compared.dedup_by(|earlier, later| later.at_ns - earlier.at_ns < TOGETHER_NS);
        compared.reverse();
        let difference = compared.iter().map(|one| (run.seconds(one.at_ns), one.reading.difference())).collect();
        Self {
            run,
            encoder: shown(rates(run, &run.encoder)),
            model: shown(rates(run, &run.model)),
            difference: shown(difference),
        }
    }

    fn found(&self) -> f64 {
        self.run.seconds(self.run.found.at_ns)
    }
}

fn peak(curve: &Curve) -> f64 {
    curve.iter().map(|(_, value)| *value).fold(0.0, f64::max)
}

/// The next multiple of 500 with a little room.
fn round_up(value: f64) -> f64 {
    (value * 1.06 / 500.0).ceil().max(1.0) * 500.0
}

fn head(canvas: &mut Canvas) {
    let left = COLUMNS[0];
    canvas.text((left, 36.0), "title", "The power of the left wheels fails: how soon the reference model tells");
    let about = "Front left wheel of the simulated robot, one run of the daemon for each length T of the sliding window. Samples as they passed";
    canvas.text((left, 57.0), "quiet", about);
    let about = "the ports, detection as the journal says; the difference is computed from the samples with the daemon's own comparison.";
    canvas.text((left, 74.0), "quiet", about);
    let [left, right] = COLUMNS;
    let y = TOP - 22.0;
    canvas.text((left, y), "head", "ticks/s");
    legend(canvas, (left + 246.0, y), ENCODER, "encoder");
    legend(canvas, (left + 344.0, y), MODEL, "reference");
    canvas.text((right, y), "head", "ticks/s");
    legend(canvas, (right + 184.0, y), DIFFERENCE, "filtered difference");
    legend(canvas, (right + 350.0, y), LIMIT, "threshold");
}

fn legend(canvas: &mut Canvas, (x, y): (f64, f64), style: &str, what: &str) {
    canvas.line((x, y - 4.0), (x + 26.0, y - 4.0), style);
    canvas.text((x + 32.0, y), "", what);
}

/// What encoder and model count a second.
fn signals(canvas: &mut Canvas, row: &Row<'_>, frame: Frame) {
    frame.draw(canvas, row);
    canvas.curve(&row.model, &frame, MODEL);
    canvas.curve(&row.encoder, &frame, ENCODER);
    canvas.text((frame.left + 9.0, frame.top + 17.0), "head", &format!("T = {} ms", row.run.window_ms));
    canvas.text((x(frame.left, POWER_OFF) - 5.0, frame.top + PANEL - 7.0), "off end", "power off");
}

/// What remains of the two after the filter, and when that is too much.
fn difference(canvas: &mut Canvas, row: &Row<'_>, frame: Frame) {
    frame.draw(canvas, row);
    let limit = frame.y(row.run.found.threshold);
    canvas.line((frame.left, limit), (frame.left + COLUMN, limit), LIMIT);
    canvas.curve(&row.difference, &frame, DIFFERENCE);
    let place = (x(frame.left, row.found()) + 7.0, frame.top + PANEL - 7.0);
    canvas.text(place, "found", &format!("fault after {:.0} ms", row.run.found_after_ms()));
    canvas.text((frame.left + 9.0, limit - 5.0), "small", &format!("{}", row.run.found.threshold));
}

/// The axis below a column.
fn time(canvas: &mut Canvas, left: f64, bottom: f64) {
    for half in 0..=(END * 2.0) as u32 {
        let at = f64::from(half) / 2.0;
        canvas.line((x(left, at), bottom), (x(left, at), bottom + 4.0), AXIS);
        canvas.text((x(left, at), bottom + 18.0), "small middle", &format!("{at:.1}"));
    }
    let middle = left + COLUMN / 2.0;
    canvas.text((middle, bottom + 38.0), "small middle", "seconds since the robot was told to drive");
}

fn x(left: f64, seconds: f64) -> f64 {
    left + (seconds - BEGIN) / (END - BEGIN) * COLUMN
}

/// A panel: where it is, and what its upper edge means.
#[derive(Clone, Copy)]
struct Frame {
    left: f64,
    top: f64,
    max: f64,
}

impl Frame {
    fn y(&self, value: f64) -> f64 {
        self.top + PANEL * (1.0 - value.clamp(0.0, self.max) / self.max)
    }

    /// Axes, and the time from the failure until it is found.
    fn draw(&self, canvas: &mut Canvas, row: &Row<'_>) {
        let (right, bottom) = (self.left + COLUMN, self.top + PANEL);
        let (off, found) = (x(self.left, POWER_OFF), x(self.left, row.found()));
        canvas.area((off, self.top), (found, bottom), "fill:#fef2f2");
        for thousand in 0..=(self.max / 1000.0) as u32 {
            let mark = f64::from(thousand) * 1000.0;
            canvas.line((self.left, self.y(mark)), (right, self.y(mark)), GRID);
            canvas.text((self.left - 8.0, self.y(mark) + 4.0), "small end", &format!("{mark}"));
        }
        canvas.line((self.left, self.top), (self.left, bottom), AXIS);
        canvas.line((self.left, bottom), (right, bottom), AXIS);
        canvas.line((off, self.top), (off, bottom), OFF);
        canvas.line((found, self.top), (found, bottom), FOUND);
    }
}

/// Elements as text.
struct Canvas(String);

impl Canvas {
    fn text(&mut self, (x, y): (f64, f64), class: &str, text: &str) {
        let text = text.replace('&', "&amp;").replace('<', "&lt;");
        // Writing to a string cannot fail.
        let _ = writeln!(self.0, r#"<text x="{x:.1}" y="{y:.1}" class="{class}">{text}</text>"#);
    }

    fn line(&mut self, from: (f64, f64), to: (f64, f64), style: &str) {
        let ((x1, y1), (x2, y2)) = (from, to);
        let _ = writeln!(self.0, r#"<line x1="{x1:.1}" y1="{y1:.1}" x2="{x2:.1}" y2="{y2:.1}" style="{style}"/>"#);
    }

    fn area(&mut self, (left, top): (f64, f64), (right, bottom): (f64, f64), style: &str) {
        let (width, height) = ((right - left).max(0.0), bottom - top);
        let _ = writeln!(
            self.0,
            r#"<rect x="{left:.1}" y="{top:.1}" width="{width:.1}" height="{height:.1}" style="{style}"/>"#
        );
    }

    /// Time in s against values.
    fn curve(&mut self, points: &[(f64, f64)], frame: &Frame, style: &str) {
        let points: Vec<String> =
            points.iter().map(|(at, value)| format!("{:.1},{:.1}", x(frame.left, *at), frame.y(*value))).collect();
        let _ = writeln!(self.0, r#"<polyline points="{}" style="fill:none;{style}"/>"#, points.join(" "));
    }
}
