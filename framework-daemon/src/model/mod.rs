//! Plain data that every other module may use. This module knows nobody.

/// Every bound, with the relations between them.
pub mod limits;

/// What a detector saw, and how severe the integrator says it is.
pub mod symptom;
