//! Path planner: odometry and sightings in, course to the target out.

use std::time::Duration;

use component_sdk::prelude::*;
use robot_objects::{Detection, Motion};

pub mod estimate;
pub mod planner;

use estimate::Pose as Place;
use planner::{Planner, Progress, Settings};

/// Odometry older than this is not acted upon.
const ODOMETRY_LASTS: Duration = Duration::from_millis(500);

/// Plans the course to the target, or searches for it.
#[derive(Component)]
#[component(name = "PathPlanner", version = "1.0", periodic = "50ms")]
pub struct PathPlanner {
    /// Where the robot is.
    #[port]
    odometry: DataIn<Odometry>,
    /// What the camera saw.
    #[port]
    target: DataIn<Detection>,
    /// Wanted speed and bearing (as the turn rate that would be on it within a second).
    #[port]
    course: DataOut<Twist>,
    /// Whether `goal_x` and `goal_y` say where the target is about.
    #[property(default = false)]
    goal_known: bool,
    /// Target ahead of the start.
    #[property(default = 0.0, unit = "m", range = -1000.0..=1000.0)]
    goal_x: f64,
    /// Target to the left of the start.
    #[property(default = 0.0, unit = "m", range = -1000.0..=1000.0)]
    goal_y: f64,
    /// Speed far from the target.
    #[property(default = 0.5, unit = "m/s", range = 0.05..=1.5)]
    cruise: f64,
    /// Distance from the robot's centre to the target's at which it is reached.
    #[property(default = 0.6, unit = "m", range = 0.1..=5.0)]
    goal_distance: f64,
    /// Turn rate of a search.
    #[property(default = 0.8, unit = "rad/s", range = 0.1..=3.0)]
    search_turn: f64,
    #[critical]
    planner: Planner,
    told: Progress,
}

impl Callbacks for PathPlanner {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        let (settings, now) = (self.settings(), cx.now().as_nanos() as f64 * 1e-9);
        let lost = self.odometry.age(cx).is_none_or(|age| age > ODOMETRY_LASTS);
        let Some(place) = self.odometry.newest().filter(|_| !lost).map(place_of) else {
            self.course.write(Motion::STOP.into());
            return Ok(());
        };
        self.planner.follow(&place, now);
        if let Some(seen) = self.target.fresh().filter(|seen| seen.found) {
            self.planner.sight(&place, seen.bearing, seen.distance, now);
        }
        self.course.write(self.planner.course(&place, now, &settings).into());
        self.tell(cx);
        Ok(())
    }
}

impl PathPlanner {
    fn settings(&self) -> Settings {
        Settings {
            goal: self.goal_known.then_some((self.goal_x, self.goal_y)),
            cruise: self.cruise,
            goal_distance: self.goal_distance,
            search_turn: self.search_turn,
        }
    }

    /// Says when the plan changes.
    fn tell(&mut self, cx: &Context<'_>) {
        let progress = self.planner.progress();
        if progress != self.told {
            self.told = progress;
            info!(cx, "{}", progress.describe());
        }
    }
}

fn place_of(odometry: &Odometry) -> Place {
    let pose = &odometry.pose.pose;
    Place { x: pose.position.x, y: pose.position.y, heading: pose.orientation.yaw() }
}

export_components!(PathPlanner);
