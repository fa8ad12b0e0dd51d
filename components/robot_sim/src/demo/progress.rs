//! What a person sees while the demo runs: one live line, and a lasting line for each fault.

use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use super::journal::Fault;
use super::table::duration;
use crate::serve::record::Moment;

/// Without a terminal a plain line comes this often.
const PLAIN_PERIOD: Duration = Duration::from_secs(2);
const BAR: usize = 28;

/// Where the run stands.
#[derive(Debug, Clone, Copy)]
pub struct Standing {
    /// Seconds since the daemon was ready.
    pub seconds: f64,
    /// The robot's newest moment, if there is one yet.
    pub moment: Option<Moment>,
    /// Metres to the target at the start.
    pub start_m: f64,
    /// Faults so far.
    pub faults: usize,
    /// Of these, recovered.
    pub recovered: usize,
}

/// Shows progress.
pub struct Progress {
    live: bool,
    last_plain: Option<Instant>,
    line_open: bool,
}

impl Progress {
    /// Live if standard output is a terminal and nobody asked for `headless`.
    #[must_use]
    pub fn new(headless: bool) -> Self {
        Self { live: !headless && std::io::stdout().is_terminal(), last_plain: None, line_open: false }
    }

    /// A lasting line.
    pub fn say(&mut self, line: &str) {
        self.clear();
        put(&format!("{line}\n"));
    }

    /// A lasting line for a fault, `at` seconds after ready.
    pub fn fault(&mut self, at: f64, fault: &Fault) {
        let recovered = match (fault.recovered(), fault.times.first_callback_ns) {
            (true, Some(time)) => format!("working again after {}", duration(Some(time))),
            _ => fault.outcome.clone(),
        };
        self.say(&format!("  {at:5.1} s  fault: {} {}; {}, {recovered}", fault.slot, fault.symptom, fault.how()));
    }

    /// Where the run stands; may be called often.
    pub fn show(&mut self, standing: Standing) {
        if self.live {
            put(&format!("\r\x1b[2K{}", render(standing, true)));
            self.line_open = true;
        } else if self.last_plain.is_none_or(|last| last.elapsed() >= PLAIN_PERIOD) {
            self.last_plain = Some(Instant::now());
            put(&format!("{}\n", render(standing, false)));
        }
    }

    /// Takes the live line away.
    pub fn clear(&mut self) {
        if std::mem::take(&mut self.line_open) {
            put("\r\x1b[2K");
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.clear();
    }
}

fn put(text: &str) {
    // Nobody may be listening any more; that is no reason to stop driving.
    let mut output = std::io::stdout();
    let _nobody = output.write_all(text.as_bytes()).and_then(|()| output.flush());
}

fn render(standing: Standing, with_bar: bool) -> String {
    let Standing { seconds, moment, start_m, faults, recovered } = standing;
    let (target, collisions) = moment.map_or((start_m, 0), |moment| (moment.target_m, moment.collisions));
    let done = if start_m > 0.0 { (1.0 - target / start_m).clamp(0.0, 1.0) } else { 0.0 };
    let filled = (done * BAR as f64).round() as usize;
    let bar = if with_bar { format!("{}{}  ", "━".repeat(filled), "·".repeat(BAR - filled)) } else { String::new() };
    format!(
        "  {seconds:5.1} s  {bar}target {target:.2} m  faults {faults}, recovered {recovered}  collisions {collisions}"
    )
}

#[cfg(test)]
mod tests {
    use super::{Standing, render};

    #[test]
    fn the_bar_fills_as_the_target_comes_nearer() {
        let standing = Standing { seconds: 3.25, moment: None, start_m: 8.0, faults: 2, recovered: 1 };
        assert_eq!(render(standing, false), "    3.2 s  target 8.00 m  faults 2, recovered 1  collisions 0");
        assert!(render(standing, true).contains(&"·".repeat(28)));
    }
}
