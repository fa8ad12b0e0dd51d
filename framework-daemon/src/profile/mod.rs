//! XML text to a checked plan: `source -> xml -> component/application/... -> validate -> plan`.

/// The checked whole that everything to the right works from.
pub mod plan;
