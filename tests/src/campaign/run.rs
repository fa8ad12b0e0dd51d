//! One class, from start to verdict.

use std::time::{Duration, Instant};

use serde_json::Value;

use super::classes::{Class, Course};
use super::layout::{self, Policy};
use super::row::Row;
use crate::bench::stats::Samples;
use crate::running::Running;

/// No fault for that long: none comes any more.
const STALLED: Duration = Duration::from_secs(10);
/// How often the journal is looked at.
const PAUSE: Duration = Duration::from_millis(10);
/// Whatever should not happen any more after the last fault had that long to happen.
const SETTLE: Duration = Duration::from_millis(50);

/// What one run left behind.
struct Traces {
    took: Duration,
    faults: Vec<Value>,
    slots: Vec<Value>,
    log: String,
    problems: Vec<String>,
}

/// Provokes the class `strikes` times in one life of a daemon, and compares with a run of the same length without.
#[must_use]
pub fn run(class: &Class, strikes: usize, policy: Policy) -> Row {
    let traces = provoke(class, strikes, policy, None);
    let control = provoke(class, 0, policy, Some(traces.took));
    judge(class, strikes, policy, traces, &control)
}

fn provoke(class: &Class, strikes: usize, policy: Policy, length: Option<Duration>) -> Traces {
    let profiles = layout::profiles(class, strikes, policy);
    let mut daemon = Running::start(profiles.path(), &[]);
    let began = Instant::now();
    let mut problems = Vec::new();
    match (length, class.course) {
        (Some(length), _) => std::thread::sleep(length),
        (None, Course::Leaving) => {
            std::thread::sleep(SETTLE);
            profiles.write("app.xml", &layout::app(class, strikes, false));
            daemon.signal("HUP");
            wait(&mut daemon, |daemon| daemon.entries("reload").len(), 1);
        }
        (None, Course::Refused) => wait(&mut daemon, |daemon| daemon.lines("the last strike").len(), 1),
        (None, Course::Again) => wait(&mut daemon, victims_faults, strikes),
        (None, Course::OnceEach) => wait(&mut daemon, victims_faults, 2 * strikes),
    }
    std::thread::sleep(SETTLE);
    let took = began.elapsed();
    let slots = daemon.end().unwrap_or_else(|problem| {
        problems.push(problem);
        Vec::new()
    });
    if !daemon.entries("lost").is_empty() {
        problems.push("faults were not written down".to_owned());
    }
    Traces { took, faults: daemon.entries("fault"), slots, log: daemon.log(), problems }
}

fn victims_faults(daemon: &Running) -> usize {
    daemon.entries("fault").iter().filter(is_victim).count()
}

/// Late because the machine was busy is not what was provoked.
fn is_victim(fault: &&Value) -> bool {
    fault["slot"].as_str().is_some_and(|slot| slot.starts_with("victim")) && fault["symptom"] != "overrun"
}

/// Waits until there are `wanted`, the daemon is dead, or none comes any more.
fn wait(daemon: &mut Running, count: impl Fn(&Running) -> usize, wanted: usize) {
    let (mut seen, mut since) = (0, Instant::now());
    while seen < wanted && since.elapsed() < STALLED && daemon.is_alive() {
        std::thread::sleep(PAUSE);
        let now = count(daemon);
        if now > seen {
            (seen, since) = (now, Instant::now());
        }
    }
}

fn judge(class: &Class, strikes: usize, policy: Policy, traces: Traces, control: &Traces) -> Row {
    let Traces { faults, slots, log, mut problems, .. } = traces;
    let has =
        |fault: &Value, field: &str, wanted: &[&str]| fault[field].as_str().is_some_and(|is| wanted.contains(&is));
    let strangers = faults.iter().filter(|fault| !is_victim(fault) && fault["symptom"] != "overrun").count();
    if strangers > 0 {
        problems.push(format!("{strangers} faults blamed on others"));
    }
    let baits: Vec<&Value> = match class.bait {
        Some(bait) => faults
            .iter()
            .filter(is_victim)
            .filter(|fault| has(fault, "symptom", &[bait]) && fault["outcome"] != "failed")
            .collect(),
        None => Vec::new(),
    };
    let mut own: Vec<&Value> =
        faults.iter().filter(is_victim).filter(|fault| !baits.iter().any(|bait| std::ptr::eq(*bait, *fault))).collect();
    if class.deadline {
        // Whoever lost its core for longer than its deadline was late, too.
        own.truncate(strikes);
    }
    let right: Vec<&&Value> = own.iter().filter(|fault| has(fault, "symptom", class.symptoms)).collect();
    if let Some(wrong) = own.iter().find(|fault| !has(fault, "symptom", class.symptoms)) {
        problems.push(format!("blamed as {}", wrong["symptom"]));
    }
    let ended: &[&Value] = if class.bait.is_some() { &baits } else { &own };
    let outcome = |names: &[&str]| ended.iter().filter(|fault| has(fault, "outcome", names)).count();
    // A thread may outlive its instance: what it does then is answered already, and only written down.
    let answered: &[&str] = if class.group == "threads" { &["recovered", "ignored"] } else { &["recovered"] };
    // What a drop does changes nothing any more.
    let ended_by_removal: &[&str] =
        if class.course == Course::Leaving { &["stopped", "ignored"] } else { &["stopped"] };
    let mut recovery = Samples::default();
    ended.iter().filter_map(|fault| fault["times"]["first_callback_ns"].as_u64()).for_each(|nanos| recovery.add(nanos));
    let refused = class.course == Course::Refused && log.contains("the last strike") && !slots.is_empty();
    let contained = if refused { strikes } else { own.len() };
    let attributed = if refused { strikes - own.len().min(strikes) } else { right.len() };
    let row = Row {
        class: class.name(),
        policy,
        injected: strikes,
        contained,
        attributed,
        recovered: if refused { attributed } else { outcome(answered) },
        stopped: outcome(ended_by_removal),
        missed: worst_missed(&slots),
        missed_control: worst_missed(&control.slots),
        gap: longest_gap(&log),
        gap_control: longest_gap(&control.log),
        p50_ns: recovery.at(0.5),
        p999_ns: recovery.at(0.999),
        quarantined: slots.iter().filter_map(|slot| slot["quarantined"].as_u64()).sum(),
        problems,
    };
    with_verdict(row)
}

fn with_verdict(mut row: Row) -> Row {
    for (what, count) in [
        ("contained", row.contained),
        ("attributed", row.attributed),
        ("recovered or stopped", row.recovered + row.stopped),
    ] {
        if count != row.injected {
            row.problems.push(format!("{count} of {} {what}", row.injected));
        }
    }
    row
}

fn worst_missed(slots: &[Value]) -> u64 {
    let others = slots.iter().filter(|slot| slot["slot"].as_str().is_some_and(|name| name.starts_with("other")));
    others.filter_map(|slot| slot["missed"].as_u64()).max().unwrap_or(0)
}

/// From what the others log when they are stopped: `other3: gaps 2 longest 1`.
fn longest_gap(log: &str) -> u64 {
    let gaps = log.lines().filter_map(|line| line.split_once(" longest ")?.1.trim().parse().ok());
    gaps.max().unwrap_or(0)
}
