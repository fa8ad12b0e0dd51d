//! The graph as a picture: dark on light, fonts that every viewer has, readable without colours too (dashes, shapes).

use std::fmt::Write;

use super::layout::{Drawing, Line, Node, Pin, Point, ROW, TITLE, layout, subtitle, text_width};
use super::{monitored, needed, range};
use crate::profile::plan::{ConnectionPlan, Plan, PortKind, SlotPlan};

const STYLE: &str = "<style>\
    text{font-family:'DejaVu Sans','Helvetica Neue',Arial,sans-serif;fill:#1b2430}\
    .heading{font-size:18px;font-weight:bold}.name{font-size:14px;font-weight:bold}.class{font-size:11px;fill:#566173}\
    .port{font-size:12px}.label{font-size:10.5px;fill:#3c4858;paint-order:stroke;stroke:#fff;stroke-width:4px}\
    .standby{font-size:11px;fill:#566173;font-style:italic}.line{fill:none;stroke-width:1.8}\
    .data{stroke:#1f5fa8}.event{stroke:#b35c00;stroke-dasharray:7 4}.service{stroke:#2a7d3f;stroke-dasharray:2 3}\
    .needs{stroke:#a02020;stroke-width:1.4;stroke-dasharray:1 4;stroke-linecap:round}.pneeds{fill:#fff;stroke:#a02020}\
    .pdata{fill:#1f5fa8}.pevent{fill:#b35c00}.pservice{fill:#2a7d3f}\
    </style>";

/// The picture, with a heading.
#[must_use]
pub fn draw(plan: &Plan, heading: &str) -> String {
    let drawing = layout(plan);
    let mut out = String::new();
    let (width, height) = (drawing.width.ceil(), drawing.height.ceil());
    // Writing to a string cannot fail.
    let _ = writeln!(
        out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\">"
    );
    let _ = writeln!(out, "{STYLE}\n<rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>");
    let _ = writeln!(out, "<text class=\"heading\" x=\"28\" y=\"38\">{}</text>", escaped(heading));
    for (connection, line) in plan.connections.iter().zip(&drawing.lines) {
        draw_line(connection, line, &mut out);
    }
    for number in 0..plan.dependencies.len() {
        needs(plan, &drawing, number, &mut out);
    }
    for (slot, node) in plan.slots.iter().zip(&drawing.nodes) {
        slot_box(slot, node, plan.applications.len() > 1, &mut out);
    }
    labels(plan, &drawing, &mut out);
    legend(height - 18.0, !plan.dependencies.is_empty(), &mut out);
    out.push_str("</svg>\n");
    out
}

fn slot_box(slot: &SlotPlan, node: &Node, several: bool, out: &mut String) {
    let (Point { x, y }, width, height) = (node.at, node.width, node.height);
    let middle = x + width / 2.0;
    let _ = writeln!(
        out,
        "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" rx=\"7\" fill=\"#f6f8fb\" stroke=\"#39465a\" stroke-width=\"1.4\"/>\
         <path d=\"M{x:.1} {0:.1}h{width:.1}\" stroke=\"#c3ccd9\"/>",
        y + TITLE - 6.0
    );
    let _ = writeln!(
        out,
        "<text class=\"name\" x=\"{middle:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
         <text class=\"class\" x=\"{middle:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
        y + 18.0,
        escaped(&slot.name),
        y + 33.0,
        escaped(&subtitle(slot))
    );
    node.left.iter().for_each(|pin| port(pin, 9.0, "start", out));
    node.right.iter().for_each(|pin| port(pin, -9.0, "end", out));
    if let Some(first) = slot.rules.secondaries.first() {
        let more = slot.rules.secondaries.len() - 1;
        let more = if more == 0 { String::new() } else { format!(" +{more}") };
        let text = format!("standby: {}{more}", first.component.name);
        let at = y + height - ROW / 2.0 + 2.0;
        let _ = writeln!(
            out,
            "<text class=\"standby\" x=\"{middle:.1}\" y=\"{at:.1}\" text-anchor=\"middle\">{}</text>",
            escaped(&text)
        );
    }
    if several {
        let _ = writeln!(
            out,
            "<text class=\"class\" x=\"{x:.1}\" y=\"{:.1}\">{}</text>",
            y - 5.0,
            escaped(&slot.application)
        );
    }
}

fn port(pin: &Pin, inwards: f64, anchor: &str, out: &mut String) {
    let Point { x, y } = pin.at;
    let class = class_of(pin.kind);
    let shape = match pin.kind {
        PortKind::Data => format!("<circle class=\"p{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\"/>"),
        PortKind::Event => {
            format!("<path class=\"p{class}\" d=\"M{:.1} {y:.1}l5 -5l5 5l-5 5z\"/>", x - 5.0)
        }
        PortKind::Service => {
            format!("<rect class=\"p{class}\" x=\"{:.1}\" y=\"{:.1}\" width=\"8\" height=\"8\"/>", x - 4.0, y - 4.0)
        }
    };
    let _ = writeln!(
        out,
        "{shape}<text class=\"port\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"{anchor}\">{}</text>",
        x + inwards,
        y + 4.0,
        escaped(&pin.name)
    );
}

fn draw_line(connection: &ConnectionPlan, line: &Line, out: &mut String) {
    let class = class_of(connection.kind);
    let Some(tip) = line.points.last() else { return };
    let path = if line.backwards { angular(&line.points) } else { smooth(&line.points) };
    let _ = writeln!(out, "<path class=\"line {class}\" d=\"{path}\"/>{}", arrow(class, *tip));
}

/// Who stops when others do: a dotted arrow from it to each slot that it needs, from top to top over what lies between, and how
/// many of them it needs beside where they leave it.
fn needs(plan: &Plan, drawing: &Drawing, number: usize, out: &mut String) {
    let node = |name: &str| {
        let slot = plan.slots.iter().position(|slot| slot.name == name);
        slot.and_then(|slot| drawing.nodes.get(slot))
    };
    let Some(dependency) = plan.dependencies.get(number) else { return };
    let Some(dependent) = node(&dependency.slot) else { return };
    // Beside the middle, where the data's own lines do not arrive either.
    let from = Point { x: dependent.at.x + dependent.width * 0.35, y: dependent.at.y };
    let (mut above, mut aside) = (false, false);
    for needed in dependency.on.iter().flat_map(|needed| &needed.slots).filter_map(|name| node(name)) {
        let tip = Point { x: needed.at.x + needed.width * 0.65, y: needed.at.y };
        let same_column = (from.x - tip.x).abs() < SAME_COLUMN;
        let path = if same_column { beside(dependent, needed, tip) } else { over(from, tip) };
        (above, aside) = (above || !same_column, aside || same_column);
        let Point { x, y } = tip;
        let _ = writeln!(
            out,
            "<path class=\"line needs\" d=\"{path}\"/><path class=\"pneeds\" d=\"M{x:.1} {:.1}l-4.5 -9h9z\"/>",
            y - 1.0
        );
    }
    // One below the other, where a slot has several dependencies.
    let earlier = plan.dependencies.iter().take(number).filter(|other| other.slot == dependency.slot).count();
    let row = 12.0 * earlier as f64;
    if above {
        label(Point { x: from.x + 5.0, y: from.y - 6.0 - row }, "start", &needed(dependency), out);
    }
    if aside {
        let right = dependent.at.x + dependent.width;
        label(
            Point { x: right + 4.0, y: dependent.at.y + TITLE / 2.0 + 14.0 + row },
            "start",
            &needed(dependency),
            out,
        );
    }
}

/// Boxes that are less apart lie one above the other.
const SAME_COLUMN: f64 = 130.0;

/// An arc from the top of one box to the top of another, as high as the heading leaves room for.
fn over(from: Point, to: Point) -> String {
    let rise = ((to.x - from.x).abs() / 6.0).clamp(22.0, 60.0);
    let top = (from.y.min(to.y) - rise).max(HEADING_BOTTOM);
    format!("M{:.1} {:.1}C{:.1} {top:.1} {:.1} {top:.1} {:.1} {:.1}", from.x, from.y, from.x, to.x, to.x, to.y - 9.0)
}

/// Where the heading ends.
const HEADING_BOTTOM: f64 = 48.0;

/// Along the right side of boxes that lie one above the other, and around into the top of the one that is needed.
fn beside(dependent: &Node, needed: &Node, tip: Point) -> String {
    let right = |node: &Node| node.at.x + node.width;
    let out = right(needed).max(right(dependent)) + 26.0;
    let (from_x, from_y) = (right(dependent), dependent.at.y + TITLE / 2.0);
    let above = tip.y - 22.0;
    format!(
        "M{from_x:.1} {from_y:.1}C{out:.1} {from_y:.1} {out:.1} {above:.1} {:.1} {above:.1}Q{:.1} {above:.1} {:.1} {:.1}",
        right(needed),
        tip.x,
        tip.x,
        tip.y - 9.0
    )
}

/// Level where it leaves, passes and arrives.
fn smooth(points: &[Point]) -> String {
    let mut path = String::new();
    let mut last: Option<Point> = None;
    for to in points {
        let _ = match last {
            None => write!(path, "M{:.1} {:.1}", to.x, to.y),
            Some(from) if (to.y - from.y).abs() < 0.5 => write!(path, "L{:.1} {:.1}", to.x, to.y),
            Some(from) => {
                let bend = (to.x - from.x) / 2.0;
                let (x1, x2) = (from.x + bend, to.x - bend);
                write!(path, "C{x1:.1} {:.1} {x2:.1} {:.1} {:.1} {:.1}", from.y, to.y, to.x, to.y)
            }
        };
        last = Some(*to);
    }
    path
}

/// Right angles with round corners.
fn angular(points: &[Point]) -> String {
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return String::new() };
    let mut path = format!("M{:.1} {:.1}", first.x, first.y);
    for corner in points.windows(3) {
        let [from, at, to] = [corner[0], corner[1], corner[2]];
        let (before, after) = (towards(at, from), towards(at, to));
        let _ = write!(path, "L{:.1} {:.1}Q{:.1} {:.1} {:.1} {:.1}", before.x, before.y, at.x, at.y, after.x, after.y);
    }
    let _ = write!(path, "L{:.1} {:.1}", last.x, last.y);
    path
}

/// The point a corner's radius away from `at` on the way to `to`.
fn towards(at: Point, to: Point) -> Point {
    const RADIUS: f64 = 9.0;
    let (dx, dy) = (to.x - at.x, to.y - at.y);
    let length = dx.hypot(dy).max(1e-9);
    let part = (RADIUS / length).min(0.5);
    Point { x: at.x + dx * part, y: at.y + dy * part }
}

fn arrow(class: &str, tip: Point) -> String {
    let Point { x, y } = tip;
    format!("<path class=\"p{class}\" d=\"M{:.1} {y:.1}l-9 -4.5v9z\"/>", x - 3.0)
}

/// The type beside the port that sends, once; the checks in the middle of each line.
fn labels(plan: &Plan, drawing: &Drawing, out: &mut String) {
    let mut done: Vec<(&str, &str)> = Vec::new();
    for (connection, line) in plan.connections.iter().zip(&drawing.lines) {
        let Some(first) = line.points.first() else { continue };
        let source = (connection.source.slot.as_str(), connection.source.port.as_str());
        if !done.contains(&source) {
            done.push(source);
            let type_name = type_of(plan, drawing, connection);
            label(Point { x: first.x + 8.0, y: first.y - 5.0 }, "start", &type_name, out);
        }
        let checks: Vec<String> = connection.validity.iter().map(range).collect();
        let at = middle(line);
        label(Point { x: at.x, y: at.y - 5.0 }, "middle", &checks.join(", "), out);
    }
    watched(plan, drawing, out);
}

/// What monitors watch, each in a line below the slot: beside the port it would cover what the lines lead to.
fn watched(plan: &Plan, drawing: &Drawing, out: &mut String) {
    for (slot, node) in plan.slots.iter().zip(&drawing.nodes) {
        let of_slot = plan.monitors.iter().filter(|monitor| monitor.port.slot == slot.name);
        for (line, monitor) in of_slot.enumerate() {
            let at = Point { x: node.at.x + 4.0, y: node.at.y + node.height + 12.0 + 12.0 * line as f64 };
            label(at, "start", &format!("{} · monitor: {}", monitor.port.port, monitored(monitor)), out);
        }
    }
}

/// The middle of the first level part; of the whole, where the line is one bend.
fn middle(line: &Line) -> Point {
    let skip = match (line.backwards, line.points.len()) {
        (true, _) => 2,
        (false, 0..=2) => 0,
        (false, _) => 1,
    };
    let mut points = line.points.iter().skip(skip);
    match (points.next(), points.next()) {
        (Some(a), Some(b)) => Point { x: f64::midpoint(a.x, b.x), y: f64::midpoint(a.y, b.y) },
        _ => Point { x: 0.0, y: 0.0 },
    }
}

fn type_of(plan: &Plan, drawing: &Drawing, connection: &ConnectionPlan) -> String {
    let slot = plan.slots.iter().position(|slot| slot.name == connection.source.slot);
    let pins = slot.and_then(|slot| drawing.nodes.get(slot)).map_or(&[][..], |node| &node.right);
    let pin = pins.iter().find(|pin| pin.name == connection.source.port && pin.kind == connection.kind);
    pin.map_or_else(String::new, |pin| pin.type_name.clone())
}

fn label(at: Point, anchor: &str, text: &str, out: &mut String) {
    if !text.is_empty() {
        let _ = writeln!(
            out,
            "<text class=\"label\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"{anchor}\">{}</text>",
            at.x,
            at.y,
            escaped(text)
        );
    }
}

fn legend(y: f64, has_needs: bool, out: &mut String) {
    let mut x = 28.0;
    let kinds = [PortKind::Data, PortKind::Event, PortKind::Service].map(class_of);
    for class in kinds.into_iter().chain(has_needs.then_some("needs")) {
        let _ = writeln!(
            out,
            "<path class=\"line {class}\" d=\"M{x:.1} {y:.1}h34\"/><text class=\"class\" x=\"{:.1}\" y=\"{:.1}\">{class}</text>",
            x + 40.0,
            y + 4.0
        );
        x += 40.0 + text_width(class, 11.0) + 24.0;
    }
}

const fn class_of(kind: PortKind) -> &'static str {
    crate::profile::wire::kind_name(kind)
}

fn escaped(text: &str) -> String {
    quick_xml::escape::escape(text).into_owned()
}
