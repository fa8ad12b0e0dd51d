//! Who needs whom, compiled from the plan at load. Pure.
//!
//! A node is a slot; or a voter, which may fail by itself, needs as many of its members as must agree, and neither runs nor is
//! stopped; or a name that stands for several slots, a composite's or an application's, which works while all of
//! them do; or a gate: what all slots of an application need because the application does. So a dependency between two
//! applications costs as many edges as they have slots, not their product.
//!
//! A voter hides its members from its readers: one that is outvoted or silent shows in nobody, because the voter hands on what
//! the others say. Only while too few agree, what a reader lacks comes of what its members have.

use std::collections::HashMap;

use crate::model::limits::{CHAIN_SLOTS, CHAIN_STEPS};
use crate::profile::plan::{Coverage, Plan, PortKind, VotingPlan};

/// A node of the graph, by number. Slots come first, in the plan's order, then voters, in its order.
pub type Number = usize;

/// What a node needs: so many of others.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Need {
    /// The others.
    pub on: Vec<Number>,
    /// How many of them must work.
    pub require: usize,
    /// In words: `1 of camera_a camera_b`.
    pub text: String,
}

/// Whose nobody is.
const NO_EXECUTOR: usize = usize::MAX;

/// A slot, a voter, or a name for several slots.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Node {
    /// What it is called.
    pub name: String,
    /// All that it needs.
    pub needs: Vec<Need>,
    /// Number of the slot's executor; no slot: of no consequence.
    pub executor: usize,
    /// How far a fault-stop of the slot reaches.
    pub coverage: Coverage,
    /// It gets the emergency stop.
    pub is_actuator: bool,
    /// It is held by the latch that the run before left, because nobody knows whether it was an actuator then.
    pub is_held: bool,
}

impl Node {
    /// True where it does not run while the emergency stop is latched.
    #[must_use]
    pub const fn waits_for_clear(&self) -> bool {
        self.is_actuator || self.is_held
    }
}

/// A slot whose faults may show in another one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Link {
    /// The slot.
    pub slot: Number,
    /// The voters on the way, each of which hides it as long as enough of its members agree.
    pub through: Vec<Number>,
}

/// Nodes with their edges, in order.
#[derive(Clone, Debug, Default)]
pub struct Graph {
    nodes: Vec<Node>,
    slots: usize,
    voters: usize,
    order: Vec<Number>,
    dependents: Vec<Vec<Number>>,
    /// Of each slot those whose faults may show in it: what it needs, and who writes to it.
    upstream: Vec<Vec<Number>>,
    places: HashMap<String, Number>,
}

impl Graph {
    /// The latch holds slots of these names, and no others besides the actuators.
    pub fn hold(&mut self, names: impl Fn(&str) -> bool) {
        let slots = self.slots();
        self.nodes.iter_mut().take(slots).for_each(|node| node.is_held = names(&node.name));
    }

    /// Of these nodes, the first `slots` of which are slots and the next `voters` voters, and of connections between those,
    /// writers first.
    #[must_use]
    pub fn new(nodes: Vec<Node>, slots: usize, voters: usize, connections: &[(Number, Number)]) -> Self {
        let mut dependents = vec![Vec::new(); nodes.len()];
        let mut upstream = vec![Vec::new(); nodes.len()];
        for (number, node) in nodes.iter().enumerate() {
            for needed in node.needs.iter().flat_map(|need| &need.on) {
                dependents[*needed].push(number);
                upstream[number].push(*needed);
            }
        }
        for (writer, reader) in connections {
            upstream[*reader].push(*writer);
        }
        let order = order(&nodes, &dependents);
        let named = nodes.iter().take(slots + voters).enumerate().filter(|(_, node)| !node.name.is_empty());
        let places = named.map(|(number, node)| (node.name.clone(), number)).collect();
        Self { nodes, slots, voters, order, dependents, upstream, places }
    }

    /// Of a plan, whose slots have these executors, by number.
    #[must_use]
    pub fn compile(plan: &Plan, executors: &[usize]) -> Self {
        Compiler::of(plan, executors).finish(plan)
    }

    /// How many slots there are.
    #[must_use]
    pub const fn slots(&self) -> usize {
        self.slots
    }

    /// True where that node is a slot.
    #[must_use]
    pub const fn is_slot(&self, number: Number) -> bool {
        number < self.slots
    }

    /// True where that node is a voter.
    #[must_use]
    pub const fn is_voter(&self, number: Number) -> bool {
        self.slots <= number && number < self.slots + self.voters
    }

    /// All voters.
    pub fn voters(&self) -> impl Iterator<Item = Number> + use<> {
        self.slots..self.slots + self.voters
    }

    /// All nodes.
    #[must_use]
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// The slot of that name.
    #[must_use]
    pub fn slot(&self, name: &str) -> Option<Number> {
        self.places.get(name).copied().filter(|number| self.is_slot(*number))
    }

    /// The voter of that name.
    #[must_use]
    pub fn voter(&self, name: &str) -> Option<Number> {
        self.places.get(name).copied().filter(|number| self.is_voter(*number))
    }

    /// Every node after all that it needs.
    #[must_use]
    pub fn order(&self) -> &[Number] {
        &self.order
    }

    /// Those that need a node.
    #[must_use]
    pub fn dependents(&self, number: Number) -> &[Number] {
        &self.dependents[number]
    }

    /// Those whose faults may show in a node, by how many steps they are away: first those at one step, and so on, as far as
    /// [`CHAIN_STEPS`]. Nobody beyond a voter: where it failed by itself, that has a root of its own.
    pub fn upstream(&self, number: Number) -> impl Iterator<Item = Vec<Number>> {
        self.beyond(vec![number], Some(number)).take(CHAIN_STEPS)
    }

    /// As [`Self::upstream`], of several at once, and nobody beyond one of them that is a voter.
    pub fn upstream_of(&self, numbers: &[Number]) -> impl Iterator<Item = Vec<Number>> {
        self.beyond(numbers.to_vec(), None)
    }

    /// Step by step, and beyond no voter but `open`.
    fn beyond(&self, mut edge: Vec<Number>, open: Option<Number>) -> impl Iterator<Item = Vec<Number>> {
        let mut seen = vec![false; self.nodes.len()];
        edge.iter().for_each(|number| seen[*number] = true);
        let step = move || {
            let mut next = Vec::new();
            let seen_through = |node: &&Number| Some(**node) == open || !self.is_voter(**node);
            for number in edge.iter().filter(seen_through).flat_map(|number| &self.upstream[*number]) {
                if !std::mem::replace(&mut seen[*number], true) {
                    next.push(*number);
                }
            }
            edge.clone_from(&next);
            (!next.is_empty()).then_some(next)
        };
        std::iter::from_fn(step)
    }

    /// The slots whose faults may show in one, nearest first, at most [`CHAIN_SLOTS`]; one that is reached through other voters,
    /// and not without all of these, is named again.
    #[must_use]
    pub fn chain(&self, slot: Number) -> Vec<Link> {
        let start = Link { slot, through: Vec::new() };
        let (mut known, mut found) = (vec![Vec::new(); self.nodes.len()], Vec::new());
        known[slot].push(Vec::new());
        let mut edge = vec![start];
        for _ in 0..CHAIN_STEPS {
            let further =
                edge.iter().flat_map(|link| self.upstream[link.slot].iter().map(|up| self.further(link, *up)));
            let is_new = |link: &Link| {
                let ways: &mut Vec<Vec<Number>> = &mut known[link.slot];
                let is_new = !ways.iter().any(|way| way.iter().all(|voter| link.through.contains(voter)));
                ways.extend(is_new.then(|| link.through.clone()));
                is_new
            };
            edge = further.filter(is_new).take(CHAIN_SLOTS).collect();
            found.extend(edge.iter().filter(|link| self.is_slot(link.slot)).cloned());
            if edge.is_empty() || found.len() >= CHAIN_SLOTS {
                break;
            }
        }
        found.truncate(CHAIN_SLOTS);
        found
    }

    fn further(&self, link: &Link, up: Number) -> Link {
        let mut through = link.through.clone();
        if self.is_voter(up) && !through.contains(&up) {
            through.push(up);
        }
        Link { slot: up, through }
    }

    /// True of all whose faults may show in a node, however far away, itself among them.
    #[must_use]
    pub fn sources(&self, number: Number) -> Vec<bool> {
        let (mut is_source, mut open) = (vec![false; self.nodes.len()], vec![number]);
        while let Some(number) = open.pop() {
            if !std::mem::replace(&mut is_source[number], true) {
                open.extend(&self.upstream[number]);
            }
        }
        is_source
    }
}

/// Every node after all that it needs (Kahn 1962). A circle, which no profile gets past the loader, comes last.
fn order(nodes: &[Node], dependents: &[Vec<Number>]) -> Vec<Number> {
    let mut open: Vec<usize> = nodes.iter().map(|node| node.needs.iter().map(|need| need.on.len()).sum()).collect();
    let mut order: Vec<Number> = (0..nodes.len()).filter(|number| open[*number] == 0).collect();
    let mut looked = 0;
    while let Some(number) = order.get(looked).copied() {
        looked += 1;
        for dependent in &dependents[number] {
            open[*dependent] -= 1;
            if open[*dependent] == 0 {
                order.push(*dependent);
            }
        }
    }
    order.extend((0..nodes.len()).filter(|number| open[*number] > 0));
    order
}

/// A graph that is being put together.
struct Compiler {
    nodes: Vec<Node>,
    /// Slots, and voters that have a name.
    slots: HashMap<String, Number>,
    applications: HashMap<String, Number>,
    composites: HashMap<Vec<String>, Number>,
}

impl Compiler {
    fn of(plan: &Plan, executors: &[usize]) -> Self {
        let node = |(slot, executor): (&crate::profile::plan::SlotPlan, &usize)| Node {
            name: slot.name.clone(),
            needs: Vec::new(),
            executor: *executor,
            coverage: slot.rules.coverage,
            is_actuator: plan.system.emergency.contains(&slot.name),
            is_held: false,
        };
        let voter = |voting: &VotingPlan| Node {
            name: voting.name.clone().unwrap_or_default(),
            executor: NO_EXECUTOR,
            ..Node::default()
        };
        let slots = plan.slots.iter().zip(executors).map(node);
        let nodes: Vec<Node> = slots.chain(plan.votings.iter().map(voter)).collect();
        let named = nodes.iter().enumerate().filter(|(_, node)| !node.name.is_empty());
        let slots = named.map(|(number, node)| (node.name.clone(), number)).collect();
        Self { nodes, slots, applications: HashMap::new(), composites: HashMap::new() }
    }

    fn finish(mut self, plan: &Plan) -> Graph {
        let (slots, voters) = (plan.slots.len(), plan.votings.len());
        for (voter, voting) in plan.votings.iter().enumerate() {
            let members = voting.inputs.iter().filter_map(|input| self.slots.get(&input.slot).copied());
            let (on, names) = (members.collect(), voting.inputs.iter().map(|input| input.slot.as_str()));
            let need = Need { on, require: voting.require, text: text(voting.require, names) };
            self.nodes[slots + voter].needs.push(need);
        }
        for dependency in &plan.dependencies {
            let Some(dependent) = self.slots.get(&dependency.slot).copied() else { continue };
            let on = dependency.on.iter().map(|needed| self.needed(&needed.name, &needed.slots)).collect();
            let names = dependency.on.iter().map(|needed| needed.name.as_str());
            let need = Need { on, require: dependency.require, text: text(dependency.require, names) };
            self.nodes[dependent].needs.push(need);
        }
        for dependency in &plan.system.dependencies {
            let on = dependency.on.iter().map(|name| self.application(name, plan)).collect();
            let text = text(dependency.require, dependency.on.iter().map(String::as_str));
            let need = Need { on, require: dependency.require, text: text.clone() };
            let gate = self.add(&dependency.application, need);
            for (number, slot) in plan.slots.iter().enumerate() {
                if slot.application == dependency.application {
                    self.nodes[number].needs.push(Need { on: vec![gate], require: 1, text: text.clone() });
                }
            }
        }
        let ends = |end: &crate::profile::plan::PortRef| self.slots.get(&end.slot).copied();
        let connections: Vec<(Number, Number)> = plan
            .connections
            .iter()
            .filter_map(|link| {
                let (source, target) = (ends(&link.source)?, ends(&link.target)?);
                // What a client asked for comes from the server.
                Some(if link.kind == PortKind::Service { (target, source) } else { (source, target) })
            })
            .collect();
        Graph::new(self.nodes, slots, voters, &connections)
    }

    /// The node of a name in a dependency.
    fn needed(&mut self, name: &str, slots: &[String]) -> Number {
        if let [slot] = slots
            && let Some(number) = self.slots.get(slot)
        {
            return *number;
        }
        if let Some(number) = self.composites.get(slots) {
            return *number;
        }
        let number = self.all_of(name, slots.iter().filter_map(|slot| self.slots.get(slot).copied()).collect());
        self.composites.insert(slots.to_vec(), number);
        number
    }

    /// The node of an application: it works while all of its slots do that start by themselves.
    fn application(&mut self, name: &str, plan: &Plan) -> Number {
        if let Some(number) = self.applications.get(name) {
            return *number;
        }
        let is_of =
            |slot: &&crate::profile::plan::SlotPlan| slot.application == name && slot.component.execution.autostart;
        let slots = plan.slots.iter().filter(is_of).filter_map(|slot| self.slots.get(&slot.name).copied()).collect();
        let number = self.all_of(name, slots);
        self.applications.insert(name.to_owned(), number);
        number
    }

    fn all_of(&mut self, name: &str, slots: Vec<Number>) -> Number {
        let require = slots.len();
        self.add(name, Need { on: slots, require, text: format!("all of {name}") })
    }

    fn add(&mut self, name: &str, need: Need) -> Number {
        self.nodes.push(Node { name: name.to_owned(), needs: vec![need], ..Node::default() });
        self.nodes.len() - 1
    }
}

/// `1 of camera_a camera_b`, or only the name where there is one.
fn text<'a>(require: usize, names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.collect();
    match names.as_slice() {
        [name] => (*name).to_owned(),
        names => format!("{require} of {}", names.join(" ")),
    }
}
