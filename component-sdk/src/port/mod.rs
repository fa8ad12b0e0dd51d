//! Typed port ends. A port belongs to its slot, not to the instance: replacing an instance never rewires anything.
//!
//! One file a pattern. Every operation that may wait ends: by what it waits for, by its deadline, or by a status that
//! says what came between.

mod data;
mod event;
mod push;
mod query;
mod requestor;
mod send;
mod service;
mod state;

pub use data::{DataIn, DataOut, Loan, Sent};
pub use event::{EventClient, EventId, EventIn, EventOut, EventServer, EventState};
pub use push::{Delivered, PushClient, PushLoan, PushServer, PushTimedServer, ServerInfo};
pub use query::{Answer, Pending, Query, QueryClient, QueryId, QueryServer, Reply, Request};
pub use requestor::Requestor;
pub use send::{Message, Outgoing, SendClient, SendServer};
pub use service::{MethodDecl, Provided, Required, Service, all_ports, method_ports, port_count};
pub use state::{Held, StateMaster, StateNames, StateRequest, StateSlave, Substates};
