//! Plain data that every other module may use. This module knows nobody.

/// What a detector saw, and how severe the integrator says it is.
pub mod symptom;
