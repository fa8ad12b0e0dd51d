//! Elements of fault tolerance. The paper names `validity`, `min`, `max`, `severity`, `dependency`; the rest are ours.

use super::Times::{Many, Optional};
use super::{Content, ElementRule, Kind, optional, required};
use crate::model::limits;

const PRELOAD: Kind = Kind::OneOf(&["none", "library", "instance"]);

const SEVERITIES: Kind = Kind::OneOf(&["ignore", "reset", "stop", "emergency"]);

const LIMIT_ATTRIBUTES: &[super::AttributeRule] = &[
    optional("slope", Kind::Number, "Factor of a linear limit: slope * of + offset."),
    optional("of", Kind::Name, "Field that a linear limit depends on."),
    optional("offset", Kind::Number, "Offset of a linear limit."),
];

const fn limit(name: &'static str, about: &'static str) -> ElementRule {
    ElementRule { name, about, attributes: LIMIT_ATTRIBUTES, children: &[], content: Content::Text(Kind::Number) }
}

/// A range check.
pub static VALIDITY: ElementRule = ElementRule {
    name: "validity",
    about: "Range of a field: a bad output blames the writer, a bad input is kept from the reader.",
    attributes: &[
        optional("field", Kind::Text, "Path of the field, linear.x; none: the object is a single number."),
        optional("delay", Kind::Duration, "How long the value must be bad before it is a fault."),
    ],
    children: &[
        (Optional, &limit("min", "Lower bound, included.")),
        (Optional, &limit("max", "Upper bound, included.")),
        (Optional, &ElementRule::value("max_rate", Kind::Number, "Largest change per second.")),
        (
            Optional,
            &ElementRule::value(
                "on_invalid",
                Kind::OneOf(&["drop", "hold", "pass"]),
                "What the reader gets: nothing, the last valid value, or the value as it is.",
            ),
        ),
    ],
    content: Content::Elements,
};

/// Silence is a fault too.
pub static MAX_AGE: ElementRule =
    ElementRule::value("max_age", Kind::Duration, "Silence of an input longer than this is a fault.");

static SEVERITY: ElementRule = ElementRule {
    name: "severity",
    about: "What to do about a symptom.",
    attributes: &[optional(
        "symptom",
        Kind::Name,
        "Symptom; none: every symptom that no other severity names, but type, and late where it says reset. crash covers \
         all crash.*.",
    )],
    children: &[],
    content: Content::Value(SEVERITIES),
};

/// What to do where too few members of a voter agree.
static QUORUM: ElementRule = ElementRule {
    name: "severity",
    about: "What to do where too few agree: ignore, as without the element, stop whoever depends on the voter, or emergency. \
            A voter has no state that a reset would mend, and inherits nothing.",
    attributes: &[optional("symptom", Kind::Name, "vote, or none: a voter has no other fault.")],
    children: &[],
    content: Content::Value(SEVERITIES),
};

/// What to do about the faults of a slot.
pub static FAULT_TOLERANCE: ElementRule = ElementRule::parent(
    "fault_tolerance",
    &[
        (Many, &SEVERITY),
        (
            Optional,
            &ElementRule::attributed(
                "reset",
                &[
                    required("limit", Kind::Integer(0, limits::RESETS_MAX as i64), "Most resets; 0: replace at once."),
                    optional("within", Kind::Duration, "Window; default 10s."),
                ],
                "Restart intensity; beyond it the ladder goes on: replace, then stop. Without the element: 10 within 10s.",
            ),
        ),
        (
            Many,
            &ElementRule::attributed(
                "secondary",
                &[
                    required("reference", Kind::Name, "Component profile with the same ports."),
                    optional("preload", PRELOAD, "How far it is prepared; default instance."),
                ],
                "Alternative class, in order of preference.",
            ),
        ),
        (
            Optional,
            &ElementRule::attributed(
                "spare",
                &[
                    optional("count", Kind::Integer(1, limits::SPARES_MAX as i64), "How many; default 1."),
                    optional("preload", PRELOAD, "How far each is prepared; default instance."),
                ],
                "Standbys of the same class, made in the background; without the element one is kept where a reset \
                 answers the loss of an instance. What only one may hold (a device) is opened in start.",
            ),
        ),
        (
            Optional,
            &ElementRule::attributed(
                "checkpoint",
                &[required("period", Kind::Duration, "How often.")],
                "Back up what the component calls critical; the instance that succeeds it after a fault goes on from there.",
            ),
        ),
        (
            Optional,
            &ElementRule::attributed(
                "recovery",
                &[required("within", Kind::Duration, "Declared target, fault to first good callback.")],
                "How fast it must recover. A recovery that takes longer is a fault, late, which is written down; a severity of \
                 its own, or a default of stop or emergency, says what else.",
            ),
        ),
        (Optional, &ElementRule::value("isolation", Kind::OneOf(&["thread", "process"]), "Where the instance lives.")),
        (
            Optional,
            &ElementRule::value(
                "coverage",
                Kind::OneOf(&["component", "executor", "system"]),
                "How far a fault of this slot reaches.",
            ),
        ),
    ],
    "What to do about the faults of a slot.",
);

/// Contamination between slots.
pub static DEPENDENCY: ElementRule = ElementRule::attributed(
    "dependency",
    &[
        required("component", Kind::Name, "Slot that stops."),
        required("on", Kind::Names, "Slots, composites and voters that it needs, separated by blanks."),
        optional("require", Kind::Integer(1, limits::SLOTS as i64), "How many of them must work; default: all."),
    ],
    "A slot stops when fewer than the required ones of those that it needs work.",
);

/// Watches a port.
pub static MONITOR: ElementRule = ElementRule {
    name: "monitor",
    about: "Helper component that watches a port.",
    attributes: &[required("component", Kind::Name, "Slot."), required("port", Kind::Name, "Its data port.")],
    children: &[(Many, &VALIDITY), (Optional, &MAX_AGE)],
    content: Content::Elements,
};

/// Compares a component with a model of it.
pub static REFERENCE_MODEL: ElementRule = ElementRule::attributed(
    "reference_model",
    &[
        required("component", Kind::Name, "Slot that is the model."),
        required("input", Kind::Name, "Output that feeds the model, or input that hears the same: slot.port."),
        required("target", Kind::Name, "Output that the model is compared with: slot.port."),
        optional("output", Kind::Name, "Port of the model that is compared; default: the one of the target's type."),
        optional("field", Kind::Name, "Number that is compared: linear.x, ticks[0]; none: the object is one."),
        optional("compare", Kind::OneOf(&["value", "rate"]), "Its mean in the window, or its change per second."),
        required("window", Kind::Duration, "Sliding window."),
        required("threshold", Kind::Number, "Largest difference of the two, each filtered over the window."),
    ],
    "Helper component that compares a component with a model of it.",
);

/// Votes over redundant outputs.
pub static VOTING: ElementRule = ElementRule {
    name: "voting",
    about: "Helper component that votes over redundant outputs.",
    attributes: &[
        optional("name", Kind::Name, "Slot that others connect to for the winner's objects; none: it is only watched."),
        required("inputs", Kind::Names, "Redundant slots or outputs (slot.port), separated by blanks; three or more."),
        optional("method", Kind::OneOf(&["median", "majority", "weighted"]), "How; default median."),
        optional("tolerance", Kind::Number, "Largest difference that still counts as equal."),
        optional("field", Kind::Name, "Number that is compared: linear.x, ranges[0]; none: the object is one."),
        optional(
            "max_age",
            Kind::Duration,
            "An input silent for longer is left out and is stale; default 1s, not stale.",
        ),
        optional(
            "require",
            Kind::Integer(1, limits::VOTERS as i64),
            "How many must agree, or nothing is handed on; default: more than half.",
        ),
    ],
    children: &[(Optional, &QUORUM)],
    content: Content::Elements,
};

/// Slots that get the emergency stop.
pub static EMERGENCY: ElementRule = ElementRule::parent(
    "emergency",
    &[(
        Many,
        &ElementRule::attributed(
            "actuator",
            &[required("component", Kind::Name, "Slot.")],
            "A slot that drives something.",
        ),
    )],
    "Who gets the emergency-stop event, first and directly.",
);
