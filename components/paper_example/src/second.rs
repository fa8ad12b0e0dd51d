//! Figure 8: a server whose handlers only queue what they are asked; an activity of its own answers, one after the other.

use std::collections::VecDeque;

use component_sdk::prelude::*;

use crate::{ScanRequest, StampRequest};

/// Furthest that the laser sees, in metres.
const FAR: f32 = 8.0;
/// Rays of a scan at most.
const RAYS: u32 = 1000;

/// A query that waits for its turn.
enum Asked {
    Stamp(Pending<StampRequest, Time>),
    Scan(Pending<ScanRequest, LaserScan>),
}

/// Tells the time and scans its surroundings: an empty room. Queries are answered in the order in which they came.
#[derive(Component)]
#[component(name = "Second", version = "1.0", periodic = "20ms")]
pub struct Second {
    /// The time.
    #[port(handler = on_time)]
    time: QueryServer<StampRequest, Time>,
    /// Distances anticlockwise from the right.
    #[port(handler = on_laser)]
    laser: QueryServer<ScanRequest, LaserScan>,
    /// How far the walls are on each side.
    #[property(default = 2.0, unit = "m", range = 0.1..=7.0)]
    room: f64,
    queue: VecDeque<Asked>,
}

impl Callbacks for Second {
    /// Answers one query.
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        match self.queue.pop_front() {
            Some(Asked::Stamp(query)) => tell_time(cx, query),
            Some(Asked::Scan(query)) => scan(cx, query, self.room as f32),
            None => Ok(()),
        }
    }
}

impl Second {
    fn on_time(&mut self, _: &mut Context<'_>, query: Query<'_, StampRequest, Time>) -> Outcome {
        self.queue.push_back(Asked::Stamp(query.keep()));
        Ok(())
    }

    fn on_laser(&mut self, _: &mut Context<'_>, query: Query<'_, ScanRequest, LaserScan>) -> Outcome {
        self.queue.push_back(Asked::Scan(query.keep()));
        Ok(())
    }
}

fn tell_time(cx: &mut Context<'_>, query: Pending<StampRequest, Time>) -> Outcome {
    let round = query.request().map(|request| request.round)?;
    info!(cx, "tells the time for round {round}");
    gone(cx, query.answer(cx.clock().into()))
}

fn scan(cx: &mut Context<'_>, query: Pending<ScanRequest, LaserScan>, room: f32) -> Outcome {
    let rays = query.request().map(|request| request.rays.clamp(2, RAYS))?;
    info!(cx, "scans with {rays} rays");
    // Filled in place: it is the client's own block, with the buffers of the scan before.
    let mut scan = query.loan(cx)?;
    scan.header.stamp = cx.clock().into();
    scan.angle_min = -std::f32::consts::FRAC_PI_2;
    scan.angle_max = std::f32::consts::FRAC_PI_2;
    scan.angle_increment = std::f32::consts::PI / (rays - 1) as f32;
    scan.range_max = FAR;
    let (first, step) = (scan.angle_min, scan.angle_increment);
    scan.ranges.clear();
    scan.ranges.extend((0..rays).map(|ray| wall(room, first + step * ray as f32)));
    let sent = scan.send();
    gone(cx, sent)
}

/// How far the wall of a square room is in that direction from its middle.
fn wall(room: f32, angle: f32) -> f32 {
    (room / angle.cos().abs().max(angle.sin().abs())).min(FAR)
}

/// A client that has left is no fault of ours.
fn gone(cx: &mut Context<'_>, answered: Result<(), Status>) -> Outcome {
    if let Err(status) = answered {
        warn!(cx, "nobody wants the answer any more: {status}");
    }
    Ok(())
}
