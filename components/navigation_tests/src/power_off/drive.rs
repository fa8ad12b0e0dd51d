//! One run: stand, listen, drive, lose the power, be found out, end.

use std::time::{Duration, Instant};

use robot_sim::demo::follow::Follower;
use robot_sim::serve::record::Record;
use serde_json::Value;

use super::stage::{Ear, Failure, Programs, Stage};
use super::{AFTER, Found, Run};

/// Far beyond what anything here needs.
const PATIENCE: Duration = Duration::from_secs(60);
const LOOK_AGAIN: Duration = Duration::from_millis(20);
/// As many values of either port before the robot drives.
const AT_REST: usize = 15;
/// As many runs, on a machine so busy that encoder and model part though nothing failed.
const ATTEMPTS: u32 = 12;

/// Runs the daemon with a window of that length until it has found that the power failed. `say` is told what is going on.
///
/// # Errors
/// In words: programs are missing, something does not come up, or each time the two part before the power fails.
pub fn measure(programs: &Programs, window_ms: u64, say: &mut dyn FnMut(&str)) -> Result<Run, Failure> {
    let mut why: Failure = "not tried".into();
    for _ in 0..ATTEMPTS {
        match attempt(programs, window_ms) {
            Ok(run) if run.found.at_ns >= run.power_off_ns => return Ok(run),
            Ok(_) => why = "the two parted before the power failed: this machine is too busy".into(),
            Err(failure) => why = failure,
        }
        say(&format!("window {window_ms} ms: {why}; once more"));
    }
    Err(why)
}

fn attempt(programs: &Programs, window_ms: u64) -> Result<Run, Failure> {
    let stage = Stage::set(programs, window_ms)?;
    let mut simulator = stage.simulator()?;
    simulator.wait_ready(PATIENCE)?;
    let mut daemon = stage.daemon()?;
    daemon.wait_ready(PATIENCE)?;
    let (encoder, model) = (stage.listen("board.encoders")?, stage.listen("model.expected")?);
    until("values of both ports", || {
        let heard = |ear: &Ear| Ok::<_, Failure>(ear.heard()?.len() >= AT_REST);
        Ok((heard(&encoder)? && heard(&model)?).then_some(()))
    })?;
    stage.release()?;
    let (mut record, mut journal) =
        (Follower::new(&stage.file("record.jsonl")), Follower::new(&stage.file("journal.jsonl")));
    let power_off_ns = until("the power to fail", || Ok(record.look().iter().find_map(power_off)))?;
    let found = until("the fault in the journal", || Ok(journal.look().iter().find_map(found)))?;
    let end_ns = power_off_ns + (AFTER * 1e9) as u64;
    until("the end", || {
        let is_over = |ear: &Ear| Ok::<_, Failure>(ear.heard()?.last().is_some_and(|last| last.at_ns > end_ns));
        Ok((is_over(&encoder)? && is_over(&model)?).then_some(()))
    })?;
    // Nobody listens any more when the daemon ends.
    let (encoder, model) = (encoder.end()?, model.end()?);
    daemon.end();
    Ok(Run { window_ms, power_off_ns, encoder, model, found })
}

fn until<T>(what: &str, mut look: impl FnMut() -> Result<Option<T>, Failure>) -> Result<T, Failure> {
    let began = Instant::now();
    while began.elapsed() < PATIENCE {
        if let Some(seen) = look()? {
            return Ok(seen);
        }
        std::thread::sleep(LOOK_AGAIN);
    }
    Err(format!("waited in vain for {what}").into())
}

fn power_off(record: &Record) -> Option<u64> {
    if let Record::Power { mono_ns, .. } = record { Some(*mono_ns) } else { None }
}

/// The first fault of the front left encoder.
fn found(entry: &Value) -> Option<Found> {
    let evidence = &entry["evidence"];
    let is_it = entry["kind"] == "fault" && entry["symptom"] == "model" && evidence["field"] == "ticks[0]";
    let number = |name: &str| evidence[name].as_f64();
    Some(Found {
        at_ns: entry["mono_ns"].as_u64().filter(|_| is_it)?,
        target: number("target")?,
        model: number("model")?,
        difference: number("difference")?,
        threshold: number("threshold")?,
    })
}
