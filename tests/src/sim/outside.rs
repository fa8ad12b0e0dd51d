//! What happens from outside: slots come, go and fail, connections change. Each real operation beside its model.

use std::sync::Arc;

use component_sdk::abi::calls::Whose;
use component_sdk::status::Status;
use framework_daemon::port::pattern::provider::Openness;
use framework_daemon::sys::bell::Ring;

use super::awaited::subscriber;
use super::executors::Executors;
use super::links;
use super::model::{
    EVENT_GATE, GATES, Gates, Instance, Link, PORTS, PULL_GATE, PUSH_GATE, SENDS, SERVERS, State, refusal, server_of,
};
use super::naive_pushes::READERS;
use super::world::World;

/// Connects a port to a slot drawn by lot.
pub(super) fn connect(world: &World, slot: usize, port: usize) {
    let (to, retry) = (world.dice.below(world.slots.len()), world.dice.once_in(2));
    let (own, other) = (world.ends(slot), world.ends(to));
    let mut model = world.model();
    let (before, server) = (model.slots[slot].links[port], server_of(other.life, port));
    if before.is_none_or(|link| link.to != server) {
        model.leave((own.life, port));
    }
    model.slots[slot].links[port] = Some(Link { to: server, retry });
    drop(model);
    world.tell(|| format!("connect slot {slot} port {port} with slot {to}, retry: {retry}"));
    let provider = &other.providers[usize::from(port == SENDS)];
    let is = own.requestors[port].connect(provider, Some(retry));
    world.same(|| "connecting".to_owned(), is, Ok(()));
    world.count("connections");
}

/// Cuts a port's connection.
pub(super) fn disconnect(world: &World, slot: usize, port: usize) {
    let own = world.ends(slot);
    let mut model = world.model();
    model.leave((own.life, port));
    model.slots[slot].links[port] = None;
    drop(model);
    world.tell(|| format!("disconnect slot {slot} port {port}"));
    own.requestors[port].disconnect();
    world.count("disconnections");
}

/// Its slot is to be built anew: nobody is to wait for it any more.
fn replace(world: &World, slot: usize) {
    let ends = world.ends(slot);
    let mut model = world.model();
    for server in servers(ends.life) {
        model.providers[server].open = Openness::Replaced;
        model.clear_queue(server, Status::ProviderReplaced);
    }
    model.writers[ends.life].open = Openness::Replaced;
    model.tell(ends.life, Status::ProviderReplaced);
    model.replace_teller(ends.life);
    drop(model);
    world.tell(|| format!("slot {slot} is about to be replaced"));
    ends.providers.iter().for_each(|port| port.replace());
    ends.output.replace();
    ends.events.replace();
}

/// Another thread of the component switches blocking off, and on again at once.
pub(super) fn close_for_a_moment(world: &World, slot: usize, gate: usize) {
    let ends = world.ends(slot);
    world.tell(|| format!("slot {slot} gate {gate}: blocking off and on"));
    let mut model = world.model();
    let gates = &mut model.slots[slot].gates[gate];
    (gates.port, gates.closings) = (true, gates.closings + 1);
    drop(model);
    for on in [false, true] {
        match gate {
            EVENT_GATE => ends.events.clients[0].blocking(Whose::Port, on),
            PUSH_GATE => ends.subscriber().blocking(Whose::Port, on),
            port => ends.requestors[port].blocking(Whose::Port, on),
        }
    }
}

fn servers(life: usize) -> std::ops::Range<usize> {
    life * SERVERS..(life + 1) * SERVERS
}

impl Executors {
    /// Everything is connected and started.
    pub(super) fn set_up(&mut self) {
        self.world.take_thread(&self.world.outside);
        for slot in 0..self.world.slots.len() {
            (0..PORTS).for_each(|port| connect(&self.world, slot, port));
            links::connect_events(&self.world, slot);
            self.world.furnish(slot);
            (0..READERS).for_each(|which| links::connect_reader(&self.world, slot, which));
            self.start(slot);
        }
    }

    /// Something drawn by lot; false: there was nothing to it.
    pub(super) fn interfere(&mut self) -> bool {
        self.world.take_thread(&self.world.outside);
        let dice = &self.world.dice;
        let (slot, port) = (dice.below(self.world.slots.len()), dice.below(PORTS));
        let (state, is_free) = (self.state(slot), self.is_free(slot));
        match dice.below(32) {
            0..6 => connect(&self.world, slot, port),
            6..9 => links::connect_events(&self.world, slot),
            9..12 => links::connect_reader(&self.world, slot, dice.below(READERS)),
            12 => disconnect(&self.world, slot, port),
            13 => links::disconnect_events(&self.world, slot),
            14 if dice.once_in(2) => links::disconnect_reader(&self.world, slot, dice.below(READERS)),
            14 => links::disconnect_writer(&self.world, slot),
            15 if dice.once_in(4) => replace(&self.world, slot),
            16..32 if is_free && state == State::Stopped => self.start(slot),
            16..24 if is_free && state == State::Breathing => self.breathe_out(slot),
            16..19 if is_free && state == State::Active => self.stop(slot),
            19..22 if is_free && state == State::Active => self.fail_astray(slot),
            22 if is_free && dice.once_in(2) => self.rebuild(slot),
            23 => close_for_a_moment(&self.world, slot, dice.below(PULL_GATE)),
            _ => return false,
        }
        true
    }

    fn set_state(&self, slot: usize, state: State) {
        self.world.tell(|| format!("slot {slot} is {state:?}"));
        self.world.model().slots[slot].state = state;
    }

    /// `start`.
    fn start(&self, slot: usize) {
        self.set_blocking(slot, true);
        self.set_state(slot, State::Active);
        self.begin_work(slot);
    }

    /// As `exec::member` has it.
    fn begin_work(&self, slot: usize) {
        let ends = self.world.ends(slot);
        let _ = ends.signal.take();
        self.set_open(slot, Openness::Serving);
        if ends.has_to_serve() {
            ends.signal.ring(Ring::Serve);
        }
    }

    fn breathe_out(&self, slot: usize) {
        self.set_state(slot, State::Active);
        self.begin_work(slot);
    }

    /// `stop`.
    pub(super) fn stop(&mut self, slot: usize) {
        self.world.count("stops");
        self.set_blocking(slot, false);
        let was_lost = self.end_wait(slot);
        self.set_open(slot, Openness::Stopped);
        self.set_state(slot, State::Stopped);
        if was_lost {
            self.change_hands(slot);
        }
    }

    /// Whatever its callback waits for, it comes to its end; true: that was a trap.
    fn end_wait(&mut self, slot: usize) -> bool {
        if !self.waits(slot) {
            return false;
        }
        self.world.tell(|| format!("slot {slot} is to wait no longer"));
        self.world.model().slots[slot].ending = true;
        self.go_on(slot, false);
        self.world.model().slots[slot].ending = false;
        if self.waits(slot) || !self.is_free(slot) {
            self.world.wrong(format!("slot {slot} waits where it may not"));
        }
        std::mem::take(&mut self.was_lost)
    }

    fn set_blocking(&self, slot: usize, on: bool) {
        let ends = self.world.ends(slot);
        let mut model = self.world.model();
        for gates in &mut model.slots[slot].gates {
            gates.slot = on;
            gates.closings += u32::from(!on);
        }
        drop(model);
        ends.set_blocking(on);
    }

    fn set_open(&self, slot: usize, open: Openness) {
        let ends = self.world.ends(slot);
        let mut model = self.world.model();
        for server in servers(ends.life) {
            let provider = &mut model.providers[server];
            if provider.open != Openness::Replaced {
                provider.open = open;
            }
            if let Some(status) = refusal(provider.open) {
                model.let_all_go(server, status);
                let instance = &mut model.slots[slot].instance;
                instance.stale_kept.extend(instance.kept.drain(..).map(|(server, id, _)| (server, id)));
            }
        }
        let teller = &mut model.tellers[ends.life];
        if teller.open != Openness::Replaced {
            teller.open = open;
        }
        model.open_writer(ends.life, open);
        if open == Openness::Stopped {
            model.readers[subscriber(ends.life)].unsubscribe(Status::Unsubscribed);
        }
        drop(model);
        self.world.tell(|| format!("slot {slot}: {open:?}"));
        ends.set_open(open);
    }

    /// Its instance is another one from now on.
    fn change_hands(&self, slot: usize) {
        let ends = self.world.ends(slot);
        let mut model = self.world.model();
        let Instance { kept, .. } = std::mem::take(&mut model.slots[slot].instance);
        model.slots[slot].instance.stale_kept = kept.into_iter().map(|(server, id, _)| (server, id)).collect();
        (model.slots[slot].wait, model.slots[slot].at_once) = (None, None);
        model.waits_for[ends.life] = None;
        (0..PORTS).for_each(|port| model.abandon((ends.life, port)));
        for gates in &mut model.slots[slot].gates {
            *gates = Gates { port: true, component: true, ..*gates };
        }
        servers(ends.life).for_each(|server| model.fail(server));
        model.forget_events(ends.life);
        model.fail_teller(ends.life);
        model.tell(ends.life, Status::ProviderGone);
        drop(model);
        ends.change_hands();
    }

    /// Its instance trapped.
    pub(super) fn trapped(&mut self, slot: usize) {
        if self.world.model().slots[slot].ending {
            self.was_lost = true;
        } else {
            self.recover(slot);
        }
    }

    fn recover(&mut self, slot: usize) {
        self.abandon(slot);
        match self.world.dice.below(10) {
            0..6 => self.change_hands(slot),
            6..9 => {
                self.change_hands(slot);
                self.set_state(slot, State::Breathing);
            }
            _ => {
                self.set_open(slot, Openness::Gone);
                self.change_hands(slot);
                self.set_state(slot, State::Stopped);
            }
        }
        self.let_in(slot);
    }

    /// A thread that it started failed.
    fn fail_astray(&mut self, slot: usize) {
        self.world.tell(|| format!("slot {slot}: a thread of its own fails"));
        self.world.count("faults astray");
        // Nothing of a sound instance is lost by a panic.
        let is_lost = if self.world.dice.once_in(8) { true } else { self.end_wait(slot) };
        if is_lost {
            self.recover(slot);
        }
    }

    /// Removed, and built anew.
    fn rebuild(&mut self, slot: usize) {
        self.world.count("replacements");
        replace(&self.world, slot);
        self.stop(slot);
        let (old, executor) = (self.world.ends(slot), self.world.dice.below(self.world.bells.len()));
        let ends = self.world.build(executor);
        ends.set_blocking(false);
        links::detach(&self.world, slot);
        let mut model = self.world.model();
        (0..PORTS).for_each(|port| model.abandon((old.life, port)));
        let state = &mut model.slots[slot];
        (state.life, state.executor, state.instance) = (ends.life, executor, Instance::default());
        (state.links, state.gates) = ([None; PORTS], [Gates { slot: false, ..Gates::OPEN }; GATES]);
        drop(model);
        self.world.tell(|| format!("slot {slot} is built anew on executor {executor}"));
        *self.world.slots[slot].try_lock().expect("one thread") = ends;
        self.world.furnish(slot);
        links::announce(&self.world);
        if Arc::strong_count(&old) != 1 {
            self.world.wrong(format!("somebody is still in slot {slot}"));
        }
    }
}
