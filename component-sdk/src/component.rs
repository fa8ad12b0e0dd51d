//! What a component is. The callbacks are OPRoS's, with their names and their order.
//!
//! Returned errors are symptoms here (OPRoS ignored what `onExecute` returned), and `on_error` is told what
//! happened (ROS 2's is not).

use std::fmt;

use crate::abi::calls::Incoming;
use crate::abi::class::ClassDecl;
use crate::context::Context;
use crate::property::Builder;

/// What a callback returns.
pub type Outcome = Result<(), ComponentError>;

/// Why a callback could not do its work: a text for the journal.
pub struct ComponentError(String);

impl ComponentError {
    /// An error with this text.
    pub fn new(text: impl Into<String>) -> Self {
        Self(text.into())
    }
}

impl fmt::Display for ComponentError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl fmt::Debug for ComponentError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

// `ComponentError` itself is no `std::error::Error`: that is what lets `?` take every one that is.
impl<E: std::error::Error> From<E> for ComponentError {
    fn from(error: E) -> Self {
        Self(error.to_string())
    }
}

/// Makes a [`ComponentError`] from a format string.
#[macro_export]
macro_rules! fault {
    ($($part:tt)*) => { $crate::component::ComponentError::new(format!($($part)*)) };
}

/// The fault that led to a call of `on_error` or `recover`.
#[derive(Clone, Copy, Debug)]
pub struct FaultInfo<'a> {
    /// Symptom, as in the journal: `crash.segv`, `error`, ...; or `restart`: the daemon itself was started again, or a reload
    /// built the slot anew.
    pub symptom: &'a str,
    /// The slot that was blamed.
    pub slot: &'a str,
    /// Panic message, error text, signal and address.
    pub message: &'a str,
}

/// What `#[derive(Component)]` writes: the class's description and how an instance is built.
pub trait Component: Sized + Send + 'static {
    /// Name, ports, properties, checkpoint regions.
    const DECL: ClassDecl;

    /// Builds an instance: ports connected to their slot, properties read from the profile.
    ///
    /// # Errors
    /// When a property's text does not fit its type or range.
    fn build(builder: &mut Builder<'_>) -> Result<Self, ComponentError>;

    /// Whether its ports may wait: as `blocking` of each of them, with a gate of its own.
    #[allow(unused_variables, reason = "a component without clients waits for nobody")]
    fn blocking(&mut self, on: bool) {}

    /// Begins what its ports do beside its callbacks; called after `start`.
    ///
    /// # Errors
    /// A task could not be started.
    #[allow(unused_variables, reason = "a component without states has nothing to begin")]
    fn attend(&mut self, cx: &mut Context<'_>) -> Outcome {
        Ok(())
    }

    /// Calls the handler of the port at which something came in.
    ///
    /// # Errors
    /// The handler's own.
    #[allow(unused_variables, reason = "a component without handlers serves nothing")]
    fn serve(&mut self, cx: &mut Context<'_>, incoming: &Incoming<'_>) -> Outcome {
        Ok(())
    }
}

/// The callbacks of a component. Each runs on a fiber, one at a time: on the slot's executor while the instance is in use.
/// An instance that is to stand ready is built, initialised and rehearsed on another thread, one that was replaced stopped
/// and destroyed there.
///
/// Order: `initialize`, `start`, then `on_execute` and `update` in turn, `stop`, `destroy`. A fault leads to
/// `on_error` and `reset` of the same instance where it may still be entered, or to `initialize`, `recover`
/// and `start` of its successor, which may have gone through `rehearse` long before. Each returned error is a fault of the component.
#[allow(unused_variables, reason = "the names of default callbacks' arguments are documentation")]
pub trait Callbacks: Component {
    /// Once, before anything else; ports may not be connected yet.
    fn initialize(&mut self, cx: &mut Context<'_>) -> Outcome {
        Ok(())
    }

    /// Each time the slot becomes active.
    fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
        Ok(())
    }

    /// Each period, or when data arrived.
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        Ok(())
    }

    /// After all members of the executor ran `on_execute` in this cycle (OPRoS `onUpdated`).
    fn update(&mut self, cx: &mut Context<'_>) -> Outcome {
        Ok(())
    }

    /// An event arrived at an [`EventIn`](crate::port::EventIn) without a handler, which gives it out. Entered again for the
    /// next one as long as one is taken each time.
    fn on_event(&mut self, cx: &mut Context<'_>) -> Outcome {
        Ok(())
    }

    /// The slot is about to become inactive.
    fn stop(&mut self, cx: &mut Context<'_>) -> Outcome {
        Ok(())
    }

    /// Once, last.
    fn destroy(&mut self, cx: &mut Context<'_>) -> Outcome {
        Ok(())
    }

    /// A fault was blamed on this instance, which is still sound (it panicked or returned an error).
    fn on_error(&mut self, cx: &mut Context<'_>, fault: &FaultInfo<'_>) -> Outcome {
        Ok(())
    }

    /// Back to the state after `start`.
    fn reset(&mut self, cx: &mut Context<'_>) -> Outcome {
        Ok(())
    }

    /// This instance succeeds one that failed; comes between `initialize` and `start`. It may be one of a daemon that was
    /// started again: then it goes on from the checkpoint that the daemon before left.
    fn recover(&mut self, cx: &mut Context<'_>, fault: &FaultInfo<'_>) -> Outcome {
        Ok(())
    }

    /// The emergency stop was raised, and the profiles name this slot as an actuator: bring what it moves to rest. Its safe
    /// outputs were written before, and are once more after this and `stop`, which follows. A fault in here changes nothing
    /// about that.
    fn on_emergency(&mut self, cx: &mut Context<'_>) -> Outcome {
        Ok(())
    }

    /// Once on an instance that is to stand ready, a secondary or a spare, after `initialize`: its ports read as empty
    /// and what it writes goes nowhere. Touch what `on_execute` will touch (buffers, tables), so that the first
    /// callback after a fault need not wait for memory; change nothing outside this instance.
    fn rehearse(&mut self, cx: &mut Context<'_>) -> Outcome {
        Ok(())
    }
}
