//! The six patterns, asked the same by one interface: what their clients have in common, whatever comes back. A further pattern
//! is a line more here; a further transport is one more of [`Transport`], and is asked all of it.

use crate::rig::{Suite, Transport};
use crate::{event, push, query, send, wiring};

/// What each of them must do.
struct Common {
    pattern: &'static str,
    suite: &'static Suite,
    /// A client that leads nowhere is told so.
    unconnected: &'static str,
    /// What goes over it arrives.
    arrives: &'static str,
    /// It can be connected to somebody else while everything runs.
    rewired: &'static str,
    /// What does not fit is refused.
    refused: &'static str,
    /// It can be cut while everything runs.
    cut: &'static str,
    /// A wait, or a call, ends when the other side fails or is not there.
    other_side: &'static str,
}

impl Common {
    fn cases(&self) -> [&'static str; 6] {
        [self.unconnected, self.arrives, self.rewired, self.refused, self.cut, self.other_side]
    }
}

static PATTERNS: [Common; 6] = [
    Common {
        pattern: "send",
        suite: &send::SUITE,
        unconnected: "send_unconnected",
        arrives: "send_handler_gets_the_value",
        rewired: "connect_disconnects_first",
        refused: "connect_wrong_type",
        cut: "send_after_disconnect",
        other_side: "server_crash_loses_its_message_only",
    },
    Common {
        pattern: "query",
        suite: &query::SUITE,
        unconnected: "query_not_connected",
        arrives: "query_returns_the_answer",
        rewired: "reconnect_does_not_revive_old_ids",
        refused: "vector_query_two_services",
        cut: "query_disconnected_while_pending",
        other_side: "server_crash_releases_the_waiter",
    },
    Common {
        pattern: "push newest",
        suite: &push::SUITE,
        unconnected: "update_disconnected",
        arrives: "update_newest_is_not_consumed",
        rewired: "connect_disconnects_first",
        refused: "connect_wrong_type",
        cut: "update_wait_disconnected",
        other_side: "crash_releases_push_waits",
    },
    Common {
        pattern: "push timed",
        suite: &push::SUITE,
        unconnected: "server_info_unconnected",
        arrives: "handler_each_cycle",
        rewired: "connect_disconnects_first",
        refused: "connect_wrong_type",
        cut: "disconnect_unsubscribes_and_wakes",
        other_side: "update_wait_timed_not_activated",
    },
    Common {
        pattern: "event",
        suite: &event::SUITE,
        unconnected: "activate_unconnected",
        arrives: "client_handler_for_every_firing",
        rewired: "event_connect_disconnects_first",
        refused: "event_connect_wrong_type",
        cut: "waiting_disconnected_id_gone",
        other_side: "a_wait_goes_on_with_the_servers_successor",
    },
    Common {
        pattern: "wiring",
        suite: &wiring::SUITE,
        unconnected: "disconnect_unconnected_ok",
        arrives: "connect_by_master",
        rewired: "rewire_under_traffic_loses_nothing_elsewhere",
        refused: "connect_incompatible",
        cut: "disconnect_by_master_ok",
        other_side: "connect_service_unavailable",
    },
];

#[test]
fn six_patterns() {
    for transport in [Transport::Near, Transport::Far] {
        for common in &PATTERNS {
            println!("{}", common.pattern);
            common.cases().into_iter().for_each(|case| common.suite.passes(transport, case));
        }
    }
}
