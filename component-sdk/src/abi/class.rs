//! What a plugin exports.

use abi_stable::StableAbi;
use abi_stable::std_types::{ROption, RSlice, RStr, RString};

use super::calls::ServeArgs;
use super::host::HostApi;
use super::payload::PortHandle;
use super::push::PushDecl;
use crate::object::{CommObject, TypeDescriptor};
use crate::property::PropertyKind;

/// The root of a plugin.
#[repr(C)]
#[derive(StableAbi)]
#[sabi(kind(Prefix(prefix_ref = PluginModuleRef)))]
#[sabi(missing_field(panic))]
pub struct PluginModule {
    /// Hands the plugin its host and installs the panic hook; called once, before anything else.
    pub install: extern "C" fn(host: &'static HostApi),
    /// The classes it exports.
    #[sabi(last_prefix_field)]
    pub classes: extern "C" fn() -> RSlice<'static, ComponentClass>,
}

/// One component class: its description and its shims.
#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct ComponentClass {
    /// What it is.
    pub decl: ClassDecl,
    /// Builds an instance; `Ok` carries it.
    pub create: for<'a> extern "C" fn(args: &CreateArgs<'a>) -> CreateResult,
    /// Enters a callback.
    pub call: for<'a> extern "C" fn(instance: *mut (), args: &CallArgs<'a>) -> CallStatus,
    /// Drops the instance.
    pub drop: extern "C" fn(instance: *mut ()) -> CallStatus,
}

/// The description of a class.
#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct ClassDecl {
    /// Class name: what a component profile's `name` refers to.
    pub name: RStr<'static>,
    /// Version.
    pub version: RStr<'static>,
    /// First paragraph of the type's documentation.
    pub description: RStr<'static>,
    /// What wakes it.
    pub trigger: TriggerDecl,
    /// Ports, in the order in which `create` gets them.
    pub ports: RSlice<'static, PortDecl>,
    /// Properties, in the order in which `create` gets their texts.
    pub properties: RSlice<'static, PropertyDecl>,
    /// Fields that make up the checkpoint.
    pub criticals: RSlice<'static, CriticalDecl>,
    /// Size of an instance in bytes.
    pub size: usize,
}

/// What wakes a class, unless its profile says otherwise.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub enum TriggerDecl {
    /// Each period.
    Periodic {
        /// In nanoseconds.
        period_ns: u64,
    },
    /// Arriving data or events.
    Nonperiodic,
    /// Nothing.
    Passive,
}

/// How the two ends of a connection deal with each other.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pattern {
    /// A writer sends values to its readers.
    Push,
    /// A client asks a server.
    Query,
    /// A client sends to a server, which answers nothing.
    Send,
    /// A server tells those of its clients whose test is true.
    Event,
    /// A writer sends events to its readers, which are entered for each.
    EventPort,
}

/// Direction of a port.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Receives: values, events, or what a server answers or takes.
    Input,
    /// Sends: values, events, or what a client asks or sends.
    Output,
}

/// A port.
#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct PortDecl {
    /// Name; of a method's port that of the service port that it belongs to.
    pub name: RStr<'static>,
    /// Interface of the service port that it is a part of; empty: it is a port of its own.
    pub service: RStr<'static>,
    /// The method that is called through it; empty: it is a port of its own.
    pub method: RStr<'static>,
    /// Pattern.
    pub pattern: Pattern,
    /// Direction.
    pub direction: Direction,
    /// What it carries; the request of a query, the parameters of a method.
    pub object: &'static TypeDescriptor,
    /// The answer of a query, the parameter of an event's activation.
    pub answer: ROption<&'static TypeDescriptor>,
    /// The component has a handler for what comes in.
    pub handler: bool,
    /// Size of the FIFO of an input, or of the queue of arrivals for its handler; 0: keeps the newest only.
    pub fifo: usize,
    /// Others find it by its name; if not, the component says when they do.
    pub listed: bool,
    /// What only push ports have.
    pub push: PushDecl,
    /// Documentation of the field.
    pub description: RStr<'static>,
}

impl PortDecl {
    /// One that is filled in later.
    pub(crate) const NONE: Self = Self {
        name: RStr::empty(),
        service: RStr::empty(),
        method: RStr::empty(),
        pattern: Pattern::Push,
        direction: Direction::Input,
        object: <()>::DESCRIPTOR,
        answer: ROption::RNone,
        handler: false,
        listed: true,
        fifo: 0,
        push: PushDecl::DATA,
        description: RStr::empty(),
    };

    /// Its name in its class: `scan`, or `motors/drive` where it is a method of a service port.
    #[must_use]
    pub fn full_name(&self) -> String {
        if self.method.is_empty() { self.name.to_string() } else { format!("{}/{}", self.name, self.method) }
    }
}

/// A property.
#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct PropertyDecl {
    /// Name.
    pub name: RStr<'static>,
    /// What its text must be.
    pub kind: PropertyKind,
    /// Text used where the profile says nothing.
    pub default: RStr<'static>,
    /// Unit; empty: none.
    pub unit: RStr<'static>,
    /// Least value of a number.
    pub min: f64,
    /// Greatest value of a number.
    pub max: f64,
    /// Documentation of the field.
    pub description: RStr<'static>,
}

/// A field of the instance that belongs to its checkpoint.
#[repr(C)]
#[derive(StableAbi, Clone, Copy, Debug)]
pub struct CriticalDecl {
    /// Name of the field.
    pub name: RStr<'static>,
    /// Offset in the instance, in bytes.
    pub offset: usize,
    /// Size in bytes.
    pub size: usize,
}

/// What `create` is given.
#[repr(C)]
#[derive(StableAbi)]
pub struct CreateArgs<'a> {
    /// One handle a port, in the class's order.
    pub ports: RSlice<'a, PortHandle>,
    /// One text a property, in the class's order.
    pub properties: RSlice<'a, RStr<'a>>,
}

/// What `create` returns.
#[repr(C)]
#[derive(StableAbi)]
pub struct CreateResult {
    /// The instance; null when it failed.
    pub instance: *mut (),
    /// How it ended.
    pub status: CallStatus,
    /// Why it failed.
    pub error: RString,
}

/// Which callback to enter.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[allow(missing_docs, reason = "each is documented at the callback of that name")]
pub enum Hook {
    Initialize,
    Start,
    Execute,
    Update,
    Event,
    Stop,
    Destroy,
    Error,
    Reset,
    Recover,
    Rehearse,
    Serve,
    Emergency,
}

/// What a callback is entered with.
#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct CallArgs<'a> {
    /// Which one.
    pub hook: Hook,
    /// Fault to provoke first; 0: none (see [`super::inject`]).
    pub inject: u8,
    /// Monotonic time of entry in nanoseconds; 0: not looked at.
    pub now_ns: u64,
    /// The fault that led here, for `Error` and `Recover`.
    pub fault: FaultArgs<'a>,
    /// What is to be served, for `Serve`.
    pub serve: ServeArgs,
}

/// A fault as `on_error` and `recover` get it.
#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct FaultArgs<'a> {
    /// Symptom name.
    pub symptom: RStr<'a>,
    /// Blamed slot.
    pub slot: RStr<'a>,
    /// Message.
    pub message: RStr<'a>,
}

impl FaultArgs<'static> {
    /// No fault.
    pub const NONE: Self = Self { symptom: RStr::empty(), slot: RStr::empty(), message: RStr::empty() };
}

/// How a shim ended.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub enum CallStatus {
    /// Well.
    Done,
    /// The callback returned an error; its text went to [`HostApi::note_error`].
    Error,
    /// The callback panicked; message and place went to [`HostApi::note_panic`].
    Panic,
}
