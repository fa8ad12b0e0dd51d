//! Benchmarks of the running system, each with its raw limit measured in the same run, interleaved: the machine is noisy,
//! ratios are not.

/// Recovery from provoked faults, through a real executor.
pub mod recovery;

/// What a guarded call costs.
pub mod guard;

/// Percentiles and the printed form.
pub mod stats;
