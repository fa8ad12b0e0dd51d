//! What the navigation robot's components say to each other: communication objects, and the conventions behind them.
//!
//! Decision: conventions that two components must share (how the ring of echoes is numbered, what a course means) live
//! here as plain functions, so that the algorithm cores can be built and tested without the SDK. Not chosen: each core
//! with its own copy of them; nothing would notice when two copies drift apart.

pub mod angle;
pub mod motion;
pub mod objects;
pub mod retry;
pub mod ring;

pub use motion::Motion;
pub use objects::{Detection, EncoderCounts, UltrasonicRing, WheelCommand};
