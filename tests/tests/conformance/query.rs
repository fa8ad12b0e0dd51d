//! Query: client, server, disconnection, blocking, handlers.

use tests::running::Running;

use crate::rig::{Transport, conformance, profiles};

conformance! {
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
    handler_panic_is_contained_and_client_released, retry_asks_the_successor_once_each, server_crash_next_call,
    queued_calls_survive_a_replacement, server_crash_releases_the_waiter, handler_hang_is_ended_and_client_released,
}

/// The asker waits for an answer that does not come.
fn waiting(transport: Transport) -> (tests::profiles::Profiles, Running) {
    let profiles = profiles(transport, "stay");
    let daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("waits");
    // Into the middle of the wait.
    std::thread::sleep(std::time::Duration::from_millis(50));
    (profiles, daemon)
}

#[test]
fn stop_while_parked() {
    for transport in [Transport::Near, Transport::Far] {
        let (_profiles, mut daemon) = waiting(transport);
        let slots = daemon.stop();
        let log = daemon.log();
        assert!(log.contains("waited: Err(Cancelled)") || log.contains("waited: Err(ProviderStopped)"), "{log}");
        assert!(slots.iter().all(|slot| slot["faults"] == 0), "{slots:?}");
    }
}

#[test]
fn wait_in_constructor_stop_destroy_recover_is_cancelled() {
    let (_profiles, mut daemon) = waiting(Transport::Far);
    daemon.stop();
    daemon.wait_for("in initialize: Some(Disconnected)");
    let stop = daemon.lines("in stop: ");
    assert!(!stop.is_empty() && stop.iter().all(|line| !line.contains("None")), "{stop:?}");
}

#[test]
fn server_ends_in_order() {
    for transport in [Transport::Near, Transport::Far] {
        let (profiles, mut daemon) = waiting(transport);
        // The teller is built anew.
        profiles.replace("Teller.xml", "<version>1.0</version>", "<version>1.1</version>");
        daemon.signal("HUP");
        daemon.wait_for("waited: Err(ProviderReplaced)");
        daemon.wait_for_lines(": waits", 2);
        // Until the new one is there it is told the same again; then it waits.
        let mut before = usize::MAX;
        while daemon.lines("waited: ").len() != before {
            before = daemon.lines("waited: ").len();
            std::thread::sleep(std::time::Duration::from_millis(300));
        }
        let ends = daemon.lines("waited: ");
        assert!(ends.iter().all(|end| end.contains("ProviderReplaced")), "{ends:?}");
        assert!(daemon.lines(": waits").len() > ends.len());
        daemon.stop();
    }
}

#[test]
fn reload_while_parked() {
    for transport in [Transport::Near, Transport::Far] {
        let (profiles, mut daemon) = waiting(transport);
        profiles.replace("Asker.xml", "<version>1.0</version>", "<version>1.1</version>");
        daemon.signal("HUP");
        daemon.wait_for("waited: Err(Cancelled)");
        daemon.wait_for_lines("waits", 2);
        let slots = daemon.stop();
        assert!(slots.iter().all(|slot| slot["faults"] == 0), "{slots:?}");
    }
}
