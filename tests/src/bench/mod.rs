//! Benchmarks of the running system, each with its raw limit measured in the same run, interleaved: the machine is noisy,
//! ratios are not.

/// Recovery from provoked faults.
pub mod recovery;

/// Recovery from callbacks that do not return.
pub mod hang;

/// What both are measured on.
pub mod rig;

/// Busy cores.
pub mod load;

/// From a write to its readers.
pub mod hop;

/// A running system to measure.
pub mod wire;

/// What a guarded call costs.
pub mod guard;

/// A checkpoint of a component.
pub mod checkpoint;

/// The emergency stop.
pub mod emergency;

/// The fault-stop of a closure.
pub mod fault_stop;

/// Checks of values.
pub mod validity;

/// A supervisor of another school, beside ours.
pub mod erlang;

/// What the system can do at best.
pub mod limits;

/// Percentiles and the printed form.
pub mod stats;

/// Ratios and targets, for people.
pub mod report;
