//! `check --plugins`: what plugins and profiles disagree about, before anything runs.

use std::process::Command;

use tests::daemon_binary::daemon_binary;
use tests::profiles::{Profiles, application, connection, plugin_dir, slot};

fn check(profiles: &Profiles) -> (Option<i32>, String) {
    let output =
        Command::new(daemon_binary()).arg("check").arg(profiles.path()).arg("--plugins").arg(plugin_dir()).output();
    let output = output.unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn what_fits_is_accepted() {
    let profiles = Profiles::new(&application(
        &[slot("ticker", "Ticker", ""), slot("listener", "Listener", "")],
        &["ticker.out -> listener.heard"],
    ));
    assert_eq!(check(&profiles), (Some(0), String::new()));
}

#[test]
fn layouts_that_differ_are_exit_4_with_the_place_of_the_connection() {
    let application =
        application(&[slot("ticker", "Ticker", ""), slot("gauge", "Gauge", "")], &["ticker.out -> gauge.heard"]);
    let (code, said) = check(&Profiles::new(&application));
    assert_eq!(code, Some(4), "{said}");
    assert!(said.contains("app.xml:8:") && said.contains("their layouts differ"), "{said}");
}

#[test]
fn a_field_that_is_not_there_names_those_that_are() {
    let application = application(&[slot("sonar", "Sonar", ""), slot("gauge", "Gauge", "")], &[]);
    let validity = "<validity field=\"rnge\"><max>3</max></validity>";
    let wire = connection("sonar.out -> gauge.heard", validity);
    let profiles = Profiles::new(&application.replace("<port_connections>\n", &format!("<port_connections>\n{wire}")));
    let (code, said) = check(&profiles);
    assert_eq!(code, Some(4), "{said}");
    assert!(said.contains("no field `rnge`") && said.contains("max_range, range"), "{said}");
}

#[test]
fn ports_and_properties_that_the_class_lacks_are_named() {
    let profiles = Profiles::new(&application(&[slot("ticker", "Ticker", "")], &[]));
    profiles.replace("Ticker.xml", "<name>out</name>", "<name>outt</name>");
    assert!(check(&profiles).1.contains("no port `outt`; it has: out"));
    profiles.replace("Ticker.xml", "<name>outt</name>", "<name>out</name>");
    profiles.replace("Ticker.xml", "name=\"label\"", "name=\"lable\"");
    assert!(check(&profiles).1.contains("no property `lable`; it has: first, label"));
}
