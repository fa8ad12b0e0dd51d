//! Coloured-target detector.

pub mod blob;
pub mod colour;
pub mod detector;
