//! What every requestor has, shown by a query client and an input. The other patterns' clients connect by the same code and
//! show what is their own in their own modules.

use tests::profiles::Profiles;

use crate::links::profiles;
use crate::rig::{Suite, Transport, conformance};

static SUITE: Suite = Suite::new(|transport| profiles(transport, "requestor"));

links::requestor_cases!(conformance SUITE;);

/// What `check` says of the profiles.
fn check(profiles: &Profiles) -> (bool, String) {
    crate::check::check(profiles)
}

#[test]
fn declared_name_twice_is_refused() {
    let profiles = profiles(Transport::Near, "requestor");
    let text = std::fs::read_to_string(profiles.path().join("Wirer.xml")).unwrap();
    let port = "<service_port>\n      <name>ask</name>";
    profiles.write("Wirer.xml", &text.replacen("<name>again</name>", "<name>ask</name>", 1));
    assert!(text.contains(port), "{text}");
    let (is_good, text) = check(&profiles);
    assert!(!is_good && text.contains("port \"ask\" is already declared"), "{text}");
}

#[test]
fn a_profile_does_not_connect_what_its_component_keeps_for_itself() {
    let profiles = profiles(Transport::Near, "requestor");
    let link = tests::profiles::connection_of("service", "wirer.hidden -> one.told", "");
    profiles.replace("app.xml", "</port_connections>", &format!("{link}</port_connections>"));
    let (is_good, text) = check(&profiles);
    assert!(!is_good && text.contains("wirer.hidden is `unlisted` in its class"), "{text}");
}
