//! XML text to a checked plan: `source -> xml -> component/application/... -> validate -> plan`.

/// Findings: where, what, the way out.
pub mod diagnostic;
/// The checked whole that everything to the right works from.
pub mod plan;
/// Text to times, numbers and sizes.
pub mod quantity;
/// Bytes to text, offsets to lines and columns.
pub mod source;
/// The nearest right name to a wrong one.
pub mod suggest;
/// Text to a tree of elements with spans.
pub mod xml;
