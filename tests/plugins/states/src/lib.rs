//! Components with states: the conformance tests of the state pattern.
//!
//! The master runs one case in each callback and logs how it went. It has states of its own, which it sets from beside, and sets
//! those of a slave that waits and fails as it is asked to.

mod slave;
mod told;

use std::sync::{Arc, Mutex};

use component_sdk::prelude::*;

pub use slave::Slave;

/// All cases, each named after the line of the tables that it stands for; those that cost the slave its life come last.
#[macro_export]
macro_rules! state_cases {
    ($then:ident $($arguments:tt)*) => {
        $then! {
            $($arguments)*
            set_not_activated, get_not_activated, acquire_not_activated, define_states_creates_both,
            substate_in_several_mains, define_reserved_name, initial_unknown, activate_enables_use, initial_state,
            define_after_activate, get_current_mains_subs, get_unknown, user_mains_contain_nonneutral,
            set_waits_until_done, set_unknown, set_life_cycle_not_allowed, set_unconnected, acquire_active_counts,
            acquire_unknown, try_acquire_ok, try_acquire_inactive, try_acquire_unknown, release_too_often_ignored,
            release_unknown, held_is_released_on_drop, try_acquire_pending, acquire_waits_for_a_pending_change,
            release_reevaluates, change_waits_for_holders, shared_substates_keep_running, order_quit_enter_wake_answer,
            quit_and_enter_handlers_per_substate, second_set_while_pending_is_answered,
            get_never_cancelled_by_neutral, set_cancelled_blocking_off, neutral_reserved, reserved_substates,
            a_handler_fails, handler_fault_is_its_slots_fault_and_the_change_is_done, slave_set_life_cycle_only,
            shutdown_jumps_the_queue, set_cancelled_in_shutdown, acquire_after_shutdown,
            deactivated_rushes_through_blocking_calls, held_is_released_when_its_callback_panics,
            held_is_released_when_its_callback_traps, master_of_a_slave_that_fails_is_told,
        }
    };
}

/// What the slave may be asked to do.
pub mod todo {
    /// Hold a substate and ask somebody who does not answer; tell how that ended.
    pub const HOLD_AND_ASK: u64 = 1;
    /// Ask somebody who does not answer for a moment; tell how that ended.
    pub const ASK: u64 = 2;
    /// Hold a substate and panic.
    pub const HOLD_AND_PANIC: u64 = 3;
    /// Hold a substate and trap.
    pub const HOLD_AND_TRAP: u64 = 4;
    /// Hold a substate for a while, then trap.
    pub const HOLD_AND_TRAP_LATER: u64 = 5;
}

/// Runs the cases, one in each period.
#[derive(Component)]
#[component(name = "Master", version = "1.0", periodic = "2ms")]
pub struct Master {
    /// States of its own.
    #[port]
    own: StateSlave,
    /// To its own states.
    #[port]
    mine: StateMaster,
    /// Likewise.
    #[port]
    second: StateMaster,
    /// To the slave's.
    #[port]
    slave: StateMaster,
    /// To nobody.
    #[port]
    loose: StateMaster,
    /// Tells the slave what to do.
    #[port]
    ask: QueryClient<u64, u64>,
    /// Never answers.
    #[port]
    #[allow(dead_code, reason = "nobody takes what comes in")]
    silent: QueryServer<u64, u64>,
    told: Arc<Mutex<Vec<String>>>,
    next: usize,
}

impl Callbacks for Master {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        self.next = cases::run(told::ALL, self.next, self, cx);
        Ok(())
    }
}

export_components!(Master, Slave);
