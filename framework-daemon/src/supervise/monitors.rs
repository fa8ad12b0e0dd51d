//! Monitors: what a `<monitor>` wants watched at a port, inserted when everything is connected.
//!
//! A monitor is an input of the framework's own, connected to the watched output, or to the outputs that are connected to the
//! watched input; its checks find what is wrong with what arrives there, and charge the writer. It only looks: readers
//! get what they would get without it. Silence is looked for where one has a `max_age` ([`watch`](crate::supervise::watch)).

use std::sync::Arc;

use component_sdk::object::TypeDescriptor;

use super::blueprint::Blueprint;
use super::helpers::{self, Helpers};
use super::system::Placed;
use super::watch::Look;
use super::wiring::{at, complain, describe};
use crate::exec::silence::Vigil;
use crate::model::fault::Label;
use crate::model::time::nanoseconds;
use crate::port::check::Checks;
use crate::port::input::InPort;
use crate::port::output::OutPort;
use crate::port::wiring::{self, Planned};
use crate::profile::plan::{MonitorPlan, OnInvalid, Plan, PortKind, PortRef, Queue, Validity};

/// What the name of a monitor's input begins with.
pub const MONITOR: &str = "monitor of ";

/// All monitors of a plan.
#[derive(Default)]
pub struct Monitors {
    posts: Vec<Post>,
}

struct Post {
    plan: MonitorPlan,
    input: Arc<InPort>,
    writers: Vec<Arc<OutPort>>,
}

/// Builds the monitors of a plan. One that was there before and is wanted as it is stays, with what it remembers.
///
/// # Errors
/// All that is wrong, one text each.
pub fn build(before: &Monitors, plan: &Plan, slots: &[Placed], helpers: &Helpers) -> Result<Monitors, Vec<String>> {
    let (mut posts, mut errors) = (Vec::new(), Vec::new());
    for monitor in &plan.monitors {
        match post(before, monitor, plan, slots, helpers) {
            Ok(post) => posts.push(post),
            Err(reason) => errors.push(at(&monitor.location, &reason)),
        }
    }
    if errors.is_empty() { Ok(Monitors { posts }) } else { Err(errors) }
}

fn post(
    before: &Monitors,
    monitor: &MonitorPlan,
    plan: &Plan,
    slots: &[Placed],
    helpers: &Helpers,
) -> Result<Post, String> {
    let find = |slot: &str| slots.iter().find(|placed| placed.slot.name == slot);
    let PortRef { slot, port } = &monitor.port;
    let output =
        |end: &PortRef| find(&end.slot).and_then(|placed| placed.slot.output(&end.port)).or(helpers.output(end));
    let object = output(&monitor.port).map(|port| port.object);
    let object = object.or_else(|| find(slot)?.slot.input(port).map(|port| port.object));
    let object = object.ok_or_else(|| format!("{slot}.{port}: no such data port"))?;
    let writers = writers_of(&monitor.port, plan).iter().filter_map(|end| output(end).cloned()).collect();
    let input = match kept(before, monitor, object) {
        Some(input) => input,
        None => Arc::new(input(monitor, object)?),
    };
    Ok(Post { plan: monitor.clone(), input, writers })
}

/// The outputs whose values pass at that port.
fn writers_of(port: &PortRef, plan: &Plan) -> Vec<PortRef> {
    let data = plan.connections.iter().filter(|connection| connection.kind == PortKind::Data);
    let writers: Vec<_> =
        data.filter(|connection| connection.target == *port).map(|connection| connection.source.clone()).collect();
    // An output is its own writer; an input without any has none, though it looks like one here.
    if writers.is_empty() { vec![port.clone()] } else { writers }
}

fn kept(before: &Monitors, monitor: &MonitorPlan, object: &'static TypeDescriptor) -> Option<Arc<InPort>> {
    let same = |post: &&Post| {
        let plain = MonitorPlan { location: post.plan.location.clone(), ..monitor.clone() };
        std::ptr::eq(post.input.object, object) && same_rules(&post.plan, &plain)
    };
    before.posts.iter().find(same).map(|post| Arc::clone(&post.input))
}

/// Where something is written does not count.
fn same_rules(one: &MonitorPlan, other: &MonitorPlan) -> bool {
    let rule = |rule: &Validity| Validity { location: one.location.clone(), ..rule.clone() };
    one.port == other.port
        && one.max_age == other.max_age
        && one.validity.iter().map(rule).eq(other.validity.iter().map(rule))
}

fn input(monitor: &MonitorPlan, object: &'static TypeDescriptor) -> Result<InPort, String> {
    let PortRef { slot, port } = &monitor.port;
    let checks = compile(monitor, object)?;
    let input = InPort::new(&format!("{MONITOR}{slot}.{port}"), object, Queue::Last, checks).tapping();
    Ok(match monitor.max_age {
        Some(max_age) => input.expecting(nanoseconds(max_age)),
        None => input,
    })
}

fn compile(monitor: &MonitorPlan, object: &'static TypeDescriptor) -> Result<Checks, String> {
    // It only looks: what is wrong with a value does not keep it from having been there.
    let look = |rule: &Validity| Validity { on_invalid: OnInvalid::Pass, ..rule.clone() };
    let rules: Vec<Validity> = monitor.validity.iter().map(look).collect();
    Checks::compile(&rules, object).map_err(|error| describe(&error))
}

/// What is wrong with the monitors of slots that do not exist yet.
#[must_use]
pub fn check(plan: &Plan, blueprints: &[Blueprint<'_>]) -> Vec<String> {
    let wrong = |monitor: &MonitorPlan| {
        let input = || {
            let blueprint = blueprints.iter().find(|blueprint| blueprint.name() == monitor.port.slot)?;
            blueprint.input_object(&monitor.port.port)
        };
        let object = helpers::object(plan, blueprints, &monitor.port).or_else(input)?;
        compile(monitor, object).err().map(|reason| at(&monitor.location, &reason))
    };
    plan.monitors.iter().filter_map(wrong).collect()
}

impl Monitors {
    /// Puts them to work in the place of those before.
    pub fn follow(&mut self, before: Self) {
        for old in before.posts {
            let stays = self.posts.iter().any(|post| Arc::ptr_eq(&post.input, &old.input));
            if !stays && wiring::detach(&old.input).is_err() {
                complain(&old.plan.port.slot, &old.input.name);
            }
        }
        for post in &self.posts {
            let planned = |output: &Arc<OutPort>| Planned { output: Arc::clone(output), checks: Checks::none() };
            if wiring::set(&post.input, &post.writers.iter().map(planned).collect::<Vec<_>>()).is_err() {
                complain(&post.plan.port.slot, &post.input.name);
            }
        }
    }

    /// Who looks for silence at those that wait for values.
    pub fn looks(&self) -> impl Iterator<Item = Look> {
        let inputs = self.posts.iter().map(|post| &post.input).filter(|input| input.hearing().is_some());
        inputs.map(|input| {
            let (input, mut vigil) = (Arc::clone(input), Vigil::default());
            let look = move |_| {
                vigil.look(|| Label::new(&input.name), &input);
                vigil.due_ns()
            };
            Box::new(look) as Look
        })
    }
}
