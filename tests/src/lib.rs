//! Harness of the black-box tests: start the daemon, wait until it is ready, talk to it.

/// Clients of the control socket.
pub mod asking;

/// Benchmarks.
pub mod bench;

/// A robot with two actuators.
pub mod brakes;

/// The torture campaign.
pub mod campaign;

/// A crowd of components that ask each other, on real threads.
pub mod crowd;

/// Components that try to harm the daemon.
pub mod culprit;

/// Where the daemon's binary is.
pub mod daemon_binary;

/// Random histories of faults on random dependency graphs.
pub mod histories;

/// A plugin from outside the repository.
pub mod outside;

/// A profile directory of the basic test components.
pub mod profiles;

/// A daemon that runs.
pub mod running;

/// A robot with three sonars and a voter.
pub mod sonars;

/// A long life under fault load.
pub mod soak;

/// Random interleavings of the communication patterns.
pub mod sim;
