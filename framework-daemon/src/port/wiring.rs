//! Connections made and cut while everything runs, by whoever asks: boot, reload, a component, an operator.
//!
//! The reader is the one that is wired: `connect` first takes it off whatever it hears, as the originals do, so that it hears
//! one writer. Where a profile gives it several, they stay until somebody connects it anew.
//!
//! One connection changes at a time for each reader, and one table at a time for each writer; always the reader first, so that
//! nobody waits in a circle. Nothing of a component is touched meanwhile, and nothing is allocated once the tables are as
//! large as they get.

use std::fmt;
use std::sync::{Arc, MutexGuard};

use component_sdk::status::Status;

use super::border::PortEnd;
use super::check::Checks;
use super::exchange::Busy;
use super::input::{InPort, Source};
use super::output::{Link, OutPort};
use super::pattern::provider::Provider;
use super::pattern::requestor::Requestor;
use super::registry::{Found, Registry, Unknown};
use super::{wiring_events, wiring_services};
use crate::model::fault::{Evidence, Fault};
use crate::model::symptom::Symptom;
use crate::model::text::ShortText;
use crate::sys::clock;

/// A port, as one names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Name<'a> {
    /// The slot.
    pub slot: &'a str,
    /// The port.
    pub port: &'a str,
}

impl fmt::Display for Name<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.slot, self.port)
    }
}

/// A connection that was not made or cut, in words that name both sides.
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error("{}", reason.as_str())]
pub struct Refusal {
    /// What kind of reason: `Error` (somebody else wires the same port all the time), `IncompatibleService`,
    /// `ServiceUnavailable` (the other side is not there), `UnknownComponent`, `UnknownPort`; of a component's own port also
    /// `Closed`, `Disconnected`, `NotAllowed`, `PortAlreadyUsed`.
    pub cause: Status,
    /// The reason.
    pub reason: ShortText,
}

impl Refusal {
    pub(super) fn new(cause: Status, reason: fmt::Arguments<'_>) -> Self {
        Self { cause, reason: ShortText::of(reason) }
    }

    /// Number of the status that it stands for.
    #[must_use]
    pub const fn code(&self) -> u32 {
        self.cause.code()
    }
}

/// Connects two ports, whichever of them is named first. The reader's other connections, or the client's, are cut before, and
/// stay so where this one is refused, for whatever reason. Where a composite's name stands for several ports, all are
/// connected.
///
/// Values on their way over other connections are not touched. The newest value on its way over one that is cut may still
/// arrive, and what the reader has not read yet stays there.
///
/// # Errors
/// Why the ports are not connected.
pub fn connect(registry: &Registry, one: Name<'_>, other: Name<'_>) -> Result<(), Refusal> {
    match find(registry, one) {
        Ok(found) => found.ends().iter().try_for_each(|first| connect_end(registry, first, one, other)),
        Err(unknown) => wiring_services::connect(registry, one, other, unknown),
    }
}

/// As [`connect`], from a port that is at hand.
///
/// # Errors
/// Why the ports are not connected.
pub fn connect_end(registry: &Registry, first: &PortEnd, one: Name<'_>, other: Name<'_>) -> Result<(), Refusal> {
    let result = find_other(registry, one, other)
        .and_then(|found| found.ends().iter().try_for_each(|second| link_or_leave(first, one, second, other)));
    if result.is_err() {
        leave(first);
    }
    result
}

fn link_or_leave(first: &PortEnd, one: Name<'_>, second: &PortEnd, other: Name<'_>) -> Result<(), Refusal> {
    let result = link(first, one, second, other);
    if result.is_err() && !is_wired(first) {
        leave(second);
    }
    result
}

/// It is what one wires: it asks or listens.
const fn is_wired(end: &PortEnd) -> bool {
    matches!(end, PortEnd::In(_) | PortEnd::Requestor(_) | PortEnd::EventIn(_) | PortEnd::EventClient(_))
}

/// What was to be connected and is not has no connection any more.
fn leave(end: &PortEnd) {
    match end {
        // Whoever is in the way has connected it to something else.
        PortEnd::In(input) => _ = detach(input),
        PortEnd::Requestor(client) => client.disconnect(),
        PortEnd::EventIn(input) => _ = detach(&input.port),
        PortEnd::EventClient(client) => client.disconnect(),
        PortEnd::Out(_) | PortEnd::Provider(_) | PortEnd::EventOut(_) | PortEnd::EventServer(_) => {}
    }
}

fn link(first: &PortEnd, one: Name<'_>, second: &PortEnd, other: Name<'_>) -> Result<(), Refusal> {
    if let Some(result) = wiring_events::connect((first, one), (second, other)) {
        return result;
    }
    match (first, second) {
        (PortEnd::Out(output), PortEnd::In(input)) => join(output, one, input, other),
        (PortEnd::In(input), PortEnd::Out(output)) => join(output, other, input, one),
        (PortEnd::Requestor(client), PortEnd::Provider(server)) => ask(client, one, server, other),
        (PortEnd::Provider(server), PortEnd::Requestor(client)) => ask(client, other, server, one),
        (PortEnd::In(_), PortEnd::In(_)) => Err(same_way(one, other, "an input", "writes")),
        (PortEnd::Out(_), PortEnd::Out(_)) => Err(same_way(one, other, "an output", "reads")),
        (PortEnd::Requestor(_), PortEnd::Requestor(_)) => Err(same_way(one, other, "a client", "answers")),
        (PortEnd::Provider(_), PortEnd::Provider(_)) => Err(same_way(one, other, "a server", "asks")),
        (PortEnd::In(_) | PortEnd::Out(_), _) => Err(other_pattern(one, other)),
        _ => Err(other_pattern(other, one)),
    }
}

/// A client asks that server from now on. What it asked before is over, even if it is the same server.
fn ask(client: &Requestor, from: Name<'_>, server: &Arc<Provider>, to: Name<'_>) -> Result<(), Refusal> {
    client.disconnect();
    client.connect(server, None).map_err(|difference| {
        Refusal::new(
            Status::IncompatibleService,
            format_args!("{from} {}, {to} {}: {difference}", client.objects.asked(), server.objects.served()),
        )
    })
}

/// Cuts all connections of a port that reads, writes or asks; one that has none is no mistake.
///
/// # Errors
/// There is no such port, or somebody else wires it all the time.
pub fn disconnect(registry: &Registry, name: Name<'_>) -> Result<(), Refusal> {
    match find(registry, name) {
        Ok(found) => found.ends().iter().try_for_each(|end| disconnect_end(end, name)),
        Err(unknown) => wiring_services::disconnect(registry, name, unknown),
    }
}

/// As [`disconnect`], of a port that is at hand.
///
/// # Errors
/// Somebody else wires it all the time.
pub fn disconnect_end(end: &PortEnd, name: Name<'_>) -> Result<(), Refusal> {
    let cut = match end {
        PortEnd::In(input) => detach(input),
        PortEnd::Out(output) => detach_all(output),
        PortEnd::EventIn(input) => detach(&input.port),
        PortEnd::EventOut(output) => detach_all(output),
        PortEnd::EventClient(client) => {
            client.disconnect();
            Ok(())
        }
        PortEnd::Requestor(client) => {
            client.disconnect();
            Ok(())
        }
        PortEnd::Provider(_) | PortEnd::EventServer(_) => return Err(is_server(name)),
    };
    cut.map_err(|Busy| busy(name))
}

pub(super) fn is_server(name: Name<'_>) -> Refusal {
    Refusal::new(
        Status::IncompatibleService,
        format_args!("{name} is a server, which does not know its clients: disconnect them by their names"),
    )
}

fn find(registry: &Registry, name: Name<'_>) -> Result<Found, Refusal> {
    let Name { slot, port } = name;
    registry.find(slot, port).map_err(|unknown| match unknown {
        Unknown::Slot => {
            Refusal::new(Status::UnknownComponent, format_args!("{name}: there is no slot {slot} with ports"))
        }
        Unknown::Port => Refusal::new(Status::UnknownPort, format_args!("{name}: slot {slot} has no port {port}")),
        Unknown::Busy => busy(name),
    })
}

/// The side that is connected to.
fn find_other(registry: &Registry, one: Name<'_>, other: Name<'_>) -> Result<Found, Refusal> {
    find(registry, other).map_err(|refusal| match refusal.cause {
        Status::Error => refusal,
        _ if wiring_services::is_service(registry, other) => wiring_services::no_pair(one, other),
        _ => Refusal::new(
            Status::ServiceUnavailable,
            format_args!("{one} cannot be connected to {}", refusal.reason.as_str()),
        ),
    })
}

fn same_way(one: Name<'_>, other: Name<'_>, what: &str, missing: &str) -> Refusal {
    Refusal::new(
        Status::IncompatibleService,
        format_args!("{one} and {other} cannot be connected: each is {what}, and none of them {missing}"),
    )
}

fn other_pattern(data: Name<'_>, service: Name<'_>) -> Refusal {
    Refusal::new(
        Status::IncompatibleService,
        format_args!("{data} and {service} cannot be connected: one is a data port, the other a service port"),
    )
}

fn busy(name: Name<'_>) -> Refusal {
    Refusal::new(Status::Error, format_args!("{name}: its connections are being changed all the time: try again"))
}

pub(super) fn join(output: &Arc<OutPort>, from: Name<'_>, input: &Arc<InPort>, to: Name<'_>) -> Result<(), Refusal> {
    let mut sources = input.sources().map_err(|Busy| busy(to))?;
    cut(&mut sources, input).map_err(|Busy| busy(to))?;
    // Also where its server is gone already, and was to have a successor. Its client did not ask for it: a wait is told so.
    input.disconnected();
    if let Some(difference) = output.object.difference(input.object) {
        let (written, expected) = (output.object.name, input.object.name);
        let said =
            format_args!("{from} carries {written}, {to} expects {expected}, and their layouts differ: {difference}");
        output.charge(&mismatch(said));
        return Err(Refusal::new(Status::IncompatibleService, said));
    }
    let link = Link { target: Arc::clone(input), checks: Checks::none() };
    add(&mut sources, output, link).map_err(|Busy| busy(from))
}

/// The fault of a writer that cannot be connected while it runs. A plan that does not fit is refused as a whole, and nobody's
/// fault but its author's.
fn mismatch(said: std::fmt::Arguments<'_>) -> Fault {
    Fault::told(Symptom::Type, clock::now_ns(), Evidence::Text { message: ShortText::of(said) })
}

type Sources<'a> = MutexGuard<'a, Vec<Source>>;

/// Takes a reader off all its writers. Those that it cannot be taken off, it stays with.
fn cut(sources: &mut Sources<'_>, input: &Arc<InPort>) -> Result<(), Busy> {
    while let Some(source) = sources.last() {
        if let Some(output) = source.upgrade() {
            remove(&output, input)?;
        }
        sources.pop();
    }
    Ok(())
}

fn remove(output: &OutPort, input: &Arc<InPort>) -> Result<(), Busy> {
    output.change(|links| links.retain(|link| !Arc::ptr_eq(&link.target, input)))?;
    input.parted(output.outlet());
    Ok(())
}

fn add(sources: &mut Sources<'_>, output: &Arc<OutPort>, link: Link) -> Result<(), Busy> {
    // Room first: what is connected is known to its reader.
    sources.reserve(1);
    let target = Arc::clone(&link.target);
    output.change(|links| links.push(link))?;
    target.joined(output.outlet());
    sources.push(Arc::downgrade(output));
    Ok(())
}

/// Cuts all connections of an input.
///
/// # Errors
/// Somebody else wires it all the time.
pub fn detach(input: &Arc<InPort>) -> Result<(), Busy> {
    cut(&mut input.sources()?, input)
}

/// Cuts all connections of an output.
///
/// # Errors
/// Somebody else wires it all the time.
pub fn detach_all(output: &Arc<OutPort>) -> Result<(), Busy> {
    while let Some(input) = output.first_target()? {
        let mut sources = input.sources()?;
        remove(output, &input)?;
        sources.retain(|source| !std::ptr::eq(source.as_ptr(), Arc::as_ptr(output)));
    }
    Ok(())
}

/// One of the writers that a plan gives a reader.
pub struct Planned {
    /// The writer.
    pub output: Arc<OutPort>,
    /// Checks of the connection.
    pub checks: Arc<Checks>,
}

/// Gives a reader exactly these writers. A connection that was there before, with the same rules, stays as it is, with what its
/// checks remember.
///
/// # Errors
/// Somebody else wires it all the time.
pub fn set(input: &Arc<InPort>, planned: &[Planned]) -> Result<(), Busy> {
    let mut sources = input.sources()?;
    let is_planned = |output: &Arc<OutPort>| planned.iter().any(|plan| Arc::ptr_eq(&plan.output, output));
    let gone = sources.iter().filter_map(Source::upgrade).filter(|output| !is_planned(output));
    gone.collect::<Vec<_>>().iter().try_for_each(|output| remove(output, input))?;
    sources.clear();
    for Planned { output, checks } in planned {
        let same = |link: &Link| Arc::ptr_eq(&link.target, input);
        output.change(|links| {
            let keeps = |link: &Link| same(link) && link.checks.same_rules(checks);
            if !links.iter().any(keeps) {
                links.retain(|link| !same(link));
                links.push(Link { target: Arc::clone(input), checks: Arc::clone(checks) });
            }
        })?;
        input.joined(output.outlet());
        sources.push(Arc::downgrade(output));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeSet, VecDeque};
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::time::{Duration, Instant};

    use component_sdk::abi::payload::ReadMode;
    use component_sdk::object::{CommObject, TypeDescriptor};
    use component_sdk::port::Sent;
    use proptest::prelude::*;

    use super::super::output::Borrower;
    use super::super::registry::Entry;
    use super::*;
    use crate::profile::plan::{Overflow, Queue};

    const WRITERS: usize = 3;
    const READERS: usize = 3;
    const FIFO: Queue = Queue::Fifo { size: 3, overflow: Overflow::DropOldest };
    const PATIENCE: Duration = Duration::from_secs(20);
    const NAMES: [&str; 3] = ["a", "b", "c"];

    /// Slots `a`, `b` and `c`, each with an output `out` and an input `in`, that of `a` for the newest value only.
    struct Rig {
        registry: Registry,
        outputs: Vec<Arc<OutPort>>,
        inputs: Vec<Arc<InPort>>,
    }

    fn rig(object: &'static TypeDescriptor) -> Rig {
        let output = |_| Arc::new(OutPort::new("out", object, Checks::default()));
        let input = |number| {
            let queue = if number == 0 { Queue::Last } else { FIFO };
            Arc::new(InPort::new("in", object, queue, Checks::default()))
        };
        let outputs: Vec<_> = (0..WRITERS).map(output).collect();
        let inputs: Vec<_> = (0..READERS).map(input).collect();
        let registry = Registry::default();
        let ends = outputs.iter().cloned().map(PortEnd::Out).zip(NAMES);
        let entries = ends.chain(inputs.iter().cloned().map(PortEnd::In).zip(NAMES));
        registry.set(entries.map(|(end, slot)| Entry { slot, end, is_listed: true }).collect()).unwrap();
        Rig { registry, outputs, inputs }
    }

    fn out(number: usize) -> Name<'static> {
        Name { slot: NAMES[number], port: "out" }
    }

    fn into(number: usize) -> Name<'static> {
        Name { slot: NAMES[number], port: "in" }
    }

    #[allow(unsafe_code, reason = "the test plays the plugin, which writes and reads through the pointer")]
    fn write<T: Copy>(output: &OutPort, value: T) -> Sent {
        let lent = output.loan(Borrower::Callback);
        // SAFETY: the block on loan is for one T.
        unsafe { lent.value.cast::<T>().write(value) };
        output.publish(lent.value, Borrower::Callback)
    }

    #[allow(unsafe_code, reason = "as above")]
    fn read<T: Copy>(input: &InPort) -> Option<T> {
        // SAFETY: a block that was published holds a T.
        unsafe { input.read(ReadMode::Take, Borrower::Callback).value.cast::<T>().as_ref().copied() }
    }

    #[derive(Clone, Debug)]
    enum Step {
        Connect(usize, usize, bool),
        Cut(usize),
        CutOutput(usize),
        Set(usize, BTreeSet<usize>),
        Write(usize),
        Read(usize),
    }

    fn step() -> impl Strategy<Value = Step> {
        prop_oneof![
            (0..WRITERS, 0..READERS, any::<bool>()).prop_map(|(from, to, turned)| Step::Connect(from, to, turned)),
            (0..READERS).prop_map(Step::Cut),
            (0..WRITERS).prop_map(Step::CutOutput),
            (0..READERS, prop::collection::btree_set(0..WRITERS, 0..3)).prop_map(|(to, from)| Step::Set(to, from)),
            (0..WRITERS).prop_map(Step::Write),
            (0..READERS).prop_map(Step::Read),
        ]
    }

    /// What should be connected, and what should wait at each reader.
    #[derive(Default)]
    struct Model {
        links: BTreeSet<(usize, usize)>,
        waiting: [VecDeque<u64>; READERS],
    }

    impl Model {
        fn write(&mut self, from: usize, value: u64) -> Sent {
            let readers: Vec<_> = self.links.iter().filter(|(writer, _)| *writer == from).map(|link| link.1).collect();
            for reader in &readers {
                let waiting = &mut self.waiting[*reader];
                waiting.push_back(value);
                let room = if *reader == 0 { 1 } else { 3 };
                waiting.drain(..waiting.len().saturating_sub(room));
            }
            if readers.is_empty() { Sent::Unconnected } else { Sent::Ok }
        }
    }

    proptest! {
        #[test]
        fn whatever_is_wired_when_values_arrive_where_they_should(steps in prop::collection::vec(step(), 0..200)) {
            let rig = rig(u64::DESCRIPTOR);
            let mut model = Model::default();
            for (number, step) in (0u64..).zip(steps) {
                match step {
                    Step::Connect(from, to, turned) => {
                        let (one, other) = if turned { (into(to), out(from)) } else { (out(from), into(to)) };
                        connect(&rig.registry, one, other).unwrap();
                        model.links.retain(|link| link.1 != to);
                        model.links.insert((from, to));
                    }
                    Step::Cut(to) => {
                        disconnect(&rig.registry, into(to)).unwrap();
                        model.links.retain(|link| link.1 != to);
                    }
                    Step::CutOutput(from) => {
                        disconnect(&rig.registry, out(from)).unwrap();
                        model.links.retain(|link| link.0 != from);
                    }
                    Step::Set(to, writers) => {
                        let planned = writers.iter().map(|from| Planned {
                            output: Arc::clone(&rig.outputs[*from]),
                            checks: Checks::none(),
                        });
                        set(&rig.inputs[to], &planned.collect::<Vec<_>>()).unwrap();
                        model.links.retain(|link| link.1 != to);
                        model.links.extend(writers.into_iter().map(|from| (from, to)));
                    }
                    Step::Write(from) => prop_assert_eq!(write(&rig.outputs[from], number), model.write(from, number)),
                    Step::Read(to) => prop_assert_eq!(read(&rig.inputs[to]), model.waiting[to].pop_front()),
                }
            }
            for (from, output) in rig.outputs.iter().enumerate() {
                let links = output.links();
                let is_linked = |to: &usize| links.iter().any(|link| Arc::ptr_eq(&link.target, &rig.inputs[*to]));
                let found: Vec<_> = (0..READERS).filter(is_linked).collect();
                let expected: Vec<_> = model.links.iter().filter(|link| link.0 == from).map(|link| link.1).collect();
                prop_assert_eq!(links.len(), expected.len());
                prop_assert_eq!(found, expected);
            }
        }
    }

    #[test]
    fn a_refusal_names_both_sides_and_leaves_the_reader_alone() {
        let rig = rig(u64::DESCRIPTOR);
        let strange = Arc::new(InPort::new("in", f64::DESCRIPTOR, Queue::Last, Checks::default()));
        let mut entries = rig.registry.all();
        entries.push(Entry { slot: "d", end: PortEnd::In(Arc::clone(&strange)), is_listed: true });
        rig.registry.set(entries).unwrap();
        let d = Name { slot: "d", port: "in" };
        let refused = |one, other| {
            let refusal = connect(&rig.registry, one, other).unwrap_err();
            (refusal.cause, refusal.to_string())
        };
        let (cause, text) = refused(into(0), into(1));
        assert!(cause == Status::IncompatibleService && text.contains("a.in") && text.contains("b.in"), "{text}");
        let (cause, text) = refused(out(0), out(1));
        assert!(cause == Status::IncompatibleService && text.contains("a.out") && text.contains("b.out"), "{text}");
        let (cause, text) = refused(d, out(1));
        assert!(
            cause == Status::IncompatibleService && text.contains("b.out carries uint64_t, d.in expects double"),
            "{text}"
        );
        assert_eq!(write(&rig.outputs[1], 1u64), Sent::Unconnected);
        let nobody = Name { slot: "nobody", port: "in" };
        let (cause, text) = refused(out(0), nobody);
        assert!(cause == Status::ServiceUnavailable && text.contains("a.out") && text.contains("nobody.in"), "{text}");
        assert_eq!(refused(nobody, out(0)).0, Status::UnknownComponent);
        let (cause, text) = refused(Name { slot: "a", port: "none" }, out(0));
        assert!(cause == Status::UnknownPort && text.contains("slot a has no port none"), "{text}");
        assert_eq!(disconnect(&rig.registry, nobody).unwrap_err().code(), 16);
        disconnect(&rig.registry, into(2)).unwrap();
    }

    #[test]
    fn under_full_traffic_no_value_is_torn_and_other_connections_lose_none() {
        type Value = [u64; 8];
        const WRITES: u64 = 50_000;
        let rig = rig(Value::DESCRIPTOR);
        let steady = Overflow::DropNewest;
        let kept = Arc::new(InPort::new(
            "kept",
            Value::DESCRIPTOR,
            Queue::Fifo { size: 64, overflow: steady },
            Checks::default(),
        ));
        set(&kept, &[Planned { output: Arc::clone(&rig.outputs[0]), checks: Checks::none() }]).unwrap();
        let over = AtomicBool::new(false);
        let whole = |value: Value| {
            assert!(value.iter().all(|word| *word == value[0]), "{value:?}");
            value[0]
        };
        std::thread::scope(|threads| {
            threads.spawn(|| {
                for number in 1..=WRITES {
                    let began = Instant::now();
                    while kept.queued() == 64 {
                        assert!(began.elapsed() < PATIENCE, "somebody reads");
                        std::thread::yield_now();
                    }
                    assert_eq!(write(&rig.outputs[0], [number; 8]), Sent::Ok);
                }
            });
            for _ in 0..2 {
                threads.spawn(|| {
                    while !over.load(Ordering::SeqCst) {
                        // Both at once: sometimes the other one is too often in the way, and says so.
                        let _ = connect(&rig.registry, into(0), out(0));
                        let _ = disconnect(&rig.registry, into(0));
                    }
                });
            }
            threads.spawn(|| {
                let mut last = 0;
                while !over.load(Ordering::SeqCst) {
                    if let Some(value) = read::<Value>(&rig.inputs[0]).map(whole) {
                        assert!(value > last, "{value} after {last}");
                        last = value;
                    }
                }
            });
            for expected in 1..=WRITES {
                let value = loop {
                    match read::<Value>(&kept) {
                        Some(value) => break value,
                        None => std::thread::yield_now(),
                    }
                };
                assert_eq!(whole(value), expected);
            }
            over.store(true, Ordering::SeqCst);
        });
        assert_eq!(kept.counts(), (WRITES, 0));
    }
}
