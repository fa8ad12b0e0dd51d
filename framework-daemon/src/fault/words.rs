//! What models and voters found, in words.

use crate::model::fault::{Evidence, Label, Stage};

/// The finding of a helper that the framework inserted; `None`: it is somebody else's.
#[must_use]
pub fn of_helper(evidence: &Evidence) -> Option<String> {
    Some(match evidence {
        Evidence::Model { port, field, target, model, difference, threshold, window_ns } => format!(
            "{}: {} in the last {} ms, its model {}, which differ by {}, at most {threshold}",
            place(port, field),
            short(*target),
            *window_ns as f64 / 1e6,
            short(*model),
            short(*difference),
        ),
        Evidence::Vote { port, field, value, agreed, agreeing, tolerance } => format!(
            "{}: {}, where {agreeing} agree on {} within {tolerance}",
            place(port, field),
            short(*value),
            short(*agreed),
        ),
        Evidence::Quorum { port, field, agreeing, require, members, forgiven } => {
            let forgiven = if *forgiven { ", forgiven with the emergency stop" } else { "" };
            format!("{}: {agreeing} of {members} agree, {require} must{forgiven}", place(port, field))
        }
        _ => return None,
    })
}

/// What became of a device: `left sonar is lost: Input/output error (os error 5)`.
#[must_use]
pub fn of_device(evidence: &Evidence, stage: Stage) -> String {
    let Evidence::Device { device, message, lost_ns, .. } = evidence else { return evidence.text().to_owned() };
    match stage {
        Stage::Confirmed => format!("{} is lost: {}", device.as_str(), message.as_str()),
        Stage::Healed | Stage::Cleared => {
            format!("{} works again after {:.1} ms", device.as_str(), *lost_ns as f64 / 1e6)
        }
    }
}

fn place(port: &Label, field: &Label) -> String {
    let (port, field) = (port.as_str(), field.as_str());
    if field.is_empty() { port.to_owned() } else { format!("{port}, field {field}") }
}

/// Six digits of a number: as many as one reads.
fn short(number: f64) -> String {
    if number == 0.0 || !number.is_finite() {
        return number.to_string();
    }
    let digits = 5 - number.abs().log10().floor() as i32;
    let scale = 10_f64.powi(digits.clamp(-300, 300));
    let rounded = (number * scale).round() / scale;
    if rounded.is_finite() { rounded.to_string() } else { number.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_finding_names_the_place_both_values_and_the_bound() {
        let (port, field) = (Label::new("board.encoders"), Label::new("ticks[0]"));
        let model = Evidence::Model {
            port,
            field,
            target: 12.345_678_9,
            model: 400.0,
            difference: 387.654_321_1,
            threshold: 50.0,
            window_ns: 200_000_000,
        };
        assert_eq!(
            of_helper(&model).unwrap(),
            "board.encoders, field ticks[0]: 12.3457 in the last 200 ms, its model 400, which differ by 387.654, at most 50"
        );
        let field = Label::new("");
        let vote = Evidence::Vote { port, field, value: 9.0, agreed: 1.5, agreeing: 2, tolerance: 0.5 };
        assert_eq!(of_helper(&vote).unwrap(), "board.encoders: 9, where 2 agree on 1.5 within 0.5");
        let few = Evidence::Quorum { port, field, agreeing: 1, require: 2, members: 3, forgiven: false };
        assert_eq!(of_helper(&few).unwrap(), "board.encoders: 1 of 3 agree, 2 must");
        assert_eq!((short(-0.000_123_456_7), short(f64::NAN)), ("-0.000123457".into(), "NaN".into()));
        assert!(short(1e300).parse::<f64>().is_ok_and(|read| (read - 1e300).abs() < 1e290));
    }
}
