//! Ratios and targets, for people.

use serde_json::Value;

/// What a ratio to the limit may be.
struct Target {
    bench: &'static str,
    field: &'static str,
    most: f64,
}

const TARGETS: [Target; 9] = [
    Target { bench: "checkpoint", field: "p50_ns", most: 1.3 },
    Target { bench: "query_cross_executor", field: "p50_ns", most: 1.15 },
    Target { bench: "hop_cross_executor", field: "p50_ns", most: 1.15 },
    Target { bench: "trap_recovery", field: "p50_ns", most: 1.5 },
    Target { bench: "trap_recovery", field: "p999_ns", most: 3.0 },
    Target { bench: "panic_recovery", field: "p50_ns", most: 1.5 },
    Target { bench: "panic_recovery", field: "p999_ns", most: 3.0 },
    Target { bench: "hang_recovery", field: "p50_ns", most: 1.5 },
    Target { bench: "hang_recovery", field: "p999_ns", most: 3.0 },
];

/// What the data path may take, in nanoseconds: a check 10 for each of its fields.
const ABSOLUTE: [(&str, f64); 5] = [
    ("hop_same_executor", 100.0),
    ("query_same_executor", 150.0),
    ("fan_out", 50.0),
    ("rewire", 4_000.0),
    ("validity_check", 160.0),
];
/// What handling beyond the slot may take at p99, in nanoseconds.
const TAILS: [(&str, f64); 2] = [("emergency_stop", 100_000.0), ("fault_stop", 10_000_000.0)];
/// How much slower than 64 bytes 1 MiB may be.
const LARGE_MOST: f64 = 1.2;

/// What is told beside the hops that are judged, for comparison.
pub const WHOLE_TURN: &str = "64 B, whole turn";

/// What a guarded callback may cost beyond a bare one.
const GUARD_NS_MAX: f64 = 10.0;
/// How much slower Erlang's supervisor must be.
const ERLANG_LEAST: f64 = 10.0;

/// The table of what the benchmarks printed, one object a line.
#[must_use]
pub fn table(lines: &[Value]) -> String {
    let mut rows = vec![head()];
    for line in lines {
        match text(line, "bench") {
            "guard_cost" => rows.push(guard(line)),
            "hop_same_executor" if text(line, "payload") == WHOLE_TURN => {}
            "hop_same_executor" if text(line, "payload") != "64 B" => rows.extend(large(line, lines)),
            bench if TAILS.iter().any(|(name, _)| *name == bench) => rows.push(tail(line)),
            bench if ABSOLUTE.iter().any(|(name, _)| *name == bench) => rows.push(absolute(line)),
            "erlang_supervisor" => {
                ["p50_ns", "p999_ns"].iter().for_each(|field| rows.extend(erlang(line, lines, field)));
            }
            bench => {
                let targets = TARGETS.iter().filter(|target| target.bench == bench);
                rows.extend(targets.map(|target| recovery(line, target)));
            }
        }
    }
    rows.join("\n")
}

fn head() -> String {
    format!(
        "{:18} {:14} {:6} {:5} {:6} {:>11} {:>11} {:>7}  {:15} met",
        "bench", "payload", "load", "sched", "", "ours us", "limit us", "ratio", "target"
    )
}

fn recovery(line: &Value, target: &Target) -> String {
    let (own, limit) = (number(line, target.field), number(&line["limit"], target.field));
    let ratio = own / limit;
    row(line, target.field, own, limit, ratio, &format!("at most {}", target.most), ratio <= target.most)
}

fn guard(line: &Value) -> String {
    let (own, limit) = (number(line, "p50_ns"), number(&line["limit"], "p50_ns"));
    let wanted = format!("at most +{GUARD_NS_MAX} ns");
    row(line, "p50_ns", own, limit, own / limit, &wanted, own - limit <= GUARD_NS_MAX)
}

fn absolute(line: &Value) -> String {
    let (own, limit) = (number(line, "p50_ns"), number(&line["limit"], "p50_ns"));
    let most = ABSOLUTE.iter().find(|(bench, _)| *bench == text(line, "bench")).map_or(f64::NAN, |(_, most)| *most);
    row(line, "p50_ns", own, limit, own / limit, &format!("at most {most} ns"), own <= most)
}

fn tail(line: &Value) -> String {
    let (own, limit) = (number(line, "p99_ns"), number(&line["limit"], "p99_ns"));
    let most = TAILS.iter().find(|(bench, _)| *bench == text(line, "bench")).map_or(f64::NAN, |(_, most)| *most);
    row(line, "p99_ns", own, limit, own / limit, &format!("at most {} us", most / 1e3), own <= most)
}

/// 1 MiB against 64 bytes under the same load and policy.
fn large(line: &Value, lines: &[Value]) -> Option<String> {
    let keys = ["bench", "load", "sched"];
    let small = |other: &&Value| text(other, "payload") == "64 B" && keys.iter().all(|key| other[*key] == line[*key]);
    let small = number(lines.iter().find(small)?, "p50_ns");
    let own = number(line, "p50_ns");
    let ratio = own / small;
    Some(row(line, "p50_ns", own, small, ratio, &format!("at most {LARGE_MOST}"), ratio <= LARGE_MOST))
}

/// Against our recovery from a trap under the same load and policy, each payload a row.
fn erlang(line: &Value, lines: &[Value], field: &str) -> Vec<String> {
    let same = |other: &&Value| {
        text(other, "bench") == "trap_recovery" && ["load", "sched"].iter().all(|key| other[*key] == line[*key])
    };
    let compare = |ours: &Value| {
        let (theirs, own) = (number(line, field), number(ours, field));
        let mut named = line.clone();
        named["payload"] = format!("to {}", text(ours, "payload")).into();
        let ratio = theirs / own;
        row(&named, field, own, theirs, ratio, &format!("at least {ERLANG_LEAST}"), ratio >= ERLANG_LEAST)
    };
    lines.iter().filter(same).map(compare).collect()
}

fn row(line: &Value, field: &str, own: f64, limit: f64, ratio: f64, target: &str, met: bool) -> String {
    let [bench, payload, load, sched] = ["bench", "payload", "load", "sched"].map(|key| text(line, key));
    let field = field.trim_end_matches("_ns");
    let (own, limit, met) = (own / 1e3, limit / 1e3, if met { "yes" } else { "NO" });
    format!(
        "{bench:18} {payload:14} {load:6} {sched:5} {field:6} {own:11.3} {limit:11.3} {ratio:7.2}  {target:15} {met}"
    )
}

fn text<'a>(line: &'a Value, field: &str) -> &'a str {
    line[field].as_str().unwrap_or_default()
}

fn number(line: &Value, field: &str) -> f64 {
    line[field].as_f64().unwrap_or(f64::NAN)
}
