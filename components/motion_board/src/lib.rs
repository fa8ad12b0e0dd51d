//! Driver of the motion board.

pub mod link;
