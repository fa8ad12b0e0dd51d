//! The vocabulary as XML Schema 1.0, for editors and for other tools.
//!
//! Written from the tables, so that it cannot say anything else; the files under `profiles/schema` are this text, and a
//! test compares them. Two things are beyond XSD 1.0: children in any order of which only some may repeat (the schema
//! then lets all repeat, and the documentation says which must stand once), and everything that spans elements or files.
//! On the other hand it is strict where the loader only warns: wrong case, stray text.

use std::fmt::Write;

use super::vocabulary::{AttributeRule, Content, ElementRule, Kind, Times, application, component, system, types};
use crate::model::limits;

/// The schemas: file name and roots.
pub static SCHEMAS: &[(&str, &[&ElementRule])] = &[
    ("system.xsd", &[&system::SYSTEM]),
    ("application.xsd", &[&application::APPLICATION, &application::PACKAGE]),
    ("component.xsd", &[&component::COMPONENT]),
    ("composite.xsd", &[&application::COMPOSITE]),
    ("data_type.xsd", &[&types::DATA_TYPE]),
    ("service.xsd", &[&types::SERVICE_TYPE]),
];

const HEAD: &str = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
    <!-- Written from the loader's own tables (framework-daemon/src/profile/vocabulary). Do not edit. -->\n\
    <xs:schema xmlns:xs=\"http://www.w3.org/2001/XMLSchema\">\n";

/// The schema of some roots.
#[must_use]
pub fn schema(roots: &[&ElementRule]) -> String {
    let mut writer = Writer::default();
    match roots {
        [root] => writer.element(root, "", 1),
        // Several names of one thing share one type.
        [first, ..] => {
            let shared = format!("{}_type", first.name);
            writer.complex_type(first, &format!(" name=\"{shared}\""), 1);
            for root in roots {
                writer.line(1, &format!("<xs:element name=\"{}\" type=\"{shared}\">", root.name));
                writer.about(root, 2);
                writer.line(1, "</xs:element>");
            }
        }
        [] => {}
    }
    let define =
        |(name, body): &(String, String)| format!("  <xs:simpleType name=\"{name}\">\n{body}  </xs:simpleType>\n");
    let types: String = writer.types.iter().map(define).collect();
    format!("{HEAD}{types}{}</xs:schema>\n", writer.out)
}

#[derive(Default)]
struct Writer {
    out: String,
    /// Named simple types: a type with attributes around it can only extend a named one.
    types: Vec<(String, String)>,
}

impl Writer {
    fn line(&mut self, depth: usize, text: &str) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.out, "{}{text}", "  ".repeat(depth));
    }

    fn element(&mut self, rule: &ElementRule, occurs: &str, depth: usize) {
        let name = rule.name;
        let plain = rule.children.is_empty() && rule.attributes.is_empty();
        if let (true, Content::Text(kind) | Content::Value(kind)) = (plain, rule.content) {
            let simple = self.simple_type(kind, matches!(rule.content, Content::Text(_)), name);
            self.line(depth, &format!("<xs:element name=\"{name}\" type=\"{simple}\"{occurs}>"));
            self.about(rule, depth + 1);
            return self.line(depth, "</xs:element>");
        }
        self.line(depth, &format!("<xs:element name=\"{name}\"{occurs}>"));
        self.about(rule, depth + 1);
        self.complex_type(rule, "", depth + 1);
        self.line(depth, "</xs:element>");
    }

    fn about(&mut self, rule: &ElementRule, depth: usize) {
        let once = rule.children.iter().filter(|(times, _)| *times == Times::One);
        let names: Vec<String> = once.map(|(_, child)| format!("<{}>", child.name)).collect();
        let mut text = rule.about.to_owned();
        if repeats(rule) && !names.is_empty() {
            let _ = write!(text, " Exactly once: {}.", names.join(", "));
        }
        let text = quick_xml::escape::escape(text);
        self.line(depth, &format!("<xs:annotation><xs:documentation>{text}</xs:documentation></xs:annotation>"));
    }

    fn complex_type(&mut self, rule: &ElementRule, named: &str, depth: usize) {
        match rule.content {
            Content::Noise => {
                self.line(depth, &format!("<xs:complexType{named} mixed=\"true\">"));
                self.line(depth + 1, "<xs:sequence>");
                self.line(depth + 2, "<xs:any processContents=\"skip\" minOccurs=\"0\" maxOccurs=\"unbounded\"/>");
                self.line(depth + 1, "</xs:sequence>");
                self.line(depth + 1, "<xs:anyAttribute processContents=\"skip\"/>");
            }
            Content::Elements => {
                self.line(depth, &format!("<xs:complexType{named}>"));
                self.children(rule, depth + 1);
                self.attributes(rule.attributes, rule.name, depth + 1);
            }
            Content::Text(kind) | Content::Value(kind) => {
                let base = self.simple_type(kind, matches!(rule.content, Content::Text(_)), rule.name);
                self.line(depth, &format!("<xs:complexType{named}>"));
                self.line(depth + 1, "<xs:simpleContent>");
                self.line(depth + 2, &format!("<xs:extension base=\"{base}\">"));
                self.attributes(rule.attributes, rule.name, depth + 3);
                self.line(depth + 2, "</xs:extension>");
                self.line(depth + 1, "</xs:simpleContent>");
            }
        }
        self.line(depth, "</xs:complexType>");
    }

    fn children(&mut self, rule: &ElementRule, depth: usize) {
        if rule.children.is_empty() {
            return;
        }
        let group = if repeats(rule) { "choice" } else { "all" };
        let often = if repeats(rule) { " minOccurs=\"0\" maxOccurs=\"unbounded\"" } else { "" };
        self.line(depth, &format!("<xs:{group}{often}>"));
        for (times, child) in rule.children {
            let occurs = if !repeats(rule) && *times == Times::Optional { " minOccurs=\"0\"" } else { "" };
            self.element(child, occurs, depth + 1);
        }
        self.line(depth, &format!("</xs:{group}>"));
    }

    fn attributes(&mut self, rules: &[AttributeRule], owner: &str, depth: usize) {
        for rule in rules {
            let may_be_empty = !rule.required && matches!(rule.kind, Kind::Text | Kind::Usually(_));
            let simple = self.simple_type(rule.kind, may_be_empty, &format!("{owner}_{}", rule.name));
            let usage = if rule.required { " use=\"required\"" } else { "" };
            self.line(depth, &format!("<xs:attribute name=\"{}\" type=\"{simple}\"{usage}>", rule.name));
            let about = quick_xml::escape::escape(rule.about);
            let text = format!("<xs:annotation><xs:documentation>{about}</xs:documentation></xs:annotation>");
            self.line(depth + 1, &text);
            self.line(depth, "</xs:attribute>");
        }
    }

    /// The name of the simple type of `kind`, defined on first use.
    fn simple_type(&mut self, kind: Kind, may_be_empty: bool, owner: &str) -> String {
        if kind == Kind::Text {
            return "xs:string".to_owned();
        }
        let body = if may_be_empty { or_empty(&restriction(kind)) } else { restriction(kind) };
        if let Some((name, _)) = self.types.iter().find(|(_, known)| *known == body) {
            return name.clone();
        }
        let stem = match kind {
            Kind::Name => "name",
            Kind::Names => "names",
            Kind::Duration => "time",
            Kind::Number => "number",
            Kind::Bytes => "size",
            Kind::Cpus => "processors",
            _ => owner,
        };
        let mut name = if may_be_empty { format!("{stem}_or_empty") } else { format!("{stem}_text") };
        while self.types.iter().any(|(taken, _)| *taken == name) {
            name.push('_');
        }
        self.types.push((name.clone(), body));
        name
    }
}

fn repeats(rule: &ElementRule) -> bool {
    rule.children.iter().any(|(times, _)| *times == Times::Many)
}

fn or_empty(restriction: &str) -> String {
    let empty = "<xs:restriction base=\"xs:token\"><xs:length value=\"0\"/></xs:restriction>";
    format!(
        "    <xs:union>\n    <xs:simpleType>\n{restriction}    </xs:simpleType>\n    \
         <xs:simpleType>{empty}</xs:simpleType>\n    </xs:union>\n"
    )
}

fn restriction(kind: Kind) -> String {
    let facets = match kind {
        Kind::Text => return String::new(),
        Kind::Name => {
            format!("<xs:minLength value=\"1\"/><xs:maxLength value=\"{}\"/>", limits::NAME_CHARS)
        }
        Kind::Names => "<xs:minLength value=\"1\"/>".to_owned(),
        Kind::OneOf(words) => enumeration(words),
        Kind::Usually(words) => {
            let usual = enumeration(words);
            let usual =
                format!("<xs:simpleType><xs:restriction base=\"xs:token\">{usual}</xs:restriction></xs:simpleType>");
            return format!("    <xs:union memberTypes=\"xs:token\">{usual}</xs:union>\n");
        }
        Kind::Duration => "<xs:pattern value=\"[+]?([0-9]+(\\.[0-9]*)?|\\.[0-9]+)\\s*(us|µs|ms|s)?\"/>".to_owned(),
        Kind::Number => "<xs:pattern value=\"[+\\-]?([0-9]+(\\.[0-9]*)?|\\.[0-9]+)([eE][+\\-]?[0-9]+)?\"/>".to_owned(),
        Kind::Bytes => "<xs:pattern value=\"[0-9]+\\s*(B|KiB|MiB|GiB)?\"/>".to_owned(),
        Kind::Cpus => "<xs:pattern value=\"[0-9]+(-[0-9]+)?([, ]+[0-9]+(-[0-9]+)?)*\"/>".to_owned(),
        Kind::Integer(min, max) => {
            let facets = format!("<xs:minInclusive value=\"{min}\"/><xs:maxInclusive value=\"{max}\"/>");
            return format!("    <xs:restriction base=\"xs:integer\">{facets}</xs:restriction>\n");
        }
    };
    format!("    <xs:restriction base=\"xs:token\">{facets}</xs:restriction>\n")
}

fn enumeration(words: &[&str]) -> String {
    words.iter().map(|word| format!("<xs:enumeration value=\"{word}\"/>")).collect()
}
