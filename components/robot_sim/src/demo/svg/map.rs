//! The world from above, the path in it, and the faults on the path.

use super::canvas::Canvas;
use super::labels::{self, Box2};
use super::{FAULT, HEADING, MARGIN, QUIET, Steering, WIDTH};
use crate::demo::report::Report;
use crate::geometry::Point;
use crate::serve::record::Moment;
use crate::simulation::REACHED_M;
use crate::world::{Colour, Outline, World};
use board_protocol::robot::BODY_RADIUS_M;

/// The robot's outline is drawn this often along the path, in seconds.
const OUTLINE_EVERY_S: f64 = 4.0;
const WALL_PIXELS: f64 = 7.0;

/// Metres of the world to pixels of the picture.
pub(super) struct Map {
    low: Point,
    high: Point,
    scale: f64,
}

impl Map {
    pub(super) fn new(world: &World) -> Self {
        let (low, high) = world.bounds();
        Self { low, high, scale: (WIDTH - 2.0 * MARGIN) / (high.x - low.x).max(0.1) }
    }

    pub(super) fn height(&self) -> f64 {
        (self.high.y - self.low.y) * self.scale
    }

    fn at(&self, x: f64, y: f64) -> (f64, f64) {
        (MARGIN + (x - self.low.x) * self.scale, HEADING + (self.high.y - y) * self.scale)
    }

    fn place(&self, moment: &Moment) -> (f64, f64) {
        self.at(moment.x, moment.y)
    }

    pub(super) fn draw(&self, canvas: &mut Canvas, report: &Report, steering: &Steering) {
        self.floor(canvas);
        self.target(canvas, &report.world);
        for obstacle in &report.world.obstacles {
            self.obstacle(canvas, &obstacle.outline, obstacle.colour);
        }
        self.walls(canvas, &report.world);
        self.path(canvas, report, steering);
        self.faults(canvas, report);
    }

    fn floor(&self, canvas: &mut Canvas) {
        let (left, bottom) = self.at(self.low.x, self.low.y);
        let (right, top) = self.at(self.high.x, self.high.y);
        let size = (right - left, bottom - top);
        canvas.rectangle((left + size.0 / 2.0, top + size.1 / 2.0), size, 0.0, "fill:#f6f4ef");
        let thin = "stroke:#e5e1d8;stroke-width:1";
        for x in 1..(self.high.x - self.low.x).ceil() as u32 {
            let x = self.at(self.low.x + f64::from(x), 0.0).0;
            canvas.line((x, top), (x, bottom), thin);
        }
        for y in 1..(self.high.y - self.low.y).ceil() as u32 {
            let y = self.at(0.0, self.low.y + f64::from(y)).1;
            canvas.line((left, y), (right, y), thin);
        }
        let metre = self.at(self.high.x - 1.15, self.low.y + 0.15);
        canvas.line(metre, (metre.0 + self.scale, metre.1), "stroke:#6b7280;stroke-width:2");
        canvas.text(metre.0 + self.scale / 2.0, metre.1 - 5.0, "small middle", "1 m");
    }

    fn walls(&self, canvas: &mut Canvas, world: &World) {
        for wall in &world.walls {
            let points: Vec<_> = wall.iter().map(|(x, y)| self.at(*x, *y)).collect();
            let style = format!("stroke:#57534e;stroke-width:{WALL_PIXELS};stroke-linejoin:round;stroke-linecap:round");
            canvas.polyline(&points, &style);
        }
    }

    fn obstacle(&self, canvas: &mut Canvas, outline: &Outline, colour: Colour) {
        let style = format!("fill:{};stroke:#00000055;stroke-width:1.5", hex(colour));
        match *outline {
            Outline::Round { x, y, radius } => canvas.circle(self.at(x, y), radius * self.scale, &style),
            Outline::Box { x, y, width, depth, turn } => {
                canvas.rectangle(self.at(x, y), (width * self.scale, depth * self.scale), -turn, &style);
            }
        }
    }

    fn target(&self, canvas: &mut Canvas, world: &World) {
        let target = &world.target;
        let (centre, colour) = (self.at(target.x, target.y), hex(target.colour));
        let reach = (target.radius + REACHED_M) * self.scale;
        canvas.circle(centre, reach, &format!("fill:{colour}14;stroke:{colour};stroke-width:1.2;stroke-dasharray:5 4"));
        canvas.circle(centre, target.radius * self.scale, &format!("fill:{colour};stroke:#7f1d1d;stroke-width:1.5"));
        canvas.text(centre.0, centre.1 + reach + 15.0, "quiet middle", "target");
    }

    fn path(&self, canvas: &mut Canvas, report: &Report, steering: &Steering) {
        self.outlines(canvas, report);
        let mut from = 0;
        while from < report.track.len() {
            let stretch = steering.stretch(report.track[from].mono_ns);
            let length = report.track[from..].partition_point(|moment| steering.stretch(moment.mono_ns) == stretch);
            // One moment more, so that there is no gap between two colours.
            let to = (from + length + 1).min(report.track.len());
            let points: Vec<_> = report.track[from..to].iter().map(|moment| self.place(moment)).collect();
            let colour = steering.colour(stretch);
            canvas.polyline(&points, &format!("stroke:{colour};stroke-width:3.5;stroke-linejoin:round"));
            from += length;
        }
    }

    /// The robot itself every few seconds, and where it started and ended.
    fn outlines(&self, canvas: &mut Canvas, report: &Report) {
        let mut next = f64::NEG_INFINITY;
        for (index, moment) in report.track.iter().enumerate() {
            let seconds = report.seconds(moment.mono_ns);
            let last = index + 1 == report.track.len();
            // While the daemon loads, the robot stands at its start; one outline is enough.
            if (seconds < next || seconds < 0.0 && index > 0) && !last {
                continue;
            }
            next = seconds.max(0.0) + OUTLINE_EVERY_S;
            self.outline(canvas, moment, if index == 0 || last { 0.9 } else { 0.35 });
        }
    }

    fn outline(&self, canvas: &mut Canvas, moment: &Moment, opacity: f64) {
        let radius = f64::from(BODY_RADIUS_M);
        let centre = self.place(moment);
        let style = format!("fill:#ffffffb0;stroke:#374151;stroke-width:1.4;opacity:{opacity}");
        canvas.circle(centre, radius * self.scale, &style);
        let nose = Point { x: moment.x, y: moment.y }.towards(moment.theta, radius);
        canvas.line(centre, self.at(nose.x, nose.y), &format!("stroke:#374151;stroke-width:1.4;opacity:{opacity}"));
    }

    fn faults(&self, canvas: &mut Canvas, report: &Report) {
        let marks: Vec<_> = report.faults.iter().filter_map(|fault| report.place(fault.mono_ns)).collect();
        let marks: Vec<_> = marks.iter().map(|moment| self.place(moment)).collect();
        let texts: Vec<String> =
            report.faults.iter().map(|fault| format!("{} {}", fault.slot, fault.symptom)).collect();
        let (left, bottom) = self.at(self.low.x, self.low.y);
        let (right, top) = self.at(self.high.x, self.high.y);
        let frame = Box2 { left, top, right, bottom };
        let taken = self.taken(report);
        for ((mark, text), spot) in marks.iter().zip(&texts).zip(labels::place(&marks, &texts, frame, taken)) {
            canvas.line(*mark, spot.anchor(*mark), &format!("stroke:{QUIET};stroke-width:1"));
            canvas.rectangle(spot.centre(), spot.size(), 0.0, "fill:#ffffffe6;stroke:#fca5a5;stroke-width:1");
            canvas.text(spot.centre().0, spot.centre().1 + 4.0, "label middle", text);
        }
        for (index, mark) in marks.iter().enumerate() {
            canvas.circle(*mark, 9.0, &format!("fill:{FAULT};stroke:#fff;stroke-width:1.8"));
            canvas.text(mark.0, mark.1 + 4.0, "number", &(index + 1).to_string());
        }
    }

    /// What labels should not cover: the path and the things in the room.
    fn taken(&self, report: &Report) -> Vec<Box2> {
        let path = report.track.iter().step_by(10).map(|moment| Box2::around(self.place(moment), 6.0));
        let target = &report.world.target;
        let target = Box2::around(self.at(target.x, target.y), (target.radius + REACHED_M) * self.scale);
        let obstacles = report.world.obstacles.iter().map(|obstacle| match obstacle.outline {
            Outline::Round { x, y, radius } => Box2::around(self.at(x, y), radius * self.scale),
            Outline::Box { x, y, width, depth, .. } => Box2::around(self.at(x, y), width.max(depth) / 2.0 * self.scale),
        });
        path.chain(obstacles).chain([target]).collect()
    }
}

fn hex(colour: Colour) -> String {
    let [red, green, blue] = colour;
    format!("#{red:02x}{green:02x}{blue:02x}")
}
