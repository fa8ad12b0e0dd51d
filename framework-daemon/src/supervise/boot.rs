//! Plan to slots, executors, wiring: `catalogue -> slots -> install (create, initialize) -> wire -> start`.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::blueprint::{Blueprint, draw, texts};
use super::catalogue::Catalogue;
use super::helpers::{self, Helpers};
use super::monitors::{self, Monitors};
use super::shutdown::shutdown;
use super::system::{Placed, System, by_name};
use super::wiring;
use crate::detect::device::LostDevices;
use crate::exec::checkpoint::Checkpoint;
use crate::exec::emergency::{self, Actuator};
use crate::exec::executor::{Executor, Stuck};
use crate::exec::keep::Keep;
use crate::exec::lane::Lane;
use crate::exec::member::{Member, Standby};
use crate::exec::silence;
use crate::exec::slot::{Slot, Status};
use crate::exec::strand::Strand;
use crate::exec::task::Tasks;
use crate::exec::trigger::Doorbell;
use crate::exec::unit::{Limits, Recipe, Source};
use crate::exec::workshop::Workshop;
use crate::fault::handle::{Cast, Hand};
use crate::model::fault::FaultSender;
use crate::model::ladder::Ladder;
use crate::model::limits::{BOOT_STEP, SHUTDOWN_STEP};
use crate::model::names;
use crate::model::schedule::Schedule;
use crate::model::time::nanoseconds;
use crate::plugin::Class;
use crate::port::charge::{Accused, Charges};
use crate::port::devices::Devices;
use crate::port::input::InPort;
use crate::port::pattern::subscriber::Subscriber;
use crate::port::pattern::turns;
use crate::port::registry;
use crate::profile::plan::{ConnectionPlan, Plan, SlotPlan, Trigger};
use crate::sys::bell::{Bell, Signal};

/// Why a system could not be brought up, one text for each thing that is wrong.
#[derive(Debug)]
pub enum BootError {
    /// Plugins that are missing or do not fit.
    Plugins(Vec<String>),
    /// Anything else.
    Failed(Vec<String>),
}

/// Brings a system up.
///
/// # Errors
/// Everything that is wrong with its plugins and connections at once; or the first component that cannot be
/// initialised. Nothing runs then.
pub fn boot(plan: Arc<Plan>, extra: &[PathBuf], faults: FaultSender) -> Result<System, BootError> {
    boot_unless(&AtomicBool::new(false), plan, extra, faults, None)
}

/// Brings a system up, unless it is given up between two steps; its checkpoints lie in `keep`.
///
/// # Errors
/// As [`boot`].
pub fn boot_unless(
    given_up: &AtomicBool,
    plan: Arc<Plan>,
    extra: &[PathBuf],
    faults: FaultSender,
    keep: Option<Arc<Keep>>,
) -> Result<System, BootError> {
    let catalogue = Catalogue::default().in_directories(directories(&plan, extra));
    let workshop = Workshop::start(faults.clone());
    let workshop = workshop.map_err(|error| BootError::Failed(vec![format!("workshop: no thread: {error}")]))?;
    let (executors, slots, registry) = (HashMap::new(), Vec::new(), Arc::clone(registry::shared()));
    let (monitors, helpers) = (Monitors::default(), Helpers::default());
    let watch = None;
    let mut system =
        System { plan, executors, slots, monitors, watch, helpers, registry, catalogue, workshop, faults, keep };
    let plan = Arc::clone(&system.plan);
    let blueprints = draw(&plan.slots, &system.catalogue).map_err(BootError::Plugins)?;
    match bring_up(&mut system, blueprints, given_up) {
        Ok(()) => {
            await_spares(&system.workshop, given_up);
            Ok(system)
        }
        Err(error) => {
            // What was brought up already ends in order.
            shutdown(system);
            Err(error)
        }
    }
}

/// Ready means ready: the first fault finds its spare. A stop does not wait for it.
fn await_spares(workshop: &Workshop, given_up: &AtomicBool) {
    let (began, look) = (Instant::now(), Duration::from_millis(10));
    while !workshop.settle(look) && !given_up.load(Ordering::Relaxed) {
        if began.elapsed() > BOOT_STEP {
            tracing::warn!("not every spare is ready after {BOOT_STEP:?}: a constructor or `initialize` takes long");
            return;
        }
    }
}

fn bring_up(system: &mut System, blueprints: Vec<Blueprint<'_>>, given_up: &AtomicBool) -> Result<(), BootError> {
    let go_on = || match given_up.load(Ordering::Relaxed) {
        true => Err(BootError::Failed(vec!["the boot was given up".to_owned()])),
        false => Ok(()),
    };
    for blueprint in blueprints {
        go_on()?;
        let placed = place(system, blueprint).map_err(|reason| BootError::Failed(vec![reason]))?;
        system.slots.push(placed);
    }
    let connections = &system.plan.connections;
    let inserted = helpers::build(&Helpers::default(), &system.plan, &system.slots, &system.faults);
    system.helpers = inserted.map_err(BootError::Plugins)?;
    let wiring = wiring::build(&[], connections, &system.slots, &system.helpers).map_err(BootError::Plugins)?;
    let monitors = monitors::build(&Monitors::default(), &system.plan, &system.slots, &system.helpers);
    let monitors = monitors.map_err(BootError::Plugins)?;
    wiring::announce(&system.registry, &system.slots, &system.helpers, &system.plan.composites);
    wiring::apply(&wiring, &system.slots);
    helpers::apply(&system.helpers, &system.slots);
    let helpers = system.helpers.clone();
    system.follow(monitors, &helpers);
    rank(&system.slots, &helpers::flow(&system.plan));
    go_on()?;
    if let Some(keep) = &system.keep {
        keep.put_in_place();
    }
    start(&system.plan, &system.slots, &helpers, |_| true).map_err(|reason| BootError::Failed(vec![reason]))?;
    system.helpers.expect();
    Ok(())
}

/// Where plugins are looked for: the command line's directories first.
#[must_use]
pub fn directories(plan: &Plan, extra: &[PathBuf]) -> Vec<PathBuf> {
    extra.iter().chain(&plan.system.plugin_dirs).cloned().collect()
}

/// Brings a blueprint to life on its executor: created and initialised, not started, not connected.
///
/// # Errors
/// In words.
pub fn place(system: &mut System, blueprint: Blueprint<'_>) -> Result<Placed, String> {
    let plan = blueprint.plan;
    let executor = executor_for(system, plan)?;
    let plugins = blueprint.plugins();
    let mut member = member(blueprint, executor.bell(), &system.workshop);
    member.checkpoint.iter_mut().for_each(|checkpoint| checkpoint.keep_in(system.keep.clone()));
    member.slot.tasks.use_schedule(executor.schedule());
    let (slot, shelf, autostart) = (Arc::clone(&member.slot), Arc::clone(&member.shelf), member.autostart);
    let signal = Arc::clone(&member.signal);
    let number = executor.install(member, BOOT_STEP)?;
    Ok(Placed { slot, executor, member: number, shelf, signal, autostart, plugins })
}

/// A slot as its executor gets it, not installed yet.
#[must_use]
pub fn member(blueprint: Blueprint<'_>, bell: &Arc<Bell>, workshop: &Workshop) -> Member {
    let Blueprint { plan, class, standbys, inputs, outputs, requestors, providers, events, waiter } = blueprint;
    let unlisted = class.unlisted();
    let handles_pushes = inputs.iter().filter_map(InPort::subscriber).any(Subscriber::has_handler)
        || outputs.iter().any(|port| port.outlet().cycle().period_ns.is_some());
    let standby = |preload| Standby { preload, unit: None };
    let (secondaries, standbys): (Vec<_>, Vec<_>) =
        standbys.into_iter().map(|(recipe, preload)| (recipe, standby(preload))).unzip();
    let recipes: Vec<Recipe> = std::iter::once(primary(plan, class)).chain(secondaries).collect();
    let name = names::intern(&plan.name);
    let signal = Signal::new(Arc::clone(bell));
    let charges = Arc::new(Charges::new(name, Arc::clone(&signal), &plan.rules.severity));
    let slot = Arc::new(Slot {
        name,
        inputs: inputs.into_iter().map(Arc::new).collect(),
        outputs: outputs.into_iter().map(Arc::new).collect(),
        requestors: requestors.into_iter().map(Arc::new).collect(),
        providers: providers.into_iter().map(Arc::new).collect(),
        unlisted,
        events,
        devices: Arc::new(Devices::new(Arc::clone(&charges))),
        charges,
        tasks: Arc::new(Tasks::new(name, Arc::clone(&signal), waiter)),
        handles_pushes,
        status: Status::new(recipes.iter().map(|recipe| recipe.class_name).collect()),
    });
    let execution = &plan.component.execution;
    if execution.trigger == Trigger::Nonperiodic {
        // What enters a handler is no reason to execute.
        let wake = slot.inputs.iter().filter(|port| port.subscriber().is_none_or(|port| !port.has_handler()));
        wake.for_each(|port| port.listen(Box::new(Doorbell(Arc::clone(&signal)))));
    }
    slot.requestors.iter().for_each(|port| port.listen(Arc::clone(&signal)));
    slot.inputs.iter().filter_map(|port| port.subscriber()).for_each(|port| port.listen(Arc::clone(&signal)));
    slot.outputs.iter().for_each(|port| port.belong_to(Arc::clone(&slot.charges) as Arc<dyn Accused>));
    slot.outputs.iter().for_each(|port| port.outlet().listen(Arc::clone(&signal)));
    slot.providers.iter().for_each(|port| port.listen(Arc::clone(&signal)));
    turns::share(&slot.providers);
    let lane = (!slot.providers.is_empty()).then(|| Lane::new(Arc::clone(&signal)));
    let lanes = lane.iter().flat_map(|lane| slot.providers.iter().map(move |port| (port, lane)));
    lanes.for_each(|(port, lane)| port.use_lane(Arc::clone(lane) as _));
    slot.events.listen(&signal);
    let shelf = workshop.shelf(&slot, recipes, plan.rules.ready_spares(), plan.rules.severity.clone());
    let watched = silence::watched(&slot.inputs);
    let intensity = plan.rules.reset.map(|intensity| (intensity.limit, intensity.within));
    Member {
        slot,
        trigger: execution.trigger,
        autostart: execution.autostart,
        signal,
        shelf,
        ladder: Ladder::new(plan.rules.severity.clone(), intensity, standbys.len()),
        recovery_within_ns: plan.rules.recovery_within.map(nanoseconds),
        standbys,
        unit: None,
        spare: None,
        strand: Strand::default(),
        ran: false,
        next_due_ns: 0,
        rank: 0,
        inject: std::collections::VecDeque::new(),
        early: None,
        watched,
        checkpoint: plan.rules.checkpoint.map(|period| Checkpoint::every(period, name)),
        lost_devices: LostDevices::default(),
        breath: None,
        coverage: plan.rules.coverage,
        chain: None,
        lane,
        stopped_us: 0,
    }
}

/// How the primary's instances are made.
fn primary(plan: &SlotPlan, class: Class) -> Recipe {
    Recipe {
        number: 0,
        class_name: class.name(),
        source: Source::Loaded(class),
        properties: texts(&plan.properties),
        limits: Limits::new(&plan.component.execution),
    }
}

/// The declared executor that the slot names, or one of its own, started when first needed.
fn executor_for(system: &mut System, plan: &SlotPlan) -> Result<Arc<Executor>, String> {
    let declared = system.plan.system.executors.iter().find(|executor| Some(&executor.name) == plan.executor.as_ref());
    let schedule: Schedule =
        declared.map_or_else(|| plan.component.execution.schedule.clone(), |plan| plan.schedule.clone());
    // A slot's own executor is apart from a declared one that happens to bear its name.
    let name = plan.executor.as_deref().unwrap_or(&plan.name);
    let key = if plan.executor.is_some() { name.to_owned() } else { format!("{name} (its own)") };
    if let Some(executor) = system.executors.get(&key)
        && executor.serves(&schedule)
    {
        return Ok(Arc::clone(executor));
    }
    let executor = Executor::start(name, schedule, system.faults.clone());
    let executor = Arc::new(executor.map_err(|error| format!("executor {name}: no thread: {error}"))?);
    system.executors.insert(key, Arc::clone(&executor));
    Ok(executor)
}

/// Gives every slot its place in the order of data flow: writers before readers; a loop is cut where it closes.
pub fn rank(slots: &[Placed], connections: &[ConnectionPlan]) {
    let order = flow_order(slots.iter().map(|placed| placed.slot.name).collect(), connections);
    let places: HashMap<&str, u32> = order.iter().zip(0..).map(|(name, rank)| (*name, rank)).collect();
    let mut batches: Vec<(&Arc<Executor>, Vec<_>)> = Vec::new();
    for placed in slots {
        let rank = (placed.member, places.get(placed.slot.name).copied().unwrap_or(0));
        match batches.iter_mut().find(|(executor, _)| Arc::ptr_eq(executor, &placed.executor)) {
            Some((_, ranks)) => ranks.push(rank),
            None => batches.push((&placed.executor, vec![rank])),
        }
    }
    for (executor, ranks) in batches {
        // A stuck executor keeps its old order.
        let _ = executor.rank(ranks, SHUTDOWN_STEP);
    }
}

/// Names in the order of data flow (depth first, as Tarjan 1976).
fn flow_order<'a>(names: Vec<&'a str>, connections: &'a [ConnectionPlan]) -> Vec<&'a str> {
    fn visit<'a>(name: &'a str, connections: &'a [ConnectionPlan], seen: &mut Vec<&'a str>, order: &mut Vec<&'a str>) {
        if seen.contains(&name) {
            return;
        }
        seen.push(name);
        for connection in connections.iter().filter(|connection| connection.target.slot == name) {
            visit(&connection.source.slot, connections, seen, order);
        }
        order.push(name);
    }
    let (mut seen, mut order) = (Vec::new(), Vec::new());
    for name in names {
        visit(name, connections, &mut seen, &mut order);
    }
    order
}

/// Starts every new slot that starts by itself, needed ones first; those that lack what they need stay as they are.
///
/// # Errors
/// The first whose `start` does not return.
pub fn start(plan: &Plan, slots: &[Placed], helpers: &Helpers, is_new: impl Fn(&str) -> bool) -> Result<(), String> {
    emergency::arm(actuators(plan, slots));
    let stuck = cast(plan, slots, helpers).start(is_new);
    stuck.map_or(Ok(()), |name| Err(format!("slot {name}: {Stuck}")))
}

/// What runs, for the fault manager.
#[must_use]
pub fn cast(plan: &Plan, slots: &[Placed], helpers: &Helpers) -> Cast {
    let placed = by_name(slots);
    let hand = |slot: &SlotPlan| {
        let Placed { slot, executor, member, autostart, .. } = (*placed.get(slot.name.as_str())?).clone();
        Some(Hand { slot, executor, member, autostart })
    };
    let voters = helpers.voters.iter().map(|voter| Arc::clone(&voter.helper)).collect();
    Cast::new(plan, plan.slots.iter().filter_map(hand).collect(), voters)
}

fn actuators(plan: &Plan, slots: &[Placed]) -> Vec<Actuator> {
    let placed = by_name(slots);
    let found = plan.system.emergency.iter().filter_map(|name| placed.get(name.as_str()));
    found.map(|placed| Actuator { slot: placed.slot.name, signal: Arc::clone(&placed.signal) }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::plan::{Location, PortKind, PortRef};

    fn connection(from: &str, to: &str) -> ConnectionPlan {
        let end = |slot: &str| PortRef { slot: slot.into(), port: "p".into() };
        ConnectionPlan {
            kind: PortKind::Data,
            source: end(from),
            target: end(to),
            validity: Vec::new(),
            on_gone: None,
            location: Location::default(),
        }
    }

    #[test]
    fn writers_come_before_readers_and_a_loop_is_cut() {
        let connections =
            [connection("sonar", "avoider"), connection("avoider", "motors"), connection("motors", "sonar")];
        let order = flow_order(vec!["motors", "avoider", "sonar"], &connections);
        assert_eq!(order.len(), 3);
        let acyclic = [connection("sonar", "avoider"), connection("avoider", "motors")];
        assert_eq!(flow_order(vec!["motors", "avoider", "sonar"], &acyclic), ["sonar", "avoider", "motors"]);
    }
}
