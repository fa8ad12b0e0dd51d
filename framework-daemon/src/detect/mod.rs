//! Fault path, step 1: value in, symptom out. Pure: no clock, no thread, no state that is not passed in.

/// How a callback ended, as a symptom.
pub mod crash;

/// A callback that returned late.
pub mod deadline;

/// Silence of a port.
pub mod freshness;

/// A signal against a model of it.
pub mod model_diff;

/// Redundant values, one of which is handed on.
pub mod vote;

/// A vote that goes on: who is silent, and since when who is at odds with the others.
pub mod poll;

/// Whether memory may be damaged after a fault.
pub mod taint;

/// A value outside its range.
pub mod range;

/// How fast a value changes.
pub mod rate;

/// Devices that are lost.
pub mod device;

/// A time of bad values, debounced.
pub mod episode;
