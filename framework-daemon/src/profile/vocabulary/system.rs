//! Elements of `system_profile`. The paper names the file, no public one exists: the elements are ours.

use super::Times::{Many, One, Optional};
use super::component::{COPYRIGHT, DESCRIPTION, ID, NAME, VERSION};
use super::fault::EMERGENCY;
use super::{Content, ElementRule, Kind, optional, required};
use crate::model::limits;

/// The whole system: threads, plugin directories, emergency stop.
pub static SYSTEM: ElementRule = ElementRule {
    name: "system_profile",
    about: "The whole system: threads, plugin directories, emergency stop.",
    attributes: &[optional(
        "on_taint",
        Kind::OneOf(&["continue", "restart"]),
        "What to do when memory shared by all components may be damaged; default continue.",
    )],
    children: &[
        (Optional, &ID),
        (One, &NAME),
        (Optional, &VERSION),
        (Optional, &DESCRIPTION),
        (Optional, &COPYRIGHT),
        (Many, &ElementRule::value("plugins", Kind::Name, "Directory of plugins, relative to this file.")),
        (
            Many,
            &ElementRule::attributed(
                "executor",
                &[
                    required("name", Kind::Name, "Name that slots refer to."),
                    optional("period", Kind::Duration, "Period of its periodic slots that declare none."),
                    optional("policy", Kind::OneOf(&["other", "fifo", "rr"]), "Scheduling policy; default other."),
                    optional(
                        "priority",
                        Kind::Integer(0, limits::PRIORITY_MAX as i64),
                        "Real-time priority, 1 to 99, for fifo and rr.",
                    ),
                    optional("cpu", Kind::Cpus, "Processors that it may use: 2, 0,1 or 0-3."),
                ],
                "A thread that runs slots.",
            ),
        ),
        (
            Many,
            &ElementRule::attributed(
                "node",
                &[
                    required("name", Kind::Name, "Name that node_id refers to."),
                    required("address", Kind::Name, "Where its daemon listens."),
                ],
                "Another daemon that runs slots.",
            ),
        ),
        (
            Many,
            &ElementRule::attributed(
                "dependency",
                &[
                    required("application", Kind::Name, "Application that stops."),
                    required("on", Kind::Names, "Applications that it needs, separated by blanks."),
                    optional(
                        "require",
                        Kind::Integer(1, limits::SLOTS as i64),
                        "How many of them must work; default: all.",
                    ),
                ],
                "An application stops when fewer than the required ones of those that it needs work.",
            ),
        ),
        (Optional, &EMERGENCY),
    ],
    content: Content::Elements,
};
