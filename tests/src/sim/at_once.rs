//! What must be of questions that are answered at once: which they are, and that nothing of them is different but how soon
//! they are served.

use component_sdk::abi::calls::{Lent, Wait as Time};
use framework_daemon::port::pattern::direct::Served;
use framework_daemon::port::pattern::provider::Openness;

use super::awaited::{Awaited, Before, End, subscriber};
use super::model::{InHand, Model, Provider, SENDS, SERVERS, State};
use super::outside;
use super::script::Actor;
use super::world::{Here, World};

/// A question that is to be answered at once.
#[derive(Clone, Copy, Debug)]
pub(super) struct AtOnce {
    number: u64,
    what: Awaited,
    time: Time,
    /// Of its gate, when it was asked.
    closings: u32,
    stage: Stage,
}

/// How far it is.
#[derive(Clone, Copy, Debug)]
enum Stage {
    Asked,
    Entered,
    /// The executor is to see to the server.
    Aside,
    /// Whoever asked waits, as after any other question.
    Begun(Before),
}

impl Model {
    /// Something is to be handled by that life's slot.
    pub(super) fn has_work(&self, life: usize) -> bool {
        let handled = self.readers[subscriber(life)].handled.as_ref();
        self.providers[life * SERVERS..(life + 1) * SERVERS].iter().any(Provider::waits)
            || handled.is_some_and(|handled| !handled.queue.is_empty())
            || self.writers[life].ticked
            || !self.listeners[life].queue.is_empty()
            || self.next_activation(life, (0, 0), false).is_some()
    }

    /// How a call ended at its server.
    pub(super) fn fate(&self, number: u64) -> Option<End> {
        self.calls.get(&number).and_then(|call| call.fate)
    }

    /// The slot that asked that.
    fn asker(&self, number: u64) -> Option<usize> {
        let life = self.calls.get(&number)?.from.0;
        self.slots.iter().position(|slot| slot.life == life)
    }

    /// The life that a question of this port can be answered by at once, as far as its calls go: none is before it, and whoever
    /// asks may wait.
    fn answers_next(&self, slot: usize, port: usize) -> Option<usize> {
        let gates = self.slots[slot].gates[port];
        let to = self.slots[slot].links[port].filter(|_| port != SENDS && gates.let_wait(gates.closings))?.to;
        let server = &self.providers[to];
        let is_next = server.queue.is_empty() && !server.hands.iter().any(|held| held.again) && server.has_room();
        (is_next && server.open == Openness::Serving).then_some(to / SERVERS)
    }
}

impl World {
    /// True where that port's next question must be answered at once.
    pub(super) fn asks_at_once(&self, slot: usize, port: usize) -> bool {
        let model = self.model();
        let life = model.answers_next(slot, port);
        let server = life.and_then(|life| Some((model.slots.iter().position(|slot| slot.life == life)?, life)));
        drop(model);
        server.is_some_and(|(server, life)| self.is_lane_open(server, life))
    }

    /// The handler is entered for it.
    pub(super) fn enters_at_once(&self, number: u64, server: usize, id: u64) {
        self.tell(|| format!("slot {server} is entered at once for {number}"));
        let mut model = self.model();
        let client = model.asker(number);
        let asked = client.and_then(|client| model.slots[client].at_once.as_mut()).filter(|one| one.number == number);
        let is_asked = asked.is_some_and(|one| {
            let is_asked = matches!(one.stage, Stage::Asked);
            one.stage = Stage::Entered;
            is_asked
        });
        let (life, executor) = (model.slots[server].life, model.slots[server].executor);
        let shares = client.is_some_and(|client| model.slots[client].executor == executor && client != server);
        let is_at_rest = model.slots[server].state == State::Active && model.slots[server].wait.is_none();
        let is_before =
            if self.lanes_look { model.has_work(life) } else { model.providers[life * SERVERS].has_calls() };
        model.providers[life * SERVERS].hands.push(InHand { id, number, again: false });
        drop(model);
        self.same(|| format!("{number} is one to be answered at once"), is_asked, true);
        self.same(|| format!("slot {server} can be entered at once"), (shares, is_at_rest), (true, true));
        self.same(|| format!("something of slot {server} comes before {number}"), is_before, false);
        self.count("served");
    }

    /// The handler was left: whoever asked goes on, or the executor sees to the server first.
    pub(super) fn leaves_at_once(&self, number: u64, served: Served) {
        let mut model = self.model();
        let Some(client) = model.asker(number) else { return };
        let life = model.slots[client].life;
        model.waits_for[life] = None;
        if served == Served::Aside {
            model.slots[client].at_once.iter_mut().for_each(|one| one.stage = Stage::Aside);
            return;
        }
        drop(model);
        self.begin_to_wait(client);
    }

    /// The handler could not be entered.
    pub(super) fn goes_by_inbox(&self, number: u64) {
        self.count("at once refused by the lane");
        let mut model = self.model();
        let Some(client) = model.asker(number) else { return };
        let Awaited::Answer(port, _) = model.slots[client].at_once.map_or(Awaited::Message, |one| one.what) else {
            return;
        };
        let Some(link) = model.slots[client].links[port] else { return };
        model.came(link.to, number);
        drop(model);
        self.begin_to_wait(client);
    }

    /// From outside, while its handler runs: whoever asked is cut off, or is to wait no longer.
    pub(super) fn disturbs(&self, number: u64, executor: usize) {
        let model = self.model();
        let asked = model.asker(number).and_then(|client| Some((client, model.slots[client].at_once?.what)));
        drop(model);
        let Some((client, Awaited::Answer(port, _))) = asked else { return };
        self.take_thread(&self.outside);
        if self.dice.once_in(2) {
            outside::disconnect(self, client, port);
        } else {
            outside::close_for_a_moment(self, client, port);
        }
        self.take_thread(&self.bells[executor]);
        self.count("at once, disturbed");
    }

    /// True where whoever asked waits for its executor only.
    pub(super) fn is_set_aside(&self, client: usize) -> bool {
        self.model().slots[client].at_once.is_some_and(|one| matches!(one.stage, Stage::Aside))
    }

    /// Whoever asked goes on and waits for the answer.
    pub(super) fn begin_to_wait(&self, client: usize) {
        let model = self.model();
        let (life, asked) = (model.slots[client].life, model.slots[client].at_once);
        drop(model);
        let Some(asked) = asked else { return };
        let before = self.before((client, life), asked.what, asked.time, Some(asked.closings));
        self.model().slots[client].at_once = Some(AtOnce { stage: Stage::Begun(before), ..asked });
    }
}

impl Actor<'_> {
    /// Asks where the answer must come at once; with what came, what must come of the wait for it.
    pub(super) fn ask_at_once(
        &self,
        (port, id): (usize, u64),
        number: u64,
        time: Time,
        here: &Here<'_>,
    ) -> (Lent, Option<Before>) {
        let mut model = self.world.model();
        let slot = &mut model.slots[self.slot];
        let (what, closings) = (Awaited::Answer(port, number), slot.gates[port].closings);
        slot.at_once = Some(AtOnce { number, what, time, closings, stage: Stage::Asked });
        let server = slot.links[port].map(|link| link.to / SERVERS);
        model.waits_for[self.ends.life] = server;
        drop(model);
        let lent = self.ends.requestors[port].ask(id, time, here);
        match self.world.model().slots[self.slot].at_once.take() {
            Some(AtOnce { stage: Stage::Begun(before), .. }) => (lent, Some(before)),
            _ => (lent, None),
        }
    }
}
