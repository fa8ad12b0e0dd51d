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
fn lines_lead_from_members_to_their_voter_and_from_who_needs_to_who_is_needed() {
    let profiles = profiles();
    let dot = drawn(&profiles, "dot");
    for member in ["left", "middle", "right"] {
        let votes = |line: &&str| line.contains(&format!("\"{member}\":")) && line.contains("-> \"sonar\":");
        assert_eq!(dot.lines().filter(votes).count(), 1, "{member}:\n{dot}");
        assert_eq!(dot.matches(&format!("\"ear\" -> \"{member}\" [color=\"#a02020\"")).count(), 1, "{member}:\n{dot}");
    }
    for compared in ["target", "model"] {
        assert!(dot.contains(&format!("\"{compared}\":\"data_said\":e -> \"model of target.said distance\"")), "{dot}");
    }
    let mermaid = drawn(&profiles, "mermaid");
    // The slots in file order: left, middle, right, model, target, ear.
    for member in 0..3 {
        assert!(mermaid.contains(&format!("s5 -.->|\"needs 2 of 3\"| s{member}\n")), "{mermaid}");
    }
    let svg = drawn(&profiles, "svg");
    assert_eq!(svg.matches("class=\"line needs\"").count(), 3 + 1, "each need and the legend's:\n{svg}");
    assert_eq!(svg.matches("class=\"pneeds\"").count(), 3, "an arrow at each that is needed:\n{svg}");
    assert_eq!(svg.matches(">needs 2 of 3<").count(), 1, "and what it says once, where they leave:\n{svg}");
}

/// Where a text is drawn, from left to right.
fn x_of(svg: &str, text: &str) -> f64 {
    let before = svg.split_once(&format!(">{text}<")).expect("it is drawn").0;
    number(before.rsplit_once(" x=\"").expect("it has a place").1)
}

/// The number at the begin of a text.
fn number(text: &str) -> f64 {
    text.chars().take_while(|c| c.is_ascii_digit() || *c == '.').collect::<String>().parse().expect("a number")
}

#[test]
fn an_arrow_of_need_points_at_the_box_that_is_needed() {
    let slots = [slot("ticker", "Ticker", ""), slot("listener", "Listener", "")];
    let profiles = Profiles::new(&application(&slots, &["ticker.out -> listener.heard"]));
    let dependency = "<dependency component=\"listener\" on=\"ticker\"/></application_profile>";
    profiles.replace("app.xml", "</application_profile>", dependency);
    let svg = drawn(&profiles, "svg");
    let tip = number(svg.split_once("class=\"pneeds\" d=\"M").expect("an arrow").1);
    let (ticker, listener, label) = (x_of(&svg, "ticker"), x_of(&svg, "listener"), x_of(&svg, "needs"));
    assert!((tip - ticker).abs() < (tip - listener).abs(), "{tip}:\n{svg}");
    assert!((label - listener).abs() < (label - ticker).abs(), "{label}:\n{svg}");
}

#[test]
fn the_heading_counts_slots_apart_from_what_the_framework_inserts() {
    let svg = drawn(&profiles(), "svg");
    assert!(svg.contains(": 6 slots, 3 connections, 1 voter, 1 comparison, 1 monitor</text>"), "{svg}");
}

#[test]
fn one_pair_that_is_compared_over_two_windows_has_two_boxes() {
    let profiles = profiles();
    profiles.replace(
        "app.xml",
        "<monitor",
        "<reference_model component=\"model\" input=\"target.heard\" target=\"target.said\" field=\"distance\" \
         window=\"1s\" threshold=\"0.1\"/><monitor",
    );
    let dot = drawn(&profiles, "dot");
    for (name, window) in [("model of target.said distance", "200ms"), ("model of target.said distance (2)", "1s")] {
        let is_it = |line: &&str| line.starts_with(&format!("  \"{name}\" [label")) && line.contains(window);
        assert_eq!(dot.lines().filter(is_it).count(), 1, "{dot}");
    }
}

#[test]
fn without_needs_nothing_is_said_of_them() {
    let profiles = Profiles::new(&application(&[slot("ticker", "Ticker", "")], &[]));
    let svg = drawn(&profiles, "svg");
    assert!(!svg.contains("class=\"line needs\"") && !svg.contains(">needs<"), "{svg}");
}
