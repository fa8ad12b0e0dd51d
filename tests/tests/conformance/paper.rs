//! What the paper promises beside its patterns' tables. Its figures 7 and 8 run in `tests/paper_example.rs`, the six patterns
//! each in a module of its own.

use crate::links::profiles;
use crate::rig::{Suite, Transport, conformance};

static SUITE: Suite = Suite::new(|transport: Transport| {
    let profiles = profiles(transport, "paper");
    let link = tests::profiles::connection_of("service", "wirer.again -> one.told", "");
    profiles.replace("app.xml", "</port_connections>", &format!("{link}</port_connections>"));
    profiles
});

links::paper_cases!(conformance SUITE;);
