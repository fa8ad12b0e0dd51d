//! The control socket: `server (one thread, poll) -> session -> wire -> interface -> answer or stream -> wire`.
//!
//! It tells how everything is and takes orders, by varlink's wire form over a Unix socket. It never waits on a component:
//! what it tells is read from counters and from a directory of what runs; an order is posted to the main loop, and its
//! answer is passed on when it comes. One thread serves all clients, with bounds on their number and on all that they send
//! and do not read, so that none of them can hold up another or the robot.

use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Instant;

use crossbeam_channel::{Receiver, Sender, never};
use serde_json::{Value, json};

use crate::exec::emergency;
use crate::fault::manager::Outlook;
use crate::fault::order::Refused;
use crate::model::limits::SHUTDOWN_STEP;
use crate::supervise::reload::Changes;
use crate::supervise::system::System;
use crate::sys::thread;

/// Answers that are there at once.
mod answer;
mod composites;

/// Models and voters as they are shown.
pub mod helpers;

/// The command line's side.
pub mod client;

/// An object as JSON, by its description.
mod decode;

/// What runs, as the control socket sees it.
pub mod directory;

/// The values that pass a port.
mod echo;

/// What may be asked.
pub mod interface;

/// The thread: who comes, who asks, who waits.
mod server;

/// One client.
mod session;

/// Where the socket is and who may use it.
pub mod socket;

/// Answers that come bit by bit.
mod stream;

/// How everything is, as JSON and as tables.
pub mod views;

/// A JSON object and a NUL byte.
pub mod wire;

use directory::{Phase, Publisher};
use interface::Refusal;
use server::{Server, Stop};
use socket::Socket;

/// How a reload ended: what changed, or everything that is wrong.
pub type Reloaded = Result<Changes, Vec<String>>;

/// How a call ended that somebody else carried out.
type Answered = Result<Value, Refusal>;

/// Asks the main loop to read the profiles again.
pub struct ReloadOrder {
    session: u64,
    answers: Sender<(u64, Answered)>,
    stop: Arc<Stop>,
}

impl ReloadOrder {
    /// Tells who ordered it how it ended.
    pub fn answer(self, reloaded: &Reloaded) {
        // Who is gone is not waited for.
        let answer = match reloaded {
            Ok(changes) => Ok(
                json!({"added": changes.added, "changed": changes.changed, "removed": changes.removed, "taken_up": changes.taken_up,
                "kept": changes.kept}),
            ),
            Err(_) if emergency::latched() => Err(Refusal::of_order(Refused::latched())),
            Err(reasons) => Err(Refusal::ReloadRefused(reasons.clone())),
        };
        let _ = self.answers.send((self.session, answer));
        self.stop.wake();
    }
}

/// The control socket as the main loop holds it. Its end is the socket's.
pub struct Control {
    publisher: Publisher,
    orders: Receiver<ReloadOrder>,
    running: Option<(Arc<Stop>, JoinHandle<()>)>,
}

impl Control {
    /// Serves a socket.
    ///
    /// # Errors
    /// When the system has no thread or descriptor left.
    pub fn start(socket: Socket, profiles: PathBuf, outlook: Outlook) -> std::io::Result<Self> {
        let publisher = Publisher::default();
        let (server, orders) = Server::new(socket, profiles, outlook, publisher.board())?;
        let stop = server.stop();
        let thread = thread::spawn("control", move || server.run())?;
        Ok(Self { publisher, orders, running: Some((stop, thread)) })
    }

    /// None: nobody can look or order.
    #[must_use]
    pub fn absent() -> Self {
        Self { publisher: Publisher::default(), orders: never(), running: None }
    }

    /// Orders of clients.
    #[must_use]
    pub const fn orders(&self) -> &Receiver<ReloadOrder> {
        &self.orders
    }

    /// Shows what runs now.
    pub fn publish(&mut self, system: &System) {
        if self.running.is_some() {
            self.publisher.publish(system);
        }
    }

    /// Says that a reload begins; [`Self::publish`] says that it has ended.
    pub fn reloading(&self) {
        self.publisher.board().set_phase(Phase::Reloading);
    }
}

impl Drop for Control {
    fn drop(&mut self) {
        let Some((stop, thread)) = self.running.take() else { return };
        stop.stop();
        let began = Instant::now();
        while !thread.is_finished() && began.elapsed() < SHUTDOWN_STEP {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        self.publisher.withdraw();
    }
}
