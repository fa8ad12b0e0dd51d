//! The picture of a run: the robot's path on the map, speed over time, what the colours and numbers mean.
//!
//! Decision: SVG written as text. A drawing library would be the largest dependency of this crate for five kinds of
//! element, and text can be compared in tests.

mod canvas;
mod labels;
mod legend;
mod map;
mod strip;

use std::path::Path;

use super::DemoError;
use super::report::Report;
use canvas::Canvas;

/// Width of the picture, in pixels.
const WIDTH: f64 = 1180.0;
/// Free space around everything, in pixels.
const MARGIN: f64 = 40.0;
/// Height of the heading, in pixels.
const HEADING: f64 = 64.0;

/// One colour per component that steered: the first, and what replaced it.
const STEERED_BY: [&str; 4] = ["#2563eb", "#ea7a0c", "#0d9488", "#9333ea"];
const FAULT: &str = "#c81e1e";
const INK: &str = "#1f2937";
const QUIET: &str = "#6b7280";

/// Draws `report` into the file `path`.
///
/// # Errors
/// The file cannot be written.
pub fn write(report: &Report, path: &Path) -> Result<(), DemoError> {
    std::fs::write(path, draw(report)).map_err(DemoError::system("write", path))
}

/// `report` as an SVG document.
#[must_use]
pub fn draw(report: &Report) -> String {
    let steering = Steering::of(report);
    let map = map::Map::new(&report.world);
    let mut canvas = Canvas::new();
    heading(&mut canvas, report);
    map.draw(&mut canvas, report, &steering);
    let below_map = HEADING + map.height() + 28.0;
    let below_strip = strip::draw(&mut canvas, report, &steering, below_map);
    let bottom = legend::draw(&mut canvas, report, &steering, below_strip + 34.0);
    canvas.document(WIDTH, bottom + 24.0)
}

fn heading(canvas: &mut Canvas, report: &Report) {
    canvas.text(MARGIN, 34.0, "title", &report.last_line());
    let how = format!(
        "world “{}”, the robot drives from left to right; times count from the daemon's ready",
        report.world.name
    );
    canvas.text(MARGIN, 53.0, "quiet", &how);
}

/// Who steered when: every replacement of an instance begins a new stretch of the path; or, where a skill says who drives,
/// what it says.
struct Steering {
    /// Begin (nanoseconds, monotonic) and class of each stretch.
    stretches: Vec<(u64, String)>,
}

impl Steering {
    fn of(report: &Report) -> Self {
        if let Some((_, first)) = report.steered.first() {
            let later = report.steered.iter().skip(1).cloned();
            return Self { stretches: [(0, first.clone())].into_iter().chain(later).collect() };
        }
        let replaced = || report.faults.iter().filter_map(|fault| Some((fault, fault.replaced_by()?)));
        let first = replaced().next().map_or_else(String::new, |(fault, _)| fault.class.clone());
        let later = replaced().map(|(fault, successor)| (fault.mono_ns, successor.to_owned()));
        Self { stretches: [(0, first)].into_iter().chain(later).collect() }
    }

    /// Number of the stretch in which `mono_ns` lies.
    fn stretch(&self, mono_ns: u64) -> usize {
        self.stretches.partition_point(|(begin, _)| *begin <= mono_ns).saturating_sub(1)
    }

    /// Who steered twice has one colour.
    fn colour(&self, stretch: usize) -> &'static str {
        STEERED_BY[self.first(stretch) % STEERED_BY.len()]
    }

    /// The first stretch of whoever steered in this one.
    fn first(&self, stretch: usize) -> usize {
        let name = |stretch: usize| self.stretches.get(stretch).map(|(_, name)| name);
        (0..stretch).find(|earlier| name(*earlier) == name(stretch)).unwrap_or(stretch)
    }
}
