//! `application_profile`, `package_profile`, and what a composite has in common with them: slots and connections as
//! written, names not yet resolved.

use std::time::Duration;

use serde::Serialize;

use super::component;
use super::composite::{self, Export};
use super::diagnostic::Reporter;
use super::fault_rules::{self, Declared};
use super::plan::{Measure, OnGone, PortKind, Property, Validity, VotingMethod};
use super::quantity;
use super::source::{Spot, Word};
use super::xml::Element;
use crate::model::limits;
use crate::model::symptom::Severity;

/// Slots and their connections: an application or a composite.
#[derive(Clone, Debug, Serialize)]
pub struct Assembly {
    /// Its name.
    pub name: Word,
    /// True where a slot or an exported port could not be read: what nothing is called may be its name.
    #[serde(skip)]
    pub incomplete: bool,
    /// Its slots.
    pub subcomponents: Vec<Subcomponent>,
    /// Its connections.
    pub connections: Vec<Connection>,
    /// Ports of a composite that show outside.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub exports: Vec<Export>,
    /// `<dependency>`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub dependencies: Vec<Dependency>,
    /// `<coordination>`: source runs after target.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub order: Vec<(Word, Word)>,
    /// `<monitor>`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub monitors: Vec<Monitor>,
    /// `<reference_model>`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub reference_models: Vec<ReferenceModel>,
    /// `<voting>`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub votings: Vec<Voting>,
}

/// A slot as written.
#[derive(Clone, Debug, Serialize)]
pub struct Subcomponent {
    /// Its name.
    pub name: Word,
    /// The profile that fills it; empty where it is not known, which is reported.
    pub reference: Word,
    /// `node_id`; empty without one.
    pub node: Word,
    /// Property values that override the component's.
    pub properties: Vec<PropertyOverride>,
    /// Declared executor.
    pub executor: Option<Word>,
    /// `fault_tolerance`.
    pub fault_tolerance: Option<Declared>,
}

/// A property of a slot.
#[derive(Clone, Debug, Serialize)]
pub struct PropertyOverride {
    /// Name, type and value.
    #[serde(flatten)]
    pub property: Property,
    /// Where its name stands.
    #[serde(skip)]
    pub spot: Spot,
}

/// One end of a connection as written.
#[derive(Clone, Debug, Serialize)]
pub struct End {
    /// Slot or composite.
    pub component: Word,
    /// Its port.
    pub port: Word,
}

/// A connection as written.
#[derive(Clone, Debug, Serialize)]
pub struct Connection {
    /// `port_type`.
    pub kind: PortKind,
    /// Where it stands.
    #[serde(skip)]
    pub kind_spot: Spot,
    /// Output or required end.
    pub source: End,
    /// Input or provided end.
    pub target: End,
    /// Range checks.
    pub validity: Vec<Validity>,
    /// `<on_gone>`.
    pub on_gone: Option<OnGone>,
    /// Where the element stands.
    #[serde(skip)]
    pub spot: Spot,
}

/// A dependency as written, between slots or between applications.
#[derive(Clone, Debug, Serialize)]
pub struct Dependency {
    /// Who stops.
    pub dependent: Word,
    /// Whom it needs.
    pub on: Vec<Word>,
    /// How many of them; `None`: all.
    pub require: Option<usize>,
    /// Where the number, or else the element, stands.
    #[serde(skip)]
    pub spot: Spot,
}

/// A `<monitor>` as written.
#[derive(Clone, Debug, Serialize)]
pub struct Monitor {
    /// The port.
    pub port: End,
    /// Range checks.
    pub validity: Vec<Validity>,
    /// Silence longer than this is a fault.
    pub max_age: Option<Duration>,
    /// Where the element stands.
    #[serde(skip)]
    pub spot: Spot,
}

/// A `<reference_model>` as written.
#[derive(Clone, Debug, Serialize)]
pub struct ReferenceModel {
    /// The model.
    pub component: Word,
    /// What feeds it: `slot.port`.
    pub input: Word,
    /// What it is compared with: `slot.port`.
    pub target: Word,
    /// Its port that is compared; empty: the one that fits.
    pub output: Word,
    /// Field that is compared.
    pub field: String,
    /// What of it is compared.
    pub measure: Measure,
    /// Sliding window; `None`: it could not be read.
    pub window: Option<Duration>,
    /// Largest difference of the filtered signals.
    pub threshold: f64,
    /// Where the element stands.
    #[serde(skip)]
    pub spot: Spot,
}

/// A `<voting>` as written.
#[derive(Clone, Debug, Serialize)]
pub struct Voting {
    /// The slot that hands the winner on; empty: nothing is handed on.
    pub name: Word,
    /// Slots or ports (`slot.port`).
    pub inputs: Vec<Word>,
    /// How.
    pub method: VotingMethod,
    /// Largest difference that counts as equal.
    pub tolerance: f64,
    /// Field that is compared.
    pub field: String,
    /// An input that is silent for longer is left out.
    pub max_age: Option<Duration>,
    /// How many must agree.
    pub require: Option<usize>,
    /// What to do where too few do.
    pub severity: Severity,
    /// Where the element stands.
    #[serde(skip)]
    pub spot: Spot,
}

/// Reads an application or a composite.
pub fn read(root: &Element, report: &mut Reporter) -> Assembly {
    let name = root.child("name").unwrap_or(root);
    let slots = root.children_of("subcomponents").flat_map(|slots| &slots.children);
    let subcomponents: Vec<Subcomponent> = root
        .grandchildren("subcomponents", "subcomponent")
        .filter_map(|element| subcomponent(element, report))
        .collect();
    let exports = composite::exports(root, report);
    let nameless = root.children_of("voting").any(|voting| voting.misread && voting.value_of("name").is_empty());
    let is_hollow = root.child("subcomponents").is_some_and(|slots| slots.children.is_empty() && slots.text.is_empty());
    if let Some(connections) = root.child("port_connections").filter(|all| is_hollow && !all.children.is_empty()) {
        report.error(connections.name_span, "connections, but no slots: <subcomponents> is empty").hint =
            Some("declare in <subcomponents> the slots that they name".to_owned());
    }
    let exported = root.children_of("export_ports").map(|ports| ports.children.len()).sum::<usize>();
    Assembly {
        name: report.text_word(name),
        incomplete: nameless
            || is_hollow
            || root.misread
            || root.child("subcomponents").is_none()
            || slots.count() != subcomponents.len()
            || exported != exports.len(),
        subcomponents,
        connections: root
            .grandchildren("port_connections", "port_connection")
            .filter_map(|element| connection(element, report))
            .collect(),
        exports,
        dependencies: root.children_of("dependency").map(|element| dependency(element, "component", report)).collect(),
        order: root.grandchildren("coordination", "depends").map(|element| depends(element, report)).collect(),
        monitors: root.children_of("monitor").filter_map(|element| monitor(element, report)).collect(),
        reference_models: root.children_of("reference_model").map(|element| reference_model(element, report)).collect(),
        votings: root.children_of("voting").map(|element| voting(element, report)).collect(),
    }
}

fn subcomponent(element: &Element, report: &mut Reporter) -> Option<Subcomponent> {
    let fault_tolerance = element.child("fault_tolerance").map(|rules| fault_rules::read(rules, report));
    let overrides = component::properties(element, report);
    let name = element.child("name")?;
    doubt_name(name, report);
    let reference = element.child("reference").cloned().unwrap_or_default();
    let properties = element.grandchildren("properties", "property");
    let spots: Vec<(String, Spot)> =
        properties.map(|property| report.value_word(property, "name")).map(|word| (word.text, word.spot)).collect();
    let locate = |property: Property| {
        let found = spots.iter().find(|(name, _)| *name == property.name);
        let spot = found.map_or_else(|| report.spot(element.name_span), |(_, spot)| spot.clone());
        PropertyOverride { property, spot }
    };
    Some(Subcomponent {
        properties: overrides.into_iter().map(locate).collect(),
        name: report.text_word(name),
        reference: report.text_word(&reference),
        node: report.text_word(element.child("node_id").unwrap_or(&Element::default())),
        executor: element.child("executor").filter(|named| !named.text.is_empty()).map(|named| report.text_word(named)),
        fault_tolerance,
    })
    .filter(|slot| !slot.name.text.is_empty())
}

/// A name that cannot be written where slots are named: in lists, before a port, before a symptom.
fn doubt_name(name: &Element, report: &mut Reporter) {
    let is_odd = |letter: char| letter.is_whitespace() || matches!(letter, '.' | ':' | '@');
    if let Some(odd) = name.text.chars().find(|letter| is_odd(*letter)) {
        let message =
            format!("the name \"{}\" has a {odd:?}, which ends a name in lists, `slot.port` and `--inject`", name.text);
        report.warning(name.text_span, message).hint = Some("use letters, digits, - and _".to_owned());
    }
}

fn connection(element: &Element, report: &mut Reporter) -> Option<Connection> {
    let validity = fault_rules::validities(element, report);
    let kind = port_kind(element.value_of("port_type"))?;
    if kind != PortKind::Data
        && let Some(found) = element.child("validity")
    {
        report.error(found.name_span, "<validity> belongs to a connection of data ports");
    }
    if kind != PortKind::Service
        && let Some(found) = element.child("on_gone")
    {
        report.error(found.name_span, "<on_gone> belongs to a connection of service ports");
    }
    Some(Connection {
        kind,
        kind_spot: report.value_word(element, "port_type").spot,
        source: end(element.child("source")?, report)?,
        target: end(element.child("target")?, report)?,
        validity,
        on_gone: on_gone(element),
        spot: report.spot(element.name_span),
    })
}

/// Reads `<on_gone>`.
#[must_use]
pub fn on_gone(parent: &Element) -> Option<OnGone> {
    match parent.text_of("on_gone") {
        "retry" => Some(OnGone::Retry),
        "fail" => Some(OnGone::Fail),
        _ => None,
    }
}

/// The kind of port that a `port_type` names.
#[must_use]
pub fn port_kind(name: &str) -> Option<PortKind> {
    match name {
        "data" => Some(PortKind::Data),
        "event" => Some(PortKind::Event),
        "service" => Some(PortKind::Service),
        _ => None,
    }
}

fn end(element: &Element, report: &Reporter) -> Option<End> {
    let end =
        End { component: report.value_word(element, "component_name"), port: report.value_word(element, "port_name") };
    (!end.component.text.is_empty() && !end.port.text.is_empty()).then_some(end)
}

/// Reads `<dependency>`; `who` is the attribute that names who stops.
pub fn dependency(element: &Element, who: &str, report: &mut Reporter) -> Dependency {
    let on = report.value_words(element, "on");
    let require = element.attribute("require").and_then(|require| require.value.parse().ok());
    let span = element.attribute("require").map_or(element.name_span, |require| require.value_span);
    if require.is_some_and(|require: usize| require > on.len()) {
        let message = format!("requires {} of {}", element.value_of("require"), on.len());
        report.error(span, message).hint = Some("require is at most the number of names in on".to_owned());
    }
    Dependency { dependent: report.value_word(element, who), on, require, spot: report.spot(element.name_span) }
}

fn depends(element: &Element, report: &mut Reporter) -> (Word, Word) {
    report.not_active(element.name_span, "<depends>");
    (report.value_word(element, "source"), report.value_word(element, "target"))
}

/// `None`: it does not say of which port.
fn monitor(element: &Element, report: &mut Reporter) -> Option<Monitor> {
    let port = End { component: report.value_word(element, "component"), port: report.value_word(element, "port") };
    let (validity, max_age) = (fault_rules::validities(element, report), fault_rules::max_age(element, report));
    if port.component.text.is_empty() || port.port.text.is_empty() {
        return None;
    }
    // What it holds instead is told already.
    if element.children.is_empty() && !element.misread {
        report.error(element.name_span, "<monitor> watches nothing").hint =
            Some("give it <validity>, with a limit, or <max_age>".to_owned());
    }
    Some(Monitor { port, validity, max_age, spot: report.spot(element.name_span) })
}

fn reference_model(element: &Element, report: &mut Reporter) -> ReferenceModel {
    let threshold = quantity::number(element.value_of("threshold")).unwrap_or(0.0);
    if threshold < 0.0 {
        report.error(report.value_word(element, "threshold").spot.span, "threshold must not be negative");
    }
    ReferenceModel {
        component: report.value_word(element, "component"),
        input: report.value_word(element, "input"),
        target: report.value_word(element, "target"),
        output: report.value_word(element, "output"),
        field: element.value_of("field").to_owned(),
        measure: if element.value_of("compare") == "rate" { Measure::Rate } else { Measure::Value },
        window: fault_rules::positive(element, "window", report),
        threshold,
        spot: report.spot(element.name_span),
    }
}

/// Two can disagree, but only three can outvote one.
pub const LEAST: usize = 3;

fn voting(element: &Element, report: &mut Reporter) -> Voting {
    let inputs = report.value_words(element, "inputs");
    if !inputs.is_empty() && inputs.len() < LEAST {
        let span = report.value_word(element, "inputs").spot.span;
        report.error(span, format!("a vote needs at least {LEAST} inputs, here are {}", inputs.len())).hint =
            Some("two can disagree, but only three can outvote one".to_owned());
    }
    if let Some(beyond) = inputs.get(limits::VOTERS) {
        report.error(beyond.spot.span, format!("more than {} inputs of one vote", limits::VOTERS)).hint =
            Some("leave some out: three already outvote one".to_owned());
    }
    let tolerance = quantity::number(element.value_of("tolerance")).unwrap_or(0.0);
    if tolerance < 0.0 {
        report.error(report.value_word(element, "tolerance").spot.span, "tolerance must not be negative");
    }
    let require = element.attribute("require").and_then(|require| require.value.parse().ok());
    if let Some(require) = require.filter(|require| *require > inputs.len()) {
        let span = report.value_word(element, "require").spot.span;
        report.error(span, format!("requires {require} of {}", inputs.len())).hint =
            Some("require is at most the number of inputs".to_owned());
    }
    Voting {
        name: report.value_word(element, "name"),
        inputs,
        method: match element.value_of("method") {
            "majority" => VotingMethod::Majority,
            "weighted" => VotingMethod::Weighted,
            _ => VotingMethod::Median,
        },
        tolerance,
        field: element.value_of("field").to_owned(),
        max_age: fault_rules::positive(element, "max_age", report),
        require,
        severity: severity_of_vote(element, report),
        spot: report.spot(element.name_span),
    }
}

/// What is to be done where too few agree: nothing, unless the element says so. What a slot inherits from a composite is about
/// being outvoted, which is another fault.
fn severity_of_vote(element: &Element, report: &mut Reporter) -> Severity {
    let Some(rule) = element.child("severity") else { return Severity::Ignore };
    let symptom = report.value_word(rule, "symptom");
    if !matches!(symptom.text.as_str(), "" | "vote") {
        let message = format!("a voter has no fault \"{}\" of its own", symptom.text);
        report.error(symptom.spot.span, message).hint =
            Some("its one fault is vote: too few agree; what its members do is for their own rules".to_owned());
    }
    let severity = Severity::from_name(&rule.text).unwrap_or(Severity::Ignore);
    if severity == Severity::Reset {
        report.error(rule.text_span, "a voter cannot be reset").hint =
            Some("it has no state that a reset would mend: say ignore, stop or emergency".to_owned());
        return Severity::Ignore;
    }
    if severity == Severity::Stop && element.value_of("name").is_empty() && !element.misread {
        report.error(rule.text_span, "nobody can depend on a voter without a name: stop stops nobody").hint =
            Some("give the <voting> a name, and add <dependency component=\"reader\" on=\"that name\"/>".to_owned());
    }
    severity
}
