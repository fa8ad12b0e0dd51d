//! Who drove when, where a skill changes it: the daemon's log says `NAME drives from SECONDS s`, on the monotonic clock.

use std::path::Path;

/// Begin (nanoseconds, monotonic) and name of each who drove, in the order of time; empty where no skill says so.
#[must_use]
pub fn read(log: &Path) -> Vec<(u64, String)> {
    // What is no text was not written by a skill.
    let bytes = std::fs::read(log).unwrap_or_default();
    String::from_utf8_lossy(&bytes).lines().filter_map(said).collect()
}

fn said(line: &str) -> Option<(u64, String)> {
    let (before, after) = line.split_once(" drives from ")?;
    let (seconds, nanos) = after.strip_suffix(" s")?.split_once('.')?;
    let begin = seconds.parse::<u64>().ok()? * 1_000_000_000 + nanos.parse::<u64>().ok()?;
    Some((begin, before.rsplit(' ').next()?.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::said;

    #[test]
    fn what_a_skill_says_is_told_from_other_lines() {
        let line = "2026-01-01T00:00:00.0Z  INFO skill: avoider_b drives from 12.000000034 s";
        assert_eq!(said(line), Some((12_000_000_034, "avoider_b".to_owned())));
        for other in ["the robot drives", "x drives from home", "INFO skill: a drives from 1.2"] {
            assert_eq!(said(other), None, "{other}");
        }
    }
}
