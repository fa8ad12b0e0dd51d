//! Plays a simulation in real time: the loop of the `robot-sim` program.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use board_protocol::{Command, Decoder, Encoder};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::camera_socket::CameraSocket;
use super::pty::Pty;
use super::record::{End, Reason, Record, Recorder};
use super::{ServeError, mono_ns};
use crate::geometry::Point;
use crate::simulation::Simulation;

/// The loop comes round at least this often.
const ROUND: Timespec = Timespec { tv_sec: 0, tv_nsec: 3_000_000 };
/// When the machine stalls for longer, simulated time stands still instead of leaping: the robot must not cross the
/// room in one step because a compiler took the processor.
const LONGEST_LEAP: Duration = Duration::from_millis(100);
/// Simulated time from round to round is at most this, however slow the machine or fast the pace.
const LONGEST_ROUND: Duration = Duration::from_millis(10);
/// Truth is recorded this often (50 Hz).
const RECORD_PERIOD: Duration = Duration::from_millis(20);

/// How to play.
#[derive(Debug, Clone, Copy)]
pub struct Playing {
    /// Simulated seconds per real second.
    pub speed: f64,
    /// Give up after this much simulated time.
    pub timeout: Duration,
    /// Go on playing the board this long after the target is reached, so that the host can end first.
    pub linger: Duration,
}

/// How it ended.
#[derive(Debug, Clone, Copy)]
pub struct Ending {
    /// The last line of the record.
    pub end: End,
    /// Frames from the driver that were damaged on the line.
    pub line_errors: u32,
}

/// A simulation with all that connects it to the outside.
pub struct Player {
    simulation: Simulation,
    pty: Pty,
    camera: Option<CameraSocket>,
    recorder: Option<Recorder>,
    /// Lines of further ultrasonic rings, in their order.
    sonars: Vec<(Pty, Encoder)>,
    encoder: Encoder,
    decoder: Decoder<Command>,
    recorded: Duration,
    power_off_recorded: bool,
    way: (Point, f64),
}

impl Player {
    /// Connects `simulation` to the outside.
    #[must_use]
    pub fn new(simulation: Simulation, pty: Pty, camera: Option<CameraSocket>, recorder: Option<Recorder>) -> Self {
        let start = simulation.truth().pose.at;
        Self {
            simulation,
            pty,
            camera,
            recorder,
            sonars: Vec::new(),
            encoder: Encoder::new(),
            decoder: Decoder::new(),
            recorded: Duration::ZERO,
            power_off_recorded: false,
            way: (start, 0.0),
        }
    }

    /// Gives the simulation's further ultrasonic rings their lines, in their order.
    #[must_use]
    pub fn with_sonars(mut self, lines: Vec<Pty>) -> Self {
        self.sonars = lines.into_iter().map(|line| (line, Encoder::new())).collect();
        self
    }

    /// The device that the driver's link leads to.
    #[must_use]
    pub fn device(&self) -> &Path {
        self.pty.device()
    }

    /// Plays until the target is reached, time is up, or `stop` is set. Calls `reached` at the moment of arrival.
    ///
    /// # Errors
    /// The line or the record fails.
    pub fn play(
        &mut self,
        playing: Playing,
        stop: &Arc<AtomicBool>,
        reached: impl FnOnce(End),
    ) -> Result<Ending, ServeError> {
        let reason = loop_until(self, playing, stop, |player| player.simulation.reached())?;
        let end = self.end(reason);
        self.record(&Record::End(end))?;
        if reason == Reason::Reached {
            reached(end);
            let playing = Playing { timeout: self.simulation.time() + playing.linger, ..playing };
            loop_until(self, playing, stop, |_| false)?;
        }
        // Not the lost ones: a driver that opens the device anew counts from 0 and would seem to have lost some.
        Ok(Ending { end, line_errors: self.decoder.counters().checksum_errors })
    }

    /// Lets `time` pass in rounds short enough for every record and picture.
    fn catch_up(&mut self, mut time: Duration) -> Result<(), ServeError> {
        while time > LONGEST_ROUND {
            self.round(LONGEST_ROUND)?;
            time -= LONGEST_ROUND;
        }
        self.round(time)
    }

    /// One round: commands in, time on, telemetry, pictures and truth out.
    fn round(&mut self, time: Duration) -> Result<(), ServeError> {
        let broken = |error| ServeError::System { doing: "use", path: "the pseudo-terminal".into(), source: error };
        let mut buffer = [0; 4096];
        let simulation = &mut self.simulation;
        let bytes = self.pty.read(&mut buffer).map_err(broken)?;
        self.decoder.feed(bytes, |command| simulation.command(command));
        for telemetry in simulation.advance(time) {
            self.pty.write(&self.encoder.encode(&telemetry)).map_err(broken)?;
        }
        self.sound().map_err(broken)?;
        self.look();
        self.note()
    }

    /// Further rings speak. They have no wheels: what a driver tells them is read and forgotten.
    fn sound(&mut self) -> io::Result<()> {
        let mut buffer = [0; 4096];
        for (line, _) in &self.sonars {
            line.read(&mut buffer)?;
        }
        for (number, round) in self.simulation.sonar_rounds() {
            if let Some((line, encoder)) = self.sonars.get_mut(number) {
                line.write(&encoder.encode(&round))?;
            }
        }
        Ok(())
    }

    fn look(&mut self) {
        let Some(camera) = &mut self.camera else { return };
        match self.simulation.camera_frame() {
            Some(frame) => camera.offer(&frame),
            None => camera.tend(),
        }
    }

    fn note(&mut self) -> Result<(), ServeError> {
        if let Some(failed) = self.simulation.left_power_off().filter(|_| !self.power_off_recorded) {
            self.power_off_recorded = true;
            self.record(&Record::Power { mono_ns: mono_ns(), t: failed.as_secs_f64() })?;
        }
        if self.simulation.time() < self.recorded + RECORD_PERIOD {
            return Ok(());
        }
        self.recorded = self.simulation.time();
        let truth = self.simulation.truth();
        self.way = (truth.pose.at, self.way.1 + self.way.0.distance(truth.pose.at));
        self.record(&Record::Truth(truth.into()))
    }

    fn record(&mut self, record: &Record) -> Result<(), ServeError> {
        self.recorder.as_mut().map_or(Ok(()), |recorder| recorder.write(record))
    }

    fn end(&self, reason: Reason) -> End {
        let truth = self.simulation.truth();
        End {
            mono_ns: mono_ns(),
            t: truth.time.as_secs_f64(),
            reached: reason == Reason::Reached,
            reason,
            collisions: truth.collisions,
            path_m: self.way.1,
        }
    }
}

fn loop_until(
    player: &mut Player,
    playing: Playing,
    stop: &Arc<AtomicBool>,
    reached: impl Fn(&Player) -> bool,
) -> Result<Reason, ServeError> {
    let mut last = Instant::now();
    loop {
        if stop.load(Ordering::Relaxed) {
            return Ok(Reason::Stopped);
        }
        let now = Instant::now();
        let elapsed = (now - last).min(LONGEST_LEAP);
        last = now;
        player.catch_up(elapsed.mul_f64(playing.speed))?;
        if reached(player) {
            return Ok(Reason::Reached);
        }
        if player.simulation.time() >= playing.timeout {
            return Ok(Reason::Timeout);
        }
        // A command ends the wait early; an error here (a signal) only shortens it.
        let _woken = poll(&mut [PollFd::from_borrowed_fd(player.pty.readable(), PollFlags::IN)], Some(&ROUND));
    }
}
