//! Every element and attribute that profiles may hold, as data.
//!
//! The loader checks each file against these tables (`conform`), the XSDs are written from them (`xsd`), and hints come
//! from them: one truth. The first draft had the allowed names in the code that reads each root; the XSD then said
//! something else after a day.

/// `application_profile`, `package_profile`, `composite_component_profile`.
pub mod application;
/// `component_profile`.
pub mod component;
/// `fault_tolerance`, `validity` and what goes with them.
pub mod fault;
/// `system_profile`.
pub mod system;
/// `data_type`, `service_port_type_profile`.
pub mod types;

/// What a text or an attribute value must be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Anything.
    Text,
    /// A name: not empty, not endless.
    Name,
    /// Names separated by blanks.
    Names,
    /// One of these words.
    OneOf(&'static [&'static str]),
    /// One of these words; another is accepted with a warning, because OPRoS took it.
    Usually(&'static [&'static str]),
    /// A time: bare milliseconds, or with `us`, `ms`, `s`.
    Duration,
    /// A finite number.
    Number,
    /// A whole number between two bounds, both included.
    Integer(i64, i64),
    /// A size: bytes, or with `KiB`, `MiB`, `GiB`.
    Bytes,
    /// Processor numbers: `2`, `0,1`, `0-3`.
    Cpus,
}

/// What an element holds besides its children.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Content {
    /// Nothing: text is accepted with a warning.
    Elements,
    /// Text; an empty element counts as absent.
    Text(Kind),
    /// Text that must be there.
    Value(Kind),
    /// Whatever an editor left here.
    Noise,
}

/// How often a child may stand in its parent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Times {
    /// At most once.
    Optional,
    /// Exactly once.
    One,
    /// As often as one likes.
    Many,
}

/// An attribute.
#[derive(Clone, Copy, Debug)]
pub struct AttributeRule {
    /// Its name.
    pub name: &'static str,
    /// What its value must be.
    pub kind: Kind,
    /// True where the element is useless without it.
    pub required: bool,
    /// What it means, in one line.
    pub about: &'static str,
}

/// An element.
#[derive(Clone, Copy, Debug)]
pub struct ElementRule {
    /// Its name.
    pub name: &'static str,
    /// What it means, in one line.
    pub about: &'static str,
    /// Its attributes.
    pub attributes: &'static [AttributeRule],
    /// Its children, in any order.
    pub children: &'static [(Times, &'static ElementRule)],
    /// What else it holds.
    pub content: Content,
}

impl ElementRule {
    /// An element of text without attributes.
    #[must_use]
    pub const fn text(name: &'static str, kind: Kind, about: &'static str) -> Self {
        Self { name, about, attributes: &[], children: &[], content: Content::Text(kind) }
    }

    /// An element of text that must not be empty, without attributes.
    #[must_use]
    pub const fn value(name: &'static str, kind: Kind, about: &'static str) -> Self {
        Self { name, about, attributes: &[], children: &[], content: Content::Value(kind) }
    }

    /// What only an editor needs.
    #[must_use]
    pub const fn noise(name: &'static str) -> Self {
        Self { name, about: "Left by an editor; ignored.", attributes: &[], children: &[], content: Content::Noise }
    }

    /// An element of children, without attributes.
    #[must_use]
    pub const fn parent(name: &'static str, children: &'static [(Times, &'static Self)], about: &'static str) -> Self {
        Self { name, about, attributes: &[], children, content: Content::Elements }
    }

    /// An element of attributes only.
    #[must_use]
    pub const fn attributed(name: &'static str, attributes: &'static [AttributeRule], about: &'static str) -> Self {
        Self { name, about, attributes, children: &[], content: Content::Elements }
    }
}

/// An attribute that must be there.
#[must_use]
pub const fn required(name: &'static str, kind: Kind, about: &'static str) -> AttributeRule {
    AttributeRule { name, kind, required: true, about }
}

/// An attribute that may be there.
#[must_use]
pub const fn optional(name: &'static str, kind: Kind, about: &'static str) -> AttributeRule {
    AttributeRule { name, kind, required: false, about }
}

/// Every root that this daemon uses.
pub static ROOTS: &[&ElementRule] = &[
    &component::COMPONENT,
    &application::APPLICATION,
    &application::PACKAGE,
    &application::COMPOSITE,
    &system::SYSTEM,
    &types::DATA_TYPE,
    &types::SERVICE_TYPE,
];

/// Roots of OPRoS's engine and editors that hold nothing this daemon uses.
pub const LEGACY_ROOTS: [&str; 4] = ["system_config", "OPRoSProject", "fsm_profile", "OPRoS"];

/// Names of all elements that may hold an element called `name`.
#[must_use]
pub fn parents_of(name: &str) -> Vec<&'static str> {
    let mut parents = Vec::new();
    for root in ROOTS {
        collect_parents(root, name, &mut parents);
    }
    parents
}

/// Names of all elements that may hold an element called `name` with that attribute.
#[must_use]
pub fn parents_with(name: &str, attribute: &str) -> Vec<&'static str> {
    let mut parents = Vec::new();
    let has_it = |rule: &ElementRule| rule.attributes.iter().any(|known| known.name == attribute);
    for root in ROOTS {
        collect(root, &|child| child.name == name && has_it(child), &mut parents);
    }
    parents
}

fn collect_parents(rule: &'static ElementRule, name: &str, parents: &mut Vec<&'static str>) {
    collect(rule, &|child| child.name == name && child.content != Content::Noise, parents);
}

fn collect(rule: &'static ElementRule, is_it: &impl Fn(&ElementRule) -> bool, parents: &mut Vec<&'static str>) {
    for (_, child) in rule.children {
        if is_it(child) && !parents.contains(&rule.name) {
            parents.push(rule.name);
        }
        collect(child, is_it, parents);
    }
}
