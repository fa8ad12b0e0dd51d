//! `robot-demo`: the daemon drives the simulated robot to its target while its components are made to fail.
//!
//! Exit code 0: the robot arrived, every fault was recovered from, nothing was hit. 1: not so. 2: could not run.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use clap::{Parser, ValueEnum};
use robot_sim::demo::compare::{self, PRELOADS};
use robot_sim::demo::progress::Progress;
use robot_sim::demo::report::Report;
use robot_sim::demo::run::{Settings, run};
use robot_sim::demo::schedule::{self, Injection};
use robot_sim::demo::{DemoError, svg, table};
use signal_hook::consts::{SIGINT, SIGTERM};

/// Drives the simulated robot with the daemon while components fail, and shows how it recovered.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// Profile directory of the robot
    #[arg(long, value_name = "DIR")]
    profile: PathBuf,
    /// Where path.svg, journal, record and logs go
    #[arg(long, value_name = "DIR", default_value = "target/demo")]
    out: PathBuf,
    /// Plain lines instead of a live one
    #[arg(long)]
    headless: bool,
    /// Inject this fault instead of the default schedule; repeatable
    #[arg(long, value_name = "SLOT:SYMPTOM@SECONDS", conflicts_with = "faults")]
    inject: Vec<Injection>,
    /// Which faults to inject
    #[arg(long, value_enum, default_value_t = Faults::Default)]
    faults: Faults,
    /// Run three times, the secondary's preload set to none, library and instance, and compare recovery times
    #[arg(long)]
    compare_preload: bool,
    /// World file [default: the built-in warehouse]
    #[arg(long, value_name = "FILE")]
    world: Option<PathBuf>,
    /// Seed of the simulator's noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Give up this many seconds after the daemon is ready
    #[arg(long, value_name = "S", default_value_t = 80)]
    timeout: u64,
    /// The daemon's program [default: framework-daemon beside this one]
    #[arg(long, value_name = "FILE")]
    daemon: Option<PathBuf>,
    /// Plugin directory; repeatable [default: where this program is]
    #[arg(long, value_name = "DIR")]
    plugins: Vec<PathBuf>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Faults {
    /// The default schedule
    Default,
    /// None at all
    None,
}

fn main() -> ExitCode {
    match demo(&Arguments::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            eprintln!("robot-demo: {error}");
            ExitCode::from(2)
        }
    }
}

fn demo(arguments: &Arguments) -> Result<bool, Box<dyn std::error::Error>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGTERM, SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    let settings = settings(arguments)?;
    let mut progress = Progress::new(arguments.headless);
    if arguments.compare_preload {
        return Ok(compare_preload(&settings, &stop, &mut progress)?);
    }
    let report = run_and_show(&settings, &stop, &mut progress)?;
    println!("{}", report.last_line());
    Ok(report.success())
}

fn settings(arguments: &Arguments) -> Result<Settings, Box<dyn std::error::Error>> {
    let beside = std::env::current_exe()?.parent().map(Path::to_owned).unwrap_or_default();
    let schedule = match arguments.faults {
        Faults::None => Vec::new(),
        Faults::Default if arguments.inject.is_empty() => schedule::default(),
        Faults::Default => arguments.inject.clone(),
    };
    let plugins = if arguments.plugins.is_empty() { vec![beside.clone()] } else { arguments.plugins.clone() };
    Ok(Settings {
        profile: arguments.profile.clone(),
        out: arguments.out.clone(),
        daemon: arguments.daemon.clone().unwrap_or_else(|| beside.join("framework-daemon")),
        simulator: beside.join("robot-sim"),
        plugins,
        schedule,
        world: arguments.world.clone(),
        seed: arguments.seed,
        timeout: Duration::from_secs(arguments.timeout),
        preload: None,
    })
}

fn run_and_show(settings: &Settings, stop: &AtomicBool, progress: &mut Progress) -> Result<Report, DemoError> {
    let report = run(settings, stop, progress)?;
    let picture = settings.out.join("path.svg");
    svg::write(&report, &picture)?;
    if !report.faults.is_empty() {
        println!("\n{}\n", table::faults(&report));
    }
    for unseen in report.unseen() {
        println!("injected but not in the journal: {unseen}");
    }
    for complaint in &report.complaints {
        println!("{complaint}");
    }
    println!("picture of the path: {}", picture.display());
    Ok(report)
}

fn compare_preload(settings: &Settings, stop: &AtomicBool, progress: &mut Progress) -> Result<bool, DemoError> {
    let mut runs = Vec::new();
    for preload in PRELOADS {
        println!("secondary with preload=\"{preload}\"");
        let out = settings.out.join(format!("preload-{preload}"));
        let settings = Settings { out, preload: Some(preload.into()), ..settings.clone() };
        let report = run_and_show(&settings, stop, progress)?;
        println!("{}\n", report.last_line());
        runs.push((preload, report));
    }
    println!("{}\n", compare::table(&runs));
    println!("{}", compare::last_line(&runs));
    Ok(compare::success(&runs))
}
