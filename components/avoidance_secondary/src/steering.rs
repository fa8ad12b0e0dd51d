//! Forces become a motion; where they cancel out, the robot feels its way along the wall instead.
//!
//! Decision: a potential field (after Khatib) with an escape that steers by the wall's distance alone. It shares neither data
//! structure nor rule of choice with the primary's histogram: an error in one is not an error in the other, which is the point of a
//! recovery block. Not chosen: random walks out of local minima; a robot that recovers from a fault should not look drunk.

use board_protocol::robot::BODY_RADIUS_M;
use robot_objects::angle::{self, degrees};
use robot_objects::motion::Motion;
use robot_objects::ring::{self, Ranges};

use crate::field::{Force, repulsion};

/// Turn rate for each rad of heading error, in 1/s.
const TURN_GAIN: f64 = 2.0;
/// Forces that leave less than this share of the wanted way are a local minimum.
const STUCK_PROGRESS: f64 = 0.25;
/// Steps in a local minimum before the wall is followed.
const PATIENCE: u8 = 12;
/// Detour in rad below which a wall may be left.
const UNWOUND: f64 = degrees(60.0);
/// Echoes on both sides that differ by less than this (m of nearness) do not change the side of the push.
const EVEN: f64 = 0.1;
/// A detour of more turns than this is a circle.
const CIRCLE: f64 = degrees(500.0);

/// How careful, how fast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Distance at which a wall is followed, body to wall, in m.
    pub clearance: f64,
    /// Nothing may move forward with an obstacle ahead nearer to the body than this, in m.
    pub stop_distance: f64,
    /// Radius of the circle around the body, in m.
    pub body_radius: f64,
    /// Fastest turn in rad/s.
    pub max_turn: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { clearance: 0.15, stop_distance: 0.08, body_radius: f64::from(BODY_RADIUS_M), max_turn: 1.8 }
    }
}

/// What is remembered between two steps: plain data, so that a checkpoint can hold it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Steering {
    /// Side of the wall being followed: 1 left, -1 right, 0 none.
    wall: f64,
    /// The course's bearing, counted through full turns since the wall was met.
    wound: f64,
    stuck: u8,
    /// Side to which obstacles in the way push: 1 left, -1 right.
    swirl: f64,
    preferred: f64,
}

impl Steering {
    /// The motion that follows `course` as nearly as `ranges` (filtered, m) allow.
    pub fn steer(&mut self, ranges: &Ranges, course: Motion, settings: &Settings) -> Motion {
        let course = course.or_stop();
        if course.forward <= 0.0 {
            self.wall = 0.0;
            return Motion { forward: 0.0, turn: limited(course.bearing() * TURN_GAIN, settings) };
        }
        self.wound = if self.wall == 0.0 { course.bearing() } else { angle::unwrap(course.bearing(), self.wound) };
        let ahead = ring::free_ahead(ranges, settings.body_radius + 0.02) - settings.body_radius;
        let wish = if self.wall == 0.0 {
            self.by_field(ranges, course, settings)
        } else {
            self.by_wall(ranges, course, ahead, settings)
        };
        let room = ((ahead - settings.stop_distance) * 1.2).max(0.0);
        Motion { forward: wish.forward.min(room), turn: limited(wish.turn, settings) }
    }

    fn by_field(&mut self, ranges: &Ranges, course: Motion, settings: &Settings) -> Motion {
        let reach = settings.body_radius + settings.clearance + 0.8 * course.forward;
        self.swirl = swirl(ranges, course.bearing(), reach, self.swirl);
        let repulsion = repulsion(ranges, settings.body_radius, reach, course.bearing(), self.swirl);
        let force = Force::towards(course.bearing(), 1.0).plus(repulsion);
        let heading = force.bearing();
        // Progress towards the course if the robot did as the forces say.
        let progress = force.strength().min(1.0) * angle::wrap(heading - course.bearing()).cos();
        self.stuck =
            if progress < STUCK_PROGRESS { self.stuck.saturating_add(1) } else { self.stuck.saturating_sub(1) };
        if self.stuck > PATIENCE {
            self.meet(ranges);
        }
        Motion {
            forward: course.forward * heading.cos().max(0.0) * force.strength().min(1.0),
            turn: heading * TURN_GAIN,
        }
    }

    /// Chooses which side the wall is to be on: the side with less room, seen along the course.
    fn meet(&mut self, ranges: &Ranges) {
        let room = |side: f64| -> f64 {
            (1..=3)
                .map(|step| {
                    ring::nearest_within(ranges, self.wound + side * degrees(30.0) * f64::from(step), degrees(16.0))
                        .min(2.0)
                })
                .sum()
        };
        let nearer = if room(1.0) >= room(-1.0) { -1.0 } else { 1.0 };
        self.wall = if self.preferred == 0.0 { nearer } else { self.preferred };
        (self.preferred, self.stuck) = (0.0, 0);
    }

    fn by_wall(&mut self, ranges: &Ranges, course: Motion, ahead: f64, settings: &Settings) -> Motion {
        if self.is_past(ranges, course, settings) {
            // What is left of the obstacle is to stay on the side where it was.
            (self.wall, self.swirl) = (0.0, -self.wall);
            return self.by_field(ranges, course, settings);
        }
        let wanted = settings.body_radius + settings.clearance;
        let gap = wall_distance(ranges, self.wall);
        // A wall ahead turns away from the wall on the side, a lost wall turns towards it, a wall at the right distance does neither.
        let blocked = (1.0 - (ahead - settings.stop_distance) / 0.45).clamp(0.0, 1.0);
        let towards = ((gap - wanted) * 2.5).clamp(-0.9, 0.9);
        let turn = self.wall * (towards * (1.0 - blocked) - blocked * 1.6);
        Motion { forward: course.forward * 0.8 * (1.0 - 0.5 * turn.abs()).max(0.1), turn }
    }

    /// Whether the wall can be left. After a full circle it is left too, and the next one is taken on the other side.
    fn is_past(&mut self, ranges: &Ranges, course: Motion, settings: &Settings) -> bool {
        if self.wound.abs() > CIRCLE {
            self.preferred = -self.wall;
            return true;
        }
        let free = ring::free_along(ranges, course.bearing(), settings.body_radius + 0.05) - settings.body_radius;
        self.wound * self.wall < UNWOUND && free > settings.clearance + 1.2 * course.forward
    }
}

/// To which side what is in the way pushes: away from where the echoes near the course are nearer. Kept while they are about even.
fn swirl(ranges: &Ranges, course: f64, reach: f64, last: f64) -> f64 {
    let nearness = |side: f64| -> f64 {
        ring::echoes(ranges)
            .filter(|(bearing, _)| (0.0..degrees(80.0)).contains(&(side * angle::wrap(bearing - course))))
            .map(|(_, distance)| (reach - distance).max(0.0))
            .sum()
    };
    let (left, right) = (nearness(1.0), nearness(-1.0));
    if (left - right).abs() < EVEN && last != 0.0 {
        last
    } else if left > right {
        -1.0
    } else {
        1.0
    }
}

/// Distance of the wall on side `side` (1 left, -1 right) from the robot's centre, from the three echoes on that side; in m.
fn wall_distance(ranges: &Ranges, side: f64) -> f64 {
    [60.0, 90.0, 120.0]
        .map(|at: f64| {
            let echo = ring::nearest_within(ranges, side * degrees(at), degrees(5.0));
            // An oblique echo of a straight wall is longer than the wall is far.
            echo * degrees(at).sin().max(0.9)
        })
        .into_iter()
        .fold(f64::INFINITY, f64::min)
}

fn limited(turn: f64, settings: &Settings) -> f64 {
    turn.clamp(-settings.max_turn, settings.max_turn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use robot_objects::ring::ECHOES;

    fn settings() -> Settings {
        Settings::default()
    }

    #[test]
    fn a_free_ring_follows_the_course() {
        let motion = Steering::default().steer(&[3.0; ECHOES], Motion::course(0.5, 0.0), &settings());
        assert!((motion.forward - 0.5).abs() < 1e-9 && motion.turn.abs() < 1e-9);
    }

    #[test]
    fn nothing_moves_forward_into_a_near_obstacle() {
        let mut steering = Steering::default();
        let mut ranges = [3.0; ECHOES];
        ranges[0] = 0.1;
        for step in 0..200 {
            let motion = steering.steer(&ranges, Motion::course(0.5, f64::from(step) * 0.1), &settings());
            assert!(motion.forward.abs() < 1e-9);
        }
    }

    #[test]
    fn a_dead_end_makes_it_follow_the_wall() {
        let mut steering = Steering::default();
        let mut ranges = [3.0; ECHOES];
        (ranges[0], ranges[1], ranges[11], ranges[2]) = (0.2, 0.2, 0.2, 0.3);
        let motion = (0..60).map(|_| steering.steer(&ranges, Motion::course(0.5, 0.0), &settings())).last();
        assert!(steering.wall != 0.0);
        assert!(motion.is_some_and(|motion| motion.turn.abs() > 0.5), "{motion:?}");
    }
}
