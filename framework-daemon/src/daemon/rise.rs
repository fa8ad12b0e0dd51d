//! The boot, on a thread of its own: whoever wants the daemon to end need not wait for a component that does not return.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crossbeam_channel::{Receiver, bounded, select};

use crate::exec::keep::Keep;
use crate::model::fault::FaultSender;
use crate::model::limits::SHUTDOWN_STEP;
use crate::profile::plan::Plan;
use crate::supervise::boot::{self, BootError};
use crate::supervise::system::System;
use crate::sys::signals::Request;
use crate::sys::thread;

/// How a boot ended.
pub(super) enum Risen {
    /// It runs; `reload`: it was asked meanwhile to read the profiles again.
    Up {
        /// What runs.
        system: Box<System>,
        /// A reload is due.
        reload: bool,
    },
    /// It cannot.
    Failed(BootError),
    /// It was asked to end before it was ready.
    Interrupted,
}

/// Brings the system up, or gives it up when asked to.
///
/// # Errors
/// When the system has no thread left.
pub(super) fn rise(
    plan: Arc<Plan>,
    plugins: Vec<PathBuf>,
    faults: FaultSender,
    keep: Option<Arc<Keep>>,
    requests: &Receiver<Request>,
) -> std::io::Result<Risen> {
    let (sender, result) = bounded(1);
    let given_up = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&given_up);
    thread::spawn("boot", move || {
        // Nobody waits for what comes too late.
        let _ = sender.send(boot::boot_unless(&asked, plan, &plugins, faults, keep));
    })?;
    let mut reload = false;
    loop {
        select! {
            recv(result) -> booted => return Ok(match booted {
                Ok(Ok(system)) => Risen::Up { system: Box::new(system), reload },
                Ok(Err(error)) => Risen::Failed(error),
                Err(_) => Risen::Failed(BootError::Failed(vec!["the boot ended without a result".to_owned()])),
            }),
            recv(requests) -> request => match request {
                Ok(Request::Reload) => reload = true,
                Ok(Request::Status) => tracing::info!("not ready yet"),
                Ok(Request::Stop) | Err(_) => break,
            },
        }
    }
    given_up.store(true, Ordering::Relaxed);
    // What is up already ends in order, as long as it answers.
    if let Ok(Ok(system)) = result.recv_timeout(SHUTDOWN_STEP) {
        crate::supervise::shutdown::shutdown(system);
    }
    Ok(Risen::Interrupted)
}
