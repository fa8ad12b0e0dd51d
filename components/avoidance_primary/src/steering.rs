//! Free directions become a motion: towards the course where that is free, else along the obstacle until the detour is undone.
//!
//! Decision: a histogram of free directions (after Borenstein and Koren's VFH), and for dead ends the Pledge rule: once the course
//! is blocked, keep the obstacle on one side and leave it only when the turns made around it have been unwound. A histogram alone
//! takes the free direction nearest to the course and so walks to and fro in every pocket that is deeper than it can see.

use board_protocol::robot::BODY_RADIUS_M;
use robot_objects::angle::{self, degrees};
use robot_objects::motion::Motion;
use robot_objects::ring::{self, Ranges};

use crate::histogram::{HALF_BEAM, Histogram};

/// Half the width of the lane that must be free ahead, beyond the body, in m.
const LANE_MARGIN: f64 = 0.02;
/// How much of the remaining way ahead may be used up each second, in 1/s.
const BRAKING: f64 = 1.2;
/// Turn rate for each rad of heading error, in 1/s.
const TURN_GAIN: f64 = 2.2;
/// The course may be left by this much when an obstacle is followed no more.
const UNWOUND: f64 = degrees(75.0);
/// How fast the chosen direction follows an edge that recedes, each step.
const HUG_STEP: f64 = degrees(5.0);
/// Farthest to the obstacle's side that the chosen direction may be.
const SHOULDER: f64 = degrees(100.0);
/// Largest angle between course and heading that is not yet an obstacle to be passed.
const SMALL_DETOUR: f64 = degrees(55.0);
/// What changing the side costs, as an angle.
const DITHER: f64 = degrees(20.0);
/// Share of the clearance that is insisted on where the alternative is a long way round.
const NARROW: f64 = 0.3;
/// A detour of more turns than this is no detour but a circle.
const CIRCLE: f64 = degrees(500.0);

/// How careful, how fast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Distance kept between body and obstacles, in m.
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
        Self { clearance: 0.11, stop_distance: 0.08, body_radius: f64::from(BODY_RADIUS_M), max_turn: 1.8 }
    }
}

/// What is remembered between two steps: plain data, so that a checkpoint can hold it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Steering {
    /// Side towards which an obstacle is being passed: 1 left, -1 right, 0 none.
    passing: f64,
    /// The course's bearing, counted through full turns since the obstacle was met.
    wound: f64,
    /// The direction last chosen along the obstacle, relative to the course: it holds still while the robot turns.
    edge: f64,
    /// By how much the last free direction near the course was off it.
    lean: f64,
    /// Side preferred at the next obstacle after a circle: the other one than last time.
    preferred: f64,
}

impl Steering {
    /// The motion that follows `course` as nearly as `ranges` (filtered, m) allow.
    pub fn steer(&mut self, ranges: &Ranges, course: Motion, settings: &Settings) -> Motion {
        let course = course.or_stop();
        if course.forward <= 0.0 {
            self.passing = 0.0;
            return Motion { forward: 0.0, turn: limited_turn(course.bearing(), settings) };
        }
        let heading = self.choose(ranges, course, settings);
        Motion { forward: speed(ranges, course.forward, heading, settings), turn: limited_turn(heading, settings) }
    }

    /// The direction to head for, relative to the robot's own.
    fn choose(&mut self, ranges: &Ranges, course: Motion, settings: &Settings) -> f64 {
        // Fast robots look far, a slow one may come near: how else could it ever reach a target that is itself an obstacle.
        let horizon = settings.body_radius + settings.clearance + 1.2 * course.forward;
        let comfortable = Histogram::of(ranges, settings.body_radius + settings.clearance, HALF_BEAM, horizon);
        let narrow = Histogram::of(ranges, settings.body_radius + settings.clearance * NARROW, 0.0, horizon);
        self.wound = if self.passing == 0.0 { course.bearing() } else { angle::unwrap(course.bearing(), self.wound) };
        if self.is_unwound()
            && let Some(lean) = self.near_course(&comfortable).or_else(|| self.near_course(&narrow))
        {
            (self.passing, self.lean) = (0.0, lean);
            return self.wound + lean;
        }
        if self.passing == 0.0 {
            self.meet(&comfortable);
        }
        // No direction is free: turn on the spot towards the wider side until one is.
        self.along(&comfortable).map_or_else(|| widest(ranges), angle::wrap)
    }

    /// Whether the turns made around an obstacle are undone. After a full circle they count as undone too, and the next try goes
    /// the other way round.
    fn is_unwound(&mut self) -> bool {
        if self.wound.abs() > CIRCLE {
            (self.preferred, self.passing) = (-self.passing, 0.0);
            self.wound = angle::wrap(self.wound);
        }
        // Passing on the left turns the course to the right, which is negative: unwound means not far on that side.
        -self.wound * self.passing < UNWOUND
    }

    /// The free direction nearest to the course, as the angle to it; the side leant to last time is favoured, against dithering.
    fn near_course(&self, histogram: &Histogram) -> Option<f64> {
        let lean = |sign: f64| histogram.first_free(self.wound, sign, SMALL_DETOUR).map(|to| to - self.wound);
        let cost = |lean: &f64| lean.abs() + if lean * self.lean < 0.0 { DITHER } else { 0.0 };
        [lean(1.0), lean(-1.0)].into_iter().flatten().min_by(|a, b| cost(a).total_cmp(&cost(b)))
    }

    /// Decides on a side when no direction near the course is free.
    fn meet(&mut self, histogram: &Histogram) {
        let detour = |sign: f64| {
            histogram.first_free(self.wound, sign, degrees(180.0)).map_or(9.0, |to| (to - self.wound).abs())
        };
        let nearer = if detour(1.0) <= detour(-1.0) { 1.0 } else { -1.0 };
        self.passing = if self.preferred == 0.0 { nearer } else { self.preferred };
        (self.preferred, self.edge) = (0.0, 0.0);
    }

    /// The direction along the obstacle's edge: from the last one away from the obstacle until free, or back towards it while free.
    fn along(&mut self, histogram: &Histogram) -> Option<f64> {
        let last = self.wound + self.edge;
        let chosen = histogram.first_free(last, self.passing, degrees(280.0))?;
        let chosen = if chosen == last { self.hug(histogram, last) } else { chosen };
        self.edge = chosen - self.wound;
        Some(chosen)
    }

    /// A few degrees back towards the obstacle, but never so far that the robot looks over its shoulder for one that is gone.
    fn hug(&self, histogram: &Histogram, last: f64) -> f64 {
        let nearer = last - self.passing * HUG_STEP;
        let over_shoulder = angle::wrap(nearer) * self.passing < -SHOULDER;
        if histogram.is_free(nearer) && !over_shoulder { nearer } else { last }
    }
}

fn widest(ranges: &Ranges) -> f64 {
    let room = |side: f64| -> f64 {
        ring::echoes(ranges).filter(|(bearing, _)| bearing * side > 0.1).map(|(_, distance)| distance).sum()
    };
    if room(1.0) >= room(-1.0) { degrees(90.0) } else { degrees(-90.0) }
}

fn limited_turn(heading: f64, settings: &Settings) -> f64 {
    (heading * TURN_GAIN).clamp(-settings.max_turn, settings.max_turn)
}

/// As fast as the course wants, slower for turns and for what is ahead, and not at all within the stop distance.
fn speed(ranges: &Ranges, wanted: f64, heading: f64, settings: &Settings) -> f64 {
    let ahead = ring::free_ahead(ranges, settings.body_radius + LANE_MARGIN) - settings.body_radius;
    let room = ((ahead - settings.stop_distance) * BRAKING).max(0.0);
    let turning = ((heading.cos() - 0.3) / 0.7).clamp(0.0, 1.0);
    (wanted * turning).min(room)
}

#[cfg(test)]
mod tests {
    use super::*;
    use robot_objects::ring::ECHOES;

    fn settings() -> Settings {
        Settings::default()
    }

    fn steer(ranges: &Ranges, bearing: f64) -> Motion {
        Steering::default().steer(ranges, Motion::course(0.5, bearing), &settings())
    }

    #[test]
    fn a_free_ring_follows_the_course() {
        let motion = steer(&[3.0; ECHOES], 0.0);
        assert!((motion.forward - 0.5).abs() < 1e-9 && motion.turn.abs() < 1e-9);
        assert!(steer(&[3.0; ECHOES], 0.5).turn > 0.5);
    }

    #[test]
    fn nothing_moves_forward_into_a_near_obstacle() {
        for bearing in [-3.0, -0.7, 0.0, 0.2, 1.5] {
            let mut ranges = [3.0; ECHOES];
            ranges[0] = 0.1;
            assert!(steer(&ranges, bearing).forward.abs() < 1e-9);
        }
    }

    #[test]
    fn a_closed_ring_turns_on_the_spot() {
        let motion = steer(&[0.1; ECHOES], 0.0);
        assert!(motion.forward.abs() < 1e-9 && motion.turn.abs() > 0.5);
    }

    #[test]
    fn an_obstacle_ahead_is_passed_on_the_freer_side() {
        let mut ranges = [3.0; ECHOES];
        ranges[0] = 0.6;
        ranges[1] = 0.5;
        assert!(steer(&ranges, 0.0).turn < -0.3);
    }

    #[test]
    fn a_course_that_stands_only_turns() {
        let motion = Steering::default().steer(&[3.0; ECHOES], Motion::course(0.0, 1.0), &settings());
        assert!(motion.forward.abs() < 1e-9 && motion.turn > 0.5);
    }
}
