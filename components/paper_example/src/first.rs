//! Figure 7: two questions under way at once, the second answer awaited first.

use component_sdk::prelude::*;

use crate::{ScanRequest, StampRequest};

/// Asks for a time stamp and for a laser scan, then waits for the scan, then fetches the time stamp.
#[derive(Component)]
#[component(name = "First", version = "1.0", periodic = "500ms")]
pub struct First {
    /// To whoever knows the time.
    #[port]
    time: QueryClient<StampRequest, Time>,
    /// To whoever has a laser.
    #[port]
    laser: QueryClient<ScanRequest, LaserScan>,
    /// Rays of a scan.
    #[property(default = 181, range = 2..=1000)]
    rays: u32,
    round: u32,
}

impl Callbacks for First {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        self.round += 1;
        let round = self.round;
        // Neither waits: both questions are under way.
        let stamp = self.time.request(StampRequest { round })?;
        let scan = self.laser.request(ScanRequest { rays: self.rays })?;
        info!(cx, "round {round}: asked for a time stamp, then for a scan");
        // The answer to the second question; the first one's stays where it is, whenever it comes. What is suspended
        // here is this callback: its thread runs other components meanwhile.
        let scan = self.laser.receive_wait(scan)?;
        let nearest = scan.ranges.iter().copied().fold(f32::INFINITY, f32::min);
        let (measured, rays) = (scan.header.stamp, scan.ranges.len());
        info!(cx, "round {round}: the scan of {}: {rays} rays, nearest {nearest:.2} m", text(measured));
        let stamp = *self.time.receive_wait(stamp)?;
        info!(cx, "round {round}: the time stamp: {}", text(stamp));
        Ok(())
    }
}

fn text(time: Time) -> String {
    format!("{}.{:09} s", time.sec, time.nanosec)
}
