//! Service types: methods as queries and sends.

use crate::rig::{Suite, conformance};
use crate::send::profiles;

static SUITE: Suite = Suite::new(|transport| profiles(transport, "calls"));

sends::service_cases!(conformance SUITE;);
