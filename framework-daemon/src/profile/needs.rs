//! Contamination: who stops when too few of others work, as the plan has it.

use serde::Serialize;

use super::plan::Location;

/// An application that stops when too few of others work.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ApplicationDependencyPlan {
    /// The application that stops.
    pub application: String,
    /// The applications that it needs.
    pub on: Vec<String>,
    /// How many of them must work.
    pub require: usize,
    /// Where it was declared.
    pub location: Location,
}

/// A slot that stops when too few of others work.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DependencyPlan {
    /// The slot that stops.
    pub slot: String,
    /// What it needs.
    pub on: Vec<NeededPlan>,
    /// How many of them must work.
    pub require: usize,
    /// Where it was declared.
    pub location: Location,
}

/// A name in a dependency: a slot, or a composite, which works while all of its slots do.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct NeededPlan {
    /// The name, as written.
    pub name: String,
    /// Its slots.
    pub slots: Vec<String>,
}
