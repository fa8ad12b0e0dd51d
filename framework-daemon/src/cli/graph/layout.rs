//! Where everything is drawn: layers from left to right, few crossings, no line through a box.
//!
//! The classic steps (Sugiyama): break cycles, longest path, order by barycentres, coordinates. A line over several
//! layers gets a place in each of them; a line backwards gets a lane below all boxes. Own code, two screens of it:
//! the layout crates either need Graphviz or know no ports.

use std::collections::HashMap;

use crate::profile::plan::{Plan, PortKind, SlotPlan};
use crate::profile::wire::{Port, ports_of};

/// Space between two boxes of a layer.
const GAP_Y: f64 = 34.0;
/// Least space between two layers.
const GAP_X: f64 = 90.0;
/// Height of one port.
pub const ROW: f64 = 20.0;
/// Height of a box's title.
pub const TITLE: f64 = 46.0;
/// Height of a line that passes a layer.
const LANE: f64 = 16.0;
/// Around everything.
const MARGIN: f64 = 28.0;
/// Room for the heading.
const HEADING: f64 = 44.0;
/// Rounds of each improvement; more change nothing that one would see.
const ROUNDS: usize = 8;

/// A point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// To the right.
    pub x: f64,
    /// Down.
    pub y: f64,
}

/// A port on a side of a box.
#[derive(Clone, Debug)]
pub struct Pin {
    /// Its name.
    pub name: String,
    /// Its kind.
    pub kind: PortKind,
    /// Type name as written.
    pub type_name: String,
    /// Its place on the box's side.
    pub at: Point,
}

/// A slot.
#[derive(Clone, Debug)]
pub struct Node {
    /// Upper left corner.
    pub at: Point,
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
    /// Inputs and provided services.
    pub left: Vec<Pin>,
    /// Outputs and required services.
    pub right: Vec<Pin>,
}

/// Everything, placed.
#[derive(Debug)]
pub struct Drawing {
    /// Width.
    pub width: f64,
    /// Height.
    pub height: f64,
    /// One node a slot, in the plan's order.
    pub nodes: Vec<Node>,
    /// One line a connection, in the plan's order.
    pub lines: Vec<Line>,
}

/// The way of a connection.
#[derive(Clone, Debug)]
pub struct Line {
    /// The points it passes, from port to port.
    pub points: Vec<Point>,
    /// True where it runs back below the boxes, in right angles.
    pub backwards: bool,
}

/// One place in a layer: a slot, or a line that passes.
#[derive(Clone, Debug)]
struct Item {
    node: Option<usize>,
    edge: usize,
    height: f64,
    y: f64,
    /// Items of the layers beside it that it is connected with.
    before: Vec<usize>,
    after: Vec<usize>,
}

/// Width of a text of that size, roughly: fonts differ, and a box must be wide enough for most.
#[must_use]
pub fn text_width(text: &str, size: f64) -> f64 {
    text.chars().map(|c| if c.is_ascii() { 0.6 } else { 1.0 }).sum::<f64>() * size
}

/// Places a plan's slots and connections.
#[must_use]
pub fn layout(plan: &Plan) -> Drawing {
    let mut nodes: Vec<Node> = plan.slots.iter().map(node).collect();
    let index: HashMap<&str, usize> = plan.slots.iter().enumerate().map(|(i, slot)| (slot.name.as_str(), i)).collect();
    let end = |name: &str| index.get(name).copied().unwrap_or_default();
    let edges: Vec<(usize, usize)> = plan
        .connections
        .iter()
        .map(|connection| (end(&connection.source.slot), end(&connection.target.slot)))
        .collect();
    let layer_of = layers(nodes.len(), &main_edges(plan, nodes.len(), &edges));
    let (mut items, mut layers) = fill(&nodes, &edges, &layer_of);
    reorder(&mut items, &mut layers);
    settle(&mut items, &layers);
    let xs = columns(&nodes, &layers, &items);
    place(&mut nodes, &items, &layers, &xs);
    let lines = lines(plan, &nodes, &edges, &layer_of, &items, &layers, &xs);
    frame(nodes, lines)
}

fn node(slot: &SlotPlan) -> Node {
    let ports = ports_of(&slot.name, &slot.component);
    let pins = |source: bool| -> Vec<Pin> { ports.iter().filter(|port| port.is_source == source).map(pin).collect() };
    let (left, right) = (pins(false), pins(true));
    let widest = |pins: &[Pin]| pins.iter().map(|pin| text_width(&pin.name, 12.0)).fold(0.0, f64::max);
    let title = text_width(&slot.name, 15.0).max(text_width(&subtitle(slot), 11.0));
    let width = (widest(&left) + widest(&right) + 56.0).max(title + 28.0).max(120.0);
    let standby = if slot.rules.secondaries.is_empty() { 0.0 } else { ROW };
    let height = TITLE + ROW * left.len().max(right.len()) as f64 + 10.0 + standby;
    Node { at: Point { x: 0.0, y: 0.0 }, width, height, left, right }
}

/// What stands under a slot's name.
#[must_use]
pub fn subtitle(slot: &SlotPlan) -> String {
    use crate::profile::plan::Trigger;
    use crate::profile::quantity::format_duration;
    let when = match slot.component.execution.trigger {
        Trigger::Periodic(period) => format!("every {}", format_duration(period)),
        Trigger::Nonperiodic => "on arrival".to_owned(),
        Trigger::Passive => "passive".to_owned(),
    };
    format!("{} · {when}", slot.component.name)
}

fn pin(port: &Port) -> Pin {
    let at = Point { x: 0.0, y: 0.0 };
    Pin { name: port.name.clone(), kind: port.kind, type_name: port.type_name.clone(), at }
}

/// Data flows from left to right. Events and services only place slots that no data reaches: a service often runs
/// against the data, and would turn the picture around.
fn main_edges(plan: &Plan, count: usize, edges: &[(usize, usize)]) -> Vec<(usize, usize)> {
    let kinds = || edges.iter().zip(&plan.connections).map(|(edge, connection)| (edge, connection.kind));
    let mut has_data = vec![false; count];
    for ((from, to), _) in kinds().filter(|(_, kind)| *kind == PortKind::Data) {
        (has_data[*from], has_data[*to]) = (true, true);
    }
    let counts = |(from, to): &(usize, usize), kind| kind == PortKind::Data || !has_data[*from] || !has_data[*to];
    kinds().filter(|(edge, kind)| counts(edge, *kind)).map(|(edge, _)| *edge).collect()
}

/// The layer of each node: behind all that feed it, as near to what it feeds as possible.
fn layers(count: usize, edges: &[(usize, usize)]) -> Vec<usize> {
    let forward = without_cycles(count, edges);
    let mut layer = vec![0_usize; count];
    // Longest path by relaxing; at most `count` rounds since nothing goes round in circles any more.
    for _ in 0..count {
        let mut changed = false;
        for (from, to) in &forward {
            if layer[*to] <= layer[*from] {
                layer[*to] = layer[*from] + 1;
                changed = true;
            }
        }
        if !changed {
            break;
        }
    }
    for node in 0..count {
        let fed = forward.iter().filter(|(from, _)| *from == node).map(|(_, to)| layer[*to]).min();
        let is_source = !forward.iter().any(|(_, to)| *to == node);
        if let (Some(nearest), true) = (fed, is_source) {
            layer[node] = nearest.saturating_sub(1);
        }
    }
    layer
}

/// The edges without those that close a circle, found depth first in file order.
fn without_cycles(count: usize, edges: &[(usize, usize)]) -> Vec<(usize, usize)> {
    let mut targets: Vec<Vec<usize>> = vec![Vec::new(); count];
    edges.iter().filter(|(from, to)| from != to).for_each(|(from, to)| targets[*from].push(*to));
    let mut state = vec![0_u8; count];
    let mut kept = Vec::new();
    for start in 0..count {
        if state[start] != 0 {
            continue;
        }
        state[start] = 1;
        let mut path = vec![(start, 0)];
        while let Some((node, next)) = path.last_mut() {
            let Some(target) = targets[*node].get(*next).copied() else {
                state[*node] = 2;
                path.pop();
                continue;
            };
            *next += 1;
            let from = *node;
            if state[target] == 1 {
                continue;
            }
            kept.push((from, target));
            if state[target] == 0 {
                state[target] = 1;
                path.push((target, 0));
            }
        }
    }
    kept
}

/// Items of every layer, with the lines that pass.
fn fill(nodes: &[Node], edges: &[(usize, usize)], layer_of: &[usize]) -> (Vec<Item>, Vec<Vec<usize>>) {
    let depth = layer_of.iter().max().map_or(0, |deepest| deepest + 1);
    let mut layers: Vec<Vec<usize>> = vec![Vec::new(); depth];
    let mut items: Vec<Item> = Vec::new();
    for (index, node) in nodes.iter().enumerate() {
        items.push(Item {
            node: Some(index),
            edge: 0,
            height: node.height,
            y: 0.0,
            before: Vec::new(),
            after: Vec::new(),
        });
        layers[layer_of[index]].push(index);
    }
    for (edge, (from, to)) in edges.iter().enumerate() {
        if layer_of[*from] >= layer_of[*to] {
            continue;
        }
        let mut last = *from;
        for layer in layers.iter_mut().take(layer_of[*to]).skip(layer_of[*from] + 1) {
            let passing = items.len();
            items.push(Item { node: None, edge, height: LANE, y: 0.0, before: Vec::new(), after: Vec::new() });
            layer.push(passing);
            join(&mut items, last, passing);
            last = passing;
        }
        join(&mut items, last, *to);
    }
    (items, layers)
}

fn join(items: &mut [Item], from: usize, to: usize) {
    items[from].after.push(to);
    items[to].before.push(from);
}

/// Sorts each layer by the mean place of what its items are connected with, forwards and backwards in turn.
fn reorder(items: &mut [Item], layers: &mut [Vec<usize>]) {
    let mut rank = vec![0.0; items.len()];
    let number =
        |layer: &[usize], rank: &mut [f64]| layer.iter().enumerate().for_each(|(i, item)| rank[*item] = i as f64);
    layers.iter().for_each(|layer| number(layer, &mut rank));
    for round in 0..ROUNDS {
        let forwards = round % 2 == 0;
        let order: Vec<usize> = if forwards { (0..layers.len()).collect() } else { (0..layers.len()).rev().collect() };
        for index in order {
            let layer = &mut layers[index];
            let key = |item: usize| {
                let beside = if forwards { &items[item].before } else { &items[item].after };
                mean(beside.iter().map(|other| rank[*other])).unwrap_or(rank[item])
            };
            let keys: HashMap<usize, f64> = layer.iter().map(|item| (*item, key(*item))).collect();
            layer.sort_by(|a, b| keys[a].total_cmp(&keys[b]));
            number(layer, &mut rank);
        }
    }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

/// Vertical places: near the mean of what an item is connected with, order kept, nothing overlapping.
fn settle(items: &mut [Item], layers: &[Vec<usize>]) {
    for layer in layers {
        let wanted = vec![0.0; layer.len()];
        stack(items, layer, &wanted);
    }
    for round in 0..ROUNDS * 2 {
        for layer in layers {
            let want = |item: &usize| {
                let beside = if round % 2 == 0 { &items[*item].before } else { &items[*item].after };
                let middle = mean(beside.iter().map(|other| items[*other].y + items[*other].height / 2.0));
                middle.map_or(items[*item].y, |middle| middle - items[*item].height / 2.0)
            };
            let wanted: Vec<f64> = layer.iter().map(want).collect();
            stack(items, layer, &wanted);
        }
    }
}

fn stack(items: &mut [Item], layer: &[usize], wanted: &[f64]) {
    let mut bottom = f64::NEG_INFINITY;
    for (item, wanted) in layer.iter().zip(wanted) {
        items[*item].y = wanted.max(bottom);
        bottom = items[*item].y + items[*item].height + GAP_Y;
    }
    // Pushing only downwards drifts: move the layer back by what it was pushed on the average.
    let pushed = layer.iter().zip(wanted).map(|(item, wanted)| items[*item].y - wanted);
    let drift = mean(pushed).unwrap_or(0.0);
    layer.iter().for_each(|item| items[*item].y -= drift);
}

/// Left and right border of each layer.
fn columns(nodes: &[Node], layers: &[Vec<usize>], items: &[Item]) -> Vec<(f64, f64)> {
    let mut x = 0.0;
    let mut all = Vec::new();
    for layer in layers {
        let members = || layer.iter().filter_map(|item| items[*item].node).map(|node| &nodes[node]);
        let width = members().map(|node| node.width).fold(40.0, f64::max);
        let labels =
            members().flat_map(|node| &node.right).map(|pin| text_width(&pin.type_name, 10.5)).fold(0.0, f64::max);
        all.push((x, x + width));
        x += width + GAP_X.max(labels + 50.0);
    }
    all
}

fn place(nodes: &mut [Node], items: &[Item], layers: &[Vec<usize>], xs: &[(f64, f64)]) {
    for (layer, (left, right)) in layers.iter().zip(xs) {
        for item in layer.iter().map(|item| &items[*item]) {
            let Some(node) = item.node.and_then(|node| nodes.get_mut(node)) else { continue };
            node.at = Point { x: left + (right - left - node.width) / 2.0, y: item.y };
            let (at, width) = (node.at, node.width);
            let row = |index: usize| at.y + TITLE + ROW * (index as f64 + 0.5);
            node.left.iter_mut().enumerate().for_each(|(i, pin)| pin.at = Point { x: at.x, y: row(i) });
            node.right.iter_mut().enumerate().for_each(|(i, pin)| pin.at = Point { x: at.x + width, y: row(i) });
        }
    }
}

fn lines(
    plan: &Plan,
    nodes: &[Node],
    edges: &[(usize, usize)],
    layer_of: &[usize],
    items: &[Item],
    layers: &[Vec<usize>],
    xs: &[(f64, f64)],
) -> Vec<Line> {
    let mut lane = items.iter().map(|item| item.y + item.height).fold(f64::NEG_INFINITY, f64::max) + GAP_Y;
    let mut backwards = 0_usize;
    let mut all = Vec::new();
    for (edge, connection) in plan.connections.iter().enumerate() {
        let (from, to) = edges[edge];
        let find = |pins: &[Pin], name: &str| {
            pins.iter()
                .find(|pin| pin.name == name && pin.kind == connection.kind)
                .map_or(Point { x: 0.0, y: 0.0 }, |pin| pin.at)
        };
        let source = find(&nodes[from].right, &connection.source.port);
        let target = find(&nodes[to].left, &connection.target.port);
        let mut points = vec![source];
        if layer_of[from] < layer_of[to] {
            for layer in layer_of[from] + 1..layer_of[to] {
                let passing = layers[layer]
                    .iter()
                    .map(|item| &items[*item])
                    .find(|item| item.node.is_none() && item.edge == edge);
                if let Some(item) = passing {
                    let y = item.y + item.height / 2.0;
                    points.extend([Point { x: xs[layer].0, y }, Point { x: xs[layer].1, y }]);
                }
            }
        } else {
            // Right of the source's layer and left of the target's there are no boxes to run through.
            let aside = 16.0 + 7.0 * (backwards % 6) as f64;
            let (right, left) = (xs[layer_of[from]].1 + aside, xs[layer_of[to]].0 - aside);
            points.extend(
                [(right, source.y), (right, lane), (left, lane), (left, target.y)].map(|(x, y)| Point { x, y }),
            );
            lane += LANE;
            backwards += 1;
        }
        points.push(target);
        all.push(Line { points, backwards: layer_of[from] >= layer_of[to] });
    }
    all
}

/// Moves everything into the positive and adds margins.
fn frame(mut nodes: Vec<Node>, mut lines: Vec<Line>) -> Drawing {
    let corners =
        nodes.iter().flat_map(|node| [node.at, Point { x: node.at.x + node.width, y: node.at.y + node.height }]);
    let labels = nodes.iter().flat_map(|node| &node.right);
    let labels = labels.map(|pin| Point { x: pin.at.x + 8.0 + text_width(&pin.type_name, 10.5), y: pin.at.y });
    let passed = lines.iter().flat_map(|line| &line.points).copied();
    let all: Vec<Point> = corners.chain(labels).chain(passed).collect();
    let extreme = |pick: fn(f64, f64) -> f64, of: fn(&Point) -> f64| all.iter().map(of).reduce(pick).unwrap_or(0.0);
    let (left, top) = (extreme(f64::min, |p| p.x), extreme(f64::min, |p| p.y));
    let (right, bottom) = (extreme(f64::max, |p| p.x), extreme(f64::max, |p| p.y));
    let (dx, dy) = (MARGIN - left, MARGIN + HEADING - top);
    let shift = |point: &mut Point| (point.x, point.y) = (point.x + dx, point.y + dy);
    for node in &mut nodes {
        shift(&mut node.at);
        node.left.iter_mut().chain(&mut node.right).for_each(|pin| shift(&mut pin.at));
    }
    lines.iter_mut().flat_map(|line| &mut line.points).for_each(shift);
    Drawing { width: (right + dx + MARGIN).max(420.0), height: bottom + dy + MARGIN + 26.0, nodes, lines }
}
