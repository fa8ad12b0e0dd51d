//! The robot runtime that does not go down.
//!
//! A module may use only modules to its left (`tests/tests/tidy.rs` keeps it so):
//!
//! `model -> sys -> detect -> profile -> plugin -> port -> exec -> fault -> supervise -> control -> daemon ->
//! cli -> main`
//!
//! - **Data path**: `port::border (a component writes) -> port::check -> port::output -> port::input -> exec::executor ->
//!   exec::callback`
//! - **Fault path**: `sys::trap or plugin shim -> detect (symptom) -> exec::recover (answer on the spot) -> fault::manager
//!   (journal)`

/// Plain data that everybody may use: names, symptoms, lifecycle, limits. Knows nobody.
pub mod model;

/// The operating system: clock, threads, fibers, traps.
pub mod sys;

/// Fault path, step 1: value in, symptom out; pure.
pub mod detect;

/// XML text to a checked [`profile::plan::Plan`]. Knows no threads and no plugins.
pub mod profile;

/// A `.so` file to a handle that the rest can use safely.
pub mod plugin;

/// Data path, first half: write, check, connection, read.
pub mod port;

/// Data path, second half: executor, callback; and the answer to a fault on the spot.
pub mod exec;

/// Fault path, step 2: what happened is told, written down, counted.
pub mod fault;

/// Whole-system operations: boot, reload, shutdown.
pub mod supervise;

/// The control socket: how everything is, and orders, over varlink's wire form.
pub mod control;

/// The main loop of `run`.
pub mod daemon;

/// One file per verb of the command line.
pub mod cli;
