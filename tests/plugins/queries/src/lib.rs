//! Components that ask and answer: the two sides of the conformance tests of the query pattern.
//!
//! The asker runs one case in each callback and logs how it went. What its peer does, each request says.

mod boot;
mod crowd;
mod ledger;
mod more;
mod server;
mod teller;
mod told;

use component_sdk::prelude::*;

pub use boot::{Early, Late};
pub use crowd::Member;
pub use teller::{Echo, OtherEcho, Teller};

/// All cases, each named after the line of the tables that it stands for; those that cost the teller its life come last.
#[macro_export]
macro_rules! query_cases {
    ($then:ident $($arguments:tt)*) => {
        $then! {
            $($arguments)*
            query_returns_the_answer, query_cancelled_discards, query_not_connected, query_unanswered_token_is_error,
            refused_query_gets_the_servers_status, request_gives_an_id, request_not_connected, request_table_full,
            receive_answer_consumes, receive_not_yet, receive_unknown_id, receive_error_consumes,
            receive_wait_answer_consumes, receive_wait_unknown_id, receive_wait_cancelled_keeps_id,
            receive_wait_error_consumes, receive_wait_timeout_keeps_id, discard_invalidates, discard_unknown_id,
            many_pending_any_order, default_deadline_ends_query, answer_later_from_another_callback, answer_ok,
            active_handler_keeps_the_request, handler_may_query_itself_others, handler_may_wait,
            component_blocking_reaches_every_requestor, three_gates_all_must_be_open, data_wins_over_the_gate, it_is_a_level, flags_not_counters, blocking_has_no_effect_on_request,
            disconnect_before_the_answer_client, disconnect_before_the_answer_server, answer_then_disconnect_then_receive,
            reconnect_does_not_revive_old_ids, cycle_of_two_is_answered, own_service_is_a_cycle, a_large_number_of_queries_loses_nothing,
            new_waits_are_cancelled_at_once, gates_are_checked_before_blocking, cancelling_does_not_consume,
            answer_after_a_cancelled_query_is_ok, wait_with_memory_query, busy_slot_gets_no_second_callback,
            parked_callback_is_no_hang, vector_query_connection, vector_query_out_of_order_and_discard,
            vector_query_disconnect_while_others_wait, vector_query_two_services,
            handler_is_called_with_server_id_request, answer_inside_the_handler, answer_after_client_left,
            server_ids_map_to_client_and_its_id, passive_slow_handler_blocks_its_slot_only,
            query_disconnected_while_pending, receive_disconnected_consumes, receive_wait_disconnected_consumes,
            cycle_of_three_over_executors, active_handler_survives_50000,
            handler_trap_is_contained_and_client_released, handler_panic_is_contained_and_client_released, queued_calls_survive_a_panic, retry_asks_the_successor_once_each, server_crash_next_call,
            queued_calls_survive_a_replacement, server_crash_releases_the_waiter, handler_hang_is_ended_and_client_released,
        }
    };
}

/// A question: what the server is to do, and a number for it.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Ask {
    /// One of the constants of [`mod@todo`].
    pub todo: u32,
    /// What it is about.
    pub number: u64,
}

/// An answer.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Told {
    /// Depends on what was asked.
    pub number: u64,
    /// Number of queries that this instance has handled.
    pub handled: u64,
}

/// What a server may be asked to do.
pub mod todo {
    /// Answer with the number and one.
    pub const ANSWER: u32 = 0;
    /// Keep the query until `LET_GO`.
    pub const KEEP: u32 = 1;
    /// Answer all kept ones, the last first; tells how many there were.
    pub const LET_GO: u32 = 2;
    /// Keep the query and answer it from `on_execute`.
    pub const LATER: u32 = 3;
    /// Let the query go unanswered.
    pub const FORGET: u32 = 4;
    /// Refuse with `NotAllowed`.
    pub const REFUSE: u32 = 5;
    /// Panic.
    pub const PANIC: u32 = 6;
    /// Trap.
    pub const TRAP: u32 = 7;
    /// Loop for ever.
    pub const HANG: u32 = 8;
    /// Ask the third component and pass on what it says.
    pub const ONWARD: u32 = 9;
    /// Ask the asker, who waits; tells the status that this ends with.
    pub const BACK: u32 = 10;
    /// Sleep that many milliseconds, then answer.
    pub const SLEEP: u32 = 11;
    /// Tells the status with which the last kept query was answered.
    pub const REPORT: u32 = 12;
    /// Trap in the first instance, answer in its successor.
    pub const TRAP_ONCE: u32 = 13;
    /// Answer, and report what came of that.
    pub const ANSWER_AND_NOTE: u32 = 14;
    /// Disconnect the asker, and keep the query.
    pub const CUT: u32 = 15;
    /// Ask the third component, which keeps the query, and pass on what it says.
    pub const ONWARD_KEEP: u32 = 16;
    /// Tell how many are kept.
    pub const KEPT: u32 = 17;
    /// Ask the third component, which asks the asker; tells the status that this ends with.
    pub const ROUND: u32 = 18;
}

/// Runs the cases, one in each period.
#[derive(Component)]
#[component(name = "Asker", version = "1.0", periodic = "2ms")]
pub struct Asker {
    /// To the teller.
    #[port]
    tell: QueryClient<Ask, Told>,
    /// To nobody.
    #[port]
    loose: QueryClient<Ask, Told>,
    /// To the teller, with a short timeout, and asked again when it fails.
    #[port]
    again: QueryClient<Ask, Told>,
    /// To its own service.
    #[port]
    own: QueryClient<Ask, Told>,
    /// For those who ask back.
    #[port(handler = on_ask)]
    answers: QueryServer<Ask, Told>,
    /// `all` cases, `stay` in a wait, or `measure` a query.
    #[property(default = "all")]
    run: String,
    next: usize,
    times: Vec<u64>,
}

impl Callbacks for Asker {
    fn initialize(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "in initialize: {:?}", self.tell.query(Ask::default()).err());
        Ok(())
    }

    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        match self.run.as_str() {
            "stay" => return self.stay(cx),
            "measure" => return self.measure(cx),
            _ => {}
        }
        self.next = cases::run(told::ALL, self.next, self, cx);
        Ok(())
    }

    fn stop(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "in stop: {:?}", self.tell.query(Ask::default()).err());
        Ok(())
    }
}

impl Asker {
    fn on_ask(&mut self, _: &mut Context<'_>, query: Query<'_, Ask, Told>) -> Outcome {
        let number = query.number + 1000;
        query.answer(Told { number, handled: 0 })?;
        Ok(())
    }

    /// Times queries, by the thousand: to look at the clock takes as long as a third of one.
    fn measure(&mut self, cx: &mut Context<'_>) -> Outcome {
        for _ in 0..50 {
            let began = cx.clock();
            for number in 0..1000 {
                self.tell.query(Ask { todo: todo::ANSWER, number })?;
            }
            self.times.push(cx.clock().since(began).as_nanos() as u64 / 1000);
        }
        self.times.sort_unstable();
        info!(cx, "a query takes {} ns at best, {} ns mostly", self.times[0], self.times[self.times.len() / 2]);
        self.times.clear();
        Ok(())
    }

    /// Waits for an answer that does not come.
    fn stay(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "waits");
        let told = self.tell.query_within(Ask { todo: todo::KEEP, number: 1 }, std::time::Duration::from_secs(3600));
        info!(cx, "waited: {:?}", told.map(|told| told.number));
        Ok(())
    }
}

export_components!(Asker, Teller, Echo, OtherEcho, Member, Early, Late);
