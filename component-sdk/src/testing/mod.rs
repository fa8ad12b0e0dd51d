//! Drives one component step by step, without the daemon: a test of an algorithm is a test of the component.
//!
//! ```
//! # use component_sdk::prelude::*;
//! # #[derive(Component)]
//! # #[component(name = "Halver")]
//! # pub struct Halver { #[port] heard: DataIn<Pose2D>, #[port] said: DataOut<Pose2D>, #[property(default = 0.5)] factor: f64 }
//! # impl Callbacks for Halver {
//! #     fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
//! #         if let Some(pose) = self.heard.newest() { self.said.write(Pose2D { x: pose.x * self.factor, ..*pose }); }
//! #         Ok(())
//! #     }
//! # }
//! use component_sdk::testing::Bench;
//!
//! let mut bench = Bench::<Halver>::with(&[("factor", "0.25")]).unwrap();
//! bench.put("heard", Pose2D { x: 8.0, ..Pose2D::default() });
//! bench.execute().unwrap();
//! assert_eq!(bench.take::<Pose2D>("said").unwrap().x, 2.0);
//! ```
#![allow(unsafe_code, reason = "address of unsafe: plays the daemon's side of the border")]

mod calls;
mod devices;
mod events;
mod links;
mod pushes;
mod sends;
mod tasks;

use std::cell::RefCell;
use std::collections::VecDeque;

use abi_stable::std_types::{RSlice, RStr};

use crate::abi::class::{ClassDecl, CreateArgs, Direction, Pattern};
use crate::abi::host::{self, HostApi};
use crate::abi::payload::{LoanResult, PortHandle, ReadMode, ReadResult};
use crate::component::{Callbacks, FaultInfo, Outcome};
use crate::context::{Context, Level};
use crate::object::{CommObject, TypeDescriptor};
use crate::property::Builder;

pub use calls::Asked;

/// A component on the bench: its ports end here.
pub struct Bench<C> {
    component: C,
    decl: ClassDecl,
    // A handle is a port's address: there are never more, and they do not move with the bench. Not boxed: who moves a box says
    // that nobody else has its address.
    ports: Vec<RefCell<BenchPort>>,
    now_ns: u64,
}

/// One port end. Objects are leaked boxes, as in the daemon: only typed code drops what is in them.
struct BenchPort {
    name: RStr<'static>,
    object: &'static TypeDescriptor,
    queue: VecDeque<(*mut u8, u64)>,
    current: Option<(*mut u8, u64)>,
    fifo: bool,
    answer: Option<&'static TypeDescriptor>,
    calls: calls::Calls,
    events: events::Events,
    handler: bool,
    push: pushes::Push,
}

thread_local! {
    static RECORD: RefCell<Record> = const {
        RefCell::new(Record { now_ns: 0, logs: Vec::new(), faults: Vec::new(), devices: devices::Told::NONE, safe_outputs: Vec::new(), wirings: Vec::new(), tasks: Vec::new(), cancelled: false, error: String::new() })
    };
}

struct Record {
    now_ns: u64,
    logs: Vec<(u8, String)>,
    faults: Vec<String>,
    devices: devices::Told,
    safe_outputs: Vec<(i32, Vec<u8>)>,
    wirings: Vec<String>,
    tasks: Vec<tasks::Started>,
    cancelled: bool,
    error: String,
}

impl<C: Callbacks> Bench<C> {
    /// A component with its properties' defaults.
    ///
    /// # Errors
    /// When a default is outside its own range.
    pub fn new() -> Result<Self, crate::component::ComponentError> {
        Self::with(&[])
    }

    /// A component with these property texts; the others have their defaults.
    ///
    /// # Errors
    /// When a text does not fit its property, or names none.
    pub fn with(properties: &[(&str, &str)]) -> Result<Self, crate::component::ComponentError> {
        host::set(&BENCH);
        let left = RECORD.with_borrow_mut(|record| {
            record.devices = devices::Told::NONE;
            std::mem::take(&mut record.tasks)
        });
        drop(left);
        let decl = C::DECL;
        if let Some((name, _)) =
            properties.iter().find(|(name, _)| decl.properties.iter().all(|p| p.name.as_str() != *name))
        {
            return Err(crate::fault!("the class has no property `{name}`"));
        }
        let texts: Vec<RStr<'_>> = decl
            .properties
            .iter()
            .map(|p| {
                properties
                    .iter()
                    .find(|(name, _)| p.name.as_str() == *name)
                    .map_or(p.default, |(_, text)| RStr::from_str(text))
            })
            .collect();
        let ports: Vec<_> = decl.ports.iter().map(|port| RefCell::new(BenchPort::new(port))).collect();
        let handles: Vec<_> = ports.iter().map(|port| PortHandle(std::ptr::from_ref(port).cast())).collect();
        let args = CreateArgs { ports: RSlice::from_slice(&handles), properties: RSlice::from_slice(&texts) };
        let component = C::build(&mut Builder::new(&args, decl.properties.as_slice()))?;
        Ok(Self { component, decl, ports, now_ns: 1_000_000_000 })
    }

    /// The component itself.
    pub fn component(&mut self) -> &mut C {
        &mut self.component
    }

    /// Lets time pass.
    pub fn advance(&mut self, by: std::time::Duration) {
        self.now_ns += u64::try_from(by.as_nanos()).unwrap_or(u64::MAX);
    }

    /// Sends `object` to an input port; a push client that is not subscribed, or not to this one, does not get it.
    ///
    /// # Panics
    /// When the class has no such input, or it carries another type.
    pub fn put<T: CommObject>(&mut self, port: &str, object: T) {
        let now = self.now_ns;
        let mut port = self.port::<T>(port, Direction::Input).borrow_mut();
        if port.push.wants(Direction::Input) {
            port.queue.push_back((Box::into_raw(Box::new(object)).cast(), now));
        }
    }

    /// What the component sent last over an output port since it was last asked.
    ///
    /// # Panics
    /// When the class has no such output, or it carries another type.
    pub fn take<T: CommObject>(&mut self, port: &str) -> Option<T> {
        let mut port = self.port::<T>(port, Direction::Output).borrow_mut();
        let newest = port.queue.pop_back();
        port.queue.clear();
        // SAFETY: `loan` filled the block with a `Box`'s memory and the component wrote a `T` there; `port` checked
        // that the port carries `T`; the block left the queue, so it is taken once.
        newest.map(|(value, _)| *unsafe { Box::from_raw(value.cast::<T>()) })
    }

    fn port<T: CommObject>(&self, name: &str, direction: Direction) -> &RefCell<BenchPort> {
        let found = self.decl.ports.iter().position(|port| {
            port.name.as_str() == name
                && port.direction == direction
                && matches!(port.pattern, Pattern::Push | Pattern::EventPort)
        });
        let index = found.unwrap_or_else(|| panic!("the class has no {direction:?} port `{name}`"));
        let object = self.decl.ports[index].object;
        assert_eq!(object.layout_hash, T::DESCRIPTOR.layout_hash, "port `{name}` carries {}", object.name);
        &self.ports[index]
    }

    fn enter(&mut self, callback: impl FnOnce(&mut C, &mut Context<'_>) -> Outcome) -> Outcome {
        RECORD.with_borrow_mut(|record| record.now_ns = self.now_ns);
        callback(&mut self.component, &mut Context::new(self.now_ns, &BENCH))
    }

    /// Calls `initialize` and `start`.
    ///
    /// # Errors
    /// The component's own.
    pub fn start(&mut self) -> Outcome {
        self.enter(C::initialize)?;
        self.enter(|component, cx| component.start(cx).and_then(|()| component.attend(cx)))
    }

    /// Calls `on_execute`.
    ///
    /// # Errors
    /// The component's own.
    pub fn execute(&mut self) -> Outcome {
        self.enter(C::on_execute)
    }

    /// Calls `update`.
    ///
    /// # Errors
    /// The component's own.
    pub fn update(&mut self) -> Outcome {
        self.enter(C::update)
    }

    /// Calls `rehearse`, as on an instance that is to stand ready.
    ///
    /// # Errors
    /// The component's own.
    pub fn rehearse(&mut self) -> Outcome {
        self.enter(C::rehearse)
    }

    /// Calls `stop`.
    ///
    /// # Errors
    /// The component's own.
    pub fn stop(&mut self) -> Outcome {
        self.enter(C::stop)
    }

    /// Calls `on_error` and `reset`, as after a panic with this message.
    ///
    /// # Errors
    /// The component's own.
    pub fn fail(&mut self, message: &str) -> Outcome {
        let fault = FaultInfo { symptom: "crash.panic", slot: "bench", message };
        self.enter(|component, cx| component.on_error(cx, &fault))?;
        self.enter(C::reset)
    }

    /// What was logged on this thread since the last call.
    #[must_use]
    pub fn logs() -> Vec<(Level, String)> {
        let level =
            |number| [Level::Error, Level::Warn, Level::Info, Level::Debug][usize::from(u8::clamp(number, 1, 4)) - 1];
        RECORD.with_borrow_mut(|record| record.logs.drain(..).map(|(number, text)| (level(number), text)).collect())
    }

    /// The faults raised on this thread since the last call.
    #[must_use]
    pub fn faults() -> Vec<String> {
        RECORD.with_borrow_mut(|record| std::mem::take(&mut record.faults))
    }

    /// The safe outputs that are registered on this thread: descriptor and bytes.
    #[must_use]
    pub fn safe_outputs() -> Vec<(i32, Vec<u8>)> {
        RECORD.with_borrow(|record| record.safe_outputs.clone())
    }

    /// What was connected, `a.x - b.y`, and disconnected, `a.x -`, in that order. A port of the component's own has no slot:
    /// `x - b.y`, `x -`; `x = name`, `x =` are names that it was given and that were taken away.
    #[must_use]
    pub fn wirings() -> Vec<String> {
        RECORD.with_borrow(|record| record.wirings.clone())
    }
}

impl BenchPort {
    fn new(decl: &crate::abi::class::PortDecl) -> Self {
        Self {
            name: decl.name,
            object: decl.object,
            queue: VecDeque::new(),
            current: None,
            fifo: decl.fifo > 0 || decl.pattern == Pattern::EventPort,
            answer: decl.answer.into_option(),
            calls: calls::Calls::new(decl),
            events: events::Events::default(),
            handler: decl.handler,
            push: pushes::Push::new(decl.push),
        }
    }

    fn read(&mut self, mode: ReadMode) -> ReadResult {
        let next =
            if self.fifo && mode == ReadMode::Take { self.queue.pop_front() } else { self.queue.drain(..).next_back() };
        self.current = next.or(self.current.take_if(|_| mode == ReadMode::Newest));
        self.current.map_or(ReadResult::NONE, |(value, stamp_ns)| ReadResult { value, stamp_ns })
    }
}

static BENCH: HostApi = HostApi {
    clock,
    log,
    raise_fault,
    note_error: tasks::note_error,
    note_panic: ignore_panic,
    note_injection: nothing,
    critical: ignore_region,
    loan,
    publish,
    give_back,
    read,
    safe_output,
    sleep,
    calls: calls::API,
    events: events::API,
    links: links::API,
    tasks: tasks::API,
    pushes: pushes::API,
    devices: devices::API,
};

extern "C" fn clock() -> u64 {
    RECORD.with_borrow(|record| record.now_ns)
}

extern "C" fn log(level: u8, text: RStr<'_>) {
    RECORD.with_borrow_mut(|record| record.logs.push((level, text.to_string())));
}

extern "C" fn raise_fault(text: RStr<'_>) {
    RECORD.with_borrow_mut(|record| record.faults.push(text.to_string()));
}

/// The bench's clock goes on by that much.
extern "C" fn sleep(nanos: u64) -> bool {
    RECORD.with_borrow_mut(|record| record.now_ns = record.now_ns.saturating_add(nanos));
    true
}

extern "C" fn safe_output(fd: i32, bytes: RSlice<'_, u8>) {
    RECORD.with_borrow_mut(|record| {
        record.safe_outputs.retain(|(known, _)| *known != fd);
        if !bytes.is_empty() {
            record.safe_outputs.push((fd, bytes.to_vec()));
        }
    });
}

extern "C" fn ignore_panic(_: RStr<'_>, _: RStr<'_>, _: u32) {}
extern "C" fn ignore_region(_: RStr<'_>, _: *mut u8, _: usize) {}
extern "C" fn nothing() {}

/// The port behind a handle of the bench; `None`: a closed one, of which the port was taken.
fn port<'a>(handle: PortHandle) -> Option<&'a RefCell<BenchPort>> {
    // SAFETY: the bench gives out handles of its own ports only and owns them longer than the component; both live on
    // one thread.
    unsafe { handle.0.cast::<RefCell<BenchPort>>().as_ref() }
}

extern "C" fn loan(handle: PortHandle) -> LoanResult {
    let Some(port) = port(handle) else { return LoanResult::CLOSED };
    let object = port.borrow().object;
    let layout =
        std::alloc::Layout::from_size_align(object.size.max(1), object.align).expect("a compiler's own layout");
    // SAFETY: the size is not zero.
    LoanResult { value: unsafe { std::alloc::alloc(layout) }, initialised: false }
}

extern "C" fn publish(handle: PortHandle, value: *mut u8) -> u32 {
    port(handle).map_or(crate::port::Sent::Closed as u32, |port| pushes::publish(&mut port.borrow_mut(), value))
}

extern "C" fn give_back(_: PortHandle, _: *mut u8) {}

extern "C" fn read(handle: PortHandle, mode: ReadMode) -> ReadResult {
    port(handle).map_or(ReadResult::NONE, |port| port.borrow_mut().read(mode))
}
