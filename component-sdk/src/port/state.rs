//! State: a coordinator sets what a component is to be at, and the component's activities keep to it.
//!
//! A main state is a set of substates. An activity, in a callback or a task, holds the substate that it belongs to; a change
//! waits until nobody holds what is to be left, and new holders wait for the change. What is in both main states goes on
//! untouched.
//!
//! ```
//! use component_sdk::prelude::*;
//!
//! /// Drives while it is told to.
//! #[derive(Component)]
//! #[component(name = "Base", periodic = "20ms")]
//! pub struct Base {
//!     #[port]
//!     state: StateSlave,
//! }
//!
//! impl Callbacks for Base {
//!     fn initialize(&mut self, _: &mut Context<'_>) -> Outcome {
//!         self.state.define("Moving", "drives")?;
//!         self.state.activate()?;
//!         Ok(())
//!     }
//!
//!     fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
//!         let Ok(_held) = self.state.try_acquire("drives") else { return Ok(()) };
//!         info!(cx, "drives");
//!         Ok(())
//!     }
//! }
//!
//! /// Tells it to.
//! #[derive(Component)]
//! #[component(name = "Coordinator", periodic = "1s")]
//! pub struct Coordinator {
//!     #[port]
//!     base: StateMaster,
//! }
//!
//! impl Callbacks for Coordinator {
//!     fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
//!         self.base.set("Moving")?;
//!         Ok(())
//!     }
//! }
//! ```
//!
//! A master asks by a query, so that each of its waits has a deadline and a slave that fails is `ProviderGone`. The slave's
//! side is a task of the component: it answers while the component's own callbacks wait, and its life is the instance's, so
//! that nothing stays held after a fault. A successor begins in its initial state.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::query::{Pending, QueryClient, QueryServer};
use crate::CommObject;
use crate::abi::calls::{Whose, api};
use crate::abi::host;
use crate::abi::payload::PortHandle;
use crate::component::Outcome;
use crate::context::Context;
use crate::object::{Sequence, Text};
use crate::state::{Asker, Edge, Hold, Life, Machine};
use crate::status::Status;
use crate::task::Task;

/// What a master asks.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct StateRequest {
    /// 0: go to a main state; 1: in which one are you; 2: which have you; 3: which substates has one.
    pub what: u32,
    /// The main state that it is about.
    pub main: Text,
}

/// What a slave answers.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct StateNames {
    /// States, by name.
    pub names: Sequence<Text>,
}

const SET: u32 = 0;
const CURRENT: u32 = 1;
const MAINS: u32 = 2;
const SUBS: u32 = 3;

/// The name under which the component itself asks; no master's.
const OWN: Asker = 0;

/// Longest time until the slave's task looks again by itself.
const PATIENCE_NS: u64 = 3_600_000_000_000;

type Handler = Box<dyn FnMut(&mut Context<'_>, &Edge) -> Outcome + Send>;

/// What the strands of a component share of its states.
struct Shared {
    /// Held for a few instructions; nobody waits meanwhile.
    machine: Mutex<Machine>,
    handler: Mutex<Option<Handler>>,
    /// The slave's own port.
    port: PortHandle,
    /// All ports of the component.
    ports: Vec<PortHandle>,
}

impl Shared {
    fn machine(&self) -> MutexGuard<'_, Machine> {
        self.machine.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn handler(&self) -> MutexGuard<'_, Option<Handler>> {
        self.handler.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Something has changed: whoever waits looks again.
    fn wake(&self) {
        (api().wake)(self.port);
    }

    fn acquire(self: &Arc<Self>, sub: &str) -> Result<Held, Status> {
        loop {
            if self.machine().hold(sub)? == Hold::Held {
                return Ok(Held { shared: Arc::clone(self), sub: sub.to_owned(), kept: false });
            }
            if std::thread::panicking() || !(host::get().tasks.wait)(PATIENCE_NS) {
                return Err(Status::Cancelled);
            }
        }
    }

    fn try_acquire(self: &Arc<Self>, sub: &str) -> Result<Held, Status> {
        match self.machine().hold(sub)? {
            Hold::Held => Ok(Held { shared: Arc::clone(self), sub: sub.to_owned(), kept: false }),
            Hold::Wait => Err(Status::NotActivated),
        }
    }

    fn release(&self, sub: &str) -> Result<(), Status> {
        self.machine().release(sub)?;
        self.wake();
        Ok(())
    }

    /// Whether blocking calls of the component may wait.
    fn blocking(&self, on: bool) {
        // Those that are no clients refuse, and have nothing to wait for.
        self.ports.iter().for_each(|port| _ = (api().blocking)(*port, Whose::Component, on));
    }
}

/// A substate that is held: as long as this lives.
pub struct Held {
    shared: Arc<Shared>,
    sub: String,
    kept: bool,
}

impl Held {
    /// Keeps the substate held beyond this: until [`StateSlave::release`].
    pub fn keep(mut self) {
        self.kept = true;
    }
}

impl std::fmt::Debug for Held {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Held").field(&self.sub).finish()
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        if !self.kept {
            // It was held: it is known.
            let _ = self.shared.release(&self.sub);
        }
    }
}

/// The handler, apart while it runs; put back however it ends.
struct Lent<'a> {
    shared: &'a Shared,
    handler: Option<Handler>,
}

impl<'a> Lent<'a> {
    fn new(shared: &'a Shared) -> Self {
        Self { shared, handler: shared.handler().take() }
    }
}

impl Drop for Lent<'_> {
    fn drop(&mut self) {
        let mut place = self.shared.handler();
        // Another one may have been set meanwhile.
        *place = place.take().or(self.handler.take());
    }
}

/// Holds substates from anywhere in the component: for its tasks.
#[derive(Clone)]
pub struct Substates(Arc<Shared>);

impl Substates {
    /// As [`StateSlave::acquire`].
    ///
    /// # Errors
    /// As there.
    pub fn acquire(&self, sub: &str) -> Result<Held, Status> {
        self.0.acquire(sub)
    }

    /// As [`StateSlave::try_acquire`].
    ///
    /// # Errors
    /// As there.
    pub fn try_acquire(&self, sub: &str) -> Result<Held, Status> {
        self.0.try_acquire(sub)
    }
}

/// The states of this component, which a [`StateMaster`] sets.
pub struct StateSlave {
    shared: Arc<Shared>,
}

impl StateSlave {
    pub(crate) fn new(port: PortHandle, ports: Vec<PortHandle>) -> Self {
        let (machine, handler) = (Mutex::default(), Mutex::default());
        Self { shared: Arc::new(Shared { machine, handler, port, ports }) }
    }

    /// Puts a substate into a main state; makes both where they are new.
    ///
    /// # Errors
    /// `Activated`: too late; `NotAllowed`: a reserved name (main states `Neutral`, `Deactivated`, `Init`, `Alive`,
    /// `FatalError`, `Shutdown`; substates `init`, `neutral`, `nonneutral`, `fatalError`, `shutdown`); `Overload`: more than
    /// 16 main states, or 27 substates.
    pub fn define(&mut self, main: &str, sub: &str) -> Result<(), Status> {
        self.shared.machine().define(main, sub)
    }

    /// The main state to begin with; without it, `Neutral`.
    ///
    /// # Errors
    /// `Error`: no such state; `Activated`: too late.
    pub fn initial(&mut self, main: &str) -> Result<(), Status> {
        self.shared.machine().set_initial(main)
    }

    /// Has a handler told of each substate that is left or entered, while nobody holds it. It runs on the slave's task, with no
    /// lock held.
    pub fn on_change(&mut self, handler: impl FnMut(&mut Context<'_>, &Edge) -> Outcome + Send + 'static) {
        *self.shared.handler() = Some(Box::new(handler));
    }

    /// The states are defined: they can be used from now on, and the component goes to its initial state.
    ///
    /// # Errors
    /// `NotAllowed`: it was activated before.
    pub fn activate(&mut self) -> Result<(), Status> {
        self.life(Life::Alive)
    }

    /// A step of the component's life. The change waits for holders as any other; this does not wait for it.
    ///
    /// # Errors
    /// `NotAllowed`: not from here.
    pub fn life(&mut self, next: Life) -> Result<(), Status> {
        let mut machine = self.shared.machine();
        machine.step(OWN, next)?;
        drop(machine);
        self.shared.wake();
        Ok(())
    }

    /// Holds a substate; waits until it is active and no change is to leave it.
    ///
    /// # Errors
    /// `UnknownState`; `NotActivated`: not activated, or shut down; `Cancelled`: the component is to stop, or may not wait
    /// here.
    pub fn acquire(&self, sub: &str) -> Result<Held, Status> {
        self.shared.acquire(sub)
    }

    /// Holds a substate if that can be done at once.
    ///
    /// # Errors
    /// `UnknownState`; `NotActivated`: not active, or about to be left.
    pub fn try_acquire(&self, sub: &str) -> Result<Held, Status> {
        self.shared.try_acquire(sub)
    }

    /// Lets a substate go that was held by [`Held::keep`]; once too often is no mistake.
    ///
    /// # Errors
    /// `UnknownState`.
    pub fn release(&self, sub: &str) -> Result<(), Status> {
        self.shared.release(sub)
    }

    /// Holds substates from tasks.
    #[must_use]
    pub fn substates(&self) -> Substates {
        Substates(Arc::clone(&self.shared))
    }

    /// For the derives: the component is about to be active.
    #[doc(hidden)]
    pub fn attend(&mut self, cx: &Context<'_>) -> Outcome {
        let (server, shared) = (QueryServer::new(self.shared.port), Arc::clone(&self.shared));
        let mut slave = Slave { server, shared, waiting: HashMap::new(), next: OWN, rushes: false };
        // Its run ends when it is cancelled. It begins anew after a fault of its handler, and each time that a bench says so,
        // where nothing waits.
        let task = Task::new("state").period(Duration::from_millis(10));
        cx.spawn(task, move |cx: &mut Context<'_>| slave.attend(cx))?;
        Ok(())
    }
}

/// The slave's side, on its task.
struct Slave {
    server: QueryServer<StateRequest, StateNames>,
    shared: Arc<Shared>,
    waiting: HashMap<Asker, Pending<StateRequest, StateNames>>,
    next: Asker,
    /// Blocking calls of the component are ended.
    rushes: bool,
}

impl Slave {
    fn attend(&mut self, cx: &mut Context<'_>) -> Outcome {
        if self.shared.machine().is_changing() {
            // Its handler failed: the fault was told.
            self.arrive();
        }
        loop {
            while let Ok(query) = self.server.try_next(cx) {
                self.hear(query.keep());
            }
            while self.change(cx)? {}
            if cx.cancelled() || !(host::get().tasks.wait)(PATIENCE_NS) {
                break;
            }
        }
        if cx.cancelled() {
            self.waiting.drain().for_each(|(_, query)| _ = query.refuse(Status::ProviderStopped));
        }
        Ok(())
    }

    fn hear(&mut self, query: Pending<StateRequest, StateNames>) {
        let Ok(request) = query.request().cloned() else { return };
        if request.what != SET {
            return answer(query, self.tell(&request));
        }
        self.next += 1;
        let taken = self.shared.machine().request(self.next, &request.main);
        match taken {
            Ok(()) => _ = self.waiting.insert(self.next, query),
            Err(status) => answer(query, Err(status)),
        }
    }

    fn tell(&self, request: &StateRequest) -> Result<Vec<Text>, Status> {
        let machine = self.shared.machine();
        match request.what {
            CURRENT => machine.current().map(|name| vec![name.into()]),
            MAINS => machine.mains().map(texts),
            SUBS => machine.subs(&request.main).map(texts),
            _ => Err(Status::Error),
        }
    }

    /// Carries a change out as far as that can be done; true: there may be another.
    fn change(&mut self, cx: &mut Context<'_>) -> Result<bool, crate::component::ComponentError> {
        let turn = self.shared.machine().turn();
        let rushes = self.shared.machine().rushes();
        if rushes && !std::mem::replace(&mut self.rushes, rushes) {
            self.shared.blocking(false);
        }
        let mut told = Ok(());
        if let Some(turn) = &turn {
            let mut lent = Lent::new(&self.shared);
            if let Some(handler) = &mut lent.handler {
                told = turn.edges.iter().try_for_each(|edge| handler(cx, edge));
            }
            drop(lent);
            self.arrive();
        }
        let answers = self.shared.machine().answers();
        for (asker, end) in answers {
            if let Some(query) = self.waiting.remove(&asker) {
                answer(query, end.map(|()| Vec::new()));
            }
        }
        told.map(|()| turn.is_some())
    }

    fn arrive(&mut self) {
        self.shared.machine().arrive();
        if std::mem::take(&mut self.rushes) {
            self.shared.blocking(true);
        }
        self.shared.wake();
    }
}

fn texts(names: Vec<&str>) -> Vec<Text> {
    names.into_iter().map(Text::from).collect()
}

/// A master that has left wants no answer.
fn answer(query: Pending<StateRequest, StateNames>, names: Result<Vec<Text>, Status>) {
    let _ = match names {
        Ok(names) => query.answer(StateNames { names: names.into() }),
        Err(status) => query.refuse(status),
    };
}

/// Sets the states of a component with a [`StateSlave`].
#[derive(Default)]
pub struct StateMaster {
    pub(crate) client: QueryClient<StateRequest, StateNames>,
}

impl StateMaster {
    pub(crate) const fn new(port: PortHandle) -> Self {
        Self { client: QueryClient::new(port) }
    }

    /// Sets the main state, and waits until that is reached: at most as long as the port's `<timeout>` says. The change goes on
    /// after a `Timeout`.
    ///
    /// # Errors
    /// `UnknownState`; `NotActivated`: the slave is not; `NotAllowed`: a step of the slave's life; `Cancelled`: the slave
    /// fails or shuts down, or this port may not wait; `Overload`: more than 8 changes wait; and those of
    /// [`QueryClient::query`].
    pub fn set(&mut self, main: &str) -> Result<(), Status> {
        self.client.query(request(SET, main)).map(drop)
    }

    /// As [`Self::set`], and waits no longer than `time`.
    ///
    /// # Errors
    /// As there.
    pub fn set_within(&mut self, main: &str, time: Duration) -> Result<(), Status> {
        self.client.query_within(request(SET, main), time).map(drop)
    }

    /// The main state that the slave is in.
    ///
    /// # Errors
    /// `NotActivated`, and those of [`QueryClient::query`].
    pub fn current(&mut self) -> Result<String, Status> {
        let names = self.names(CURRENT, "")?;
        names.into_iter().next().ok_or(Status::Error)
    }

    /// All main states of the slave.
    ///
    /// # Errors
    /// As [`Self::current`].
    pub fn mains(&mut self) -> Result<Vec<String>, Status> {
        self.names(MAINS, "")
    }

    /// The substates of a main state.
    ///
    /// # Errors
    /// As [`Self::current`], and `UnknownState`.
    pub fn subs(&mut self, main: &str) -> Result<Vec<String>, Status> {
        self.names(SUBS, main)
    }

    fn names(&mut self, what: u32, main: &str) -> Result<Vec<String>, Status> {
        let names = self.client.query(request(what, main))?;
        Ok(names.names.iter().map(|name| name.as_str().to_owned()).collect())
    }

    /// Whether this port may wait; as [`QueryClient::blocking`].
    ///
    /// # Errors
    /// `Closed`.
    pub fn blocking(&mut self, on: bool) -> Result<(), Status> {
        self.client.blocking(on)
    }

    /// For the derives: the component's gate.
    #[doc(hidden)]
    pub fn component_blocking(&mut self, on: bool) {
        self.client.component_blocking(on);
    }
}

fn request(what: u32, main: &str) -> StateRequest {
    StateRequest { what, main: main.into() }
}
