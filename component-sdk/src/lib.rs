//! The one crate a component author needs.
