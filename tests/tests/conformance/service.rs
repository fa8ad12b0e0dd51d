//! Service types: methods as queries and sends.

use tests::profiles::connection_of;

use crate::check::check;
use crate::rig::{Suite, Transport, conformance};
use crate::send::profiles;

static SUITE: Suite = Suite::new(|transport| profiles(transport, "calls"));

sends::service_cases!(conformance SUITE;);

const INTERFACE: &str = "BoardMethods.service.xml";

/// What `check` says with one text of the interface's file replaced.
fn check_with(from: &str, to: &str) -> (bool, String) {
    let profiles = profiles(Transport::Near, "calls");
    profiles.replace(INTERFACE, from, to);
    check(&profiles)
}

#[test]
fn interface_of_a_plugin_is_described_and_accepted() {
    let (is_good, text) = check(&profiles(Transport::Near, "calls"));
    assert!(is_good && !text.contains("in the plugin"), "{text}");
}

#[test]
fn interface_file_is_compared() {
    let differences = [
        (
            "<type>double</type><name>by</name>",
            "<type>float</type><name>by</name>",
            ":5:6: error: parameter `by` of method `turn` is double in the plugin, not float",
        ),
        (
            "return_type=\"uint64_t\"",
            "return_type=\"std::vector&lt;double&gt;\"",
            "the result of method `beeps` is uint64_t in the plugin, not std::vector<double>",
        ),
        ("\"nonblocking\"", "\"blocking\"", "method `beep` is nonblocking in the plugin, not blocking"),
        (
            "name=\"clear\"",
            "name=\"clean\"",
            "the plugin has no method `clean`; it has: turn, go, beep, beeps, release, clear",
        ),
        ("name=\"clear\"", "name=\"clean\"", "method `clear` of the plugin is missing"),
        (
            "<param index=\"2\"><type>uint32_t</type><name>after_ms</name></param>",
            "",
            "method `go` has 2 parameters in the plugin, not 1",
        ),
        (
            "<type_name>BoardMethods</type_name>",
            "<type_name>Other</type_name>",
            "has no interface `BoardMethods`; it has: Other",
        ),
    ];
    for (from, to, said) in differences {
        let (is_good, text) = check_with(from, to);
        assert!(!is_good && text.contains(said) && text.contains(INTERFACE), "`{said}` in {text}");
    }
}

#[test]
fn unknown_cxx_type_warns() {
    let (is_good, text) = check_with("return_type=\"Pose2D\"", "return_type=\"ObjectLocation\"");
    let said =
        ": warning: the result of method `go`: whether ObjectLocation is what the plugin has, Pose2D, is not known";
    assert!(is_good && text.contains(said), "{text}");
    assert_eq!(text.matches(said).count(), 1, "once, though two components refer to it: {text}");
}

#[test]
fn types_of_cxx_are_known() {
    let (is_good, text) =
        check_with("<type>uint32_t</type><name>after_ms</name>", "<type>unsigned int</type><name>ms</name>");
    assert!(is_good && !text.contains("in the plugin"), "{text}");
}

#[test]
fn names_in_another_case_warn() {
    let (is_good, text) = check_with("name=\"release\"", "name=\"Release\"");
    assert!(is_good && text.contains("warning: method `Release` is called `release` in the plugin"), "{text}");
    let (is_good, text) = check_with("<type_name>BoardMethods<", "<type_name>boardMethods<");
    assert!(is_good && text.contains("interface `boardMethods` is called `BoardMethods` in the plugin"), "{text}");
}

#[test]
fn missing_interface_file_is_not_compared() {
    let profiles = profiles(Transport::Near, "calls");
    std::fs::remove_file(profiles.path().join(INTERFACE)).unwrap();
    let (is_good, text) = check(&profiles);
    assert!(is_good, "{text}");
}

#[test]
fn wired_at_boot_incompatible_is_refused_at_load() {
    let others = [
        (
            "miser.board",
            "sender.board calls turn, go, beep, beeps, release, clear, miser.board has turn, beep: method `go` is missing",
        ),
        (
            "other.board",
            "sender.board asks BoardMethodsTurn for double, other.board answers OtherMethodsTurn with double: method `turn`",
        ),
        (
            "taker.orders",
            "sender.board calls turn, go, beep, beeps, release, clear, taker.orders takes Order: one is a service of methods",
        ),
    ];
    for (server, said) in others {
        let profiles = profiles(Transport::Near, "calls");
        let link = |to: &str| connection_of("service", &format!("sender.board -> {to}"), "");
        profiles.replace("app.xml", &link("board.board"), &link(server));
        let (is_good, text) = check(&profiles);
        assert!(!is_good && text.contains(said), "`{said}` in {text}");
    }
}
