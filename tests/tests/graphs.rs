//! What `graph` draws of fault tolerance: who needs whom, who votes, who is compared, who is watched; in each of its forms.

use tests::asking::graph;
use tests::profiles::{Profiles, application, plugin_dir, slot};

/// Three waves with a voter, a model of one of them, a monitor, and an ear that needs two of three.
fn profiles() -> Profiles {
    let slots = ["left", "middle", "right"].map(|name| slot(name, "Wave", ""));
    let more = [slot("model", "Amplifier", ""), slot("target", "Amplifier", ""), slot("ear", "Ear", "")];
    let connections = ["sonar.out -> ear.heard", "left.out -> target.heard"];
    let profiles = Profiles::new(&application(&[&slots[..], &more[..]].concat(), &connections));
    profiles.describe(&plugin_dir().join("libsignals.so"));
    profiles.replace(
        "app.xml",
        "</application_profile>",
        "<voting name=\"sonar\" inputs=\"left middle right\" method=\"median\" tolerance=\"5\" field=\"distance\"/>\
         <reference_model component=\"model\" input=\"target.heard\" target=\"target.said\" field=\"distance\" \
         window=\"200ms\" threshold=\"0.5\"/>\
         <monitor component=\"middle\" port=\"out\"><max_age>100ms</max_age></monitor>\
         <dependency component=\"ear\" on=\"left middle right\" require=\"2\"/></application_profile>",
    );
    profiles
}

fn drawn(profiles: &Profiles, kind: &str) -> String {
    let drawn = graph(profiles.path(), kind);
    assert_eq!(drawn.code, Some(0), "{}", drawn.err);
    drawn.out
}

#[test]
fn every_form_names_voters_comparisons_monitors_and_needs() {
    let profiles = profiles();
    for kind in ["dot", "mermaid", "svg"] {
        let text = drawn(&profiles, kind);
        for wanted in [
            "sonar",
            "voter by median",
            "model of target.said distance",
            "comparison over 200ms",
            "monitor: not silent for 100ms",
            "needs 2 of 3",
        ] {
            assert!(text.contains(wanted), "{kind} lacks {wanted}:\n{text}");
        }
    }
}

#[test]
fn lines_lead_from_members_to_their_voter_and_from_who_is_needed_to_who_needs() {
    let profiles = profiles();
    let dot = drawn(&profiles, "dot");
    for member in ["left", "middle", "right"] {
        let votes = |line: &&str| line.contains(&format!("\"{member}\":")) && line.contains("-> \"sonar\":");
        assert_eq!(dot.lines().filter(votes).count(), 1, "{member}:\n{dot}");
        assert_eq!(dot.matches(&format!("\"{member}\" -> \"ear\" [color=\"#a02020\"")).count(), 1, "{member}:\n{dot}");
    }
    for compared in ["target", "model"] {
        assert!(dot.contains(&format!("\"{compared}\":\"data_said\":e -> \"model of target.said distance\"")), "{dot}");
    }
    let mermaid = drawn(&profiles, "mermaid");
    assert_eq!(mermaid.matches("-.->|\"needs 2 of 3\"|").count(), 3, "{mermaid}");
    let svg = drawn(&profiles, "svg");
    assert_eq!(svg.matches("class=\"line needs\"").count(), 3 + 1, "each need and the legend's:\n{svg}");
}

#[test]
fn without_needs_nothing_is_said_of_them() {
    let profiles = Profiles::new(&application(&[slot("ticker", "Ticker", "")], &[]));
    let svg = drawn(&profiles, "svg");
    assert!(!svg.contains("class=\"line needs\"") && !svg.contains(">needs<"), "{svg}");
}
