//! XML text to a checked plan: `source -> xml -> conform -> component/application/... -> assemble -> validate -> plan`.
//!
//! Every step goes on after an error, so that one run tells all that is wrong in all files.

/// Bytes to text, offsets to lines and columns.
pub mod source;

/// Text to a tree of elements with spans.
pub mod xml;

/// Every element and attribute, as data.
pub mod vocabulary;

/// A tree against its vocabulary.
pub mod conform;

/// `component_profile`.
pub mod component;

/// Data ports: which values a reader gets, how often a writer sends.
mod push;

/// `application_profile` and `package_profile`.
pub mod application;

/// `composite_component_profile`.
pub mod composite;

/// `system_profile`.
pub mod system;

/// `data_type`.
pub mod data_type;

/// `service_port_type_profile`.
pub mod service_type;

/// `fault_tolerance` and `validity`.
pub mod fault_rules;

/// One file, whatever its root.
pub mod document;

/// The files of a directory, and how a reference finds its file.
pub mod files;

/// Slots and connections: references followed, composites flattened.
pub mod assemble;

/// A slot: what fills it, its properties, its secondaries.
pub mod fill;

/// What a composite hands down to the slots inside.
pub mod inherit;

/// Connections: both ends resolved and checked.
pub mod wire;

/// Models and voters that the framework inserts.
pub mod helpers;

/// What no file can tell alone.
pub mod validate;

/// What a plan promises and cannot keep.
pub mod admit;

/// A directory to a plan.
pub mod load;

/// One file alone.
pub mod single;

/// Contamination, as the plan has it.
mod needs;

/// The checked whole that everything to the right works from.
pub mod plan;

/// Old plan, new plan: what a reload has to touch.
pub mod diff;

/// The vocabulary as XML Schema.
pub mod xsd;

/// Findings: where, what, the way out.
pub mod diagnostic;

/// Text to times, numbers and sizes.
pub mod quantity;

/// The nearest right name to a wrong one.
pub mod suggest;

pub use load::{Loaded, load};
