//! Table, picture and last line from a journal and a path.

mod common;

use std::path::Path;
use std::time::Duration;

use board_protocol::Telemetry;
use common::avoid;
use robot_sim::demo::follow::Follower;
use robot_sim::demo::journal::{Fault, merge};
use robot_sim::demo::report::Report;
use robot_sim::demo::{compare, schedule, svg, table};
use robot_sim::geometry::wrap;
use robot_sim::serve::record::{End, Moment, Reason};
use robot_sim::{Simulation, World};

/// The fixture is a real run's journal, its clock moved, with what a reader must bear put in: a line that completes an earlier
/// one, a fault that is ignored, noise, a torn end. This is its clock when the daemon was ready, and when the simulation began.
const READY_NS: u64 = 1_000_000_000;
const BEGUN_NS: u64 = 700_000_000;

fn faults() -> Vec<Fault> {
    let mut faults = Vec::new();
    merge(
        &mut faults,
        Follower::new(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/journal.jsonl")).look(),
    );
    faults
}

/// A drive through the default world on virtual time.
fn track() -> (Vec<Moment>, End) {
    let mut robot = Simulation::new(World::warehouse(), 1);
    let (mut track, mut ring, mut last) = (Vec::new(), [0; 12], 0.0);
    let clock = |time: Duration| BEGUN_NS + u64::try_from(time.as_nanos()).unwrap();
    while robot.time() < Duration::from_secs(60) && !robot.reached() {
        let pose = robot.truth().pose;
        if robot.time() > Duration::from_millis(300) {
            let bearing = wrap(pose.at.bearing(robot.world().target.at()) - pose.theta);
            robot.command(avoid(ring, bearing, &mut last));
        }
        for message in robot.advance(Duration::from_millis(20)) {
            if let Telemetry::Ultrasonic(newest) = message {
                ring = newest.ranges_mm;
            }
        }
        track.push(Moment { mono_ns: clock(robot.time()), ..Moment::from(robot.truth()) });
    }
    let t = robot.time().as_secs_f64();
    let collisions = robot.truth().collisions;
    let mono_ns = clock(robot.time());
    (track, End { mono_ns, t, reached: robot.reached(), reason: Reason::Reached, collisions, path_m: 9.0 })
}

fn report() -> Report {
    let (track, end) = track();
    Report {
        world: World::warehouse(),
        track,
        over_ns: end.mono_ns,
        end: Some(end),
        faults: faults(),
        steered: Vec::new(),
        schedule: schedule::default(),
        ready_ns: READY_NS,
        complaints: Vec::new(),
    }
}

#[test]
fn the_journal_is_read_with_all_its_other_kinds_and_a_torn_last_line() {
    let faults = faults();
    assert_eq!(faults.iter().map(|fault| fault.seq).collect::<Vec<_>>(), [2, 3, 4, 5, 6, 20]);
    assert_eq!(faults[2].times.first_callback_ns, Some(57_894), "the later line with the same number holds");
}

#[test]
fn a_good_run_is_a_success_with_the_promised_last_line() {
    let report = report();
    assert!(report.success(), "{}", report.last_line());
    let seconds = format!("{:.1}", report.duration());
    assert_eq!(report.last_line(), format!("target reached in {seconds} s; faults 5, recovered 5, collisions 0"));
}

#[test]
fn each_thing_that_went_wrong_spoils_the_success() {
    let spoilt = |spoil: fn(&mut Report)| {
        let mut report = report();
        spoil(&mut report);
        (report.success(), report.last_line())
    };
    assert!(!spoilt(|report| report.faults[0].outcome = "failed".into()).0);
    assert!(!spoilt(|report| report.end.as_mut().unwrap().collisions = 1).0);
    assert!(!spoilt(|report| drop(report.faults.remove(2))).0, "a due fault that nobody saw");
    let (success, line) = spoilt(|report| report.end = None);
    assert!(!success && line.starts_with("target not reached after "), "{line}");
}

#[test]
fn the_table_says_what_where_when_and_how() {
    let table = table::faults(&report());
    let line = table.lines().find(|line| line.contains("crash.segv") && line.contains("avoider")).unwrap();
    for part in ["10.02 s", "29.5 µs", "57.9 µs", "replaced by AvoidanceSecondary", "recovered"] {
        assert!(line.contains(part), "`{part}` is missing in {line}");
    }
    assert!(table.contains("injected panic (src/abi/inject.rs:32)"));
    assert!(table.contains("SIGSEGV at 0x8"));
    assert_eq!(table.lines().count(), 2 + 6);
}

#[test]
fn the_comparison_has_a_line_for_each_way_of_preloading() {
    let runs: Vec<_> = compare::PRELOADS.into_iter().map(|preload| (preload, report())).collect();
    let table = compare::table(&runs);
    assert_eq!(table.matches("57.9 µs").count(), 3);
    assert!(compare::success(&runs));
    assert!(compare::last_line(&runs).ends_with("faults 15, recovered 15, collisions 0"));
}

#[test]
fn the_picture_shows_world_path_and_numbered_faults() {
    let report = report();
    let picture = svg::draw(&report);
    assert!(picture.starts_with("<svg ") && picture.ends_with("</svg>\n"));
    for part in ["#d62020", "AvoidanceSecondary from 10.0 s", ">6</text>", "avoider crash.panic", "target reached in"] {
        assert!(picture.contains(part), "`{part}` is missing");
    }
    assert!(!picture.contains("filter & co"), "text is escaped");
    let lines = picture.matches("<polyline").count();
    assert!(lines >= 5, "a wall, two stretches of path, two of speed; got {lines}");
    // To look at it: SVG_OUT=path.svg cargo test -p robot_sim --test report
    if let Some(path) = std::env::var_os("SVG_OUT") {
        svg::write(&report, Path::new(&path)).unwrap();
    }
}

#[test]
fn a_run_without_anything_can_be_drawn_too() {
    let report = Report { track: Vec::new(), faults: Vec::new(), end: None, ..report() };
    assert!(svg::draw(&report).ends_with("</svg>\n"));
}
