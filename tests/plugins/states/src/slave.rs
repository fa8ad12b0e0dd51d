//! The one whose states are set by somebody else.

use std::hint::black_box;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use component_sdk::prelude::*;

use crate::todo;

/// It holds its substate.
pub(crate) static HOLDS: AtomicBool = AtomicBool::new(false);

/// Holds, waits and fails as it is asked to.
#[derive(Component)]
#[component(name = "Slave", version = "1.0", passive)]
pub struct Slave {
    #[port]
    state: StateSlave,
    #[port(handler = on_ask)]
    asked: QueryServer<u64, u64>,
    /// To somebody who does not answer.
    #[port]
    deaf: QueryClient<u64, u64>,
}

impl Callbacks for Slave {
    fn initialize(&mut self, _: &mut Context<'_>) -> Outcome {
        self.state.define("Moving", "drives")?;
        self.state.define("Looking", "turns")?;
        self.state.activate()?;
        Ok(())
    }
}

impl Slave {
    fn on_ask(&mut self, cx: &mut Context<'_>, query: Query<'_, u64, u64>) -> Outcome {
        let what = *query;
        let _held = if what == todo::ASK { None } else { Some(self.state.acquire("drives")?) };
        let long = if what == todo::ASK { Duration::from_millis(10) } else { Duration::from_secs(3600) };
        HOLDS.store(what != todo::ASK, Ordering::SeqCst);
        match what {
            todo::HOLD_AND_PANIC => panic!("it was asked to"),
            todo::HOLD_AND_TRAP => trap(),
            todo::HOLD_AND_TRAP_LATER => {
                let _ = cx.sleep(Duration::from_millis(30));
                trap();
            }
            _ => {}
        }
        let end = self.deaf.query_within(1, long).err();
        query.answer(end.map_or(0, |status| u64::from(status.code())))?;
        Ok(())
    }
}

#[allow(unsafe_code, reason = "the write faults, which is its purpose")]
fn trap() {
    // SAFETY: none.
    unsafe { black_box(8 as *mut u32).write_volatile(1) };
}
