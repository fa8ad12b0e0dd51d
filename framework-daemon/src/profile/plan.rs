//! The checked whole: what the profiles say, resolved, merged and validated; immutable, shared by `Arc`.
//!
//! Everything to the right of `profile` works from these types and never sees XML.

use std::borrow::Borrow;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use serde::{Serialize, Serializer};

pub use super::composite::CompositePlan;
pub use super::helpers::{ReferenceModelPlan, VotingPlan};
pub use super::needs::{ApplicationDependencyPlan, DependencyPlan, NeededPlan};
pub use super::push::PushPlan;
pub use super::system::OnTaint;
pub use crate::detect::model_diff::Measure;
pub use crate::detect::vote::Method as VotingMethod;
pub use crate::model::schedule::{Policy, Schedule};
use crate::model::symptom::{Severity, SeverityTable, Symptom};

/// Where something was written: file, line and column (both from 1).
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Default)]
pub struct Location {
    /// The profile file, as it was named on the command line or by a reference.
    #[serde(serialize_with = "shown")]
    pub file: Arc<PathBuf>,
    /// Line, from 1.
    pub line: u32,
    /// Column in characters, from 1.
    pub column: u32,
}

/// A path as it is shown: serde refuses paths that are not UTF-8, and such a name must not make a plan unprintable.
fn shown<S: Serializer>(path: &impl Borrow<PathBuf>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&path.borrow().to_string_lossy())
}

fn all_shown<S: Serializer>(paths: &[PathBuf], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(paths.iter().map(|path| path.to_string_lossy()))
}

/// A whole profile directory, checked.
#[derive(Clone, Debug, Serialize)]
pub struct Plan {
    /// The directory that was loaded.
    #[serde(serialize_with = "shown")]
    pub root: PathBuf,
    /// Executors, plugin directories: `system_profile`, or its defaults.
    pub system: SystemPlan,
    /// Names of the applications in the directory.
    pub applications: Vec<String>,
    /// Every slot of every application, composites flattened (`outer.inner`), in file order.
    pub slots: Vec<SlotPlan>,
    /// Every connection, ends resolved to slots, composites' exported ports resolved to inner ones.
    pub connections: Vec<ConnectionPlan>,
    /// Every composite, by name: what shows of it outside.
    pub composites: Vec<CompositePlan>,
    /// Contamination between slots.
    pub dependencies: Vec<DependencyPlan>,
    /// `coordination/depends`: pairs of slots, the second of which runs first (not active yet).
    pub order: Vec<(String, String)>,
    /// Ports that a helper watches (not active yet).
    pub monitors: Vec<MonitorPlan>,
    /// Slots compared with a model.
    pub reference_models: Vec<ReferenceModelPlan>,
    /// Redundant outputs that are voted over.
    pub votings: Vec<VotingPlan>,
}

/// What a `system_profile` says.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SystemPlan {
    /// Name of the system; empty without a `system_profile`.
    pub name: String,
    /// Directories searched for plugins, absolute or relative to the profile's file, already joined.
    #[serde(serialize_with = "all_shown")]
    pub plugin_dirs: Vec<PathBuf>,
    /// Declared executors. A slot without one gets its own.
    pub executors: Vec<ExecutorPlan>,
    /// Other daemons (not active yet).
    pub nodes: Vec<NodePlan>,
    /// Contamination between applications.
    pub dependencies: Vec<ApplicationDependencyPlan>,
    /// Slots that get the emergency stop, in order.
    pub emergency: Vec<String>,
    /// What to do when shared memory may be damaged.
    pub on_taint: OnTaint,
}

/// Another daemon.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NodePlan {
    /// Name that `node_id` refers to.
    pub name: String,
    /// Where it listens.
    pub address: String,
    /// Where it was declared.
    pub location: Location,
}

/// A port that a helper component watches.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MonitorPlan {
    /// The port.
    pub port: PortRef,
    /// Range checks.
    pub validity: Vec<Validity>,
    /// Silence longer than this is a fault.
    pub max_age: Option<Duration>,
    /// Where it was declared.
    pub location: Location,
}

/// One declared executor thread.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ExecutorPlan {
    /// Name that slots refer to.
    pub name: String,
    /// Period of its periodic slots that declare none of their own.
    pub period: Option<Duration>,
    /// Scheduling policy, priority and affinity.
    pub schedule: Schedule,
    /// Where it was declared.
    pub location: Location,
}

/// One slot: a named place in an application that an instance fills.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SlotPlan {
    /// Unique name; inner components of composites are `outer.inner`.
    pub name: String,
    /// Name of the application it belongs to.
    pub application: String,
    /// The primary component class.
    pub component: Arc<ComponentPlan>,
    /// Property values: the component profile's, overridden by the subcomponent's. Later duplicates are gone.
    pub properties: Vec<Property>,
    /// Name of a declared executor; `None`: one of its own.
    pub executor: Option<String>,
    /// Name of the node that runs it, as written (not active yet); `None`: this one.
    pub node: Option<String>,
    /// What to do about faults.
    pub rules: FaultRules,
    /// Where the subcomponent was declared.
    pub location: Location,
}

/// A property and its text value, checked against `type_name` where the type is known.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Property {
    /// Name.
    pub name: String,
    /// Type as written (`double`, `int`, `std::string`, ...).
    #[serde(rename = "type")]
    pub type_name: String,
    /// The text.
    pub value: String,
}

/// What a `component_profile` says.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ComponentPlan {
    /// Class name: what the plugin must export.
    pub name: String,
    /// Version as written; may be empty.
    pub version: String,
    /// `library_name` as written (`Foo.dll`, `libfoo.so`, `foo`).
    pub library: String,
    /// When and how its callbacks run.
    pub execution: Execution,
    /// Declared properties with their defaults.
    pub properties: Vec<Property>,
    /// Data ports.
    pub data_ports: Vec<DataPortPlan>,
    /// Event ports.
    pub event_ports: Vec<EventPortPlan>,
    /// Service ports.
    pub service_ports: Vec<ServicePortPlan>,
    /// Where the profile's root element stands.
    pub location: Location,
}

/// What `execution_semantics` says.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Execution {
    /// What wakes the component.
    pub trigger: Trigger,
    /// Thread scheduling, for a slot with an executor of its own.
    pub schedule: Schedule,
    /// How long `on_execute` may take.
    pub deadline: Option<Deadline>,
    /// Size of the fiber's stack in bytes; `None`: the default.
    pub stack: Option<usize>,
    /// `lifecycle_type`: `start` runs it at boot (true), anything else leaves it initialised (false).
    pub autostart: bool,
    /// `singleton`: at most one slot may use the class.
    pub singleton: bool,
}

/// How long a callback may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Deadline {
    /// Beyond it an overrun.
    pub budget: Duration,
    /// Beyond it a hang: the callback is ended.
    pub hang: Duration,
}

/// What wakes a component.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase", tag = "type", content = "period")]
pub enum Trigger {
    /// Each period, on absolute time.
    Periodic(Duration),
    /// When data or an event arrives.
    Nonperiodic,
    /// Never by itself.
    Passive,
}

/// Direction of a data or event port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Usage {
    /// Receives.
    Input,
    /// Sends.
    Output,
}

/// A data port.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DataPortPlan {
    /// Name, unique in the component.
    pub name: String,
    /// Direction.
    pub usage: Usage,
    /// Type name as written.
    pub data_type: String,
    /// How an input buffers.
    pub queue: Queue,
    /// Range checks on this end.
    pub validity: Vec<Validity>,
    /// Silence longer than this is a fault (input ports).
    pub max_age: Option<Duration>,
    /// What holds of values that are pushed, instead of what the class says.
    pub push: PushPlan,
    /// Where it was declared.
    pub location: Location,
}

/// How an input port buffers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase", tag = "policy")]
pub enum Queue {
    /// The newest value only; reading does not consume it.
    Last,
    /// First in, first out.
    Fifo {
        /// Most values held.
        size: usize,
        /// What happens beyond it.
        overflow: Overflow,
    },
}

/// What a full FIFO does with one more value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Overflow {
    /// The oldest value makes room (OPRoS).
    #[default]
    DropOldest,
    /// The new value is lost.
    DropNewest,
    /// The new value is lost, and that is a fault (`overload`).
    Fault,
}

/// A range check on a field of a communication object.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Validity {
    /// Path of the field, `linear.x`; empty: the object is a single number.
    pub field: String,
    /// Lower bound, inclusive.
    pub min: Option<Limit>,
    /// Upper bound, inclusive.
    pub max: Option<Limit>,
    /// Largest change per second.
    pub max_rate: Option<f64>,
    /// How long the value must be bad before it is a fault.
    pub delay: Duration,
    /// What the reader gets meanwhile.
    pub on_invalid: OnInvalid,
    /// Where it was declared.
    pub location: Location,
}

/// A bound: a constant, or a linear function of another field of the same object.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Limit {
    /// A constant.
    Constant(f64),
    /// `slope * field + offset`.
    Linear {
        /// Factor.
        slope: f64,
        /// Path of the other field.
        of: String,
        /// Offset.
        offset: f64,
    },
}

/// What the reader gets instead of an invalid value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum OnInvalid {
    /// Nothing.
    #[default]
    Drop,
    /// The last valid value.
    Hold,
    /// The value as it is.
    Pass,
}

/// An event port.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct EventPortPlan {
    /// Name, unique in the component.
    pub name: String,
    /// Direction.
    pub usage: Usage,
    /// Type name as written.
    pub data_type: String,
    /// Events that may wait at an input; `None`: what its class says.
    pub queue_size: Option<usize>,
    /// What a full queue does with one more.
    pub overflow: Overflow,
    /// Activations that an input may have at once.
    pub activations: usize,
    /// Longest time that an input waits for an event, where its author does not say.
    pub timeout: Duration,
    /// Where it was declared.
    pub location: Location,
}

/// A service port.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ServicePortPlan {
    /// Name, unique in the component.
    pub name: String,
    /// True for `provided`, false for `required`.
    pub provided: bool,
    /// Interface type name.
    pub type_name: String,
    /// XML file of the interface, as written.
    pub reference: String,
    /// Calls that may wait for a provided service.
    pub queue_size: usize,
    /// Calls that a required service may have open at once.
    pub pending: usize,
    /// Longest time that a call of a required service is waited for, where its author does not say.
    pub timeout: Duration,
    /// What becomes of a call of a required service when its provider fails.
    pub on_gone: OnGone,
    /// Where it was declared.
    pub location: Location,
}

/// What becomes of a call when its provider fails while it has it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum OnGone {
    /// The caller is told.
    #[default]
    Fail,
    /// The provider's successor is asked again.
    Retry,
}

/// The pattern of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PortKind {
    /// Data port to data port.
    Data,
    /// Event port to event port.
    Event,
    /// Required service port to provided service port.
    Service,
}

/// One end of a connection.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize)]
pub struct PortRef {
    /// Slot name.
    pub slot: String,
    /// Port name.
    pub port: String,
}

/// One out-port to one in-port.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ConnectionPlan {
    /// Its pattern.
    pub kind: PortKind,
    /// Output or required end.
    pub source: PortRef,
    /// Input or provided end.
    pub target: PortRef,
    /// Range checks on the connection.
    pub validity: Vec<Validity>,
    /// What becomes of a call when its provider fails; `None`: what the required port says.
    pub on_gone: Option<OnGone>,
    /// Where it was declared.
    pub location: Location,
}

/// What `fault_tolerance` says.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FaultRules {
    /// What to do about each symptom.
    pub severity: SeverityTable,
    /// Symptoms that have a severity by their own name.
    #[serde(skip)]
    pub named: Vec<Symptom>,
    /// Restart intensity.
    pub reset: Option<Intensity>,
    /// Alternative classes with the same ports, in order.
    pub secondaries: Vec<SecondaryPlan>,
    /// Pool of standbys of the same class.
    pub spares: Option<SparePlan>,
    /// Period of checkpoints.
    pub checkpoint: Option<Duration>,
    /// Declared target, fault to first good callback; a breach is a fault, `late`.
    pub recovery_within: Option<Duration>,
    /// Where the instance lives (`process` is not active yet).
    pub isolation: Isolation,
    /// How far a fault-stop of this slot reaches.
    pub coverage: Coverage,
}

impl FaultRules {
    /// Spares that are created and initialised before a fault. Where the rules name none: one, if a fault that loses the
    /// instance is answered by a reset.
    #[must_use]
    pub fn ready_spares(&self) -> usize {
        let loses = |symptom: &Symptom| symptom.loses_instance() && self.severity.get(*symptom) == Severity::Reset;
        let resets = self.reset.is_none_or(|intensity| intensity.limit > 0) && Symptom::ALL.iter().any(loses);
        match self.spares {
            Some(spares) if spares.preload == Preload::Instance => spares.count as usize,
            Some(_) => 0,
            None => usize::from(resets),
        }
    }
}

/// At most `limit` resets within `within`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Intensity {
    /// Most resets; 0: replace at once.
    pub limit: u32,
    /// Window.
    pub within: Duration,
}

/// A secondary of a recovery block.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SecondaryPlan {
    /// Its class.
    pub component: Arc<ComponentPlan>,
    /// Its property values: its own profile's, overridden by the slot's where it declares them too.
    pub properties: Vec<Property>,
    /// How far it is prepared.
    pub preload: Preload,
    /// Where it was declared.
    pub location: Location,
}

/// Standbys of the same class.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct SparePlan {
    /// How many.
    pub count: u32,
    /// How far each is prepared.
    pub preload: Preload,
}

/// How far a standby is prepared before it is needed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Preload {
    /// Not at all: library loaded at the fault.
    None,
    /// Library loaded.
    Library,
    /// Instance created and initialised.
    #[default]
    Instance,
}

/// Where an instance lives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Isolation {
    /// In the daemon's process.
    #[default]
    Thread,
    /// In a host process of its own.
    Process,
}

/// How far a fault reaches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Coverage {
    /// The slot alone.
    #[default]
    Component,
    /// All slots of its executor.
    Executor,
    /// Everything.
    System,
}
