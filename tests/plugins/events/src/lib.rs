//! Components that tell of events and hear of them: the two sides of the conformance tests of the event pattern.
//!
//! The watcher runs one case in each callback and logs how it went. What its peer does, each request says.

mod faults;
mod heard;
mod measurer;
mod wired;

use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use component_sdk::prelude::*;

pub use faults::{FaultListener, FaultReporter};
pub use measurer::{Chime, Measurer, OtherMeasurer};

/// All cases, each named after the line of the tables that it stands for; those that cost the measurer its life come last.
#[macro_export]
macro_rules! event_cases {
    ($then:ident $($arguments:tt)*) => {
        $then! {
            $($arguments)*
            activate_ok_many_ids, activate_unconnected, deactivate_ok, deactivate_wrong_id,
            single_needs_deactivate_after_firing, deactivate_after_disconnect, single_try_active_fired_passive,
            continuous_try_fired_active, try_does_not_consume, single_get_unconsumed, single_get_consumed_passive,
            single_get_waits, continuous_get_newest, continuous_get_waits, single_next_after_fired_passive,
            single_next_waits, continuous_next_ignores_buffered, waiting_cancelled_keeps_id,
            waiting_disconnected_id_gone, get_timeout, next_timeout, default_deadline_ends_an_event_wait,
            several_waiters_same_event, storage_is_one_event_overwritten, client_handler_begins,
            client_handler_for_every_firing, put_tests_every_activation_of_every_client, test_true_fires_that_activation,
            parameter_is_kept_per_activation_and_mutable, single_is_not_sent_again_test_still_runs, on_activation_hook,
            event_is_fresh_for_each_activation, put_says_that_one_failed, put_without_activations_ok,
            event_wait_has_memory, event_data_wins_over_the_gate, event_gate_is_a_level_and_no_counter,
            component_blocking_reaches_event_clients, new_event_client_is_not_connected, event_connect_ok,
            event_connect_disconnects_first, event_connect_to_the_same_disconnects_first, event_connect_unknown_service, event_connect_wrong_type,
            event_connect_wrong_pattern, event_connect_failed_leaves_disconnected,
            event_disconnect_ok_connected_or_not, event_disconnect_tells_the_server, own_event_is_a_cycle,
            event_port_begins, event_port_delivers_each_in_order, event_port_overflow_by_rule,
            vector_event_connection, vector_event_three_activations, vector_event_single, vector_event_continuous,
            vector_event_threshold, a_panic_in_a_test_is_contained, parameters_survive_a_replaced_server,
            a_wait_goes_on_with_the_servers_successor, a_parameter_left_half_changed_is_nobodys,
        }
    };
}

/// What a client asks for.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Threshold {
    /// The level.
    pub above: f64,
    /// It was above when it was tested last: told only when that changes. Not looked at where `always`.
    pub was: bool,
    /// Told each time that it is above.
    pub always: bool,
    /// Owns memory that both sides use.
    pub label: Text,
}

/// What it is told.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Crossing {
    /// The value.
    pub value: f64,
    /// The activation's label.
    pub label: Text,
    /// What was there before: nothing, in an event that is fresh.
    pub before: f64,
}

/// A request: what the measurer is to do.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Ask {
    /// One of the constants of [`mod@todo`].
    pub todo: u32,
    /// What it is about.
    pub value: f64,
}

/// What became of it.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Told {
    /// Code of the status of a put; 0: it went well.
    pub status: u32,
    /// Tests that ran in it.
    pub tests: u64,
    /// Activations that the instance was told of.
    pub activations: u64,
}

/// What the measurer may be asked to do.
pub mod todo {
    /// Put that value.
    pub const PUT: u32 = 0;
    /// Answer, and put that value a moment later.
    pub const PUT_LATER: u32 = 1;
    /// Answer, and cut the connection of the watcher a moment later.
    pub const CUT_LATER: u32 = 2;
    /// Send that many events, numbered from 1.
    pub const SEND: u32 = 3;
    /// Panic in a test.
    pub const PANIC_IN_TEST: u32 = 4;
    /// Trap in a test.
    pub const TRAP_IN_TEST: u32 = 5;
    /// Trap.
    pub const TRAP: u32 = 6;
    /// Answer, and trap a moment later; the successor puts that value.
    pub const TRAP_LATER: u32 = 7;
}

/// Runs the cases, one in each period.
#[derive(Component)]
#[component(name = "Watcher", version = "1.0", periodic = "2ms")]
pub struct Watcher {
    /// Has the measurer do something.
    #[port]
    ask: QueryClient<Ask, Told>,
    /// At the measurer.
    #[port]
    level: EventClient<Threshold, Crossing>,
    /// At the measurer, with a handler and a small queue.
    #[port(handler = on_crossing)]
    heard: EventClient<Threshold, Crossing>,
    /// At nobody.
    #[port]
    loose: EventClient<Threshold, Crossing>,
    /// At its own server.
    #[port]
    own: EventClient<Threshold, Crossing>,
    /// For itself.
    #[port]
    mine: EventServer<Threshold, Crossing>,
    /// With a handler.
    #[port(handler = on_alarm)]
    alarms: EventIn<u64>,
    /// Without one.
    #[port(fifo = 3)]
    notes: EventIn<u64>,
    /// Without one; keeps the first ones.
    #[port(fifo = 3)]
    first_notes: EventIn<u64>,
    /// `all` cases, `stay` in a wait, `fall` with activations, or `measure` events of all kinds.
    #[property(default = "all")]
    run: String,
    next: usize,
    measured: Option<EventId<Crossing>>,
    /// What the handlers got.
    crossings: Vec<f64>,
    alarmed: Vec<u64>,
    noted: Vec<u64>,
    first_noted: Vec<u64>,
    /// How much of it the next case waits for, and how long it has.
    awaited: usize,
    patience: u32,
}

impl Callbacks for Watcher {
    fn initialize(&mut self, cx: &mut Context<'_>) -> Outcome {
        info!(cx, "in initialize: {:?}", self.level.activate(Mode::Single, Threshold::default()).err());
        Ok(())
    }

    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        match self.run.as_str() {
            "stay" => return self.stay(cx),
            "fall" => return self.fall(cx),
            "measure" => return self.measure(),
            _ => {}
        }
        let got = self.crossings.len() + self.alarmed.len() + self.noted.len() + self.first_noted.len();
        if got < self.awaited && self.patience > 0 {
            self.patience -= 1;
            return Ok(());
        }
        self.next = cases::run(heard::ALL, self.next, self, cx);
        Ok(())
    }

    fn on_event(&mut self, _: &mut Context<'_>) -> Outcome {
        self.noted.extend(self.notes.take().copied());
        self.first_noted.extend(self.first_notes.take().copied());
        Ok(())
    }

    fn stop(&mut self, cx: &mut Context<'_>) -> Outcome {
        let id = self.level.activate(Mode::Single, Threshold::default());
        info!(cx, "in stop: {:?}", id.and_then(|id| self.level.get_event(id).cloned()).err());
        Ok(())
    }
}

impl Watcher {
    fn on_crossing(&mut self, _: &mut Context<'_>, _: EventId<Crossing>, event: &Crossing) -> Outcome {
        self.crossings.push(event.value);
        Ok(())
    }

    fn on_alarm(&mut self, _: &mut Context<'_>, event: &u64) -> Outcome {
        self.alarmed.push(*event);
        Ok(())
    }

    /// Waits for an event that does not come.
    fn stay(&mut self, cx: &mut Context<'_>) -> Outcome {
        let id = match self.level.activate(Mode::Continuous, Threshold { above: 1e9, ..Threshold::default() }) {
            Ok(id) => id,
            Err(status) => {
                info!(cx, "waited: Err({status:?})");
                return Ok(());
            }
        };
        info!(cx, "waits");
        let event = self.level.get_event_within(id, Duration::from_secs(3600)).cloned();
        info!(cx, "waited: {event:?}");
        let kept = self.level.deactivate(id);
        info!(cx, "the id was {}", if kept.is_ok() { "kept" } else { "gone" });
        Ok(())
    }

    /// One event of each kind.
    fn measure(&mut self) -> Outcome {
        let id = match self.measured {
            Some(id) => id,
            None => {
                let parameter = Threshold { always: true, ..Threshold::default() };
                self.heard.activate(Mode::Continuous, parameter.clone())?;
                *self.measured.insert(self.level.activate(Mode::Continuous, parameter)?)
            }
        };
        self.ask.query(Ask { todo: todo::PUT, value: 1.0 })?;
        self.level.get_event(id)?;
        self.ask.query(Ask { todo: todo::SEND, value: 1.0 })?;
        self.alarmed.clear();
        self.noted.clear();
        self.first_noted.clear();
        self.crossings.clear();
        Ok(())
    }

    /// The first instance falls with its activations; its successor asks how many there are.
    fn fall(&mut self, cx: &mut Context<'_>) -> Outcome {
        static INSTANCES: AtomicU32 = AtomicU32::new(0);
        if self.next == 0 && INSTANCES.fetch_add(1, Ordering::SeqCst) == 0 {
            for _ in 0..5 {
                self.level.activate(Mode::Continuous, Threshold::default())?;
            }
            info!(cx, "tested before: {}", self.ask.query(Ask { todo: todo::PUT, value: 1.0 })?.tests);
            measurer::trap();
        }
        self.next += 1;
        if self.next == 1 {
            info!(cx, "tested afterwards: {}", self.ask.query(Ask { todo: todo::PUT, value: 1.0 })?.tests);
        }
        Ok(())
    }
}

export_components!(Chime, Watcher, Measurer, OtherMeasurer, FaultListener, FaultReporter);
