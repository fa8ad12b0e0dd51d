//! `robot-sim`: the motion board on a pseudo-terminal, the camera on a socket, the truth in a file.
//!
//! Exit code 0: target reached, or ended by SIGTERM or SIGINT. 1: not reached in time. 2: could not run.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use board_protocol::robot::RING;
use clap::Parser;
use robot_sim::serve::camera_socket::CameraSocket;
use robot_sim::serve::pty::Pty;
use robot_sim::serve::record::{End, Reason, Recorder};
use robot_sim::serve::{Player, Playing};
use robot_sim::{Simulation, SonarFaults, World};
use signal_hook::consts::{SIGINT, SIGTERM};

/// Plays the robot: its motion board on a pseudo-terminal, its camera on a Unix socket.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// Symbolic link to make to the pseudo-terminal; the driver's device
    #[arg(long, value_name = "LINK")]
    board: PathBuf,
    /// Unix socket to serve camera frames on
    #[arg(long, value_name = "SOCKET")]
    camera: Option<PathBuf>,
    /// File to record the truth in, as JSON lines
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// World file [default: the built-in warehouse]
    #[arg(long, value_name = "FILE")]
    world: Option<PathBuf>,
    /// Seed of all noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Give up after this many simulated seconds
    #[arg(long, value_name = "S", default_value_t = 120.0)]
    timeout: f64,
    /// Go on playing the board this many seconds after the target is reached
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    linger: f64,
    /// Pull a sensor of the ultrasonic ring out: its number, and after how many simulated seconds
    #[arg(long, value_name = "SENSOR@S", value_parser = sensor_and_time)]
    unplug: Option<(usize, Duration)>,
    /// Let the power of the left wheels fail this many seconds after the first command to drive
    #[arg(long, value_name = "S")]
    left_power_off: Option<f64>,
    /// Play one more ultrasonic ring, on a line of its own that this symbolic link leads to; repeatable, they count from 0
    #[arg(long, value_name = "LINK")]
    sonar: Vec<PathBuf>,
    /// Let one of these rings fall silent: its number, and how many seconds after the first command to drive; repeatable
    #[arg(long, value_name = "RING@S", value_parser = number_and_time)]
    sonar_silent: Vec<(usize, Duration)>,
    /// Let one of these rings drift, so that all seems nearer and nearer: its number and its time, as before; repeatable
    #[arg(long, value_name = "RING@S", value_parser = number_and_time)]
    sonar_drift: Vec<(usize, Duration)>,
    /// Keep to real time (the default)
    #[arg(long, conflicts_with = "speed")]
    realtime: bool,
    /// Simulated seconds per real second
    #[arg(long, default_value_t = 1.0)]
    speed: f64,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(Reason::Reached | Reason::Stopped) => ExitCode::SUCCESS,
        Ok(Reason::Timeout) => ExitCode::from(1),
        Err(error) => {
            eprintln!("robot-sim: {error}");
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &Arguments) -> Result<Reason, Box<dyn std::error::Error>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGTERM, SIGINT] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    let playing = Playing {
        speed: arguments.speed,
        timeout: Duration::try_from_secs_f64(arguments.timeout)?,
        linger: Duration::try_from_secs_f64(arguments.linger)?,
    };
    let mut player = player(arguments)?;
    say(&format!("ready board={} device={}", arguments.board.display(), player.device().display()));
    let ending = player.play(playing, &stop, report)?;
    if ending.end.reason != Reason::Reached {
        report(ending.end);
    }
    if ending.line_errors > 0 {
        eprintln!("robot-sim: {} frames from the driver were damaged on the line", ending.line_errors);
    }
    Ok(ending.end.reason)
}

fn player(arguments: &Arguments) -> Result<Player, Box<dyn std::error::Error>> {
    let world = arguments.world.as_ref().map_or_else(|| Ok(World::warehouse()), |path| World::load(path))?;
    let recorder = arguments.record.as_ref().map(|path| Recorder::create(path, &world, arguments.seed)).transpose()?;
    let camera = arguments.camera.as_ref().map(|path| CameraSocket::open(path)).transpose()?;
    let pty = Pty::open(&arguments.board)?;
    let mut simulation = Simulation::new(world, arguments.seed);
    if let Some((sensor, at)) = arguments.unplug {
        simulation.unplug(sensor, at);
    }
    if let Some(seconds) = arguments.left_power_off {
        simulation.cut_left_power_after(Duration::try_from_secs_f64(seconds)?);
    }
    let lines = sonars(arguments, &mut simulation)?;
    Ok(Player::new(simulation, pty, camera, recorder).with_sonars(lines))
}

/// Further rings, each with its line.
fn sonars(arguments: &Arguments, simulation: &mut Simulation) -> Result<Vec<Pty>, Box<dyn std::error::Error>> {
    let rings = arguments.sonar.len();
    if let Some((ring, _)) =
        arguments.sonar_silent.iter().chain(&arguments.sonar_drift).find(|(ring, _)| *ring >= rings)
    {
        return Err(
            format!("there is no ring {ring}: {rings} were asked for with --sonar, and they count from 0").into()
        );
    }
    let of = |faults: &[(usize, Duration)], ring| faults.iter().find(|(number, _)| *number == ring).map(|(_, at)| *at);
    for ring in 0..rings {
        let (silent_after, drifts_after) = (of(&arguments.sonar_silent, ring), of(&arguments.sonar_drift, ring));
        simulation.add_sonar(SonarFaults { silent_after, drifts_after });
    }
    Ok(arguments.sonar.iter().map(|link| Pty::open(link)).collect::<Result<_, _>>()?)
}

/// `3@1.5`.
fn sensor_and_time(text: &str) -> Result<(usize, Duration), String> {
    let parsed = number_and_time(text).ok().filter(|(sensor, _)| *sensor < RING);
    parsed.ok_or_else(|| format!("write SENSOR@SECONDS, with a sensor from 0 to {}: 3@1.5", RING - 1))
}

/// `1@2.5`.
fn number_and_time(text: &str) -> Result<(usize, Duration), String> {
    let parsed = text
        .split_once('@')
        .and_then(|(number, at)| Some((number.parse().ok()?, Duration::try_from_secs_f64(at.parse().ok()?).ok()?)));
    parsed.ok_or_else(|| "write NUMBER@SECONDS: 1@2.5".to_owned())
}

fn report(end: End) {
    let how = match end.reason {
        Reason::Reached => "reached",
        Reason::Timeout => "timeout",
        Reason::Stopped => "stopped",
    };
    say(&format!("{how} t={:.1} path_m={:.2} collisions={}", end.t, end.path_m, end.collisions));
}

/// `println!` would end the simulation when whoever reads its output has gone.
fn say(line: &str) {
    let _nobody_listens = writeln!(std::io::stdout(), "{line}");
}
