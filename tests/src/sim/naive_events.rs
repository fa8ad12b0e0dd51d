//! What must be of events: every activation with its parameter, its firings and its end.

use std::collections::VecDeque;

use component_sdk::abi::events::{Mode, Which};
use component_sdk::status::Status;
use framework_daemon::port::pattern::provider::Openness;

use super::awaited::End;
use super::model::{Model, refusal};

/// What a client asked for.
#[derive(Debug)]
pub(super) struct Activation {
    /// Life of the client.
    pub(super) client: usize,
    /// Its place among the client's.
    pub(super) index: u32,
    pub(super) mode: Mode,
    /// How often its parameter was changed by a test.
    pub(super) tests: u64,
    pub(super) firings: u64,
    /// What was not fetched.
    pub(super) event: Option<u64>,
    /// The server knows of it.
    pub(super) announced: bool,
    /// In the server's hands.
    pub(super) held: bool,
    /// Why it is over.
    pub(super) end: Option<Status>,
}

impl Activation {
    pub(super) const fn is_spent(&self) -> bool {
        matches!(self.mode, Mode::Single) && self.firings > 0 && self.event.is_none()
    }

    pub(super) fn over(&mut self, why: Status) {
        if self.end.is_none() {
            (self.end, self.event) = (Some(why), None);
        }
    }
}

/// The client's end of a life of a slot.
#[derive(Debug)]
pub(super) struct Listener {
    /// Life of its server.
    pub(super) server: Option<usize>,
    pub(super) room: usize,
    /// Parameters being filled.
    pub(super) loans: usize,
    /// Firings that wait for the handler: the activation, the event.
    pub(super) queue: VecDeque<(u64, u64)>,
    pub(super) queue_room: usize,
    pub(super) drops_oldest: bool,
    pub(super) handled: bool,
}

/// The server's end of a life of a slot.
#[derive(Debug)]
pub(super) struct Teller {
    pub(super) open: Openness,
    /// The number of each connection, and the life of its client.
    pub(super) clients: Vec<(u64, usize)>,
    /// Its component is told of each activation first.
    pub(super) hooked: bool,
    /// A client lost an event in this pass.
    pub(super) lost: bool,
    /// In its hands: by a test, or by a handler that is told of it.
    pub(super) tested: Option<u64>,
    pub(super) told: Option<u64>,
    pub(super) fired: u64,
    pub(super) refused: u64,
}

impl Model {
    fn of_client(&self, life: usize) -> impl Iterator<Item = (u64, &Activation)> {
        self.activations.iter().filter(move |(_, one)| one.client == life).map(|(number, one)| (*number, one))
    }

    /// Activations that a client has.
    pub(super) fn active(&self, life: usize) -> usize {
        self.of_client(life).filter(|(_, one)| one.end.is_none()).count()
    }

    /// What lending a parameter must come to.
    pub(super) fn asking(&mut self, life: usize) -> Result<(), Status> {
        self.activations.retain(|_, one| one.client != life || one.end.is_none() || one.held);
        let listener = &self.listeners[life];
        let server = listener.server.ok_or(Status::Disconnected)?;
        refusal(self.tellers[server].open).map_or(Ok(()), Err)?;
        let used = listener.loans + self.of_client(life).count();
        if used >= listener.room { Err(Status::Overload) } else { Ok(()) }
    }

    /// A client's activations are over.
    pub(super) fn end_activations(&mut self, life: usize, why: Status) {
        self.activations.values_mut().filter(|one| one.client == life).for_each(|one| one.over(why));
    }

    /// A client leads nowhere.
    pub(super) fn cut_events(&mut self, life: usize) {
        if let Some(server) = self.listeners[life].server.take() {
            self.tellers[server].clients.retain(|(_, client)| *client != life);
        }
        self.end_activations(life, Status::Disconnected);
    }

    /// A client leads to that server, and what it had activated is over, be it the same one.
    pub(super) fn connect_events(&mut self, life: usize, server: usize) {
        self.cut_events(life);
        self.listeners[life].server = Some(server);
        self.last += 1;
        self.tellers[server].clients.push((self.last, life));
    }

    /// The instance of a client is gone.
    pub(super) fn forget_events(&mut self, life: usize) {
        self.end_activations(life, Status::NotActivated);
        self.listeners[life].queue.clear();
        self.listeners[life].loans = 0;
    }

    /// A server is about to be built anew: what was asked of it is over.
    pub(super) fn replace_teller(&mut self, life: usize) {
        self.tellers[life].open = Openness::Replaced;
        let clients: Vec<usize> = self.tellers[life].clients.iter().map(|(_, client)| *client).collect();
        clients.into_iter().for_each(|client| self.end_activations(client, Status::ProviderReplaced));
    }

    /// The instance of a server is gone: what it had in its hands waits for its successor.
    pub(super) fn fail_teller(&mut self, life: usize) {
        let Teller { tested, told, .. } = &mut self.tellers[life];
        for number in [tested.take(), told.take()].into_iter().flatten() {
            self.put_down(number);
        }
    }

    /// Out of a server's hands.
    pub(super) fn put_down(&mut self, number: u64) {
        if let Some(one) = self.activations.get_mut(&number) {
            one.held = false;
        }
    }

    /// The next activation for a server's hands, from that connection and place on: its connection, its number.
    pub(super) fn next_activation(&self, server: usize, from: (u64, u32), announced: bool) -> Option<(u64, u64)> {
        let clients = self.tellers[server].clients.iter().filter(|(connection, _)| *connection >= from.0);
        clients.into_iter().find_map(|(connection, life)| {
            let first = if *connection == from.0 { from.1 } else { 0 };
            let due = |one: &Activation| !one.held && one.end.is_none() && one.announced == announced;
            let own = self.of_client(*life).filter(|(_, one)| due(one) && one.index >= first);
            own.min_by_key(|(_, one)| one.index).map(|(number, _)| (*connection, number))
        })
    }

    /// A server fires an activation; true: a firing was lost to the handler's queue.
    pub(super) fn fire(&mut self, server: usize, number: u64, event: u64) {
        let Some(one) = self.activations.get_mut(&number).filter(|one| one.end.is_none()) else { return };
        if one.mode == Mode::Single && one.firings > 0 {
            return;
        }
        (one.firings, one.event) = (one.firings + 1, Some(event));
        let listener = &mut self.listeners[one.client];
        let is_full = listener.handled && listener.queue.len() >= listener.queue_room;
        if is_full && listener.drops_oldest {
            listener.queue.pop_front();
        }
        if listener.handled && (!is_full || listener.drops_oldest) {
            listener.queue.push_back((number, event));
        }
        let teller = &mut self.tellers[server];
        *(if is_full { &mut teller.refused } else { &mut teller.fired }) += 1;
        teller.lost |= is_full;
    }

    /// The next firing that a client's handler is to be entered for.
    pub(super) fn next_firing(&mut self, life: usize) -> Option<(u64, u64)> {
        loop {
            let firing = self.listeners[life].queue.pop_front()?;
            if self.activations.get(&firing.0).is_some_and(|one| one.end.is_none()) {
                return Some(firing);
            }
        }
    }

    /// What is there of an activation, or why nothing will come; without a look at its server.
    pub(super) fn event_there(&self, number: u64, which: Which, before: u64) -> Option<End> {
        let Some(one) = self.activations.get(&number) else { return Some(Err(Status::NotActivated)) };
        if let Some(end) = one.end {
            return Some(Err(end));
        }
        let is_single = one.mode == Mode::Single;
        if which == Which::Next && is_single && before > 0 {
            return Some(Err(Status::Passive));
        }
        let is_wanted = which == Which::Present || one.firings > before;
        let event = one.event.filter(|_| is_wanted);
        event.map(Ok).or(one.is_spent().then_some(Err(Status::Passive)))
    }

    /// The same, with a look at its server.
    pub(super) fn event_end(&self, life: usize, number: u64, which: Which, before: u64) -> Option<End> {
        self.event_there(number, which, before).or_else(|| match self.listeners[life].server {
            None => Some(Err(Status::Disconnected)),
            Some(server) => refusal(self.tellers[server].open).map(Err),
        })
    }

    /// How far an activation is.
    pub(super) fn event_state(&self, number: u64) -> Result<(), Status> {
        let one = self.activations.get(&number).filter(|one| one.end.is_none()).ok_or(Status::WrongId)?;
        match one.event {
            Some(_) => Ok(()),
            None if one.is_spent() => Err(Status::Passive),
            None => Err(Status::Active),
        }
    }
}
