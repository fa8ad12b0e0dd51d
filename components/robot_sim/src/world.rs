//! The world file: walls, obstacles, target, start. JSON, metres and degrees.
//!
//! ```json
//! { "name": "corridor",
//!   "walls": [[[0, 0], [4, 0], [4, 2], [0, 2], [0, 0]]],
//!   "wall_height": 0.8,
//!   "obstacles": [{ "shape": { "round": { "x": 2, "y": 1, "radius": 0.2 } }, "height": 0.4, "colour": [70, 90, 150] },
//!                 { "shape": { "box": { "x": 3, "y": 1.5, "width": 0.4, "depth": 0.2, "turn": 30 } },
//!                   "height": 0.4, "colour": [120, 120, 120] }],
//!   "target": { "x": 3.6, "y": 1, "radius": 0.15, "height": 1.2, "colour": [210, 30, 30] },
//!   "start": { "x": 0.5, "y": 1, "theta": 0 } }
//! ```
//!
//! Decision: one small file of our own. The formats of the big simulators describe joints, meshes and inertias; a
//! reader for the tenth that a flat room needs would be longer than this simulator.

use std::path::Path;

use board_protocol::robot::BODY_RADIUS_M;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::geometry::{Point, Pose};
use crate::scene::Scene;

/// Red, green, blue.
pub type Colour = [u8; 3];

/// Everything the robot can see and bump into, and what it is to reach.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct World {
    /// Name for reports.
    pub name: String,
    /// Each wall is a line through these points (x, y in metres).
    pub walls: Vec<Vec<(f64, f64)>>,
    /// Height of the walls, in metres.
    pub wall_height: f64,
    /// Things in the way.
    pub obstacles: Vec<Obstacle>,
    /// What the robot is to reach; solid too.
    pub target: Target,
    /// Where the robot starts.
    pub start: Start,
}

/// Something in the way.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Obstacle {
    /// Its outline seen from above.
    #[serde(rename = "shape")]
    pub outline: Outline,
    /// Its height, in metres.
    pub height: f64,
    /// Its colour.
    pub colour: Colour,
}

/// Outline of an obstacle, seen from above.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Outline {
    /// A circle.
    Round {
        /// Centre, metres.
        x: f64,
        /// Centre, metres.
        y: f64,
        /// Metres.
        radius: f64,
    },
    /// A rectangle, turned about its centre.
    Box {
        /// Centre, metres.
        x: f64,
        /// Centre, metres.
        y: f64,
        /// Extent along x before turning, metres.
        width: f64,
        /// Extent along y before turning, metres.
        depth: f64,
        /// Degrees counter-clockwise.
        #[serde(default)]
        turn: f64,
    },
}

/// The coloured post that the robot is to reach.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Target {
    /// Centre, metres.
    pub x: f64,
    /// Centre, metres.
    pub y: f64,
    /// Metres.
    pub radius: f64,
    /// Metres.
    pub height: f64,
    /// What the camera sees.
    pub colour: Colour,
}

impl Target {
    /// Its centre.
    #[must_use]
    pub fn at(&self) -> Point {
        Point { x: self.x, y: self.y }
    }

    /// Distance from `place` to the target's surface, in metres.
    #[must_use]
    pub fn distance(&self, place: Point) -> f64 {
        place.distance(self.at()) - self.radius
    }
}

/// Where the robot starts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// Metres.
    pub x: f64,
    /// Metres.
    pub y: f64,
    /// Degrees counter-clockwise from the x axis.
    pub theta: f64,
}

impl Start {
    /// The same in radians.
    #[must_use]
    pub fn pose(&self) -> Pose {
        Pose { at: Point { x: self.x, y: self.y }, theta: self.theta.to_radians() }
    }
}

/// Why a world file cannot be used.
#[derive(Debug, Error)]
pub enum WorldError {
    /// The file could not be read.
    #[error("cannot read the world file: {0}")]
    Read(#[from] std::io::Error),
    /// Not JSON, or not of this shape; the message carries line and column.
    #[error("not a world file: {0}; components/robot_sim/README.md shows the form")]
    Syntax(#[from] serde_json::Error),
    /// The numbers make no world.
    #[error("the world cannot be: {0}")]
    Sense(String),
}

impl World {
    /// Reads and checks a world file.
    ///
    /// # Errors
    /// The file cannot be read, is not of this form, or describes an impossible world.
    pub fn load(path: &Path) -> Result<Self, WorldError> {
        Self::parse(&std::fs::read_to_string(path)?)
    }

    /// Reads and checks the text of a world file.
    ///
    /// # Errors
    /// The text is not of this form, or describes an impossible world.
    pub fn parse(text: &str) -> Result<Self, WorldError> {
        let world: Self = serde_json::from_str(text)?;
        world.check()?;
        Ok(world)
    }

    /// The default scenario, `worlds/warehouse.json`.
    ///
    /// # Panics
    /// Never: the file is part of the program and a test loads it.
    #[must_use]
    pub fn warehouse() -> Self {
        Self::parse(include_str!("../worlds/warehouse.json")).expect("the built-in world is valid")
    }

    /// Lower left and upper right corner of all walls, in metres.
    #[must_use]
    pub fn bounds(&self) -> (Point, Point) {
        let points = || self.walls.iter().flatten();
        let low = |of: fn(&(f64, f64)) -> f64| points().map(of).fold(f64::INFINITY, f64::min);
        let high = |of: fn(&(f64, f64)) -> f64| points().map(of).fold(f64::NEG_INFINITY, f64::max);
        (Point { x: low(|p| p.0), y: low(|p| p.1) }, Point { x: high(|p| p.0), y: high(|p| p.1) })
    }

    fn check(&self) -> Result<(), WorldError> {
        let sense = |good: bool, complaint: String| if good { Ok(()) } else { Err(WorldError::Sense(complaint)) };
        sense(self.walls.iter().all(|wall| wall.len() >= 2), "a wall needs two points or more".into())?;
        sense(!self.walls.is_empty(), "there are no walls; the robot would drive away for ever".into())?;
        sense(self.wall_height > 0.0, "wall_height must be above 0".into())?;
        for (index, obstacle) in self.obstacles.iter().enumerate() {
            sense(obstacle.is_solid(), format!("obstacle {index} has an extent that is not above 0"))?;
        }
        sense(self.target.radius > 0.0 && self.target.height > 0.0, "the target has no extent".into())?;
        let room = Scene::new(self).clearance(self.start.pose().at) - f64::from(BODY_RADIUS_M);
        sense(room > 0.0, format!("the robot starts {:.2} m inside something", -room))
    }
}

impl Obstacle {
    fn is_solid(&self) -> bool {
        let outline = match self.outline {
            Outline::Round { radius, .. } => radius > 0.0,
            Outline::Box { width, depth, .. } => width > 0.0 && depth > 0.0,
        };
        outline && self.height > 0.0
    }
}
