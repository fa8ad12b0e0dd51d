//! Connections of events and values, made and cut by name while everything runs. Each real operation beside its model.

use framework_daemon::port::border::PortEnd;
use framework_daemon::port::registry::Entry;
use framework_daemon::port::wiring::{self, Name};

use super::awaited::subscriber;
use super::world::World;

/// Names of slots, and of their ports.
const SLOTS: [&str; super::world::SLOTS_MAX] = ["a", "b", "c", "d", "e", "f", "g", "h"];
pub(super) const LISTENS: &str = "listens";
pub(super) const TELLS: &str = "tells";
pub(super) const WRITES: &str = "writes";
pub(super) const READS: [&str; super::naive_pushes::READERS] = ["subscribes", "queues"];

const fn name(slot: usize, port: &'static str) -> Name<'static> {
    Name { slot: SLOTS[slot], port }
}

/// From now on these are the ports that names lead to.
pub(super) fn announce(world: &World) {
    let entries = (0..world.slots.len()).flat_map(|slot| {
        let ends = world.ends(slot);
        let inputs = ends.inputs.iter().cloned().map(PortEnd::In).collect::<Vec<_>>();
        let ends = ends.events.ends().chain(inputs).chain([PortEnd::Out(ends.output.clone())]).collect::<Vec<_>>();
        ends.into_iter().map(move |end| Entry { slot: SLOTS[slot], end, is_listed: true })
    });
    let set = world.registry.set(entries.collect());
    world.same(|| "announcing the ports".to_owned(), set.is_ok(), true);
}

/// Connects two ports, whichever is named first.
fn connect(world: &World, one: Name<'static>, other: Name<'static>) {
    world.tell(|| format!("connect {one} with {other}"));
    world.count("connections");
    let turned = world.dice.once_in(2);
    let made = if turned {
        wiring::connect(&world.registry, other, one)
    } else {
        wiring::connect(&world.registry, one, other)
    };
    world.same(|| format!("connecting {one} with {other}"), made.is_ok(), true);
}

fn disconnect(world: &World, one: Name<'static>) {
    world.tell(|| format!("disconnect {one}"));
    world.count("disconnections");
    world.same(|| format!("disconnecting {one}"), wiring::disconnect(&world.registry, one).is_ok(), true);
}

/// Connects a slot's client of events to a server drawn by lot.
pub(super) fn connect_events(world: &World, slot: usize) {
    let to = world.dice.below(world.slots.len());
    let lives = (world.ends(slot).life, world.ends(to).life);
    world.model().connect_events(lives.0, lives.1);
    connect(world, name(slot, LISTENS), name(to, TELLS));
}

pub(super) fn disconnect_events(world: &World, slot: usize) {
    world.model().cut_events(world.ends(slot).life);
    disconnect(world, name(slot, LISTENS));
}

/// Connects a reader to a writer drawn by lot.
pub(super) fn connect_reader(world: &World, slot: usize, which: usize) {
    let from = world.dice.below(world.slots.len());
    let (reader, writer) = (subscriber(world.ends(slot).life) + which, world.ends(from).life);
    world.model().join(reader, writer);
    connect(world, name(slot, READS[which]), name(from, WRITES));
}

pub(super) fn disconnect_reader(world: &World, slot: usize, which: usize) {
    world.model().part(subscriber(world.ends(slot).life) + which);
    disconnect(world, name(slot, READS[which]));
}

/// Takes all its readers off a slot's output.
pub(super) fn disconnect_writer(world: &World, slot: usize) {
    let life = world.ends(slot).life;
    let mut model = world.model();
    let readers = std::mem::take(&mut model.writers[life].to);
    readers.iter().for_each(|reader| model.part(*reader));
    drop(model);
    disconnect(world, name(slot, WRITES));
}

/// Takes all connections off a slot that leaves.
pub(super) fn detach(world: &World, slot: usize) {
    disconnect_writer(world, slot);
    (0..READS.len()).for_each(|which| disconnect_reader(world, slot, which));
    disconnect_events(world, slot);
}
