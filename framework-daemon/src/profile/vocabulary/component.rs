//! Elements of `component_profile`: OPRoS's two dialects together, and ours (`deadline`, `stack`, `overflow`,
//! `validity`, `max_age`).

use super::Times::{Many, One, Optional};
use super::fault::{MAX_AGE, VALIDITY};
use super::{Content, ElementRule, Kind, optional, required};
use crate::model::limits;

/// Left by the editor: a UUID that is not unique.
pub static ID: ElementRule = ElementRule::text("id", Kind::Text, "Identifier of the editor; not unique, ignored.");
/// Free text.
pub static DESCRIPTION: ElementRule = ElementRule::text("description", Kind::Text, "Free text.");
/// As written.
pub static VERSION: ElementRule = ElementRule::text("version", Kind::Text, "Version, as written.");
/// Left by the editor.
pub static LAYOUT: ElementRule = ElementRule::noise("layout");
/// Left by the editor.
pub static COLLAPSED: ElementRule = ElementRule::noise("collapsed");
/// Name of what the profile describes.
pub static NAME: ElementRule = ElementRule::value("name", Kind::Name, "Name.");
/// A file that describes more.
pub static REFERENCE: ElementRule = ElementRule::text("reference", Kind::Text, "File that describes it.");
/// Where it is meant to be used.
pub static APP_DOMAIN: ElementRule = ElementRule::noise("app_domain");
/// Where it is meant to be used.
pub static APP_ROBOT: ElementRule = ElementRule::noise("app_robot");

/// Who made it.
pub static COPYRIGHT: ElementRule = ElementRule::parent(
    "copyright",
    &[
        (
            Many,
            &ElementRule::parent(
                "company",
                &[
                    (Optional, &ElementRule::text("name", Kind::Text, "Name of the company.")),
                    (Optional, &ElementRule::text("phone", Kind::Text, "Telephone.")),
                    (Optional, &ElementRule::text("fax", Kind::Text, "Telefax.")),
                    (Optional, &ElementRule::text("address", Kind::Text, "Address.")),
                    (Optional, &ElementRule::text("homepage", Kind::Text, "Web page.")),
                ],
                "Who made it.",
            ),
        ),
        (Optional, &ElementRule::text("license_policy", Kind::Text, "Licence.")),
        (Optional, &ElementRule::text("version", Kind::Text, "Version of the licence.")),
    ],
    "Who made it and under which licence.",
);

static OS: ElementRule = ElementRule {
    name: "os",
    about: "Operating system that the library was built for; ignored.",
    attributes: &[optional("name", Kind::Text, "Its name."), optional("version", Kind::Text, "Its version.")],
    children: &[],
    content: Content::Text(Kind::Text),
};

/// The library that holds the component.
pub static EXECUTION_ENVIRONMENT: ElementRule = ElementRule::parent(
    "execution_environment",
    &[
        (Many, &OS),
        (Many, &ElementRule::text("cpu", Kind::Text, "Processor that the library was built for; ignored.")),
        (Optional, &ElementRule::text("library_type", Kind::Text, "dll or so; ignored.")),
        (One, &ElementRule::value("library_name", Kind::Name, "Library that holds it: Foo.dll, libfoo.so or foo.")),
        (Optional, &ElementRule::text("impl_language", Kind::Text, "Programming language; ignored.")),
        (Optional, &ElementRule::text("compiler", Kind::Text, "Compiler; ignored.")),
        (Optional, &APP_DOMAIN),
        (Optional, &APP_ROBOT),
    ],
    "The library that holds the component.",
);

const CREATION: Kind = Kind::Usually(&["singleton", "multiple"]);
/// Values of `execution_semantics/type`.
pub const TRIGGERS: &[&str] =
    &["periodic", "non-periodic", "aperiodic", "passive", "periodic-shared", "periodic-exclusive"];

/// When and how the callbacks run.
pub static EXECUTION_SEMANTICS: ElementRule = ElementRule::parent(
    "execution_semantics",
    &[
        (One, &ElementRule::value("type", Kind::OneOf(TRIGGERS), "What wakes the component.")),
        (
            Optional,
            &ElementRule::text("period", Kind::Text, "Period of a periodic component; a bare number is milliseconds."),
        ),
        (
            Optional,
            &ElementRule::text(
                "priority",
                Kind::Integer(i32::MIN as i64, i32::MAX as i64),
                "Real-time priority, 1 to 99; needs policy SCHED_FIFO or SCHED_RR.",
            ),
        ),
        (
            Optional,
            &ElementRule::text(
                "policy",
                Kind::OneOf(&["SCHED_OTHER", "SCHED_FIFO", "SCHED_RR"]),
                "Scheduling policy of its thread.",
            ),
        ),
        (
            Optional,
            &ElementRule::text(
                "lifecycle_type",
                Kind::Usually(&["start", "init"]),
                "start: run at boot; init: initialise only.",
            ),
        ),
        (Optional, &ElementRule::text("creation_type", CREATION, "singleton: at most one slot may use the class.")),
        (
            Optional,
            &ElementRule::text("instance_creation", CREATION, "The same as creation_type, in the editor's spelling."),
        ),
        (Optional, &DEADLINE),
        (Optional, &ElementRule::value("stack", Kind::Bytes, "Stack of one callback, 64KiB to 1GiB; default 1MiB.")),
    ],
    "When and how the callbacks run.",
);

static DEADLINE: ElementRule = ElementRule {
    name: "deadline",
    about: "How long on_execute may take: beyond it overrun. Without one a callback hangs after 1 s.",
    attributes: &[optional(
        "hang",
        Kind::Duration,
        "Beyond it the callback hangs and is ended; default: twice the deadline.",
    )],
    children: &[],
    content: Content::Value(Kind::Duration),
};

static PROPERTY: ElementRule = ElementRule {
    name: "property",
    about: "A named value that the component reads.",
    attributes: &[
        required("name", Kind::Name, "Its name."),
        optional("type", Kind::Text, "Its type: double, int, bool, string, ..."),
    ],
    children: &[],
    content: Content::Text(Kind::Text),
};

/// Named values that the component reads.
pub static PROPERTIES: ElementRule =
    ElementRule::parent("properties", &[(Many, &PROPERTY)], "Named values that the component reads.");

/// Values of `usage` of data and event ports.
pub const USAGE: Kind = Kind::OneOf(&["input", "output"]);
const QUEUE_POLICY: Kind = Kind::OneOf(&["LAST", "FIFO", "LIFO", "UFIFO"]);
const DATA_TYPE: ElementRule = ElementRule::value("data_type", Kind::Name, "Type of what it carries.");

static POLICY_PARAM: ElementRule = ElementRule {
    name: "policy_param",
    about: "Parameter of the queue, in the spelling of <policy>.",
    attributes: &[required("name", Kind::OneOf(&["size"]), "size: most values held.")],
    children: &[],
    content: Content::Text(Kind::Integer(0, i32::MAX as i64)),
};

static OVERFLOW: ElementRule = ElementRule::value(
    "overflow",
    Kind::OneOf(&["drop_oldest", "drop_newest", "fault"]),
    "What a full FIFO does with one more value.",
);

static DATA_PORT: ElementRule = ElementRule::parent(
    "data_port",
    &[
        (One, &ElementRule::value("name", Kind::Name, "Name, unique in the component.")),
        (One, &ElementRule::value("usage", USAGE, "Direction.")),
        (One, &DATA_TYPE),
        (Optional, &DESCRIPTION),
        (Optional, &REFERENCE),
        (Optional, &LAYOUT),
        (Optional, &ElementRule::text("queueing_policy", QUEUE_POLICY, "How an input buffers: LAST or FIFO.")),
        (Optional, &ElementRule::text("queuing_policy", QUEUE_POLICY, "The same, in another spelling.")),
        (Optional, &ElementRule::text("policy", QUEUE_POLICY, "The same, in a third spelling.")),
        (Many, &POLICY_PARAM),
        (
            Optional,
            &ElementRule::text("queue_size", Kind::Integer(0, i32::MAX as i64), "Most values that a FIFO holds."),
        ),
        (Optional, &OVERFLOW),
        (
            Optional,
            &ElementRule::text(
                "prescale",
                Kind::Integer(1, i32::MAX as i64),
                "An input gets every n-th value; a push client whatever it asks for when it subscribes.",
            ),
        ),
        (
            Optional,
            &ElementRule::text(
                "timeout",
                Kind::Duration,
                "Longest wait of a push client for the next value, 1s without it.",
            ),
        ),
        (
            Optional,
            &ElementRule::text("period", Kind::Duration, "Cycle of a timed push server, instead of the plugin's."),
        ),
        (
            Optional,
            &ElementRule::text(
                "min_cycle",
                Kind::Duration,
                "Least time between two values of an output; earlier ones are not sent.",
            ),
        ),
        (Many, &VALIDITY),
        (Optional, &MAX_AGE),
    ],
    "A port for data: the newest value, or a queue.",
);

static EVENT_PORT: ElementRule = ElementRule::parent(
    "event_port",
    &[
        (One, &ElementRule::value("name", Kind::Name, "Name, unique in the component.")),
        (One, &ElementRule::value("usage", USAGE, "Direction.")),
        (Optional, &ElementRule::text("data_type", Kind::Text, "Type of what it carries.")),
        (Optional, &DESCRIPTION),
        (Optional, &REFERENCE),
        (Optional, &LAYOUT),
        (
            Optional,
            &ElementRule::text(
                "queue_size",
                Kind::Integer(1, limits::FIFO_SIZE_MAX as i64),
                "Events that may wait at an input, 15 where neither it nor the class says.",
            ),
        ),
        (Optional, &OVERFLOW),
        (
            Optional,
            &ElementRule::text(
                "activations",
                Kind::Integer(1, limits::ACTIVATIONS_MAX as i64),
                "Activations that an input may have at once, 16 without it.",
            ),
        ),
        (
            Optional,
            &ElementRule::text("timeout", Kind::Duration, "Longest time that an event is waited for, 1s without it."),
        ),
    ],
    "A port for events.",
);

/// What becomes of a call when its provider fails.
pub static ON_GONE: ElementRule = ElementRule::value(
    "on_gone",
    Kind::OneOf(&["fail", "retry"]),
    "When the provider fails while it has a call: fail tells the caller, retry asks the successor again.",
);

static SERVICE_PORT: ElementRule = ElementRule::parent(
    "service_port",
    &[
        (One, &ElementRule::value("name", Kind::Name, "Name, unique in the component.")),
        (One, &ElementRule::value("usage", Kind::OneOf(&["provided", "required"]), "Who calls whom.")),
        (Optional, &ElementRule::text("type", Kind::Text, "Name of the interface.")),
        (Optional, &REFERENCE),
        (Optional, &DESCRIPTION),
        (Optional, &LAYOUT),
        (
            Optional,
            &ElementRule::text(
                "queue_size",
                Kind::Integer(1, limits::INBOX_MAX as i64),
                "Calls that may wait for a provided service, 64 without it.",
            ),
        ),
        (
            Optional,
            &ElementRule::text(
                "pending",
                Kind::Integer(1, limits::PENDING_MAX as i64),
                "Calls that a required service may have open at once, 8 without it.",
            ),
        ),
        (
            Optional,
            &ElementRule::text("timeout", Kind::Duration, "Longest time that a call is waited for, 1s without it."),
        ),
        (Optional, &ON_GONE),
    ],
    "A port for calls.",
);

static PORTS: ElementRule = ElementRule::parent(
    "ports",
    &[(Many, &DATA_PORT), (Many, &EVENT_PORT), (Many, &SERVICE_PORT)],
    "The component's ports.",
);

static VAR: ElementRule = ElementRule {
    name: "var",
    about: "A variable that a monitor may read.",
    attributes: &[required("name", Kind::Name, "Its name."), optional("type", Kind::Text, "Its type.")],
    children: &[],
    content: Content::Text(Kind::Text),
};

static FSM: ElementRule = ElementRule::parent(
    "fsm",
    &[
        (Optional, &ElementRule::text("name", Kind::Text, "Name.")),
        (Optional, &ElementRule::text("type", Kind::Text, "Type.")),
        (Optional, &REFERENCE),
    ],
    "A state machine of OPRoS; not used.",
);

static DATA_TYPE_REFERENCE: ElementRule = ElementRule {
    name: "reference",
    about: "File of a data type.",
    attributes: &[optional("name", Kind::Text, "Name of the data type.")],
    children: &[],
    content: Content::Text(Kind::Text),
};

/// A component class: what a plugin exports.
pub static COMPONENT: ElementRule = ElementRule::parent(
    "component_profile",
    &[
        (Optional, &ID),
        (One, &ElementRule::value("name", Kind::Name, "Class name: what the plugin exports.")),
        (Optional, &VERSION),
        (Optional, &DESCRIPTION),
        (Optional, &LAYOUT),
        (Optional, &COLLAPSED),
        (Optional, &COPYRIGHT),
        (Optional, &APP_DOMAIN),
        (Optional, &APP_ROBOT),
        (One, &EXECUTION_ENVIRONMENT),
        (One, &EXECUTION_SEMANTICS),
        (Optional, &PROPERTIES),
        (Optional, &ElementRule::parent("data_type_list", &[(Many, &DATA_TYPE_REFERENCE)], "Files of its data types.")),
        (
            Optional,
            &ElementRule::parent(
                "defined_data_types",
                &[(Many, &ElementRule::text("defined_data_type", Kind::Text, "File of a data type."))],
                "Files of its data types.",
            ),
        ),
        (
            Optional,
            &ElementRule::parent(
                "defined_service_types",
                &[(Many, &ElementRule::text("defined_service_type", Kind::Text, "File of an interface."))],
                "Files of its interfaces.",
            ),
        ),
        (Optional, &ElementRule::parent("exports", &[(Many, &VAR)], "Variables that a monitor may read.")),
        (Optional, &ElementRule::parent("monitoring", &[(Many, &VAR)], "Variables that a monitor may read.")),
        (Optional, &FSM),
        (Optional, &PORTS),
    ],
    "A component class: what a plugin exports.",
);
