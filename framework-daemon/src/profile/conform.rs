//! A tree against its vocabulary: unknown, missing, repeated, misspelt, of the wrong kind.
//!
//! Everything that a table can say is said here, so that the files that extract (`component`, `application`, ...) need not
//! look at errors at all: they read what is there. A name in the wrong case is put right in the tree, with a warning.

use super::diagnostic::Reporter;
use super::quantity;
use super::source::Span;
use super::suggest;
use super::vocabulary::{self, AttributeRule, Content, ElementRule, Kind, Times};
use super::xml::{Attribute, Element};
use crate::model::limits;

/// Checks `element` and everything in it against `rule`.
pub fn conform(element: &mut Element, rule: &'static ElementRule, report: &mut Reporter) {
    if rule.content == Content::Noise {
        return;
    }
    check_attributes(element, rule, report);
    check_children(element, rule, report);
    check_text(element, rule, report);
}

fn check_attributes(element: &mut Element, rule: &'static ElementRule, report: &mut Reporter) {
    for attribute in &mut element.attributes {
        // What ties a file to its schema is nobody's business but the editor's.
        if attribute.name.starts_with("xmlns")
            || attribute.name.starts_with("xsi:")
            || attribute.name.starts_with("xml:")
        {
            continue;
        }
        check_attribute(attribute, rule, report);
    }
    for wanted in rule.attributes.iter().filter(|wanted| wanted.required) {
        if element.attribute(wanted.name).is_none() {
            let message = format!("<{}> needs the attribute {}", rule.name, wanted.name);
            report.error(element.name_span, message).hint = Some(format!("{}: {}", wanted.name, wanted.about));
        }
    }
}

fn check_attribute(attribute: &mut Attribute, rule: &'static ElementRule, report: &mut Reporter) {
    let Some(found) = find_attribute(attribute, rule, report) else {
        let names: Vec<&str> = rule.attributes.iter().map(|known| known.name).collect();
        let hint = suggest::hint(&attribute.name, &names, str::to_owned);
        let message = format!("unknown attribute {} in <{}>", attribute.name, rule.name);
        report.error(attribute.name_span, message).hint = hint;
        return;
    };
    if attribute.value.trim().is_empty() {
        if found.required || !matches!(found.kind, Kind::Text | Kind::Usually(_)) {
            report.error(attribute.name_span, format!("the attribute {} is empty", found.name)).hint =
                Some(format!("{}: {}", found.name, found.about));
        }
        return;
    }
    attribute.value = attribute.value.trim().to_owned();
    check_kind(&mut attribute.value, attribute.value_span, found.kind, found.name, report);
}

fn find_attribute(
    attribute: &mut Attribute,
    rule: &'static ElementRule,
    report: &mut Reporter,
) -> Option<&'static AttributeRule> {
    if let Some(found) = rule.attributes.iter().find(|known| known.name == attribute.name) {
        return Some(found);
    }
    let found = rule.attributes.iter().find(|known| same_but_case(known.name, &attribute.name))?;
    report.warning(attribute.name_span, format!("attribute {} is written {}", attribute.name, found.name));
    found.name.clone_into(&mut attribute.name);
    Some(found)
}

fn check_children(element: &mut Element, rule: &'static ElementRule, report: &mut Reporter) {
    let mut first_seen: Vec<Option<Span>> = vec![None; rule.children.len()];
    for child in &mut element.children {
        let Some(index) = find_child(child, rule, report) else { continue };
        let Some((times, child_rule)) = rule.children.get(index) else { continue };
        if let Some(Some(first)) = first_seen.get(index)
            && *times != Times::Many
        {
            let line = report.location(*first).line;
            let message = format!("<{}> stands twice in <{}>; the first is in line {line}", child_rule.name, rule.name);
            report.error(child.name_span, message).hint = Some("remove one of them".to_owned());
        }
        if let Some(seen) = first_seen.get_mut(index) {
            seen.get_or_insert(child.name_span);
        }
        conform(child, child_rule, report);
    }
    for ((times, wanted), seen) in rule.children.iter().zip(&first_seen) {
        if *times == Times::One && seen.is_none() {
            let message = format!("<{}> needs the element <{}>", rule.name, wanted.name);
            report.error(element.name_span, message).hint = Some(format!("<{}>: {}", wanted.name, wanted.about));
        }
    }
}

/// The index of the rule that a child falls under; reports what falls under none.
fn find_child(child: &mut Element, rule: &'static ElementRule, report: &mut Reporter) -> Option<usize> {
    let exact = rule.children.iter().position(|(_, known)| known.name == child.name);
    if exact.is_some() {
        return exact;
    }
    if let Some(index) = rule.children.iter().position(|(_, known)| same_but_case(known.name, &child.name)) {
        let (_, known) = rule.children.get(index)?;
        report.warning(child.name_span, format!("<{}> is written <{}>", child.name, known.name));
        known.name.clone_into(&mut child.name);
        return Some(index);
    }
    let message = format!("unknown element <{}> in <{}>", child.name, rule.name);
    let hint = if report.is_full() { None } else { unknown_child_hint(&child.name, rule) };
    report.error(child.name_span, message).hint = hint;
    None
}

fn unknown_child_hint(name: &str, rule: &'static ElementRule) -> Option<String> {
    let known: Vec<&str> = rule.children.iter().map(|(_, child)| child.name).collect();
    if let Some(near) = suggest::nearest(name, known.iter().copied()) {
        return Some(format!("did you mean <{near}>?"));
    }
    let parents = vocabulary::parents_of(name);
    if !parents.is_empty() {
        let list: Vec<String> = parents.iter().map(|parent| format!("<{parent}>")).collect();
        return Some(format!("<{name}> belongs in {}", list.join(", ")));
    }
    if known.is_empty() {
        return Some(format!("<{}> holds no elements", rule.name));
    }
    suggest::hint(name, &known, |known| format!("<{known}>"))
}

fn check_text(element: &mut Element, rule: &'static ElementRule, report: &mut Reporter) {
    let span = element.text_span;
    match rule.content {
        Content::Elements => {
            if !element.text.is_empty() {
                report.warning(span, format!("text in <{}> is ignored", rule.name)).hint =
                    Some("remove it, or make it a comment".to_owned());
            }
        }
        Content::Text(kind) => {
            if !element.text.is_empty() {
                check_kind(&mut element.text, span, kind, rule.name, report);
            }
        }
        Content::Value(kind) => {
            if element.text.is_empty() {
                report.error(element.name_span, format!("<{}> is empty", rule.name)).hint =
                    Some(format!("<{}>: {}", rule.name, rule.about));
            } else {
                check_kind(&mut element.text, span, kind, rule.name, report);
            }
        }
        Content::Noise => {}
    }
}

fn check_kind(text: &mut String, span: Span, kind: Kind, what: &str, report: &mut Reporter) {
    // A span of a text with references or line breaks in it is longer than the text, which is what a caret wants.
    let wrong = match kind {
        Kind::Text => None,
        Kind::Name => overlong(text),
        Kind::Names => text.split_whitespace().find_map(overlong),
        Kind::OneOf(words) => return check_word(text, span, words, true, what, report),
        Kind::Usually(words) => return check_word(text, span, words, false, what, report),
        Kind::Duration => quantity::duration(text).err(),
        Kind::Number => quantity::number(text).err(),
        Kind::Integer(min, max) => quantity::integer(text, min, max).err(),
        Kind::Bytes => quantity::bytes(text).err(),
        Kind::Cpus => quantity::cpus(text).err(),
    };
    if let Some(wrong) = wrong {
        report.error(span, format!("{what}: {wrong}"));
    }
}

fn check_word(
    text: &mut String,
    span: Span,
    words: &'static [&'static str],
    strict: bool,
    what: &str,
    report: &mut Reporter,
) {
    if words.contains(&text.as_str()) {
        return;
    }
    if let Some(word) = words.iter().find(|word| same_but_case(word, text)) {
        report.warning(span, format!("{what}: \"{text}\" is written \"{word}\""));
        (*word).clone_into(text);
        return;
    }
    let message = format!("{what}: \"{text}\" is not one of {}", words.join(", "));
    let hint = suggest::nearest(text, words.iter().copied()).map(|word| format!("did you mean {word}?"));
    if strict {
        report.error(span, message).hint = hint;
    } else {
        report.warning(span, message).hint =
            hint.or_else(|| Some("OPRoS accepted it, so it is accepted here".to_owned()));
    }
}

fn overlong(name: &str) -> Option<String> {
    (name.chars().count() > limits::NAME_CHARS).then(|| format!("longer than {} characters", limits::NAME_CHARS))
}

fn same_but_case(left: &str, right: &str) -> bool {
    left.eq_ignore_ascii_case(right)
}
