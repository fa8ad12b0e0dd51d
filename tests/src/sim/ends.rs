//! The ends of a slot's ports, from when it is built until it is built anew, and what the daemon does with all of them.

use std::collections::VecDeque;
use std::sync::Arc;

use component_sdk::object::CommObject;
use component_sdk::status::Status;
use framework_daemon::port::check::Checks;
use framework_daemon::port::event_ends::EventEnds;
use framework_daemon::port::input::InPort;
use framework_daemon::port::output::OutPort;
use framework_daemon::port::pattern::event_client::{self, EventClient};
use framework_daemon::port::pattern::event_server::EventServer;
use framework_daemon::port::pattern::objects::Objects;
use framework_daemon::port::pattern::outlet::{Cycle, Outlet};
use framework_daemon::port::pattern::provider::{Openness, Provider};
use framework_daemon::port::pattern::requestor::{Requestor, Room};
use framework_daemon::port::pattern::subscriber::{Subscriber, Terms};
use framework_daemon::port::pattern::turns;
use framework_daemon::port::wait::Waiter;
use framework_daemon::profile::plan::{Overflow, Queue};
use framework_daemon::sys::bell::Signal;

use super::links::{LISTENS, READS, TELLS, WRITES};
use super::model::{self, Model, PORTS, SENDS, Turns};
use super::naive_events::{Listener, Teller};
use super::naive_pushes::{Handled, Reader, Writer};
use super::world::{NO_DEADLINE_NS, World};

const QUERY: Objects = Objects { request: u64::DESCRIPTOR, answer: Some(u64::DESCRIPTOR) };
const MESSAGE: Objects = Objects { request: u64::DESCRIPTOR, answer: None };
/// Longer than any history: cycles begin by lot.
const PERIOD_NS: u64 = 1_000_000_000;

/// The ends of a slot's ports.
pub(super) struct Ends {
    /// Number of this life.
    pub(super) life: usize,
    pub(super) providers: Vec<Arc<Provider>>,
    pub(super) requestors: Vec<Requestor>,
    /// A client and a server.
    pub(super) events: EventEnds,
    pub(super) output: Arc<OutPort>,
    /// A subscriber, and a queue.
    pub(super) inputs: Vec<Arc<InPort>>,
    pub(super) signal: Arc<Signal>,
}

impl Ends {
    /// # Panics
    /// Never: the first input is one's.
    pub(super) fn subscriber(&self) -> &Subscriber {
        self.inputs[0].subscriber().expect("the first input is a subscriber's")
    }

    /// As `exec::service` has it.
    pub(super) fn set_blocking(&self, on: bool) {
        self.requestors.iter().for_each(|port| port.set_blocking(on));
        self.providers.iter().for_each(|port| port.set_blocking(on));
        self.events.set_blocking(on);
        self.subscriber().set_blocking(on);
    }

    /// As `exec::service` has it.
    pub(super) fn set_open(&self, open: Openness) {
        self.providers.iter().for_each(|port| port.set_open(open));
        self.events.set_open(open);
        self.output.set_open(open);
        if open == Openness::Stopped {
            self.inputs.iter().for_each(|port| port.unsubscribe());
        }
    }

    /// As `exec::service` has it.
    pub(super) fn change_hands(&self) {
        self.requestors.iter().for_each(Requestor::close_calls);
        self.providers.iter().for_each(|port| port.fail());
        self.events.change_hands();
        self.subscriber().change_hands();
        self.output.tell(Status::ProviderGone);
    }

    /// As `exec::service` has it.
    pub(super) fn has_to_serve(&self) -> bool {
        self.providers.iter().any(|port| port.waits()) || self.subscriber().waits() || self.output.outlet().has_ticked()
    }

    /// All of them ring for the slot.
    fn listen(&self) {
        self.requestors.iter().for_each(|port| port.listen(Arc::clone(&self.signal)));
        self.providers.iter().for_each(|port| port.listen(Arc::clone(&self.signal)));
        self.events.listen(&self.signal);
        self.subscriber().listen(Arc::clone(&self.signal));
        self.output.outlet().listen(Arc::clone(&self.signal));
    }
}

impl World {
    /// The ends of a new life on that executor.
    pub(super) fn build(&self, executor: usize) -> Arc<Ends> {
        let (waiter, signal) = (Waiter::new(), Signal::new(Arc::clone(&self.bells[executor])));
        let mut model = self.model();
        let life = model.waits_for.len();
        model.waits_for.push(None);
        let requestors = (0..PORTS).map(|port| {
            let room = Room { pending: self.pending, timeout_ns: NO_DEADLINE_NS, retry: false };
            Requestor::new("asks", if port == SENDS { MESSAGE } else { QUERY }, room, Arc::clone(&waiter))
        });
        let ends = Ends {
            life,
            requestors: requestors.collect(),
            providers: self.servers(&mut model, &waiter),
            events: self.events(&mut model, &waiter),
            output: Arc::new(self.output(&mut model, &waiter)),
            inputs: vec![Arc::new(self.subscribing(&mut model, &waiter)), Arc::new(self.queueing(&mut model))],
            signal,
        };
        drop(model);
        ends.signal.assign(life);
        ends.listen();
        turns::share(&ends.providers);
        Arc::new(ends)
    }

    fn servers(&self, model: &mut Model, waiter: &Arc<Waiter>) -> Vec<Arc<Provider>> {
        let rooms = [1 + self.dice.below(4), 1 + self.dice.below(4)];
        let takes = !self.dice.once_in(3);
        for (room, handled) in rooms.into_iter().zip([true, takes]) {
            let (open, queue, hands) = (Openness::Starting, [].into(), Vec::new());
            model.providers.push(model::Provider { open, room, handled, queue, hands });
        }
        model.turns.push(Turns { room: 2 * (rooms[0] + rooms[1]), order: VecDeque::new(), others_first: false });
        let messages = Provider::new("takes", MESSAGE, rooms[1], Arc::clone(waiter));
        let messages = if takes { messages } else { messages.without_handler() };
        [Provider::new("answers", QUERY, rooms[0], Arc::clone(waiter)), messages].map(Arc::new).into()
    }

    fn events(&self, model: &mut Model, waiter: &Arc<Waiter>) -> EventEnds {
        let (room, queue_room) = (1 + self.dice.below(3), 1 + self.dice.below(3));
        let [drops_oldest, handled, hooked] = [(); 3].map(|()| self.dice.once_in(2));
        let (server, loans, queue) = (None, 0, VecDeque::new());
        model.listeners.push(Listener { server, room, loans, queue, queue_room, drops_oldest, handled });
        let (open, clients, lost) = (Openness::Starting, Vec::new(), false);
        let (tested, told, fired, refused) = (None, None, 0, 0);
        model.tellers.push(Teller { open, clients, hooked, lost, tested, told, fired, refused });
        let room = event_client::Room {
            activations: room,
            queue: queue_room,
            overflow: if drops_oldest { Overflow::DropOldest } else { Overflow::DropNewest },
            handled,
            timeout_ns: NO_DEADLINE_NS,
        };
        let object = u64::DESCRIPTOR;
        let client = EventClient::new(LISTENS, object, object, room, Arc::clone(waiter));
        let server = EventServer::new(TELLS, object, object, hooked, Arc::clone(waiter));
        let mut ends = EventEnds::default();
        (ends.clients, ends.servers) = (vec![Arc::new(client)], vec![Arc::new(server)]);
        ends
    }

    fn output(&self, model: &mut Model, waiter: &Arc<Waiter>) -> OutPort {
        let [timed, started] = [(); 2].map(|()| self.dice.once_in(2));
        let started = timed && started;
        let (running, ticked, missed, open, to) = (false, false, 0, Openness::Starting, Vec::new());
        model.writers.push(Writer { timed, started, running, ticked, missed, open, to });
        let cycle = Cycle { period_ns: timed.then_some(PERIOD_NS), started, min_cycle_ns: 0 };
        OutPort::serving(WRITES, u64::DESCRIPTOR, Checks::default(), Outlet::new(cycle, Arc::clone(waiter)))
    }

    fn subscribing(&self, model: &mut Model, waiter: &Arc<Waiter>) -> InPort {
        let prescale = self.dice.once_in(4).then(|| 1 + self.dice.below(3) as u32);
        let handler = self.dice.once_in(2).then(|| (1 + self.dice.below(3) as u32, 1 + self.dice.below(3)));
        let handled =
            |(every, room): (u32, usize)| Handled { every: u64::from(every), room, seen: 0, queue: [].into() };
        model.readers.push(Reader { prescale, handled: handler.map(handled), ..Reader::new(None) });
        let subscriber = Subscriber::new(Terms { prescale, timeout_ns: NO_DEADLINE_NS, handler }, Arc::clone(waiter));
        InPort::new(READS[0], u64::DESCRIPTOR, Queue::Last, Checks::default()).subscribed_by(subscriber)
    }

    fn queueing(&self, model: &mut Model) -> InPort {
        let (size, drops_oldest) = (1 + self.dice.below(4), self.dice.once_in(2));
        model.readers.push(Reader::new(Some((size, drops_oldest))));
        let overflow = if drops_oldest { Overflow::DropOldest } else { Overflow::DropNewest };
        InPort::new(READS[1], u64::DESCRIPTOR, Queue::Fifo { size, overflow }, Checks::default())
    }
}
