//! The torture campaign: each class of misbehaviour again and again, in one life of a daemon, beside twenty other slots.

/// Which classes there are, and what is right for each.
pub mod classes;

/// The profiles of one run.
pub mod layout;

/// One class, from start to verdict.
pub mod run;

/// What was found, and the printed form.
pub mod row;
