//! What the colours and the numbers mean: who steered, and every fault with its times.

use super::canvas::Canvas;
use super::{FAULT, INK, MARGIN, Steering};
use crate::demo::report::Report;
use crate::demo::table::duration;

const ROW: f64 = 22.0;
/// Where the columns of the fault list begin, in pixels.
const COLUMNS: [f64; 6] = [70.0, 130.0, 310.0, 430.0, 560.0, 790.0];

/// Draws the legend below `top`; returns its lower end.
pub(super) fn draw(canvas: &mut Canvas, report: &Report, steering: &Steering, top: f64) -> f64 {
    let mut y = steered_by(canvas, report, steering, top);
    if report.faults.is_empty() {
        return y;
    }
    for (x, head) in COLUMNS.iter().zip(["at", "fault", "detected after", "recovered after", "how", "told by"]) {
        canvas.text(*x, y, "head", head);
    }
    canvas.line((MARGIN, y + 7.0), (super::WIDTH - MARGIN, y + 7.0), "stroke:#e5e7eb;stroke-width:1");
    for (index, fault) in report.faults.iter().enumerate() {
        y += ROW;
        canvas.circle((MARGIN + 9.0, y - 4.0), 9.0, &format!("fill:{FAULT}"));
        canvas.text(MARGIN + 9.0, y, "number", &(index + 1).to_string());
        let cells = [
            format!("{:.2} s", report.seconds(fault.mono_ns)),
            format!("{} {}", fault.slot, fault.symptom),
            duration(fault.times.detected_ns),
            duration(fault.times.first_callback_ns),
            if fault.recovered() || fault.ignored() {
                fault.how()
            } else {
                format!("{}: {}", fault.how(), fault.outcome)
            },
            fault.told(52),
        ];
        for (x, cell) in COLUMNS.iter().zip(&cells) {
            canvas.text(*x, y, "", cell);
        }
    }
    y
}

/// One coloured line per stretch of the path; returns where to go on.
fn steered_by(canvas: &mut Canvas, report: &Report, steering: &Steering, top: f64) -> f64 {
    let mut x = MARGIN;
    for (stretch, (begin, class)) in steering.stretches.iter().enumerate() {
        if steering.first(stretch) != stretch {
            continue;
        }
        let style = format!("stroke:{};stroke-width:4;stroke-linecap:round", steering.colour(stretch));
        canvas.line((x, top - 4.0), (x + 26.0, top - 4.0), &style);
        let name = if class.is_empty() { "path of the robot" } else { class };
        let since = if stretch == 0 { String::new() } else { format!(" from {:.1} s", report.seconds(*begin)) };
        let text = format!("{name}{since}");
        canvas.text(x + 34.0, top, "", &text);
        x += 60.0 + 7.0 * text.chars().count() as f64;
    }
    canvas.circle((x + 9.0, top - 4.0), 9.0, &format!("fill:none;stroke:{INK};stroke-width:1.2"));
    canvas.line((x + 9.0, top - 4.0), (x + 18.0, top - 4.0), &format!("stroke:{INK};stroke-width:1.2"));
    canvas.text(x + 26.0, top, "", "the robot, every 4 s");
    canvas.circle((x + 179.0, top - 4.0), 9.0, &format!("fill:{FAULT}"));
    canvas.text(x + 196.0, top, "", "a fault on the way");
    top + 34.0
}
