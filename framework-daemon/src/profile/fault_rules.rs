//! What the integrator says about faults: `fault_tolerance` of a slot, `validity` of a port or connection.
//!
//! Everything of the language is read and validated now. What has no effect yet is told by a note, so that nobody trusts
//! a rule that does not act.

use std::collections::HashSet;
use std::time::Duration;

use serde::Serialize;

use super::diagnostic::Reporter;
use super::plan::{Coverage, FaultRules, Intensity, Isolation, Limit, OnInvalid, Preload, SparePlan, Validity};
use super::quantity;
use super::source::{Spot, Word};
use super::suggest;
use super::xml::Element;
use crate::model::limits;
use crate::model::symptom::{Severity, SeverityTable, Symptom};

/// `fault_tolerance` as written, references not yet resolved.
#[derive(Clone, Debug, Serialize)]
pub struct Declared {
    /// The rules; `secondaries` is empty until the references are resolved.
    #[serde(flatten)]
    pub rules: FaultRules,
    /// The references.
    pub references: Vec<Secondary>,
    /// Where it says that a fault brings the robot to its safe state.
    #[serde(skip)]
    pub emergency: Option<Spot>,
}

/// A `<secondary>` as written.
#[derive(Clone, Debug, Serialize)]
pub struct Secondary {
    /// Its profile.
    pub reference: Word,
    /// How far it is prepared.
    pub preload: Preload,
}

/// Reads `<fault_tolerance>`.
pub fn read(element: &Element, report: &mut Reporter) -> Declared {
    let rules = FaultRules {
        severity: severities(element, report),
        named: named(element),
        reset: element.child("reset").map(|reset| intensity(reset, report)),
        secondaries: Vec::new(),
        spares: element.child("spare").map(spares),
        checkpoint: element.child("checkpoint").map(|checkpoint| period_of_checkpoint(checkpoint, report)),
        recovery_within: element.child("recovery").and_then(|recovery| positive(recovery, "within", report)),
        isolation: isolation(element, report),
        coverage: coverage(element),
    };
    let references = secondaries(element, report);
    let declared = Declared { rules, references, emergency: emergency(element, report) };
    warn_of_idle_ladder(element, &declared, report);
    if element.children.is_empty() {
        report.warning(element.name_span, "<fault_tolerance> says nothing").hint =
            Some("say what to do about a fault, <severity>reset</severity>, or remove it".to_owned());
    }
    declared
}

/// A ladder that no severity ever climbs is a mistake that only shows when the robot needs it.
fn warn_of_idle_ladder(element: &Element, declared: &Declared, report: &mut Reporter) {
    let resets = Symptom::ALL.into_iter().any(|symptom| declared.rules.severity.get(symptom) == Severity::Reset);
    // One that cannot be read may be the one that is missed.
    let unread = element.children_of("severity").any(|rule| Severity::from_name(&rule.text).is_none());
    if resets || unread || element.misread {
        return;
    }
    if let Some(idle) = element.child("reset").or_else(|| element.child("secondary")).or_else(|| element.child("spare"))
    {
        report.warning(idle.name_span, format!("<{}> is never used: no severity is \"reset\"", idle.name)).hint =
            Some("add <severity>reset</severity>; without one a crash stops the slot".to_owned());
    }
}

/// The first rule that brings the robot to its safe state.
fn emergency(element: &Element, report: &Reporter) -> Option<Spot> {
    let severity = element.children_of("severity").find(|rule| rule.text == Severity::Emergency.name());
    let coverage = element.child("coverage").filter(|coverage| coverage.text == "system");
    severity.or(coverage).map(|rule| report.spot(rule.text_span))
}

/// Symptoms that the element names one by one.
fn named(element: &Element) -> Vec<Symptom> {
    element.children_of("severity").filter_map(|rule| Symptom::from_name(rule.value_of("symptom"))).collect()
}

fn severities(element: &Element, report: &mut Reporter) -> SeverityTable {
    let mut named: [Option<Severity>; Symptom::COUNT] = [None; Symptom::COUNT];
    let mut exact = [false; Symptom::COUNT];
    let mut default = None;
    let mut seen = HashSet::new();
    for rule in element.children_of("severity") {
        let Some(severity) = Severity::from_name(&rule.text) else { continue };
        let symptom = rule.value_of("symptom");
        if symptom.is_empty() && rule.misread {
            continue;
        }
        if !seen.insert(symptom) {
            let what = if symptom.is_empty() {
                "a default severity".to_owned()
            } else {
                format!("a severity for \"{symptom}\"")
            };
            report.error(rule.name_span, format!("{what} is already given")).hint =
                Some("remove one of them".to_owned());
            continue;
        }
        match symptom {
            "" => default = Some(severity),
            "crash" => {
                let crashes = Symptom::ALL.into_iter().filter(|symptom| symptom.is_crash());
                // `crash.segv` beats `crash` in whatever order they stand.
                crashes
                    .filter(|crash| !exact[*crash as usize])
                    .for_each(|crash| named[crash as usize] = Some(severity));
            }
            name => match Symptom::from_name(name) {
                Some(found) => {
                    named[found as usize] = Some(severity);
                    exact[found as usize] = true;
                }
                None => unknown_symptom(rule, report),
            },
        }
    }
    let mut table = SeverityTable::opros_default();
    for symptom in Symptom::ALL {
        let default = default.filter(|default| is_covered(symptom, *default));
        if let Some(severity) = named[symptom as usize].or(default) {
            table.set(symptom, severity);
        }
    }
    table
}

/// A slot that is late works again: to reset it once more would only be later still, and cost the resets that a fault needs.
/// So a reset of it must be asked for by name. So must one where a device is lost: that does not come back by it, and resets
/// that are spent on it would stop whoever waits for it. A slot that somebody tried to connect wrongly works as before, whatever its
/// other faults ask for.
fn is_covered(symptom: Symptom, default: Severity) -> bool {
    match symptom {
        Symptom::Type => false,
        Symptom::Late | Symptom::Device => default != Severity::Reset,
        _ => true,
    }
}

fn unknown_symptom(rule: &Element, report: &mut Reporter) {
    let mut names = vec!["crash"];
    names.extend(Symptom::ALL.iter().map(|symptom| symptom.name()));
    let word = report.value_word(rule, "symptom");
    let hint = suggest::nearest(&word.text, names.iter().copied())
        .map_or_else(|| format!("symptoms are {}", names.join(", ")), |near| format!("did you mean {near}?"));
    report.error(word.spot.span, format!("unknown symptom \"{}\"", word.text)).hint = Some(hint);
}

fn intensity(element: &Element, report: &mut Reporter) -> Intensity {
    let limit = quantity::integer(element.value_of("limit"), 0, i64::from(limits::RESETS_MAX)).unwrap_or(0);
    let within = if element.attribute("within").is_some() { positive(element, "within", report) } else { None };
    Intensity { limit: u32::try_from(limit).unwrap_or(0), within: within.unwrap_or(limits::RESETS_WINDOW) }
}

fn secondaries(element: &Element, report: &mut Reporter) -> Vec<Secondary> {
    let mut all = Vec::new();
    for secondary in element.children_of("secondary") {
        if all.len() == limits::SECONDARIES {
            report.error(secondary.name_span, format!("more than {} secondaries of one slot", limits::SECONDARIES));
            break;
        }
        let reference = report.value_word(secondary, "reference");
        if !reference.text.is_empty() {
            all.push(Secondary { reference, preload: preload(secondary) });
        }
    }
    all
}

fn preload(element: &Element) -> Preload {
    match element.value_of("preload") {
        "none" => Preload::None,
        "library" => Preload::Library,
        _ => Preload::Instance,
    }
}

fn spares(element: &Element) -> SparePlan {
    let count = quantity::integer(element.value_of("count"), 1, i64::from(limits::SPARES_MAX)).unwrap_or(1);
    SparePlan { count: u32::try_from(count).unwrap_or(1), preload: preload(element) }
}

fn period_of_checkpoint(element: &Element, report: &mut Reporter) -> Duration {
    positive(element, "period", report).unwrap_or_default()
}

fn isolation(element: &Element, report: &mut Reporter) -> Isolation {
    let Some(found) = element.child("isolation").filter(|found| found.text == "process") else {
        return Isolation::Thread;
    };
    report.not_active(found.text_span, "isolation in a process");
    Isolation::Process
}

fn coverage(element: &Element) -> Coverage {
    match element.text_of("coverage") {
        "executor" => Coverage::Executor,
        "system" => Coverage::System,
        _ => Coverage::Component,
    }
}

/// A time in an attribute that must be more than nothing.
pub(super) fn positive(element: &Element, name: &str, report: &mut Reporter) -> Option<Duration> {
    let attribute = element.attribute(name)?;
    let time = quantity::duration(&attribute.value).ok()?;
    if time.is_zero() {
        report.error(attribute.value_span, format!("{name} must be more than 0"));
        return None;
    }
    Some(time)
}

/// Reads every `<validity>` in `parent`.
pub fn validities(parent: &Element, report: &mut Reporter) -> Vec<Validity> {
    let mut all: Vec<Validity> = Vec::new();
    let mut fields = HashSet::new();
    for element in parent.children_of("validity") {
        let validity = validity(element, report);
        if !fields.insert(validity.field.clone()) {
            let what =
                if validity.field.is_empty() { "the object".to_owned() } else { format!("\"{}\"", validity.field) };
            report.error(element.name_span, format!("a validity of {what} is already given here")).hint =
                Some("put all limits of a field into one <validity>".to_owned());
        }
        all.push(validity);
    }
    all
}

fn validity(element: &Element, report: &mut Reporter) -> Validity {
    let (min, max) = (limit(element, "min", report), limit(element, "max", report));
    if let (Some(Limit::Constant(low)), Some(Limit::Constant(high))) = (&min, &max)
        && low > high
    {
        let span = element.child("max").map_or(element.name_span, |max| max.text_span);
        report.error(span, format!("max {high} is less than min {low}: no value would be valid"));
    }
    let max_rate = max_rate(element, report);
    let says_nothing = min.is_none() && max.is_none() && max_rate.is_none() && !element.misread;
    if says_nothing && element.children.iter().all(|c| c.name == "on_invalid") {
        report.error(element.name_span, "<validity> checks nothing").hint =
            Some("give it <min>, <max> or <max_rate>".to_owned());
    }
    check_field_path(element, report);
    Validity {
        field: element.value_of("field").to_owned(),
        min,
        max,
        max_rate,
        delay: quantity::duration(element.value_of("delay")).unwrap_or_default(),
        on_invalid: match element.text_of("on_invalid") {
            "hold" => OnInvalid::Hold,
            "pass" => OnInvalid::Pass,
            _ => OnInvalid::Drop,
        },
        location: report.location(element.name_span),
    }
}

fn check_field_path(element: &Element, report: &mut Reporter) {
    let Some(field) = element.attribute("field") else { return };
    let legal =
        |part: &str| !part.is_empty() && part.chars().all(|c| c.is_alphanumeric() || matches!(c, '_' | '[' | ']'));
    if !field.value.split('.').all(legal) {
        report.error(field.value_span, format!("\"{}\" is not the path of a field", field.value)).hint =
            Some("write a field's name, or the way to it: linear.x".to_owned());
    }
}

fn max_rate(element: &Element, report: &mut Reporter) -> Option<f64> {
    let found = element.child("max_rate")?;
    let rate = quantity::number(&found.text).ok()?;
    if rate <= 0.0 {
        report.error(found.text_span, "max_rate must be more than 0");
        return None;
    }
    Some(rate)
}

/// A constant, or a linear function of another field; both at once contradict each other.
fn limit(element: &Element, name: &str, report: &mut Reporter) -> Option<Limit> {
    let found = element.child(name)?;
    if found.attributes.is_empty() {
        if found.text.is_empty() {
            report.error(found.name_span, format!("<{name}> is empty")).hint =
                Some(format!("write <{name}>3.0</{name}>, or <{name} slope=\"0.5\" of=\"speed\" offset=\"10\"/>"));
        }
        return quantity::number(&found.text).ok().map(Limit::Constant);
    }
    if !found.text.is_empty() {
        report.error(found.text_span, format!("<{name}> is either a number or a linear function, not both"));
    }
    if found.attribute("of").is_none() {
        report.error(found.name_span, format!("a linear <{name}> needs the attribute of")).hint =
            Some("of names the field that the limit depends on".to_owned());
    }
    Some(Limit::Linear {
        slope: found.attribute("slope").map_or(Ok(1.0), |slope| quantity::number(&slope.value)).unwrap_or(1.0),
        of: found.value_of("of").to_owned(),
        offset: quantity::number(found.value_of("offset")).unwrap_or(0.0),
    })
}

/// Reads `<max_age>` in `parent`.
pub fn max_age(parent: &Element, report: &mut Reporter) -> Option<Duration> {
    let found = parent.child("max_age")?;
    let age = quantity::duration(&found.text).ok()?;
    if age.is_zero() {
        report.error(found.text_span, "max_age must be more than 0");
        return None;
    }
    Some(age)
}
