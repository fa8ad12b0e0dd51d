//! The example of the SmartSoft paper (figures 7 and 8): *first* asks twice without waiting and fetches the answers in the
//! order that suits it; *second* queues what it is asked and answers when it comes to it.

mod first;
mod second;

use component_sdk::prelude::*;

pub use first::First;
pub use second::Second;

/// Asks what time it is.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StampRequest {
    /// Round of the asker, for its log.
    pub round: u32,
}

/// Asks for a scan.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScanRequest {
    /// Rays over the half circle ahead, 2 to 1000.
    pub rays: u32,
}

export_components!(First, Second);
