//! Speed over time below the map, the faults as lines across it: a break in the drive would show here.

use super::canvas::Canvas;
use super::{FAULT, MARGIN, QUIET, Steering, WIDTH};
use crate::demo::report::Report;
use crate::serve::record::Moment;
use board_protocol::robot::WHEEL_RADIUS_M;

const HEIGHT: f64 = 110.0;
const TICK_S: u32 = 5;

/// Draws the strip below `top`; returns its lower end.
pub(super) fn draw(canvas: &mut Canvas, report: &Report, steering: &Steering, top: f64) -> f64 {
    let moments: Vec<&Moment> = report.track.iter().filter(|moment| moment.mono_ns >= report.ready_ns).collect();
    let span = report.duration().max(1.0);
    let highest = moments.iter().map(|moment| speed(moment)).fold(0.5, f64::max);
    let at = |seconds: f64, speed: f64| {
        let share = speed.max(0.0) / highest;
        (MARGIN + seconds / span * (WIDTH - 2.0 * MARGIN), top + HEIGHT - share * (HEIGHT - 14.0))
    };
    axes(canvas, span, highest, at);
    for (index, fault) in report.faults.iter().enumerate() {
        let (x, _) = at(report.seconds(fault.mono_ns), 0.0);
        canvas.line((x, top), (x, top + HEIGHT), &format!("stroke:{FAULT};stroke-width:1;stroke-dasharray:3 3"));
        canvas.circle((x, top), 7.5, &format!("fill:{FAULT}"));
        canvas.text(x, top + 4.0, "number", &(index + 1).to_string());
    }
    for pair in moments.chunk_by(|a, b| steering.stretch(a.mono_ns) == steering.stretch(b.mono_ns)) {
        let points: Vec<_> = pair.iter().map(|moment| at(report.seconds(moment.mono_ns), speed(moment))).collect();
        let colour = steering.colour(pair.first().map_or(0, |moment| steering.stretch(moment.mono_ns)));
        canvas.polyline(&points, &format!("stroke:{colour};stroke-width:2;stroke-linejoin:round"));
    }
    top + HEIGHT + 16.0
}

fn axes(canvas: &mut Canvas, span: f64, highest: f64, at: impl Fn(f64, f64) -> (f64, f64)) {
    let (left, base) = at(0.0, 0.0);
    canvas.line((left, base), at(span, 0.0), &format!("stroke:{QUIET};stroke-width:1"));
    canvas.text(left, at(0.0, highest).1 - 20.0, "head", "speed");
    for step in 1..=(highest / 0.2) as u32 {
        let speed = f64::from(step) * 0.2;
        canvas.line(at(0.0, speed), at(span, speed), "stroke:#e5e7eb;stroke-width:1");
        canvas.text(left - 4.0, at(0.0, speed).1 + 4.0, "small end", &format!("{speed:.1}"));
    }
    canvas.text(left - 4.0, base + 4.0, "small end", "0 m/s");
    for tick in (0..=span as u32).step_by(TICK_S as usize) {
        canvas.text(at(f64::from(tick), 0.0).0, base + 15.0, "small middle", &format!("{tick} s"));
    }
}

/// Speed of the robot's centre, in metres per second.
fn speed(moment: &Moment) -> f64 {
    moment.wheels.iter().sum::<f64>() / 4.0 * f64::from(WHEEL_RADIUS_M)
}
