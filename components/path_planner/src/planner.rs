//! The course: towards the target where it is known, else a search for it.
//!
//! Decision: the planner gives a course (speed and bearing) and leaves obstacles to the avoider: it needs no map, and whichever
//! avoider is at work, the plan is the same. Not chosen: a grid and A* here; with twelve echoes the map is poor, and the planner
//! would have to agree with two avoiders about what is free.

use robot_objects::angle::{self, degrees};
use robot_objects::motion::Motion;

use crate::estimate::{Estimate, Pose};

/// How to approach, and what is known beforehand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Where the target is said to be, in the odometry's frame (m); none: search.
    pub goal: Option<(f64, f64)>,
    /// Speed far from the target, in m/s.
    pub cruise: f64,
    /// Distance from the robot's centre to the target's at which it is reached, in m.
    pub goal_distance: f64,
    /// Turn rate of the search, in rad/s.
    pub search_turn: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { goal: None, cruise: 0.5, goal_distance: 0.6, search_turn: 0.8 }
    }
}

/// Slowest approach in m/s: slower than that the motors only hum.
const CREEP: f64 = 0.12;
/// How much of the remaining way is taken each second, in 1/s.
const APPROACH: f64 = 0.6;
/// The robot has left the target again when it is this much farther than `goal_distance`, in m.
const LEFT: f64 = 0.25;
/// A target that is not seen from where it ought to be is given up after this many seconds.
const DISAPPOINTED: f64 = 4.0;
/// How far a search goes on after a turn without success, in m.
const SEARCH_LEG: f64 = 1.5;

/// What the robot is doing about its target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Progress {
    /// Looking for it.
    #[default]
    Searching,
    /// Driving to where it is seen or said to be.
    Approaching,
    /// There.
    Arrived,
}

impl Progress {
    /// In words, for the log.
    #[must_use]
    pub const fn describe(self) -> &'static str {
        match self {
            Self::Searching => "searching for the target",
            Self::Approaching => "on the way to the target",
            Self::Arrived => "target reached",
        }
    }
}

/// The planner: plain data, so that a checkpoint can hold it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Planner {
    target: Option<Estimate>,
    progress: Progress,
    told: bool,
    near_since: Option<f64>,
    search: Search,
    /// Last pose, and when it was (s).
    last: Option<(Pose, f64)>,
}

/// Memory of a search: turn once around, then go a leg, then again.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Search {
    last: Option<Pose>,
    turned: f64,
    gone: f64,
}

impl Planner {
    /// Takes a sighting of the target at `bearing` (rad, left positive) and `distance` (m), seen from `pose` at `now` (s).
    pub fn sight(&mut self, pose: &Pose, bearing: f64, distance: f64, now: f64) {
        if !bearing.is_finite() || !distance.is_finite() {
            return;
        }
        match &mut self.target {
            // What one sees beats what one was told, however far apart they are.
            Some(estimate) if estimate.last_seen.is_some() => estimate.refine(pose, bearing, distance, now),
            target => *target = Some(Estimate::first(pose, bearing, distance, now)),
        }
    }

    /// Keeps what is known where it is when the odometry starts anew: a step that no robot can make means that its frame has
    /// moved. To be called with each pose, before [`Planner::sight`] and [`Planner::course`].
    pub fn follow(&mut self, pose: &Pose, now: f64) {
        if let Some((before, then)) = self.last.replace((*pose, now))
            && before.is_beyond_reach_of(pose, now - then)
        {
            self.target = self.target.map(|target| target.carried(&before, pose));
            self.search.last = None;
        }
    }

    /// The course from `pose` at `now` (s).
    pub fn course(&mut self, pose: &Pose, now: f64, settings: &Settings) -> Motion {
        if let (false, Some((x, y))) = (self.told, settings.goal) {
            self.told = true;
            self.target = self.target.or(Some(Estimate::told(x, y)));
        }
        self.give_up_phantom(pose, now, settings);
        match self.target {
            Some(target) => self.approach(&target, pose, settings),
            None => self.look_around(pose, settings),
        }
    }

    /// What the robot is doing.
    #[must_use]
    pub fn progress(&self) -> Progress {
        self.progress
    }

    /// The target's place in the odometry's frame (m), as far as it is known.
    #[must_use]
    pub fn target(&self) -> Option<(f64, f64)> {
        self.target.map(|target| (target.x, target.y))
    }

    fn approach(&mut self, target: &Estimate, pose: &Pose, settings: &Settings) -> Motion {
        let (distance, bearing) = (target.distance(pose), target.bearing(pose));
        let reach = settings.goal_distance + if self.progress == Progress::Arrived { LEFT } else { 0.0 };
        if distance <= reach && target.last_seen.is_some() {
            self.progress = Progress::Arrived;
            return Motion::STOP;
        }
        self.progress = Progress::Approaching;
        let speed = ((distance - settings.goal_distance) * APPROACH + CREEP).clamp(CREEP, settings.cruise);
        Motion::course(speed, bearing)
    }

    /// Near the estimate and still nothing in sight: the estimate is wrong.
    fn give_up_phantom(&mut self, pose: &Pose, now: f64, settings: &Settings) {
        let Some(target) = self.target else { return };
        if self.progress == Progress::Arrived || target.distance(pose) > settings.goal_distance + LEFT {
            self.near_since = None;
            return;
        }
        let since = *self.near_since.get_or_insert(now);
        if now - since.max(target.last_seen.unwrap_or(since)) > DISAPPOINTED {
            (self.target, self.near_since, self.search) = (None, None, Search::default());
        }
    }

    fn look_around(&mut self, pose: &Pose, settings: &Settings) -> Motion {
        self.progress = Progress::Searching;
        self.search.advance(pose);
        if self.search.turned < degrees(360.0) {
            return Motion { forward: 0.0, turn: settings.search_turn };
        }
        if self.search.gone > SEARCH_LEG {
            self.search = Search::default();
        }
        Motion::course(settings.cruise * 0.7, 0.0)
    }
}

impl Search {
    fn advance(&mut self, pose: &Pose) {
        if let Some(last) = self.last {
            let turned = angle::wrap(pose.heading - last.heading).abs();
            if self.turned < degrees(360.0) {
                self.turned += turned;
            } else {
                self.gone += (pose.x - last.x).hypot(pose.y - last.y);
            }
        }
        self.last = Some(*pose);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> Settings {
        Settings::default()
    }

    fn at(x: f64, y: f64, heading: f64) -> Pose {
        Pose { x, y, heading }
    }

    #[test]
    fn without_a_hint_it_turns_once_and_then_goes_on() {
        let mut planner = Planner::default();
        let first = planner.course(&at(0.0, 0.0, 0.0), 0.0, &settings());
        assert!(first.forward.abs() < 1e-9 && first.turn > 0.5);
        let mut last = first;
        for step in 0..80 {
            last = planner.course(&at(0.0, 0.0, f64::from(step) * 0.1), f64::from(step), &settings());
        }
        assert!(last.forward > 0.2 && planner.progress() == Progress::Searching);
    }

    #[test]
    fn it_drives_to_what_it_sees_slows_down_and_stops() {
        let mut planner = Planner::default();
        planner.sight(&at(0.0, 0.0, 0.0), 0.5, 4.0, 0.0);
        let far = planner.course(&at(0.0, 0.0, 0.0), 0.0, &settings());
        assert!((far.forward - 0.5).abs() < 1e-9 && (far.bearing() - 0.5).abs() < 1e-9);
        let (x, y) = planner.target().unwrap_or_default();
        let near = planner.course(&at(x - 0.8, y, 0.0), 1.0, &settings());
        assert!(near.forward < 0.3 && near.forward > 0.1);
        assert_eq!(planner.course(&at(x - 0.55, y, 0.0), 2.0, &settings()), Motion::STOP);
        assert_eq!(planner.progress(), Progress::Arrived);
    }

    #[test]
    fn an_odometry_that_starts_anew_does_not_move_the_target() {
        let mut planner = Planner::default();
        planner.follow(&at(4.0, 1.0, 0.7), 0.0);
        planner.sight(&at(4.0, 1.0, 0.7), 0.2, 3.0, 0.0);
        planner.follow(&at(4.02, 1.0, 0.75), 0.05);
        let before = planner.course(&at(4.02, 1.0, 0.75), 0.05, &settings());
        planner.follow(&at(0.0, 0.0, 0.0), 0.1);
        let after = planner.course(&at(0.0, 0.0, 0.0), 0.1, &settings());
        assert!((before.bearing() - after.bearing()).abs() < 1e-9 && before.forward == after.forward);
    }

    #[test]
    fn a_hint_without_a_target_ends_in_a_search() {
        let mut planner = Planner::default();
        let settings = Settings { goal: Some((3.0, 0.0)), ..settings() };
        assert!(planner.course(&at(0.0, 0.0, 0.0), 0.0, &settings).forward > 0.4);
        for step in 0..200 {
            planner.course(&at(2.9, 0.0, 0.0), f64::from(step) * 0.05, &settings);
        }
        assert_eq!(planner.progress(), Progress::Searching);
    }
}
