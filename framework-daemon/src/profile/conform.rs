//! A tree against its vocabulary: unknown, missing, repeated, misspelt, of the wrong kind.
//!
//! Everything that a table can say is said here, so that the files that extract (`component`, `application`, ...) need not
//! look at errors at all: they read what is there. A name in the wrong case is put right in the tree, with a warning; a
//! misspelt one is put right too, once its error is told, so that one mistake is one error: who wrote `<nam>` need not hear
//! that `<name>` is missing, and that nothing is called what stands in it.

use std::collections::HashSet;

use super::diagnostic::{Reporter, words_of};
use super::quantity;
use super::source::Span;
use super::suggest;
use super::vocabulary::{self, AttributeRule, Content, ElementRule, Kind, Times};
use super::xml::{Attribute, Element};
use crate::model::limits;

/// Checks `element` and everything in it against `rule`.
pub fn conform(element: &mut Element, rule: &'static ElementRule, report: &mut Reporter) {
    conform_beside(&[], element, rule, report);
}

/// The same where strangers of these names stand beside it: one that it lacks may be meant for it.
fn conform_beside(strangers: &[String], element: &mut Element, rule: &'static ElementRule, report: &mut Reporter) {
    if rule.content == Content::Noise {
        return;
    }
    check_attributes(element, rule, report);
    check_children(strangers, element, rule, report);
    check_text(element, rule, report);
}

fn check_attributes(element: &mut Element, rule: &'static ElementRule, report: &mut Reporter) {
    let mut given: HashSet<String> = element.attributes.iter().map(|attribute| attribute.name.clone()).collect();
    let mut misread = false;
    for attribute in &mut element.attributes {
        // What ties a file to its schema is nobody's business but the editor's.
        if attribute.name.starts_with("xmlns")
            || attribute.name.starts_with("xsi:")
            || attribute.name.starts_with("xml:")
        {
            continue;
        }
        misread |= !check_attribute(attribute, rule, &mut given, report);
    }
    element.misread |= misread;
    // One that is written as an element is told with the elements.
    let is_child = |name: &str| rule.children.iter().any(|(_, known)| known.name == name);
    let is_given = |name: &str| element.attribute(name).is_some() || (!is_child(name) && element.child(name).is_some());
    let missing = rule.attributes.iter().filter(|wanted| wanted.required && !is_given(wanted.name));
    let missing: Vec<(String, &str)> = missing.map(|wanted| (wanted.name.to_owned(), wanted.about)).collect();
    match missing.as_slice() {
        // What it needs stands between its tags.
        [(name, _)] if rule.content == Content::Elements && !element.text.is_empty() => {
            let hint = format!("write <{} {name}=\"{}\"/>", rule.name, element.text);
            report.error(element.name_span, format!("<{}> needs the attribute {name}", rule.name)).hint = Some(hint);
            element.text.clear();
        }
        _ => tell_missing(element, rule, "attribute", &missing, report),
    }
}

/// All that an element lacks of one sort, as one error.
fn tell_missing(
    element: &Element,
    rule: &'static ElementRule,
    sort: &str,
    missing: &[(String, &str)],
    report: &mut Reporter,
) {
    let Some(((last, _), before)) = missing.split_last() else { return };
    let plural = if before.is_empty() { "" } else { "s" };
    let mut names = before.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
    names.push_str(if before.is_empty() { "" } else { " and " });
    let message = format!("<{}> needs the {sort}{plural} {names}{last}", rule.name);
    let about: Vec<String> = missing.iter().map(|(name, about)| format!("{name}: {about}")).collect();
    report.error(element.name_span, message).hint = Some(about.join(" "));
}

/// False where it says nothing.
fn check_attribute(
    attribute: &mut Attribute,
    rule: &'static ElementRule,
    given: &mut HashSet<String>,
    report: &mut Reporter,
) -> bool {
    let Some(found) = find_attribute(attribute, rule, given, report) else { return false };
    if attribute.value.trim().is_empty() {
        if found.required || !matches!(found.kind, Kind::Text | Kind::Usually(_)) {
            report.error(attribute.name_span, format!("the attribute {} is empty", found.name)).hint =
                Some(format!("{}: {}", found.name, found.about));
        }
        return false;
    }
    let blanks = attribute.value.len() - attribute.value.trim_start().len();
    attribute.value_span.start += u32::try_from(blanks).unwrap_or(0);
    attribute.value = attribute.value.trim().to_owned();
    check_kind(&mut attribute.value, attribute.value_span, found.kind, found.name, report);
    true
}

/// The rule that an attribute falls under. A misspelt one is put right in the tree once it is reported, so that nothing that
/// follows from it is reported too.
fn find_attribute(
    attribute: &mut Attribute,
    rule: &'static ElementRule,
    given: &mut HashSet<String>,
    report: &mut Reporter,
) -> Option<&'static AttributeRule> {
    if let Some(found) = rule.attributes.iter().find(|known| known.name == attribute.name) {
        return Some(found);
    }
    let names: Vec<&str> = rule.attributes.iter().map(|known| known.name).collect();
    let other_case = names.iter().copied().find(|name| same_but_case(name, &attribute.name));
    let wanted = rule.attributes.iter().filter(|known| known.required && !given.contains(known.name));
    // Nobody will read the hints beyond the limit.
    let near = || suggest::nearest(&attribute.name, names.iter().copied()).filter(|_| !report.is_full());
    let near = other_case.or_else(near);
    let is_near = near.is_some();
    let meant = near.or_else(|| only(wanted).map(|known| known.name));
    let free = meant.filter(|name| !given.contains(*name));
    if other_case.is_some() && free.is_some() {
        let message = format!("attribute {} is written {}", attribute.name, free.unwrap_or_default());
        report.warning(attribute.name_span, message);
    } else {
        let as_told = as_element(attribute, rule).filter(|_| meant.is_none());
        // The element of that name is another one elsewhere.
        let elsewhere = if is_near { Vec::new() } else { vocabulary::parents_with(rule.name, &attribute.name) };
        let hint = match (meant, free) {
            _ if !elsewhere.is_empty() => {
                format!("<{} {}=...> belongs in <{}>", rule.name, attribute.name, elsewhere.join(">, <"))
            }
            (Some(name), None) => format!("{name} stands here already: remove one of them"),
            (Some(name), Some(_)) => format!("did you mean {name}?"),
            _ if as_told.is_some() => as_told.unwrap_or_default(),
            (None, _) if names.is_empty() && rule.children.is_empty() => format!("<{}> has no attributes", rule.name),
            (None, _) if names.is_empty() => {
                let held = rule.children.iter().map(|(_, held)| held.name);
                format!("<{}> has no attributes; it holds elements: {}", rule.name, suggest::listed(held))
            }
            (None, _) => format!("possible here: {}", suggest::listed(names)),
        };
        let message = format!("unknown attribute {} in <{}>", attribute.name, rule.name);
        report.error(attribute.name_span, message).hint = Some(hint);
    }
    let found = rule.attributes.iter().find(|known| Some(known.name) == free)?;
    found.name.clone_into(&mut attribute.name);
    given.insert(found.name.to_owned());
    if !is_near {
        // A guess, good enough for a hint: nothing is concluded from the value.
        attribute.value.clear();
        return None;
    }
    Some(found)
}

fn check_children(strangers: &[String], element: &mut Element, rule: &'static ElementRule, report: &mut Reporter) {
    let is_known = |name: &str| rule.children.iter().any(|(_, known)| same_but_case(known.name, name));
    let mine: Vec<String> = element
        .children
        .iter()
        .map(|child| child.name.clone())
        .filter(|name| !is_known(name))
        .take(STRANGERS)
        .collect();
    let mut too_deep: Vec<String> = Vec::new();
    let mut given: HashSet<String> = element.children.iter().map(|child| child.name.clone()).collect();
    let mut misread = false;
    let mut first_seen: Vec<Option<Span>> = vec![None; rule.children.len()];
    for child in &mut element.children {
        let Some(index) = find_child(child, rule, &mut given, report) else {
            misread = true;
            too_deep.extend(child.children.iter().map(|inner| inner.name.clone()).take(STRANGERS));
            continue;
        };
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
        conform_beside(&mine, child, child_rule, report);
    }
    element.misread |= misread;
    let wanted = rule.children.iter().zip(&first_seen).filter(|((times, _), _)| *times == Times::One);
    let is_told = |name: &str| strangers.iter().chain(&too_deep).any(|stranger| stranger == name);
    let missing = wanted.filter(|((_, wanted), seen)| seen.is_none() && !is_told(wanted.name));
    let missing: Vec<(String, &str)> =
        missing.map(|((_, wanted), _)| (format!("<{}>", wanted.name), wanted.about)).collect();
    tell_missing(element, rule, "element", &missing, report);
}

/// How many elements in the wrong place are looked at for what is missing elsewhere.
const STRANGERS: usize = 16;

/// The index of the rule that a child falls under; reports what falls under none. A misspelt one, or the only one that can be what
/// is missing, is put right in the tree, as attributes are, where there is room for another of that name.
fn find_child(
    child: &mut Element,
    rule: &'static ElementRule,
    given: &mut HashSet<String>,
    report: &mut Reporter,
) -> Option<usize> {
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
    // Nobody will read the hints beyond the limit.
    if report.is_full() {
        report.error(child.name_span, message);
        return None;
    }
    let wanted = rule.children.iter().filter(|(times, known)| *times == Times::One && !given.contains(known.name));
    // What belongs elsewhere is no other name for what is missing here.
    let is_stranger = |known: &ElementRule| {
        vocabulary::parents_of(&child.name).is_empty() && (child.children.is_empty() || !known.children.is_empty())
    };
    let missing = only(wanted).filter(|(_, known)| is_stranger(known)).map(|(_, known)| known.name);
    let near = suggest::nearest(&child.name, rule.children.iter().map(|(_, known)| known.name)).or(missing);
    let hint = near.map(|near| format!("did you mean <{near}>?"));
    let hint = hint.or_else(|| as_attribute(child, rule)).or_else(|| unknown_child_hint(&child.name, rule));
    report.error(child.name_span, message).hint = hint;
    let index = rule.children.iter().position(|(_, known)| Some(known.name) == near)?;
    let (times, known) = rule.children.get(index)?;
    if *times != Times::Many && given.contains(known.name) {
        return None;
    }
    known.name.clone_into(&mut child.name);
    given.insert(known.name.to_owned());
    Some(index)
}

/// The one there is; `None`: there is none, or several.
fn only<T>(mut all: impl Iterator<Item = T>) -> Option<T> {
    all.next().filter(|_| all.next().is_none())
}

/// What is an attribute of the element that it stands in.
fn as_attribute(child: &Element, rule: &'static ElementRule) -> Option<String> {
    let meant = rule.attributes.iter().find(|known| same_but_case(known.name, &child.name))?;
    Some(format!("{0} is an attribute: write <{1} {0}=\"{2}\">", meant.name, rule.name, child.text))
}

/// What is an element in the element that it stands in, or its text.
fn as_element(attribute: &Attribute, rule: &'static ElementRule) -> Option<String> {
    let (name, value) = (&attribute.name, &attribute.value);
    if let Some((_, known)) = rule.children.iter().find(|(_, known)| same_but_case(known.name, name)) {
        return Some(format!("{0} is an element: write <{1} ...><{0}>{value}</{0}></{1}>", known.name, rule.name));
    }
    let is_text = matches!(rule.content, Content::Text(_) | Content::Value(_)) && name.eq_ignore_ascii_case("value");
    is_text.then(|| format!("the value stands between the tags: write <{0} ...>{value}</{0}>", rule.name))
}

fn unknown_child_hint(name: &str, rule: &'static ElementRule) -> Option<String> {
    let holds = |known: &ElementRule| known.children.iter().any(|(_, inner)| inner.name == name);
    let mut parents: Vec<&str> =
        rule.children.iter().filter(|(_, known)| holds(known)).map(|(_, known)| known.name).collect();
    if parents.is_empty() {
        parents = vocabulary::parents_of(name);
    }
    if !parents.is_empty() {
        let list: Vec<String> = parents.iter().map(|parent| format!("<{parent}>")).collect();
        return Some(format!("<{name}> belongs in {}", list.join(", ")));
    }
    let known = rule.children.iter().filter(|(_, child)| child.content != Content::Noise);
    let known: Vec<String> = known.map(|(_, child)| format!("<{}>", child.name)).collect();
    if known.is_empty() {
        return Some(format!("<{}> holds no elements", rule.name));
    }
    Some(format!("possible here: {}", suggest::listed(known.iter().map(String::as_str))))
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
        Kind::Name => {
            let wrong = overlong(text);
            if wrong.is_some() {
                // Nothing is called that, and nothing will be looked for by it.
                text.clear();
            }
            wrong
        }
        Kind::Names => return check_names(text, span, what, report),
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

/// A list of names. Commas are taken for blanks, once they are reported.
fn check_names(text: &mut String, span: Span, what: &str, report: &mut Reporter) {
    if let Some(at) = text.find(',') {
        let comma = Span::new(span.start as usize + at, 1);
        report.error(comma, format!("{what}: names are separated by blanks, not by commas")).hint = Some(format!(
            "write {what}=\"{}\"",
            text.split([',', ' ']).filter(|name| !name.is_empty()).collect::<Vec<_>>().join(" ")
        ));
        *text = text.replace(',', " ");
    }
    let mut names = HashSet::new();
    for (name, span) in words_of(text, span) {
        if let Some(wrong) = overlong(name) {
            report.error(span, format!("{what}: {wrong}"));
        } else if !names.insert(name) {
            report.error(span, format!("{what}: \"{name}\" stands here twice")).hint =
                Some("remove one of them".to_owned());
        }
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
    // `SCHED_FIFO` where `fifo` is meant.
    let lower = text.to_lowercase();
    let held = words.iter().copied().find(|word| word.len() > 2 && lower.ends_with(word));
    let near = suggest::nearest(text, words.iter().copied()).or(held);
    let hint = near.map(|word| format!("did you mean {word}?"));
    if strict {
        report.error(span, message).hint = hint;
        // What follows from it is no news.
        near.unwrap_or(text).to_owned().clone_into(text);
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
