//! Components that wire themselves and others: the conformance tests of what every requestor has, and of the wiring pattern.
//!
//! The wirer runs one case in each callback and logs how it went. It begins each with nothing connected and leaves it so.

mod paper;
mod peers;
mod requestor;
mod wiring;

use component_sdk::prelude::*;

pub use peers::{Adder, Crowd, Kept, Lister, OtherAdder, Speaker, Sum};

/// What every requestor has.
#[macro_export]
macro_rules! requestor_cases {
    ($then:ident $($arguments:tt)*) => {
        $then! {
            $($arguments)*
            new_end_is_not_connected, unlisted_end_is_no_port, declared_end_is_a_wireable_port,
            add_makes_it_wireable, add_again_renames, add_taken_name_is_refused, add_leaves_the_connection,
            add_of_no_name_is_an_error, remove_hides_it, remove_of_no_port_is_ok, remove_leaves_the_connection,
            connect_ok, connect_disconnects_first, connect_to_the_same_disconnects_first, connect_unknown_service,
            connect_wrong_type, connect_failed_leaves_disconnected, connect_never_waits, connect_inside_a_callback,
            disconnect_ok_when_connected, disconnect_ok_when_not_connected, disconnect_releases_waiters_first,
            disconnect_does_not_wait_for_a_hung_server, blocking_ok_and_no_effect_on_request,
            reader_connects_itself,
        }
    };
}

/// The wiring pattern.
#[macro_export]
macro_rules! wiring_cases {
    ($then:ident $($arguments:tt)*) => {
        $then! {
            $($arguments)*
            names_are_slot_and_port, every_slot_is_a_slave, connect_by_master, connect_cancelled,
            connect_unknown_component, connect_unknown_port, connect_service_unavailable, connect_incompatible,
            disconnect_by_master_ok, disconnect_unconnected_ok, disconnect_unknown_component,
            disconnect_unknown_port, failed_connect_leaves_disconnected, compatibility_by_layout,
            wrong_type_incompatible, wrong_pattern_incompatible, refusal_names_both_sides,
            removed_port_keeps_connection_unknown_to_masters, duplicate_port_name,
            masters_at_once_are_serialised_per_port, rewire_under_traffic_loses_nothing_elsewhere,
        }
    };
}

/// What the paper promises beside its patterns' tables.
#[macro_export]
macro_rules! paper_cases {
    ($then:ident $($arguments:tt)*) => {
        $then! { $($arguments)* three_ways_to_be_wired, add_remove, connect_any_time, by_value }
    };
}

/// A question.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, Default, PartialEq)]
pub struct Ask {
    /// One of the constants of [`mod@todo`].
    pub todo: u32,
    /// What it is about.
    pub number: u64,
}

/// An answer.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, Default, PartialEq)]
pub struct Told {
    /// Depends on what was asked.
    pub number: u64,
}

/// What a server may be asked to do.
pub mod todo {
    /// Add its summand.
    pub const ANSWER: u32 = 0;
    /// Keep the query until `REPORT`.
    pub const KEEP: u32 = 1;
    /// Answer what is kept; tells the status that this ended with, or nothing where nothing is kept.
    pub const REPORT: u32 = 2;
    /// Disconnect the wirer's port and let its question go unanswered for a while.
    pub const CUT: u32 = 3;
    /// Connect its own client in the handler and tell what that one is told.
    pub const ONWARD: u32 = 4;
    /// Stay in the handler for that many milliseconds, without a wait.
    pub const HOLD: u32 = 5;
}

/// Runs the cases, one in each period.
#[derive(Component)]
#[component(name = "Wirer", version = "1.0", periodic = "2ms")]
pub struct Wirer {
    /// Found by its name.
    #[port]
    ask: QueryClient<Ask, Told>,
    /// Another one.
    #[port]
    again: QueryClient<Ask, Told>,
    /// Not found until a case says so.
    #[port(unlisted)]
    hidden: QueryClient<Ask, Told>,
    /// Values.
    #[port]
    heard: DataIn<u64>,
    /// Values, found by nobody.
    #[port(unlisted)]
    overheard: DataIn<u64>,
    /// Which cases: `requestor`, `wiring`, `paper`, or none.
    #[property(default = "requestor")]
    run: String,
    next: usize,
}

impl Callbacks for Wirer {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        let all = match self.run.as_str() {
            "requestor" => requestor::ALL,
            "wiring" => wiring::ALL,
            "paper" => paper::ALL,
            _ => return Ok(()),
        };
        self.next = cases::run(all, self.next, self, cx);
        for port in [&mut self.ask, &mut self.again, &mut self.hidden] {
            port.disconnect()?;
        }
        self.heard.disconnect()?;
        self.overheard.disconnect()?;
        Ok(())
    }
}

impl Wirer {
    /// Asks for a sum.
    fn sum(&mut self, number: u64) -> Result<u64, Status> {
        number_of(self.ask.query(Ask { todo: todo::ANSWER, number }))
    }
}

fn number_of(told: Result<component_sdk::port::Reply<'_, Told>, Status>) -> Result<u64, Status> {
    told.map(|told| told.number)
}

/// The status of a refusal.
fn status<T>(result: Result<T, component_sdk::wiring::Refusal>) -> Result<T, Status> {
    result.map_err(|refusal| refusal.status)
}

export_components!(Wirer, Adder, OtherAdder, Speaker, Kept, Crowd, Lister);
