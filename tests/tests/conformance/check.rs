//! What is found before anything runs.

use std::process::Command;

use tests::daemon_binary::daemon_binary;
use tests::profiles::{Profiles, connection_of, plugin_dir};

use crate::query::profiles;
use crate::rig::Transport;

/// What `check` says.
pub(crate) fn check(profiles: &Profiles) -> (bool, String) {
    let mut command = Command::new(daemon_binary());
    let output = command.arg("check").arg(profiles.path()).arg("--plugins").arg(plugin_dir()).output();
    let output = output.expect("the daemon's binary runs");
    let text = [output.stdout, output.stderr].concat();
    (output.status.success(), String::from_utf8_lossy(&text).into_owned())
}

#[test]
fn declared_end_is_a_wireable_port() {
    let (is_good, text) = check(&profiles(Transport::Near, "all"));
    assert!(is_good && !text.contains("not active"), "{text}");
}

#[test]
fn wired_at_boot_incompatible_is_refused_at_load() {
    let profiles = profiles(Transport::Near, "all");
    profiles.replace("app.xml", "<reference>Echo.xml</reference>", "<reference>OtherEcho.xml</reference>");
    // The other one asks nobody.
    profiles.replace("app.xml", &connection_of("service", "echo.back -> asker.answers", ""), "");
    let (is_good, text) = check(&profiles);
    assert!(!is_good, "{text}");
    for part in ["teller.onward asks Ask for Told", "echo.told answers", "layouts differ"] {
        assert!(text.contains(part), "`{part}` in {text}");
    }
}

#[test]
fn wrong_pattern_incompatible() {
    let profiles = profiles(Transport::Near, "all");
    let port = "<data_port><name>tell</name><usage>output</usage><data_type>Ask</data_type></data_port>";
    let asker = std::fs::read_to_string(profiles.path().join("Asker.xml")).unwrap();
    let (before, rest) = asker.split_once("<service_port>\n      <name>tell</name>").unwrap();
    let (_, after) = rest.split_once("</service_port>").unwrap();
    profiles.write("Asker.xml", &format!("{before}{port}{after}"));
    let app = std::fs::read_to_string(profiles.path().join("app.xml")).unwrap();
    let link = connection_of("service", "asker.tell -> teller.told", "");
    profiles.write("app.xml", &app.replace(&link, ""));
    let (is_good, text) = check(&profiles);
    assert!(!is_good && text.contains("port `tell` is a <service_port> in the plugin, not a <data_port>"), "{text}");
}

#[test]
fn a_setting_of_the_other_side_is_refused() {
    let profiles = profiles(Transport::Near, "all");
    profiles.replace("Echo.xml", "<queue_size>64</queue_size>", "<pending>8</pending>");
    let (is_good, text) = check(&profiles);
    assert!(!is_good && text.contains("<pending> belongs to a required service"), "{text}");
}
