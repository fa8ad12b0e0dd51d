//! What good profiles become: slots, connections, rules; every layout, dialect and encoding that OPRoS knew.

use std::fs;
use std::path::Path;
use std::time::Duration;

use framework_daemon::model::symptom::{Severity, Symptom};
use framework_daemon::profile::diagnostic::{Diagnostic, Level};
use framework_daemon::profile::plan::{Limit, OnInvalid, Overflow, Plan, Policy, Preload, Queue, Trigger};
use framework_daemon::profile::{Loaded, load};

fn component(name: &str, more: &str) -> String {
    format!(
        "<component_profile><name>{name}</name><execution_environment><library_name>lib{name}.so</library_name>\
         </execution_environment><execution_semantics><type>periodic</type><period>20</period></execution_semantics>\
         <properties><property name=\"gain\" type=\"double\">1.0</property></properties><ports>{more}\
         <data_port><name>in</name><usage>input</usage><data_type>double</data_type></data_port>\
         <data_port><name>out</name><usage>output</usage><data_type>double</data_type></data_port></ports></component_profile>"
    )
}

fn slot(name: &str, reference: &str, more: &str) -> String {
    format!("<subcomponent><name>{name}</name><reference>{reference}</reference>{more}</subcomponent>")
}

fn link(from: &str, to: &str) -> String {
    let ((a, out), (b, into)) = (from.split_once(':').expect("slot:port"), to.split_once(':').expect("slot:port"));
    format!(
        "<port_connection port_type=\"data\"><source component_name=\"{a}\" port_name=\"{out}\"/>\
         <target component_name=\"{b}\" port_name=\"{into}\"/></port_connection>"
    )
}

fn assembly(root: &str, slots: &[String], links: &[String], more: &str) -> String {
    let (slots, links) = (slots.concat(), links.concat());
    format!(
        "<{root}><name>nav</name><subcomponents>{slots}</subcomponents><port_connections>{links}</port_connections>{more}</{root}>"
    )
}

fn application(slots: &[String], links: &[String]) -> String {
    assembly("application_profile", slots, links, "")
}

fn loaded(files: &[(&str, &str)]) -> Loaded {
    let dir = tempfile::tempdir().expect("a temporary directory");
    for (name, text) in files {
        let path = dir.path().join(name);
        fs::create_dir_all(path.parent().unwrap_or(Path::new("."))).expect("a directory");
        fs::write(path, text).expect("a file");
    }
    load(dir.path()).unwrap_or_else(|found| panic!("{}", found.iter().map(Diagnostic::to_string).collect::<String>()))
}

fn plan(files: &[(&str, &str)]) -> Plan {
    loaded(files).plan
}

#[test]
fn composites_are_flattened_and_their_exported_ports_resolved() {
    let export = |slot: &str, port: &str, name: &str| {
        format!(
            "<export_port><component_name>{slot}</component_name><port_name>{port}</port_name><export_port_name>{name}</export_port_name></export_port>"
        )
    };
    let inner = assembly(
        "composite_component_profile",
        &[slot("left", "A.xml", ""), slot("right", "A.xml", "")],
        &[],
        &format!(
            "<export_ports>{}{}{}</export_ports>",
            export("left", "in", "speed"),
            export("right", "in", "speed"),
            export("left", "out", "state")
        ),
    );
    let outer = assembly(
        "composite_component_profile",
        &[slot("wheels", "Inner.xml", "")],
        &[],
        &format!(
            "<export_ports>{}{}</export_ports>",
            export("wheels", "speed", "speed"),
            export("wheels", "state", "state")
        ),
    );
    let app = application(
        &[slot("base", "Outer.xml", ""), slot("brain", "A.xml", "")],
        &[link("brain:out", "base:speed"), link("base:state", "brain:in")],
    );
    let plan = plan(&[("app.xml", &app), ("Outer.xml", &outer), ("Inner.xml", &inner), ("A.xml", &component("A", ""))]);
    let names: Vec<&str> = plan.slots.iter().map(|slot| slot.name.as_str()).collect();
    assert_eq!(names, ["base.wheels.left", "base.wheels.right", "brain"]);
    let links: Vec<String> = plan
        .connections
        .iter()
        .map(|c| format!("{}.{}>{}.{}", c.source.slot, c.source.port, c.target.slot, c.target.port))
        .collect();
    assert_eq!(
        links,
        ["brain.out>base.wheels.left.in", "brain.out>base.wheels.right.in", "base.wheels.left.out>brain.in"]
    );
}

#[test]
fn references_are_found_in_every_layout_of_opros() {
    let app = application(&[slot("a", "A.xml", "")], &[]);
    for place in ["A.xml", "nav/A.xml", "nav/A/A.xml", "robot/A.xml", "robot/A/A.xml", "A/A.xml", "A/profile/A.xml"] {
        let plan = plan(&[("robot.xml", &app), (place, &component("A", ""))]);
        assert_eq!(plan.slots.len(), 1, "{place}");
    }
    let windows = application(&[slot("a", "parts\\A.xml", "")], &[]);
    assert_eq!(plan(&[("robot.xml", &windows), ("parts/A.xml", &component("A", ""))]).slots.len(), 1);
}

#[test]
fn both_dialects_say_the_same() {
    let editor = "<component_profile><id>x</id><name>A</name><version>1.0</version><layout>1,2,3,4</layout><collapsed>0</collapsed>\
        <copyright><company><name/><phone/></company><license_policy/></copyright>\
        <execution_environment><library_type>dll</library_type><library_name>A.dll</library_name><app_domain/></execution_environment>\
        <execution_semantics><type>non-periodic</type><period/><priority>5</priority><instance_creation>multiple</instance_creation>\
        <lifecycle_type>init</lifecycle_type></execution_semantics><ports><data_port><name>in</name><usage>input</usage>\
        <data_type>int</data_type><reference/><queueing_policy>FIFO</queueing_policy><queue_size>10</queue_size><layout/></data_port></ports>\
        </component_profile>";
    let hand = "<component_profile><name>A</name><description>d</description><execution_environment><os name='Linux' version='6'/>\
        <cpu>x86</cpu><library_name>A.dll</library_name></execution_environment><execution_semantics><type>aperiodic</type>\
        <priority>5</priority><creation_type>multiple</creation_type><lifecycle_type>init</lifecycle_type></execution_semantics>\
        <ports><data_port><name>in</name><usage>input</usage><data_type>int</data_type><policy>FIFO</policy>\
        <policy_param name='size'>10</policy_param></data_port></ports></component_profile>";
    for text in [editor, hand] {
        let plan =
            plan(&[("app.xml", &application(&[slot("a", "A.xml", "<type>atomic</type>")], &[])), ("A.xml", text)]);
        let component = &plan.slots[0].component;
        assert_eq!(component.execution.trigger, Trigger::Nonperiodic);
        assert!(!component.execution.autostart && !component.execution.singleton);
        assert_eq!(component.execution.schedule.policy, Policy::Other);
        assert_eq!(component.data_ports[0].queue, Queue::Fifo { size: 10, overflow: Overflow::DropOldest });
        assert_eq!(component.library, "A.dll");
    }
}

#[test]
fn korean_names_in_their_own_encoding_are_read() {
    let app = application(&[slot("로봇", "A.xml", "")], &[]).replace("nav", "항법");
    let text = format!("<?xml version=\"1.0\" encoding=\"EUC-KR\"?>{app}");
    let (bytes, _, _) = encoding_rs::EUC_KR.encode(&text);
    let dir = tempfile::tempdir().expect("a temporary directory");
    fs::write(dir.path().join("app.xml"), bytes).expect("a file");
    fs::write(dir.path().join("A.xml"), component("A", "")).expect("a file");
    let plan = load(dir.path()).expect("accepted").plan;
    assert_eq!((plan.applications[0].as_str(), plan.slots[0].name.as_str()), ("항법", "로봇"));
}

#[test]
fn fault_rules_are_resolved_and_properties_reach_the_secondary() {
    let rules = "<properties><property name='gain'>2.5</property></properties><fault_tolerance><severity>reset</severity>\
        <severity symptom='crash.segv'>ignore</severity><severity symptom='crash'>stop</severity><reset limit='0'/>\
        <secondary reference='B.xml' preload='library'/><secondary reference='C.xml'/><recovery within='20ms'/></fault_tolerance>";
    let app = application(&[slot("a", "A.xml", rules)], &[]);
    let plan = plan(&[
        ("app.xml", &app),
        ("A.xml", &component("A", "")),
        ("B.xml", &component("B", "")),
        ("C.xml", &component("C", "")),
    ]);
    let slot = &plan.slots[0];
    assert_eq!(slot.properties[0].value, "2.5");
    let severity = |symptom| slot.rules.severity.get(symptom);
    assert_eq!(severity(Symptom::Error), Severity::Reset);
    assert_eq!(severity(Symptom::CrashPanic), Severity::Stop);
    assert_eq!(severity(Symptom::CrashSegv), Severity::Ignore, "the exact name beats crash");
    assert_eq!(slot.rules.reset.map(|reset| (reset.limit, reset.within)), Some((0, Duration::from_secs(10))));
    assert_eq!(slot.rules.recovery_within, Some(Duration::from_millis(20)));
    let secondaries: Vec<_> = slot
        .rules
        .secondaries
        .iter()
        .map(|s| (s.component.name.as_str(), s.preload, s.properties[0].value.as_str()))
        .collect();
    assert_eq!(secondaries, [("B", Preload::Library, "2.5"), ("C", Preload::Instance, "2.5")]);
}

#[test]
fn without_fault_rules_everything_is_as_in_opros() {
    let plan = plan(&[("app.xml", &application(&[slot("a", "A.xml", "")], &[])), ("A.xml", &component("A", ""))]);
    let rules = &plan.slots[0].rules;
    assert_eq!(rules.severity.get(Symptom::CrashSegv), Severity::Stop);
    assert!(rules.reset.is_none() && rules.secondaries.is_empty() && rules.recovery_within.is_none());
    assert_eq!(plan.slots[0].component.data_ports[0].queue, Queue::Last);
}

#[test]
fn an_executor_gives_its_period_to_slots_that_have_none() {
    let system = "<system_profile><name>s</name><plugins>plugins</plugins>\
        <executor name='fast' period='5ms' policy='fifo' priority='80' cpu='0-1'/></system_profile>";
    let app = application(&[slot("a", "A.xml", "<executor>fast</executor>")], &[]);
    let without = component("A", "").replace("<period>20</period>", "");
    let plan = plan(&[("system.xml", system), ("app.xml", &app), ("A.xml", &without), ("plugins/x", "")]);
    assert_eq!(plan.slots[0].component.execution.trigger, Trigger::Periodic(Duration::from_millis(5)));
    assert_eq!(plan.slots[0].executor.as_deref(), Some("fast"));
    assert_eq!(plan.system.executors[0].schedule.cpus, [0, 1]);
    assert!(plan.system.plugin_dirs[0].ends_with("plugins"));
}

#[test]
fn validity_is_read_on_ports_and_connections() {
    let check =
        "<validity field=\"linear.x\" delay=\"50\"><min>-1</min><max>2.5</max><on_invalid>hold</on_invalid></validity>";
    let port = format!("<data_port><name>v</name><usage>output</usage><data_type>Twist</data_type>{check}</data_port>");
    let connection = link("a:out", "b:in").replace("</port_connection>", &format!("{check}</port_connection>"));
    let app = application(&[slot("a", "A.xml", ""), slot("b", "A.xml", "")], &[connection]);
    let plan = plan(&[("app.xml", &app), ("A.xml", &component("A", &port))]);
    for validity in [&plan.slots[0].component.data_ports[0].validity[0], &plan.connections[0].validity[0]] {
        assert_eq!((validity.field.as_str(), validity.delay), ("linear.x", Duration::from_millis(50)));
        assert_eq!((&validity.min, &validity.max), (&Some(Limit::Constant(-1.0)), &Some(Limit::Constant(2.5))));
        assert_eq!(validity.on_invalid, OnInvalid::Hold);
    }
}

#[test]
fn what_is_active_gets_no_note() {
    let rules = "<fault_tolerance><severity>reset</severity><reset limit='3' within='10s'/><secondary reference='B.xml'/>\
        <recovery within='20ms'/></fault_tolerance>";
    let app = application(&[slot("a", "A.xml", rules)], &[]);
    let found =
        loaded(&[("app.xml", &app), ("A.xml", &component("A", "")), ("B.xml", &component("B", ""))]).diagnostics;
    assert!(found.iter().all(|finding| finding.level != Level::Note), "{found:?}");
}
