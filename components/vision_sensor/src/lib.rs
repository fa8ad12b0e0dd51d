//! Camera over a Unix socket.

pub mod frames;
