//! Whatever is in a file or a directory, the loader answers with findings: it never panics, and never says yes and no.

use std::fs;
use std::path::{Path, PathBuf};

use framework_daemon::profile::diagnostic::Diagnostic;
use framework_daemon::profile::diff::diff;
use framework_daemon::profile::single;
use framework_daemon::profile::{load, plan::Plan};
use proptest::prelude::*;

/// Every example of the repository, good and bad, as a seed.
fn seeds() -> Vec<Vec<u8>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../profiles");
    let mut seeds = Vec::new();
    for kind in ["broken", "doubtful"] {
        for case in fs::read_dir(root.join(kind)).into_iter().flatten().flatten() {
            let files = fs::read_dir(case.path()).into_iter().flatten().flatten().map(|file| file.path());
            seeds.extend(
                files
                    .filter(|file| file.extension().is_some_and(|ext| ext == "xml"))
                    .filter_map(|file| fs::read(file).ok()),
            );
        }
    }
    assert!(seeds.len() > 100, "the examples are missing");
    seeds
}

/// One change to a file, as a person or a bad disk makes it.
#[derive(Clone, Debug)]
enum Change {
    Flip(prop::sample::Index, u8),
    Cut(prop::sample::Index, usize),
    Copy(prop::sample::Index, prop::sample::Index, usize),
    Insert(prop::sample::Index, &'static str),
}

fn change() -> impl Strategy<Value = Change> {
    let words = vec![
        "<",
        ">",
        "&",
        "</",
        "/>",
        "\"",
        "<!--",
        "-->",
        "<![CDATA[",
        "]]>",
        "<?x ?>",
        "<!DOCTYPE a>",
        "&#0;",
        "&#x110000;",
        "<validity>",
        "<name/>",
        "\0",
        "\u{feff}",
        "-1",
        "1e400",
        "99999999999999999999",
        " xmlns=\"a\"",
        "NaN",
        "ms",
    ];
    prop_oneof![
        (any::<prop::sample::Index>(), any::<u8>()).prop_map(|(at, byte)| Change::Flip(at, byte)),
        (any::<prop::sample::Index>(), 1..200_usize).prop_map(|(at, length)| Change::Cut(at, length)),
        (any::<prop::sample::Index>(), any::<prop::sample::Index>(), 1..200_usize)
            .prop_map(|(a, b, n)| Change::Copy(a, b, n)),
        (any::<prop::sample::Index>(), prop::sample::select(words)).prop_map(|(at, word)| Change::Insert(at, word)),
    ]
}

fn apply(bytes: &mut Vec<u8>, change: &Change) {
    if bytes.is_empty() {
        bytes.push(b'<');
    }
    let length = bytes.len();
    match change {
        Change::Flip(at, byte) => bytes[at.index(length)] = *byte,
        Change::Cut(at, count) => {
            let at = at.index(length);
            bytes.drain(at..(at + count).min(length));
        }
        Change::Copy(from, to, count) => {
            let from = from.index(length);
            let part = bytes[from..(from + count).min(length)].to_vec();
            let at = to.index(length);
            bytes.splice(at..at, part);
        }
        Change::Insert(at, word) => {
            let at = at.index(length);
            bytes.splice(at..at, word.bytes());
        }
    }
}

fn write(dir: &Path, name: &str, bytes: &[u8]) {
    fs::write(dir.join(name), bytes).expect("a temporary file can be written");
}

const GOOD: &str = "<application_profile><name>a</name><subcomponents>\
    <subcomponent><name>one</name><reference>A.xml</reference></subcomponent>\
    <subcomponent><name>two</name><reference>A.xml</reference></subcomponent></subcomponents>\
    <port_connections><port_connection port_type='data'><source component_name='one' port_name='out'/>\
    <target component_name='two' port_name='in'/></port_connection></port_connections></application_profile>";
const COMPONENT: &str = "<component_profile><name>A</name><execution_environment><library_name>a</library_name>\
    </execution_environment><execution_semantics><type>periodic</type><period>20</period></execution_semantics><ports>\
    <data_port><name>in</name><usage>input</usage><data_type>double</data_type></data_port>\
    <data_port><name>out</name><usage>output</usage><data_type>double</data_type></data_port></ports></component_profile>";

fn plan_of(application: &str, component: &str) -> Plan {
    let dir = tempfile::tempdir().expect("a temporary directory");
    write(dir.path(), "app.xml", application.as_bytes());
    write(dir.path(), "A.xml", component.as_bytes());
    load(dir.path()).unwrap_or_else(|found| panic!("{found:?}")).plan
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let document = single::check_bytes(Path::new("a.xml"), &bytes);
        prop_assert!(document.profile.is_some() || !document.findings.is_empty());
    }

    #[test]
    fn changed_examples_never_panic(
        seed in any::<prop::sample::Index>(),
        changes in prop::collection::vec(change(), 1..6),
    ) {
        let seeds = seeds();
        let mut bytes = seeds[seed.index(seeds.len())].clone();
        changes.iter().for_each(|change| apply(&mut bytes, change));
        let document = single::check_bytes(Path::new("a.xml"), &bytes);
        // Each finding can be shown, and stands in the file.
        for finding in &document.findings {
            prop_assert!(!finding.to_string().is_empty());
            prop_assert!(finding.location.line as usize <= bytes.len() + 1);
        }
    }

    #[test]
    fn a_directory_with_changed_files_is_accepted_or_refused(
        changes in prop::collection::vec(change(), 0..4),
        in_component in any::<bool>(),
    ) {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let (mut application, mut component) = (GOOD.as_bytes().to_vec(), COMPONENT.as_bytes().to_vec());
        let target = if in_component { &mut component } else { &mut application };
        changes.iter().for_each(|change| apply(target, change));
        write(dir.path(), "app.xml", &application);
        write(dir.path(), "A.xml", &component);
        match load(dir.path()) {
            Ok(loaded) => {
                prop_assert!(!loaded.diagnostics.iter().any(Diagnostic::is_error));
                prop_assert!(diff(&loaded.plan, &loaded.plan).is_empty());
            }
            Err(found) => prop_assert!(found.iter().any(Diagnostic::is_error)),
        }
    }
}

#[test]
fn the_same_words_in_other_places_are_no_difference() {
    let old = plan_of(GOOD, COMPONENT);
    let new = plan_of(&GOOD.replace("><", ">\n  <!-- moved -->\n<"), &COMPONENT.replace("><", ">\n\n<"));
    assert!(diff(&old, &new).is_empty(), "{:?}", diff(&old, &new));
}

#[test]
fn each_change_is_found_and_nothing_else() {
    let old = plan_of(GOOD, COMPONENT);
    let period = diff(&old, &plan_of(GOOD, &COMPONENT.replace(">20<", ">10<")));
    assert_eq!(period.slots_changed, ["one", "two"]);
    assert!(period.connections_added.is_empty() && period.slots_added.is_empty());
    let renamed = diff(&old, &plan_of(&GOOD.replace("two", "three"), COMPONENT));
    assert_eq!((renamed.slots_added, renamed.slots_removed), (vec!["three".to_owned()], vec!["two".to_owned()]));
    assert_eq!((renamed.connections_added.len(), renamed.connections_removed.len()), (1, 1));
    let check = GOOD.replace("port_name='in'/>", "port_name='in'/><validity><max>1</max></validity>");
    let checked = diff(&old, &plan_of(&check, COMPONENT));
    assert_eq!((checked.connections_added.len(), checked.connections_removed.len()), (1, 1));
    assert!(checked.slots_changed.is_empty());
}

/// Directories as people, links and mistakes leave them.
#[test]
fn odd_directories_are_answered() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let at = |name: &str| -> PathBuf { dir.path().join(name) };
    assert!(load(&at("missing")).is_err());
    write(dir.path(), "app.xml", GOOD.as_bytes());
    assert!(load(&at("app.xml")).is_err(), "a file is no directory");
    fs::create_dir(at("A.xml")).expect("a directory called like a file");
    let found = load(dir.path()).expect_err("the reference is a directory");
    assert!(found.iter().any(|finding| finding.message.contains("not a regular file")), "{found:?}");
    fs::remove_dir(at("A.xml")).expect("the directory is removed");
    std::os::unix::fs::symlink("A.xml", at("A.xml")).expect("a link to itself");
    assert!(load(dir.path()).is_err(), "a link that leads nowhere");
    fs::remove_file(at("A.xml")).expect("the link is removed");
    std::os::unix::fs::symlink(".", at("a")).expect("a link to its own directory");
    write(dir.path(), "A.xml", COMPONENT.as_bytes());
    assert!(load(dir.path()).is_ok());
    let twice = GOOD.replacen("A.xml", "a/a/a/A.xml", 1);
    write(dir.path(), "app.xml", twice.as_bytes());
    assert!(load(dir.path()).is_ok(), "two names of one file are one file");
}

/// A name that is not UTF-8 is shown as well as it can be, and hides no change.
#[test]
fn names_that_are_not_text_are_no_obstacle() {
    use std::os::unix::ffi::OsStrExt;
    let dir = tempfile::tempdir().expect("a temporary directory");
    let odd = dir.path().join(std::ffi::OsStr::from_bytes(b"\xff"));
    fs::create_dir(&odd).expect("a directory with an odd name");
    write(&odd, "app.xml", GOOD.as_bytes());
    write(&odd, "A.xml", COMPONENT.as_bytes());
    let old = load(&odd).expect("accepted").plan;
    assert!(serde_json::to_string(&old).is_ok());
    write(&odd, "A.xml", COMPONENT.replace(">20<", ">10<").as_bytes());
    assert_eq!(diff(&old, &load(&odd).expect("accepted").plan).slots_changed, ["one", "two"]);
    write(&odd, "A.xml", b"<a>");
    let found = load(&odd).expect_err("refused");
    assert!(found.iter().all(|finding| serde_json::to_string(finding).is_ok()));
}

#[test]
fn what_is_too_large_is_refused_quickly() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let file = fs::File::create(dir.path().join("app.xml")).expect("a file");
    file.set_len(1 << 40).expect("a sparse file of a terabyte");
    assert!(load(dir.path()).is_err());
    let refused = |text: &str| !single::check_bytes(Path::new("a.xml"), text.as_bytes()).accepted();
    assert!(refused(&"<a>".repeat(1_000_000)));
    assert!(refused(&format!("<data_type>{}</data_type>", "<a/>".repeat(200_000))));
    let attributes: String = (0..100_000).map(|index| format!(" a{index}=''")).collect();
    assert!(refused(&format!("<data_type{attributes}/>")));
}

/// One line of megabytes with a finding in every element: each finding costs its own size, not the line's.
#[test]
fn many_findings_in_one_long_line_cost_little() {
    let text = format!("<data_type>{}</data_type>", "<strutc name=\"가나다라마바사\"/>".repeat(90_000));
    let document = single::check_bytes(Path::new("a.xml"), text.as_bytes());
    let shown: usize = document.findings.iter().map(|finding| finding.to_string().len()).sum();
    assert!(!document.accepted() && shown < 1_000_000, "{shown}");
    let last = document.findings.iter().map(|finding| finding.message.as_str()).find(|text| text.contains("not shown"));
    // Beyond the first thousand; and those of them that have one name, once they are what they were meant to be.
    assert_eq!(last, Some("89999 more findings in this file are not shown"));
}

/// Each level of composites holds ten of the next: flattened, they would be more than memory holds.
#[test]
fn composites_cannot_multiply_without_end() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    for level in 0..12 {
        let slots: String = (0..10)
            .map(|i| format!("<subcomponent><name>x{i}</name><reference>C{}.xml</reference></subcomponent>", level + 1))
            .collect();
        let text = format!(
            "<composite_component_profile><name>C{level}</name><subcomponents>{slots}</subcomponents><export_ports/>\
             </composite_component_profile>"
        );
        write(dir.path(), &format!("C{level}.xml"), text.as_bytes());
    }
    write(dir.path(), "C12.xml", COMPONENT.as_bytes());
    write(dir.path(), "app.xml", GOOD.replace("A.xml", "C0.xml").as_bytes());
    let found = load(dir.path()).expect_err("too many slots");
    assert!(found.iter().any(|finding| finding.message.contains("slots in one directory")), "{found:?}");
}

#[test]
fn a_thousand_slots_in_one_circle_of_dependencies_are_refused_with_the_path() {
    let slots: String = (0..1000)
        .map(|i| format!("<subcomponent><name>s{i}</name><reference>A.xml</reference></subcomponent>"))
        .collect();
    let circle: String =
        (0..1000).map(|i| format!("<dependency component='s{i}' on='s{}'/>", (i + 1) % 1000)).collect();
    let text = format!(
        "<application_profile><name>a</name><subcomponents>{slots}</subcomponents>{circle}</application_profile>"
    );
    let dir = tempfile::tempdir().expect("a temporary directory");
    write(dir.path(), "app.xml", text.as_bytes());
    write(dir.path(), "A.xml", COMPONENT.as_bytes());
    let found = load(dir.path()).expect_err("a circle");
    assert!(found.iter().any(|finding| finding.message.contains("s0 -> s1 -> s2")), "{:?}", found.last());
}
