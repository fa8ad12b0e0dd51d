//! Elements of `application_profile`, `package_profile` (two names of one thing) and `composite_component_profile`.

use super::Times::{Many, One, Optional};
use super::component::{
    APP_DOMAIN, APP_ROBOT, COLLAPSED, COPYRIGHT, DESCRIPTION, EXECUTION_ENVIRONMENT, ID, LAYOUT, NAME, ON_GONE,
    PROPERTIES, REFERENCE, VERSION,
};
use super::fault::{DEPENDENCY, FAULT_TOLERANCE, MONITOR, REFERENCE_MODEL, VALIDITY, VOTING};
use super::{Content, ElementRule, Kind, optional, required};

static SUBCOMPONENT: ElementRule = ElementRule {
    name: "subcomponent",
    about: "A slot: a named place that an instance fills.",
    attributes: &[
        optional("type", Kind::Text, "atomic, composite or original; ignored, the referenced file tells."),
        optional("read_only", Kind::Text, "Left by an editor; ignored."),
        optional("layout", Kind::Text, "Left by an editor; ignored."),
        optional("id", Kind::Text, "Left by an editor; ignored."),
    ],
    children: &[
        (One, &ElementRule::value("name", Kind::Name, "Name of the slot, unique in the directory.")),
        (One, &ElementRule::value("reference", Kind::Name, "Profile of its component or composite.")),
        (Optional, &ElementRule::text("node_id", Kind::Text, "Node that runs it.")),
        (Optional, &ID),
        (Optional, &VERSION),
        (Optional, &DESCRIPTION),
        (
            Optional,
            &ElementRule::text(
                "type",
                Kind::Text,
                "atomic, composite or original; ignored, the referenced file tells.",
            ),
        ),
        (Optional, &LAYOUT),
        (Optional, &COLLAPSED),
        (Many, &ElementRule::noise("port_layouts")),
        (Optional, &PROPERTIES),
        (
            Optional,
            &ElementRule::value("executor", Kind::Name, "Declared executor that runs it; none: one of its own."),
        ),
        (Optional, &FAULT_TOLERANCE),
    ],
    content: Content::Elements,
};

static SUBCOMPONENTS: ElementRule =
    ElementRule::parent("subcomponents", &[(Many, &SUBCOMPONENT)], "The slots of the application.");

const END: &[super::AttributeRule] = &[
    required("component_name", Kind::Name, "Slot."),
    required("port_name", Kind::Name, "Its port."),
    optional("layout", Kind::Text, "Left by an editor; ignored."),
];

static PORT_CONNECTION: ElementRule = ElementRule {
    name: "port_connection",
    about: "One output to one input.",
    attributes: &[
        required("port_type", Kind::OneOf(&["data", "event", "service"]), "Kind of both ports."),
        optional("io_type", Kind::Text, "Transport of OPRoS; ignored."),
        optional("id", Kind::Text, "Left by an editor; ignored."),
        optional("layout", Kind::Text, "Left by an editor; ignored."),
    ],
    children: &[
        (One, &ElementRule::attributed("source", END, "Output or required port.")),
        (One, &ElementRule::attributed("target", END, "Input or provided port.")),
        (Many, &ElementRule::noise("bend_points")),
        (Many, &VALIDITY),
        (Optional, &ON_GONE),
    ],
    content: Content::Elements,
};

static PORT_CONNECTIONS: ElementRule =
    ElementRule::parent("port_connections", &[(Many, &PORT_CONNECTION)], "What is connected with what.");

static COORDINATION: ElementRule = ElementRule::parent(
    "coordination",
    &[(
        Many,
        &ElementRule::attributed(
            "depends",
            &[
                required("source", Kind::Name, "Slot that runs after the target."),
                required("target", Kind::Name, "Slot that runs first."),
            ],
            "Run order of two slots.",
        ),
    )],
    "Run order of slots.",
);

static TOPICS: ElementRule = ElementRule::noise("topics");
static ABOUT_APPLICATION: &str = "An application: slots and their connections.";

macro_rules! assembly {
    ($name:literal, $about:expr, [$($extra:expr),* $(,)?]) => {
        ElementRule::parent(
            $name,
            &[
                (Optional, &ID),
                (One, &NAME),
                (Optional, &VERSION),
                (Optional, &DESCRIPTION),
                (Optional, &COPYRIGHT),
                (Optional, &REFERENCE),
                (Optional, &LAYOUT),
                (Optional, &COLLAPSED),
                (Optional, &APP_DOMAIN),
                (Optional, &APP_ROBOT),
                (Many, &TOPICS),
                (One, &SUBCOMPONENTS),
                (Optional, &PORT_CONNECTIONS),
                (Optional, &COORDINATION),
                (Many, &DEPENDENCY),
                (Many, &MONITOR),
                (Many, &REFERENCE_MODEL),
                (Many, &VOTING),
                $($extra),*
            ],
            $about,
        )
    };
}

/// An application.
pub static APPLICATION: ElementRule = assembly!("application_profile", ABOUT_APPLICATION, []);

/// An application, in the newer spelling.
pub static PACKAGE: ElementRule = assembly!("package_profile", ABOUT_APPLICATION, []);

static EXPORT_PORT: ElementRule = ElementRule::parent(
    "export_port",
    &[
        (One, &ElementRule::value("component_name", Kind::Name, "Inner slot.")),
        (One, &ElementRule::value("port_name", Kind::Name, "Its port.")),
        (Optional, &ElementRule::text("port_type", Kind::OneOf(&["data", "event", "service"]), "Kind of the port.")),
        (
            Optional,
            &ElementRule::text(
                "port_dir",
                Kind::Usually(&["input", "output", "provided", "required"]),
                "Direction of the port.",
            ),
        ),
        (Optional, &ElementRule::text("export_port_name", Kind::Text, "Name outside; default: the inner name.")),
        (Optional, &LAYOUT),
    ],
    "A port of an inner slot that shows outside.",
);

static EXPORT_PORTS: ElementRule =
    ElementRule::parent("export_ports", &[(Many, &EXPORT_PORT)], "Ports that show outside.");

/// A component made of components.
pub static COMPOSITE: ElementRule = assembly!(
    "composite_component_profile",
    "A component made of components.",
    [(One, &EXPORT_PORTS), (Optional, &EXECUTION_ENVIRONMENT)]
);
