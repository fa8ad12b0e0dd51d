//! Whole-system operations: `boot -> (reload)* -> shutdown`.

/// A slot before anything of it exists.
pub mod blueprint;

/// Plan to slots, executors, wiring.
pub mod boot;

/// Classes by name: libraries found, loaded once, checked against the profile.
pub mod catalogue;

/// Data ports, as class and profile describe them together.
mod pushes;

/// Models and voters, with their ears at outputs.
pub mod helpers;

/// New plan, difference, prepare, commit; or nothing at all.
pub mod reload;

/// Reverse order, a deadline for each component.
pub mod shutdown;

/// Event ports: made and connected.
pub mod events;

/// Connections of service ports.
pub mod services;

/// The interfaces that profiles state, compared with the plugins'.
pub mod interfaces;

/// What watches ports for the framework.
pub mod monitors;

/// One thread that looks for silence.
pub mod watch;

/// The set of live things.
pub mod system;

/// Connections: layouts compared, links built.
pub mod wiring;
