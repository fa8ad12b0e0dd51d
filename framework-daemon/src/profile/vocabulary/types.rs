//! Elements of `data_type` and `service_port_type_profile`.

use super::Times::{Many, One, Optional};
use super::component::{DESCRIPTION, ID};
use super::{Content, ElementRule, Kind, optional, required};

static ITEM: ElementRule = ElementRule {
    name: "item",
    about: "A field: its text is the name.",
    attributes: &[required("type", Kind::Name, "Its type.")],
    children: &[],
    content: Content::Value(Kind::Name),
};

/// Communication objects as structures of fields.
pub static DATA_TYPE: ElementRule = ElementRule::parent(
    "data_type",
    &[
        (Optional, &ID),
        (Optional, &DESCRIPTION),
        (
            Many,
            &ElementRule {
                name: "struct",
                about: "A communication object.",
                attributes: &[required("name", Kind::Name, "Its type name.")],
                children: &[(Many, &ITEM)],
                content: Content::Elements,
            },
        ),
    ],
    "Communication objects as structures of fields.",
);

static PARAM: ElementRule = ElementRule {
    name: "param",
    about: "A parameter of a method.",
    attributes: &[optional("index", Kind::Text, "Its place.")],
    children: &[
        (Optional, &ElementRule::text("name", Kind::Text, "Its name.")),
        (Optional, &ElementRule::text("type", Kind::Text, "Its type.")),
    ],
    content: Content::Elements,
};

static METHOD: ElementRule = ElementRule {
    name: "method",
    about: "A method of an interface.",
    attributes: &[
        required("name", Kind::Name, "Its name."),
        optional("return_type", Kind::Text, "Type of its result."),
        optional("call_type", Kind::Usually(&["blocking", "nonblocking"]), "Whether the caller waits."),
    ],
    children: &[(Many, &PARAM), (Optional, &DESCRIPTION)],
    content: Content::Elements,
};

/// Interfaces of service ports.
pub static SERVICE_TYPE: ElementRule = ElementRule::parent(
    "service_port_type_profile",
    &[
        (Optional, &ID),
        (Optional, &DESCRIPTION),
        (
            Many,
            &ElementRule::parent(
                "service_port_type",
                &[
                    (One, &ElementRule::value("type_name", Kind::Name, "Name of the interface.")),
                    (Optional, &DESCRIPTION),
                    (Many, &METHOD),
                ],
                "An interface.",
            ),
        ),
    ],
    "Interfaces of service ports.",
);
