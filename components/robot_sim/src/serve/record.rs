//! The record of a run: JSON lines, the world first, then the truth at 50 Hz, at last how it ended.
//!
//! Every line has `mono_ns`, the monotonic clock that the daemon's journal uses, so that a fault finds its place on the
//! path. The world stands in the file, so that a record can be drawn without anything else.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{ServeError, mono_ns};
use crate::simulation::Truth;
use crate::world::World;

/// One line of a record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Record {
    /// The first line.
    Start {
        /// Monotonic clock, nanoseconds.
        mono_ns: u64,
        /// Seed of all noise.
        seed: u64,
        /// The world.
        world: World,
    },
    /// What was really the case at a moment.
    Truth(Moment),
    /// The power of the left wheels failed.
    Power {
        /// Monotonic clock, nanoseconds.
        mono_ns: u64,
        /// Seconds since the simulation began.
        t: f64,
    },
    /// The last line.
    End(End),
}

/// What was really the case at a moment.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Moment {
    /// Monotonic clock, nanoseconds.
    pub mono_ns: u64,
    /// Seconds since the simulation began.
    pub t: f64,
    /// Metres.
    pub x: f64,
    /// Metres.
    pub y: f64,
    /// Radians.
    pub theta: f64,
    /// Front-left, rear-left, front-right, rear-right, radians per second.
    pub wheels: [f64; 4],
    /// So far.
    pub collisions: u32,
    /// From the robot's centre to the target's surface, metres.
    pub target_m: f64,
    /// From the robot's centre to the nearest surface, metres.
    pub clearance_m: f64,
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct End {
    /// Monotonic clock, nanoseconds.
    pub mono_ns: u64,
    /// Seconds since the simulation began.
    pub t: f64,
    /// Whether the robot came to its target.
    pub reached: bool,
    /// `reached`, `timeout` or `stopped` (by a signal).
    pub reason: Reason,
    /// In all.
    pub collisions: u32,
    /// Length of the way, metres.
    pub path_m: f64,
}

/// Why a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Reason {
    /// At the target.
    Reached,
    /// Not there in time.
    Timeout,
    /// Ended by a signal.
    Stopped,
}

impl From<Truth> for Moment {
    fn from(truth: Truth) -> Self {
        Self {
            mono_ns: mono_ns(),
            t: truth.time.as_secs_f64(),
            x: truth.pose.at.x,
            y: truth.pose.at.y,
            theta: truth.pose.theta,
            wheels: truth.wheels_rad_s,
            collisions: truth.collisions,
            target_m: truth.target_m,
            clearance_m: truth.clearance_m,
        }
    }
}

/// Writes a record, each line as soon as it is known, so that others can follow the file.
pub struct Recorder {
    file: File,
    path: PathBuf,
}

impl Recorder {
    /// Begins the file `path` anew with the first line.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn create(path: &Path, world: &World, seed: u64) -> Result<Self, ServeError> {
        let file = File::create(path).map_err(ServeError::system("write", path))?;
        let mut recorder = Self { file, path: path.to_owned() };
        recorder.write(&Record::Start { mono_ns: mono_ns(), seed, world: world.clone() })?;
        Ok(recorder)
    }

    /// Adds a line.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&mut self, record: &Record) -> Result<(), ServeError> {
        let line = serde_json::to_string(record).map_err(io::Error::from);
        // One write per line: a reader never sees half of one.
        line.and_then(|line| self.file.write_all(format!("{line}\n").as_bytes()))
            .map_err(ServeError::system("write", &self.path))
    }
}
