//! Components that send and that call methods: the conformance tests of messages and service types.
//!
//! The sender runs one case in each callback and logs how it went. What its peer does, each order says.

mod board;
mod called;
mod sent;
mod taker;

use component_sdk::prelude::*;

pub use board::{Board, BoardMethods, FewMethods, Miser, OtherBoard, OtherMethods};
pub use taker::{ActiveTaker, ActiveTeller, Taker};

/// An order: what the taker is to do, and a number for it.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Order {
    /// One of the constants of [`mod@todo`].
    pub todo: u32,
    /// What it is about.
    pub number: u64,
    /// A remark.
    pub remark: Text,
}

/// What a taker has taken.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Taken {
    /// The numbers, in the order in which they were taken, since somebody asked last.
    pub numbers: Sequence<u64>,
    /// The last remark.
    pub remark: Text,
    /// When the last one was taken, in nanoseconds.
    pub at_ns: u64,
}

/// What a taker may be ordered to do.
pub mod todo {
    /// Note the number.
    pub const NOTE: u32 = 0;
    /// Sleep that many milliseconds, then note it.
    pub const SLEEP: u32 = 1;
    /// Panic.
    pub const PANIC: u32 = 2;
    /// Trap.
    pub const TRAP: u32 = 3;
    /// Trap in the first instance, note the number in its successor.
    pub const TRAP_ONCE: u32 = 4;
    /// Loop for ever.
    pub const HANG: u32 = 5;
}

/// All cases of the send pattern, those that cost the taker its life last.
#[macro_export]
macro_rules! send_cases {
    ($then:ident $($arguments:tt)*) => { $then! { $($arguments)*
        new_end_is_not_connected, send_unconnected, send_handler_gets_the_value, send_ok_means_handed_over,
        send_does_not_wait, send_is_by_value, send_many_clients_one_server, send_full_queue_is_overload,
        send_after_disconnect, send_before_disconnect_arrives, send_handler_may_wait, a_dropped_loan_is_not_sent,
        blocking_ok_and_no_effect_on_send, connect_ok, connect_disconnects_first, connect_unknown_service,
        connect_wrong_type, connect_wrong_pattern, connect_failed_leaves_disconnected, connect_inside_a_callback,
        disconnect_ok_when_connected, disconnect_ok_when_not_connected, disconnected_whatever_disconnect_returned,
        send_queued_by_an_active_server_is_fifo, active_handler_is_one_worker_fifo, active_handler_of_another_is_not_allowed,
        active_handler_times_out, a_large_number_of_messages_loses_nothing,
        vector_send_connection, vector_send_api, handler_panic_is_contained,
        retry_serves_the_successor_once_each, server_crash_loses_its_message_only, handler_hang_is_ended,
    } };
}

/// All cases of service types.
#[macro_export]
macro_rules! service_cases {
    ($then:ident $($arguments:tt)*) => { $then! { $($arguments)*
        blocking_method_is_a_query, nonblocking_method_is_a_send, method_without_parameters_or_result,
        method_may_be_asked_for_later, method_may_refuse, method_may_wait, parameters_go_by_value_or_reference,
        unconnected_call_is_disconnected, server_may_have_more, blocking_reaches_every_method,
        component_blocking_reaches_every_method, missing_method_is_incompatible, other_layout_is_incompatible,
        one_method_may_be_wired_by_itself, failed_connect_leaves_disconnected, disconnect_by_the_services_name,
        names_of_a_service_lead_to_it, methods_are_served_in_the_order_of_the_calls,
    } };
}

/// Runs the cases, one in each period.
#[derive(Component)]
#[component(name = "Sender", version = "1.0", periodic = "2ms")]
pub struct Sender {
    /// To the taker.
    #[port]
    order: SendClient<Order>,
    /// To the taker, and to its successor.
    #[port]
    again: SendClient<Order>,
    /// To nobody.
    #[port]
    loose: SendClient<Order>,
    /// What the taker has taken.
    #[port]
    taken: QueryClient<u64, Taken>,
    /// To the active taker.
    #[port]
    active: SendClient<Order>,
    /// To the active teller.
    #[port]
    asked: QueryClient<u64, u64>,
    /// From the active taker.
    #[port]
    told: SendServer<Order>,
    /// Has a handler.
    #[port(handler = on_order)]
    handled: SendServer<Order>,
    /// To the board.
    #[port]
    board: Required<dyn BoardMethods>,
    /// To the board as well, with fewer methods.
    #[port]
    few: Required<dyn FewMethods>,
    /// To nobody.
    #[port]
    nobody: Required<dyn BoardMethods>,
    /// `sends`, `calls` or `measure`.
    #[property(default = "sends")]
    run: String,
    next: usize,
}

impl Callbacks for Sender {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        match self.run.as_str() {
            "sends" => self.next = cases::run(sent::ALL, self.next, self, cx),
            "calls" => self.next = cases::run(called::ALL, self.next, self, cx),
            _ => return self.measure(cx),
        }
        Ok(())
    }
}

impl Sender {
    fn on_order(&mut self, _: &mut Context<'_>, _: &Order) -> Outcome {
        Ok(())
    }

    /// Sends for ever, a few at a time.
    fn measure(&mut self, cx: &mut Context<'_>) -> Outcome {
        for number in 0..200 {
            match self.order.send(Order { number, ..Order::default() }) {
                Ok(()) => {}
                Err(Status::Overload) => _ = cx.sleep(std::time::Duration::from_millis(1)),
                Err(other) => return Err(other.into()),
            }
            self.board.beep(440)?;
            self.board.turn(0.5)?;
        }
        Ok(())
    }
}

export_components!(Sender, Taker, ActiveTaker, ActiveTeller, Board, Miser, OtherBoard);
