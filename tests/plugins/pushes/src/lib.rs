//! Components that put and listen: the two sides of the conformance tests of the push pattern.
//!
//! The listener runs one case in each callback and logs how it went. What its peer does, it is asked for by queries.

mod many;
mod newest;
mod sender;
mod table;
mod timed;
mod wild;

use component_sdk::prelude::*;

pub use many::{Counter, Feeder, LAST};
pub use sender::{OtherSender, Sender, Waiter};
pub use wild::Wild;

/// All cases, each named after the line of the tables that it stands for; those that cost the sender its life come last.
#[macro_export]
macro_rules! push_cases {
    ($then:ident $($arguments:tt)*) => {
        $then! {
            $($arguments)*
            new_server_is_not_running, not_started_subscribe_ok, not_started_update_and_wait, put_when_stopped,
            started_with_its_slot, subscribe_ok, subscribe_twice_ok, second_subscribe_keeps_the_prescale, subscribe_unconnected,
            subscribe_prescale_zero, subscribe_needs_no_acknowledgement, unsubscribe_ok, unsubscribe_twice_ok,
            unsubscribe_drops_the_value, update_newest_is_not_consumed, update_no_data, update_unsubscribed,
            update_disconnected, update_never_from_an_earlier_subscription, update_wait_is_for_the_next_arrival,
            update_wait_cancelled, update_wait_unsubscribed, update_wait_disconnected, update_wait_timed_not_activated,
            update_wait_timeout_is_timeout, disconnect_unsubscribes_and_wakes,
            put_reaches_every_subscriber_in_the_callers_thread, put_says_that_one_failed_and_serves_the_others,
            put_reports_any_failing_client, put_without_subscribers_ok, buffer_is_one_value, one_put_wakes_all_waiters,
            every_nth_put_first_at_once, counter_is_per_client, subscribe_below_one, server_info, server_info_unconnected,
            server_stop_drops_value_and_wakes, start_resets_counters_first_tick_at_once, start_twice_is_no_op,
            stop_tells_clients, stop_twice_is_no_op, handler_each_cycle, counters_count_calls_not_time,
            timed_no_data_and_stopped_are_told_apart, put_from_anywhere_with_prescale, min_cycle_time_thins,
            busy_slot_gets_no_second_callback, input_handler_each_arrival, input_handler_prescale,
            prescale_above_one_is_called,
            data_input_is_subscribed_by_its_connection, data_output_feeds_a_client, profile_prescale_overrides,
            profile_period_overrides, no_data_is_nothing_since_subscription, unsubscribed_while_connected,
            new_end_is_not_connected, connect_ok, connect_disconnects_first, connect_unknown_service, connect_wrong_type,
            connect_failed_leaves_disconnected, disconnect_ok_when_connected, disconnect_ok_when_not_connected,
            disconnect_of_a_subscribed_client_is_fast, component_blocking_reaches_every_requestor,
            three_gates_all_must_be_open, new_waits_are_cancelled_at_once, push_has_no_memory_so_is_cancelled, it_is_a_level,
            flags_not_counters, wait_without_memory_push, subscribe_zero_leaves_no_lock, own_server_is_a_cycle,
            waiting_for_each_other_is_a_cycle, vector_push_connection, vector_push_prescale_2, vector_push_two_waiters,
            crash_releases_push_waits, subscription_outlives_the_servers_crash,
        }
    };
}

/// What a peer is to do, and with which number.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Order {
    /// One of the constants of [`mod@todo`].
    pub todo: u32,
    /// What it is about.
    pub number: u64,
}

/// What a peer may be asked to do. What is done *later* is done in one of its next periods.
pub mod todo {
    /// Put the number; tells how it was delivered.
    pub const PUT: u32 = 0;
    /// Put the number in each period from now on.
    pub const PUT_ON: u32 = 1;
    /// Stop that.
    pub const STILL: u32 = 2;
    /// Start the timed server.
    pub const START: u32 = 3;
    /// Stop it.
    pub const STOP: u32 = 4;
    /// Stop it later.
    pub const STOP_LATER: u32 = 5;
    /// Put the number to the timed server's clients.
    pub const PUT_TIMED: u32 = 6;
    /// Tells how often the timed server's handler was entered.
    pub const TICKS: u32 = 7;
    /// Put the number by the server with a least time.
    pub const PUT_THIN: u32 = 8;
    /// Put the number by the server one of whose readers has a queue of one place.
    pub const PUT_NARROW: u32 = 9;
    /// Write the number to a data output.
    pub const WRITE: u32 = 10;
    /// Disconnect the listener's first client later.
    pub const CUT_LATER: u32 = 11;
    /// Trap later.
    pub const TRAP_LATER: u32 = 12;
    /// Wait for the next value of the own client; tells it.
    pub const WAIT: u32 = 13;
    /// Sleep that many milliseconds.
    pub const SLEEP: u32 = 14;
    /// Wait for the listener's next value; tells the status that this ends with.
    pub const WAIT_BACK: u32 = 15;
}

/// Runs the cases, one in each period.
#[derive(Component)]
#[component(name = "Hearer", version = "1.0", periodic = "2ms")]
pub struct Hearer {
    /// To the sender.
    #[port]
    order: QueryClient<Order, u64>,
    /// To the other one who waits.
    #[port]
    other: QueryClient<Order, u64>,
    /// Of the sender's first server.
    #[port]
    newest: PushClient<u64>,
    /// As the first.
    #[port]
    second: PushClient<u64>,
    /// As the first, with a handler.
    #[port(handler = on_value, fifo = 16)]
    handled: PushClient<u64>,
    /// As the first, with a handler for every second value.
    #[port(handler = on_second, prescale = 2)]
    halved: PushClient<u64>,
    /// As the first; connected is subscribed.
    #[port(fifo = 32)]
    data: DataIn<u64>,
    /// As the one before; the profile says: every third.
    #[port(fifo = 32)]
    thirds: DataIn<u64>,
    /// As the first; the profile says: every fourth.
    #[port]
    fourths: PushClient<u64>,
    /// Of the timed server.
    #[port]
    timed: PushClient<u64>,
    /// Of the timed server, too.
    #[port]
    again: PushClient<u64>,
    /// Of a timed server that starts with its slot.
    #[port]
    auto: PushClient<u64>,
    /// Of the server with a least time.
    #[port]
    thin: PushClient<u64>,
    /// One place, of the server whose values are too many for it.
    #[port(fifo = 1)]
    narrow: DataIn<u64>,
    /// Beside it.
    #[port]
    beside: PushClient<u64>,
    /// Of a data output.
    #[port]
    written: PushClient<u64>,
    /// Of nobody.
    #[port]
    loose: PushClient<u64>,
    /// Of the own server.
    #[port]
    own: PushClient<u64>,
    /// For itself, and for the sender.
    #[port]
    feed: PushServer<u64>,
    /// `all` cases, or `stay` in a wait.
    #[property(default = "all")]
    run: String,
    next: usize,
    values: Vec<u64>,
    seconds: Vec<u64>,
    /// Periods for which it waits at most for its handlers.
    awaits: u32,
}

impl Callbacks for Hearer {
    fn initialize(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "in initialize: {:?} {:?}", self.newest.subscribe(1), self.newest.update_wait());
        Ok(())
    }

    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        if self.run == "stay" {
            return self.stay(cx);
        }
        if self.awaits > 0 && (self.values.len() < 6 || self.seconds.len() < 3) {
            self.awaits -= 1;
            return Ok(());
        }
        self.next = cases::run(table::ALL, self.next, self, cx);
        Ok(())
    }

    fn stop(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "in stop: {:?}", self.newest.update_wait());
        Ok(())
    }
}

impl Hearer {
    fn on_value(&mut self, _: &mut Context<'_>, value: &u64) -> Outcome {
        self.values.push(*value);
        Ok(())
    }

    fn on_second(&mut self, _: &mut Context<'_>, value: &u64) -> Outcome {
        self.seconds.push(*value);
        Ok(())
    }

    /// Waits for a value that does not come.
    fn stay(&mut self, cx: &mut Context<'_>) -> Outcome {
        let _ = self.newest.subscribe(2);
        info!(cx, "waits");
        let value = self.newest.update_wait_within(std::time::Duration::from_secs(3600)).copied();
        info!(cx, "waited: {value:?}");
        if value == Err(Status::ProviderReplaced) {
            // The successor is there soon.
            let _ = cx.sleep(std::time::Duration::from_millis(20));
        }
        Ok(())
    }
}

export_components!(Hearer, Sender, OtherSender, Waiter, Wild, Feeder, Counter);
