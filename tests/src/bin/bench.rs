//! Runs benchmarks and prints one JSON object a line; see `scripts/bench`.

use std::io::{self, BufRead, Write};
use std::path::PathBuf;
use std::time::Duration;

use clap::Parser;
use serde_json::Value;
use tests::bench::hop::Part;
use tests::bench::load::Load;
use tests::bench::rig::Payload;
use tests::bench::stats::{Samples, Setting};
use tests::bench::{checkpoint, emergency, erlang, fault_stop, guard, hang, hop, recovery, report, validity, wire};

/// As in the daemon.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Benchmarks, each with its raw limit measured in the same run.
#[derive(Parser)]
struct Arguments {
    /// Which ones; all without any.
    #[arg(value_parser = NAMES)]
    names: Vec<String>,
    /// Faults of each kind.
    #[arg(long, default_value_t = 10_000)]
    faults: usize,
    /// Only under this load.
    #[arg(long, value_parser = ["idle", "cpu100"])]
    load: Option<String>,
    /// Only under this policy.
    #[arg(long, value_parser = ["other", "fifo"])]
    sched: Option<String>,
    /// A table of ratios and targets instead of JSON.
    #[arg(long)]
    report: bool,
    /// The table of an earlier run's JSON.
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
}

const NAMES: [&str; 15] = [
    "guard_cost",
    "checkpoint",
    "validity_check",
    "hop_same_executor",
    "hop_cross_executor",
    "query_same_executor",
    "query_cross_executor",
    "fan_out",
    "rewire",
    "trap_recovery",
    "panic_recovery",
    "hang_recovery",
    "erlang_supervisor",
    "fault_stop",
    "emergency_stop",
];
/// Fault-stops of a closure.
const CLOSURES: usize = 30;
/// Copies of a component's state.
const CHECKPOINTS: usize = 20_000;
/// Connections made and cut.
const REWIRES: usize = 10_000;
/// How long the data path of each kind is measured.
const RUN: Duration = Duration::from_secs(2);
/// What takes the place of what failed.
const PAYLOADS: [Payload; 2] = [Payload::Spare, Payload::Fresh];
/// Threads that keep all cores busy.
const LOADS: [(&str, usize); 2] = [("idle", 0), ("cpu100", 4)];
/// Between two hops that each wake their reader.
const PAUSE: Duration = Duration::from_micros(200);
const SCHEDS: [&str; 2] = ["other", "fifo"];

fn main() -> io::Result<()> {
    let arguments = Arguments::parse();
    if let Some(file) = &arguments.from {
        let lines: io::Result<Vec<String>> = io::BufReader::new(std::fs::File::open(file)?).lines().collect();
        let lines: Vec<Value> = lines?.iter().filter_map(|line| serde_json::from_str(line).ok()).collect();
        return writeln!(io::stdout(), "{}", report::table(&lines));
    }
    // The bare panics are not to be told, and to tell them would take time; all others are.
    let tell = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        if info.payload().downcast_ref::<&str>() != Some(&"bare") {
            tell(info);
        }
    }));
    let mut run = Run { arguments, lines: Vec::new() };
    run.guard_cost()?;
    run.hop("checkpoint", "64 KiB", "idle", "other", || checkpoint::measure(CHECKPOINTS))?;
    run.hop("validity_check", "16 fields", "idle", "other", || validity::check(1000))?;
    for (load, threads) in LOADS {
        for sched in SCHEDS {
            if run.is_asked(load, sched) {
                let _load = Load::start(threads);
                run.data_path(load, sched)?;
                run.recoveries(load, sched)?;
                run.erlang(load, sched)?;
                run.handling(load, sched)?;
            }
        }
    }
    if run.arguments.report {
        writeln!(io::stdout(), "{}", report::table(&run.lines))?;
    }
    Ok(())
}

struct Run {
    arguments: Arguments,
    lines: Vec<Value>,
}

impl Run {
    fn is_wanted(&self, name: &str) -> bool {
        self.arguments.names.is_empty() || self.arguments.names.iter().any(|asked| asked == name)
    }

    fn is_asked(&self, load: &str, sched: &str) -> bool {
        let fits = |asked: &Option<String>, name: &str| asked.as_deref().is_none_or(|asked| asked == name);
        fits(&self.arguments.load, load) && fits(&self.arguments.sched, sched)
    }

    fn guard_cost(&mut self) -> io::Result<()> {
        if !self.is_wanted("guard_cost") {
            return Ok(());
        }
        for (payload, measure) in [
            ("fiber", guard::fiber as fn(usize) -> _),
            ("callback", guard::callback),
            ("callback that may wait", guard::waiting),
        ] {
            let (mut own, mut limit) = measure(1000);
            let setting = Setting { bench: "guard_cost", payload, load: "idle", sched: "other" };
            self.tell(setting.line(&mut own, Some(&mut limit)))?;
        }
        Ok(())
    }

    fn data_path(&mut self, load: &str, sched: &str) -> io::Result<()> {
        for payload in [hop::Payload::Small, hop::Payload::Large] {
            let first = || hop::same(payload, Part::First, sched, RUN);
            self.hop("hop_same_executor", payload.name(), load, sched, first)?;
        }
        let turn = || hop::same(hop::Payload::Small, Part::Turn, sched, RUN);
        self.hop("hop_same_executor", report::WHOLE_TURN, load, sched, turn)?;
        for payload in [hop::Payload::Small, hop::Payload::Large] {
            let cross = || hop::cross(payload, Duration::ZERO, sched, RUN);
            self.hop("hop_cross_executor", payload.name(), load, sched, cross)?;
        }
        // Long after the last one, so that whoever is to hear it sleeps.
        let rare = || hop::cross(hop::Payload::Small, PAUSE, sched, 5 * RUN);
        self.hop("hop_cross_executor", "64 B, rare", load, sched, rare)?;
        self.hop("query_same_executor", "64 B", load, sched, || hop::query_same(sched, RUN))?;
        self.hop("query_cross_executor", "64 B", load, sched, || hop::query_cross(sched, RUN))?;
        for (payload, executor) in [("its executor", "one"), ("another one", "other")] {
            self.hop("fan_out", payload, load, sched, || hop::fan_out(executor, sched, RUN))?;
        }
        self.hop("rewire", "64 B", load, sched, || wire::rewire(sched, REWIRES))
    }

    fn hop(
        &mut self,
        bench: &str,
        payload: &str,
        load: &str,
        sched: &str,
        measure: impl FnOnce() -> (Samples, Samples),
    ) -> io::Result<()> {
        if !self.is_wanted(bench) {
            return Ok(());
        }
        let (mut own, mut limit) = measure();
        let setting = Setting { bench, payload, load, sched };
        self.tell(setting.line(&mut own, Some(&mut limit)))
    }

    fn recoveries(&mut self, load: &str, sched: &str) -> io::Result<()> {
        let faults = self.arguments.faults;
        for payload in PAYLOADS {
            for (bench, symptom) in
                [("trap_recovery", "crash.segv"), ("panic_recovery", "crash.panic"), ("hang_recovery", "hang")]
            {
                if self.is_wanted(bench) {
                    let (mut own, mut limit) = match symptom {
                        "hang" => hang::measure(payload, sched, faults),
                        _ => recovery::measure(symptom, payload, sched, faults),
                    };
                    let setting = Setting { bench, payload: payload.name(), load, sched };
                    let mut line = setting.line(&mut own.first_callback, Some(&mut limit));
                    line["steps_p50_ns"] = own.medians();
                    self.tell(line)?;
                }
            }
        }
        Ok(())
    }

    fn erlang(&mut self, load: &str, sched: &str) -> io::Result<()> {
        if !self.is_wanted("erlang_supervisor") {
            return Ok(());
        }
        match erlang::measure(sched, self.arguments.faults) {
            Ok(mut samples) => {
                let setting = Setting { bench: "erlang_supervisor", payload: "process", load, sched };
                self.tell(setting.line(&mut samples, None))
            }
            Err(reason) => writeln!(io::stderr(), "erlang_supervisor {load} {sched}: left out: {reason}"),
        }
    }

    fn handling(&mut self, load: &str, sched: &str) -> io::Result<()> {
        let faults = self.arguments.faults;
        self.hop("emergency_stop", "serial line", load, sched, || emergency::measure(sched, faults))?;
        for shape in [fault_stop::Shape::Chain, fault_stop::Shape::Star] {
            let stop = || fault_stop::measure(shape, sched, CLOSURES.min(faults));
            self.hop("fault_stop", &shape.name(), load, sched, stop)?;
        }
        Ok(())
    }

    fn tell(&mut self, line: Value) -> io::Result<()> {
        if self.arguments.report {
            let [bench, payload, load, sched] = ["bench", "payload", "load", "sched"].map(|key| &line[key]);
            writeln!(io::stderr(), "{bench} {payload} {load} {sched}")?;
        } else {
            writeln!(io::stdout(), "{line}")?;
        }
        self.lines.push(line);
        Ok(())
    }
}
