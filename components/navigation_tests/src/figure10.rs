//! The experiment as a drawing: above what encoder and model say, below for each length of the window their filtered difference,
//! the threshold, and when the fault is raised.

use std::fmt::Write;

use crate::power_off::{Experiment, LENGTH, POWER_OFF, THRESHOLD, Windowed};

const WIDTH: f64 = 900.0;
const LEFT: f64 = 74.0;
const RIGHT: f64 = 26.0;
const TOP: f64 = 92.0;
/// Height of the panel above, and of one below.
const ABOVE: f64 = 190.0;
const BELOW: f64 = 86.0;
const GAP: f64 = 26.0;
/// Ticks/s at the upper edges.
const RATE_MAX: f64 = 2800.0;
const DIFFERENCE_MAX: f64 = 3100.0;
/// Where time begins, in s.
const BEGIN: f64 = -0.2;

const STYLE: &str = "text{font-family:'Inter','Segoe UI','DejaVu Sans',sans-serif;font-size:12px;fill:#1f2937}\
.title{font-size:19px;font-weight:600}.quiet{fill:#6b7280}.small{font-size:11px;fill:#6b7280}.end{text-anchor:end}\
.middle{text-anchor:middle}.head{font-weight:600}.found{font-weight:600;fill:#b91c1c}.off{font-weight:600;fill:#92400e}";
const ENCODER: &str = "stroke:#1d4ed8;stroke-width:1.8";
const MODEL: &str = "stroke:#6b7280;stroke-width:1.8;stroke-dasharray:6 3";
const DIFFERENCE: &str = "stroke:#0f766e;stroke-width:1.8";
const LIMIT: &str = "stroke:#b91c1c;stroke-width:1;stroke-dasharray:3 3";
const OFF: &str = "stroke:#d97706;stroke-width:1.4";
const FOUND: &str = "stroke:#b91c1c;stroke-width:1.4";

/// The drawing as an SVG document.
#[must_use]
pub fn draw(experiment: &Experiment) -> String {
    let below = experiment.windows.len() as f64;
    let height = TOP + ABOVE + below * (BELOW + GAP) + 62.0;
    let mut canvas = Canvas(String::new());
    canvas.text(LEFT, 34.0, "title", "The power of the left wheels fails: how soon the encoder's model tells");
    let about = "Front left encoder of the simulated robot and its reference model; the window's length sets how soon and how surely.";
    canvas.text(LEFT, 54.0, "quiet", about);
    let mut top = TOP;
    speeds(&mut canvas, experiment, top);
    top += ABOVE + GAP;
    for window in &experiment.windows {
        differences(&mut canvas, window, top);
        top += BELOW + GAP;
    }
    let bottom = top - GAP;
    for tenth in (0..=(LENGTH * 10.0) as u32).step_by(5) {
        let at = f64::from(tenth) / 10.0;
        canvas.text(x(at), bottom + 18.0, "small middle", &format!("{at:.1}"));
    }
    canvas.text(
        (LEFT + WIDTH - RIGHT) / 2.0,
        bottom + 38.0,
        "small middle",
        "seconds since the robot was told to drive",
    );
    canvas.line((x(POWER_OFF), TOP), (x(POWER_OFF), bottom), OFF);
    canvas.text(x(POWER_OFF) - 6.0, TOP + 16.0, "off end", "power off");
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{height:.0}\" viewBox=\"0 0 {WIDTH} {height:.0}\">\n\
         <style>{STYLE}</style>\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n{}</svg>\n",
        canvas.0
    )
}

/// What encoder and model count a second.
fn speeds(canvas: &mut Canvas, experiment: &Experiment, top: f64) {
    let frame = Frame { top, height: ABOVE, max: RATE_MAX };
    frame.draw(canvas, &[0.0, 1000.0, 2000.0], "ticks/s");
    canvas.curve(&experiment.model, &frame, MODEL);
    canvas.curve(&experiment.encoder, &frame, ENCODER);
    let legend = |canvas: &mut Canvas, place: f64, style: &str, what: &str| {
        let (from, y) = (WIDTH - RIGHT - 245.0 + place, top - 12.0);
        canvas.line((from, y), (from + 26.0, y), style);
        canvas.text(from + 32.0, y + 4.0, "", what);
    };
    legend(canvas, 0.0, ENCODER, "encoder");
    legend(canvas, 105.0, MODEL, "reference model");
}

/// What remains of the two after the filter, and when that is too much.
fn differences(canvas: &mut Canvas, window: &Windowed, top: f64) {
    let frame = Frame { top, height: BELOW, max: DIFFERENCE_MAX };
    frame.draw(canvas, &[0.0, 2000.0], "");
    canvas.text(LEFT + 8.0, top + 17.0, "head", &format!("T = {} ms", window.window_ms));
    canvas.line((LEFT, frame.y(THRESHOLD)), (WIDTH - RIGHT, frame.y(THRESHOLD)), LIMIT);
    canvas.text(LEFT + 8.0, frame.y(THRESHOLD) - 4.0, "small", &format!("threshold {THRESHOLD}"));
    let curve: Vec<(f64, f64)> = window.readings.iter().map(|(at, reading)| (*at, reading.difference())).collect();
    canvas.curve(&curve, &frame, DIFFERENCE);
    if let Some(at) = window.detected {
        canvas.line((x(at), top), (x(at), top + BELOW), FOUND);
        let text = format!("fault after {:.0} ms", (at - POWER_OFF) * 1e3);
        canvas.text(x(at) + 7.0, top + BELOW - 7.0, "found", &text);
    }
}

fn x(seconds: f64) -> f64 {
    LEFT + (seconds - BEGIN) / (LENGTH - BEGIN) * (WIDTH - LEFT - RIGHT)
}

/// A panel: where it is, and what its upper edge means.
struct Frame {
    top: f64,
    height: f64,
    max: f64,
}

impl Frame {
    fn y(&self, value: f64) -> f64 {
        self.top + self.height * (1.0 - value / self.max)
    }

    fn draw(&self, canvas: &mut Canvas, marks: &[f64], unit: &str) {
        let (right, bottom) = (WIDTH - RIGHT, self.top + self.height);
        for mark in marks {
            canvas.line((LEFT, self.y(*mark)), (right, self.y(*mark)), "stroke:#e5e7eb;stroke-width:1");
            canvas.text(LEFT - 8.0, self.y(*mark) + 4.0, "small end", &format!("{mark}"));
        }
        canvas.line((LEFT, self.top), (LEFT, bottom), "stroke:#9ca3af;stroke-width:1");
        canvas.line((LEFT, bottom), (right, bottom), "stroke:#9ca3af;stroke-width:1");
        canvas.text(LEFT - 8.0, self.top + 2.0, "small end", unit);
    }
}

/// Elements as text.
struct Canvas(String);

impl Canvas {
    fn text(&mut self, x: f64, y: f64, class: &str, text: &str) {
        let text = text.replace('&', "&amp;").replace('<', "&lt;");
        // Writing to a string cannot fail.
        let _ = writeln!(self.0, r#"<text x="{x:.1}" y="{y:.1}" class="{class}">{text}</text>"#);
    }

    fn line(&mut self, from: (f64, f64), to: (f64, f64), style: &str) {
        let ((x1, y1), (x2, y2)) = (from, to);
        let _ = writeln!(self.0, r#"<line x1="{x1:.1}" y1="{y1:.1}" x2="{x2:.1}" y2="{y2:.1}" style="{style}"/>"#);
    }

    /// Time in s against values; what lies before the panel is left out.
    fn curve(&mut self, points: &[(f64, f64)], frame: &Frame, style: &str) {
        let shown = points.iter().filter(|(at, _)| *at >= BEGIN && *at <= LENGTH);
        let points: Vec<String> =
            shown.map(|(at, value)| format!("{:.1},{:.1}", x(*at), frame.y(value.clamp(0.0, frame.max)))).collect();
        let _ = writeln!(self.0, r#"<polyline points="{}" style="fill:none;{style}"/>"#, points.join(" "));
    }
}
