//! Derive macros of `component-sdk`.
