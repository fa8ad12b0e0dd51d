//! Harness of the black-box tests: start the daemon, wait until it is ready, talk to it.

/// Where the daemon's binary is.
pub mod daemon_binary;
