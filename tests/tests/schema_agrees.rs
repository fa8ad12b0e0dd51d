//! The XSDs say the same as the loader's tables, in both directions.
//!
//! `UPDATE_GOLDEN=1 cargo test -p tests --test schema_agrees` writes them anew.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use framework_daemon::profile::diagnostic::Level;
use framework_daemon::profile::single;
use framework_daemon::profile::source::Source;
use framework_daemon::profile::vocabulary::{Content, ElementRule, Kind};
use framework_daemon::profile::xml::{self, Element};
use framework_daemon::profile::xsd::{SCHEMAS, schema};

fn schema_dir() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../profiles/schema")
}

#[test]
fn the_schema_files_are_what_the_tables_say() {
    for (file, roots) in SCHEMAS {
        let path = schema_dir().join(file);
        let text = schema(roots);
        if std::env::var_os("UPDATE_GOLDEN").is_some() {
            std::fs::write(&path, &text).expect("the schema can be written");
        }
        let found = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(found == text, "{file} differs from the tables; UPDATE_GOLDEN=1 writes it anew");
    }
}

/// The writer could forget something of the tables, so the schemas are also read back and compared with them.
#[test]
fn every_element_attribute_and_word_stands_in_both() {
    for (file, roots) in SCHEMAS {
        let text = std::fs::read_to_string(schema_dir().join(file)).expect("the schema exists");
        let tree = xml::parse(&Source::from_text(Path::new(file), text)).expect("the schema is well-formed");
        let (mut in_schema, mut in_tables) = (BTreeSet::new(), BTreeSet::new());
        for element in tree.children_of("xs:element") {
            facts_of_schema(&tree, element, "", &mut in_schema);
        }
        roots.iter().for_each(|rule| facts_of_table(rule, "", &mut in_tables));
        let differing: Vec<_> = in_schema.symmetric_difference(&in_tables).collect();
        assert!(differing.is_empty(), "{file}: {differing:?}");
    }
}

fn facts_of_table(rule: &ElementRule, above: &str, facts: &mut BTreeSet<String>) {
    let path = format!("{above}/{}", rule.name);
    facts.insert(path.clone());
    for attribute in rule.attributes {
        let need = if attribute.required { "!" } else { "" };
        facts.insert(format!("{path}@{}{need}", attribute.name));
        facts.extend(words(attribute.kind).map(|word| format!("{path}@{}={word}", attribute.name)));
    }
    if let Content::Text(kind) | Content::Value(kind) = rule.content {
        facts.extend(words(kind).map(|word| format!("{path}={word}")));
    }
    rule.children.iter().for_each(|(_, child)| facts_of_table(child, &path, facts));
}

fn words(kind: Kind) -> impl Iterator<Item = &'static str> {
    match kind {
        Kind::OneOf(words) | Kind::Usually(words) => words.iter().copied(),
        _ => [].iter().copied(),
    }
}

fn facts_of_schema(tree: &Element, element: &Element, above: &str, facts: &mut BTreeSet<String>) {
    let path = format!("{above}/{}", element.value_of("name"));
    facts.insert(path.clone());
    let type_name = element.value_of("type");
    match tree.children_of("xs:complexType").find(|found| found.value_of("name") == type_name) {
        Some(shared) => walk_type(tree, shared, &path, facts),
        None => enumerations_of_type(tree, type_name, &path, facts),
    }
    for part in &element.children {
        walk_type(tree, part, &path, facts);
    }
}

fn walk_type(tree: &Element, part: &Element, path: &str, facts: &mut BTreeSet<String>) {
    match part.name.as_str() {
        "xs:element" => return facts_of_schema(tree, part, path, facts),
        "xs:attribute" => {
            let name = part.value_of("name");
            let need = if part.value_of("use") == "required" { "!" } else { "" };
            facts.insert(format!("{path}@{name}{need}"));
            return enumerations_of_type(tree, part.value_of("type"), &format!("{path}@{name}"), facts);
        }
        "xs:extension" => enumerations_of_type(tree, part.value_of("base"), path, facts),
        _ => {}
    }
    part.children.iter().for_each(|inner| walk_type(tree, inner, path, facts));
}

fn enumerations_of_type(tree: &Element, name: &str, path: &str, facts: &mut BTreeSet<String>) {
    let Some(definition) = tree.children_of("xs:simpleType").find(|found| found.value_of("name") == name) else {
        assert!(name.is_empty() || name.starts_with("xs:"), "type {name} is not defined");
        return;
    };
    enumerations(definition, path, facts);
}

fn enumerations(element: &Element, path: &str, facts: &mut BTreeSet<String>) {
    if element.name == "xs:enumeration" {
        facts.insert(format!("{path}={}", element.value_of("value")));
    }
    element.children.iter().for_each(|inner| enumerations(inner, path, facts));
}

/// A second opinion where there is one: the schemas are valid XSD, and accept a profile that the loader accepts.
#[test]
fn xmllint_agrees_where_it_is_installed() {
    if Command::new("xmllint").arg("--version").output().is_err() {
        println!("SKIPPED: xmllint is not installed");
        return;
    }
    for (file, example) in EXAMPLES {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let path = dir.path().join("example.xml");
        std::fs::write(&path, example).expect("the example can be written");
        let run =
            Command::new("xmllint").arg("--noout").arg("--schema").arg(schema_dir().join(file)).arg(&path).output();
        let output = run.expect("xmllint runs");
        assert!(output.status.success(), "{file}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

/// Where xmllint refuses a profile, the loader has something to say about it too; the other way round it may know more.
#[test]
fn what_the_schema_refuses_the_loader_reports() {
    if Command::new("xmllint").arg("--version").output().is_err() {
        println!("SKIPPED: xmllint is not installed");
        return;
    }
    let mut refused = 0;
    for path in ["broken", "doubtful"].iter().flat_map(|kind| examples(kind)) {
        let document = single::check(&path);
        let schema = SCHEMAS.iter().find(|(_, roots)| roots.iter().any(|rule| rule.name == document.root));
        let Some((file, _)) = schema.filter(|_| document.profile.is_some()) else { continue };
        let run =
            Command::new("xmllint").arg("--noout").arg("--schema").arg(schema_dir().join(file)).arg(&path).output();
        let output = run.expect("xmllint runs");
        if !output.status.success() {
            refused += 1;
            let said = document.findings.iter().any(|finding| finding.level != Level::Note);
            assert!(said, "{}: {}", path.display(), String::from_utf8_lossy(&output.stderr));
        }
    }
    assert!(refused > 25, "the schemas refuse only {refused} of the broken profiles");
}

fn examples(kind: &str) -> Vec<PathBuf> {
    let cases = std::fs::read_dir(schema_dir().join("..").join(kind)).expect("the examples exist");
    let files = cases.flatten().filter_map(|case| std::fs::read_dir(case.path()).ok()).flatten().flatten();
    files.map(|file| file.path()).filter(|path| path.extension().is_some_and(|ext| ext == "xml")).collect()
}

const EXAMPLES: [(&str, &str); 6] = [
    (
        "system.xsd",
        "<system_profile><executor name='a' policy='fifo' priority='50' cpu='0-1'/><name>s</name></system_profile>",
    ),
    (
        "application.xsd",
        "<application_profile><name>a</name><subcomponents><subcomponent><reference>B.xml</reference><name>b</name>\
         <fault_tolerance><severity>reset</severity><severity symptom='crash'>stop</severity><reset limit='3' within='10s'/>\
         </fault_tolerance></subcomponent></subcomponents><port_connections/></application_profile>",
    ),
    (
        "component.xsd",
        "<component_profile><name>C</name><execution_environment><library_name>c</library_name></execution_environment>\
         <execution_semantics><period/><type>passive</type><priority>5</priority></execution_semantics><ports><data_port>\
         <usage>input</usage><name>p</name><data_type>double</data_type><queue_size/><validity><min>-1.5e3</min></validity>\
         </data_port></ports></component_profile>",
    ),
    (
        "composite.xsd",
        "<composite_component_profile><name>K</name><subcomponents/><export_ports/></composite_component_profile>",
    ),
    ("data_type.xsd", "<data_type><struct name='S'><item type='int'>x</item></struct></data_type>"),
    (
        "service.xsd",
        "<service_port_type_profile><service_port_type><method name='m'/><type_name>T</type_name></service_port_type>\
         </service_port_type_profile>",
    ),
];
