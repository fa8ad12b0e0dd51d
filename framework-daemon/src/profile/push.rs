//! What a data port's profile says of values that are pushed: which ones a reader gets, how often a writer sends.

use std::time::Duration;

use serde::Serialize;

use super::diagnostic::Reporter;
use super::plan::Usage;
use super::quantity;
use super::xml::Element;

/// What a profile says of values that are pushed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct PushPlan {
    /// An input gets every n-th value.
    pub prescale: Option<u32>,
    /// Longest time that a push client waits for the next value, where its author does not say.
    pub timeout: Option<Duration>,
    /// Cycle of a timed server.
    pub period: Option<Duration>,
    /// Least time between two values that an output sends.
    pub min_cycle: Option<Duration>,
}

/// What belongs to an input, and what to an output.
pub(super) fn push(port: &Element, usage: Usage, report: &mut Reporter) -> PushPlan {
    let (reads, writes) = (usage == Usage::Input, usage == Usage::Output);
    let prescale = belonging(port, "prescale", reads, report);
    PushPlan {
        // Its range is the vocabulary's.
        prescale: prescale.and_then(|element| element.text.parse().ok()),
        timeout: duration(port, "timeout", reads, report),
        period: duration(port, "period", writes, report),
        min_cycle: duration(port, "min_cycle", writes, report),
    }
}

/// The element of that name, where it belongs to this direction.
fn belonging<'a>(port: &'a Element, name: &str, belongs: bool, report: &mut Reporter) -> Option<&'a Element> {
    let element = port.child(name).filter(|element| !element.text.is_empty())?;
    if belongs {
        return Some(element);
    }
    let direction = if port.text_of("usage") == "input" { "output" } else { "input" };
    report.error(element.name_span, format!("<{name}> belongs to an {direction}"));
    None
}

fn duration(port: &Element, name: &str, belongs: bool, report: &mut Reporter) -> Option<Duration> {
    let element = belonging(port, name, belongs, report)?;
    // Not a time: `conform` has said so.
    let time = quantity::duration(&element.text).ok()?;
    if time.is_zero() {
        report.error(element.text_span, format!("<{name}> must be more than 0"));
        return None;
    }
    Some(time)
}
