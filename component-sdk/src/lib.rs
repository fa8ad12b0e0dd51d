//! The one crate a component author needs.
//!
//! ```
//! use component_sdk::prelude::*;
//!
//! /// Halves what it hears.
//! #[derive(Component)]
//! #[component(name = "Halver", version = "1.0", nonperiodic)]
//! pub struct Halver {
//!     #[port]
//!     heard: DataIn<Pose2D>,
//!     #[port]
//!     said: DataOut<Pose2D>,
//!     #[property(default = 0.5, unit = "1", range = 0.0..=1.0)]
//!     factor: f64,
//! }
//!
//! impl Callbacks for Halver {
//!     fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
//!         if let Some(pose) = self.heard.newest() {
//!             self.said.write(Pose2D { x: pose.x * self.factor, ..*pose });
//!         }
//!         Ok(())
//!     }
//! }
//!
//! export_components!(Halver);
//! # fn main() {}
//! ```
//!
//! Build it as a `cdylib`, drop the `.so` into the plugin directory, name the class in a component profile.
//! The component need not know anything about faults: the integrator adds fault tolerance in the profiles.

// The derives name this crate as its users do; the SDK's own objects use them too.
extern crate self as component_sdk;

/// The binary contract between plugin and daemon, on one page.
pub mod abi;

/// What a component is: the traits that an author implements.
pub mod component;

/// What a callback is given: clock, log, `raise_fault`.
pub mod context;

/// Devices that are lost and found again.
pub mod device;

/// Communication objects: what makes a type one, and what its description is good for.
pub mod object;

/// The standard set of communication objects, with ROS 2's field names.
pub mod objects;

/// Typed port ends.
pub mod port;

/// Typed properties, read from the profile.
pub mod property;

/// The states of a component: a table and a few pure functions.
pub mod state;

/// What the operations of the communication patterns answer.
pub mod status;

/// Threads of a component.
pub mod task;

/// Connections made and cut while everything runs.
pub mod wiring;

/// Drives one component step by step, without the daemon.
pub mod testing;

pub use component_sdk_derive::{CommObject, Component, service};

/// All that a component's source file needs.
pub mod prelude {
    pub use crate::abi::events::Mode;
    pub use crate::component::{Callbacks, ComponentError, FaultInfo, Outcome};
    pub use crate::context::{Context, Instant, Level};
    pub use crate::object::{CommObject, Sequence, Text};
    pub use crate::objects::*;
    pub use crate::port::{
        DataIn, DataOut, Delivered, Loan, Message, Pending, Provided, PushClient, PushServer, PushTimedServer, Query,
        QueryClient, QueryId, QueryServer, Requestor, Required, SendClient, SendServer, Sent,
    };
    pub use crate::port::{EventClient, EventId, EventIn, EventOut, EventServer, EventState};
    pub use crate::port::{Held, StateMaster, StateSlave, Substates};
    pub use crate::state::{Edge, Life};
    pub use crate::status::Status;
    pub use crate::task::{Job, Task};
    pub use crate::{CommObject, Component, error, export_components, fault, info, service, warn};
}

/// For the derives: a text of fixed layout.
#[doc(hidden)]
#[must_use]
pub const fn abi_name(text: &'static str) -> abi_stable::std_types::RStr<'static> {
    abi_stable::std_types::RStr::from_str(text)
}

/// For the derives: a slice of fixed layout.
#[doc(hidden)]
#[must_use]
pub const fn abi_slice<T>(slice: &'static [T]) -> abi_stable::std_types::RSlice<'static, T> {
    abi_stable::std_types::RSlice::from_slice(slice)
}

/// For the derives: the answer of a query.
#[doc(hidden)]
#[must_use]
pub const fn some_object(
    object: &'static object::TypeDescriptor,
) -> abi_stable::std_types::ROption<&'static object::TypeDescriptor> {
    abi_stable::std_types::ROption::RSome(object)
}

/// For the derives: no answer.
#[doc(hidden)]
#[must_use]
pub const fn no_object() -> abi_stable::std_types::ROption<&'static object::TypeDescriptor> {
    abi_stable::std_types::ROption::RNone
}

/// For the derives: the size of a checkpoint field, which must be plain data (copied byte by byte).
#[doc(hidden)]
#[must_use]
pub const fn critical_size<T: Copy + Send + 'static>() -> usize {
    size_of::<T>()
}
