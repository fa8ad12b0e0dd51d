//! Ultrasonic filter: raw ring in, ring without ghosts and dropouts out.

pub mod ring_filter;
