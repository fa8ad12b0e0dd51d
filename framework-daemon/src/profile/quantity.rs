//! Text to times, numbers and sizes.
//!
//! Times are OPRoS's: a bare number is milliseconds. `us`, `ms` and `s` may follow it. Own code because no library reads
//! a bare number as milliseconds and refuses what is ambiguous (`1m`: minute or metre?).

use std::time::Duration;

use crate::model::limits;

/// A time: `20`, `20ms`, `1.5s`, `250us`.
///
/// # Errors
/// What is wrong with it, as the end of a sentence.
pub fn duration(text: &str) -> Result<Duration, String> {
    let (number, unit) = split_unit(text);
    let seconds_per_unit = match unit {
        "" | "ms" => 1e-3,
        "us" | "µs" => 1e-6,
        "s" => 1.0,
        _ => return Err(format!("\"{text}\" is not a time: write 20, 20ms, 250us or 1.5s")),
    };
    let value = decimal(number).ok_or_else(|| format!("\"{text}\" is not a time: write 20, 20ms, 250us or 1.5s"))?;
    let seconds = value * seconds_per_unit;
    if seconds < 0.0 {
        return Err(format!("\"{text}\" is negative"));
    }
    if seconds > limits::DURATION_MAX.as_secs_f64() {
        return Err(format!("\"{text}\" is longer than the {} s that a time may have", limits::DURATION_MAX.as_secs()));
    }
    // Rounded to whole nanoseconds: 1.1 ms is 1,100,000 ns and not one less.
    Ok(Duration::from_secs_f64((seconds * 1e9).round() / 1e9))
}

/// A time as a profile would write it, in the largest unit that keeps it whole.
#[must_use]
pub fn format_duration(time: Duration) -> String {
    let micros = time.as_micros();
    if micros.is_multiple_of(1_000_000) {
        format!("{}s", micros / 1_000_000)
    } else if micros.is_multiple_of(1_000) {
        format!("{}ms", micros / 1_000)
    } else {
        format!("{micros}us")
    }
}

/// A finite number.
///
/// # Errors
/// What is wrong with it.
pub fn number(text: &str) -> Result<f64, String> {
    let comma = if text.contains(',') { ": write a point in place of the comma" } else { "" };
    decimal(text).ok_or_else(|| format!("\"{text}\" is not a number{comma}"))
}

/// A whole number in a range.
///
/// # Errors
/// What is wrong with it.
pub fn integer(text: &str, min: i64, max: i64) -> Result<i64, String> {
    let value: i64 = text.trim().parse().map_err(|_| format!("\"{text}\" is not a whole number"))?;
    if value < min || value > max {
        return Err(format!("{value} is out of range: {min} to {max} is possible"));
    }
    Ok(value)
}

/// A size in bytes: `65536`, `64KiB`, `1MiB`.
///
/// # Errors
/// What is wrong with it.
pub fn bytes(text: &str) -> Result<usize, String> {
    let wrong = || format!("\"{text}\" is not a size: write 65536, 64KiB or 1MiB");
    let (number, unit) = split_unit(text);
    let factor: usize = match unit {
        "" | "B" => 1,
        "KiB" => 1 << 10,
        "MiB" => 1 << 20,
        "GiB" => 1 << 30,
        _ => return Err(wrong()),
    };
    let count: usize = number.parse().map_err(|_| wrong())?;
    count.checked_mul(factor).ok_or_else(wrong)
}

/// Processor numbers: `2`, `0,1`, `0-3`, `0-1,4`.
///
/// # Errors
/// What is wrong with it.
pub fn cpus(text: &str) -> Result<Vec<usize>, String> {
    let wrong = || format!("\"{text}\" is not a list of processors: write 2, 0,1 or 0-3");
    let mut all = Vec::new();
    for part in text.split([',', ' ']).filter(|part| !part.is_empty()) {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let first: usize = first.trim().parse().map_err(|_| wrong())?;
        let last: usize = last.trim().parse().map_err(|_| wrong())?;
        if last > limits::CPU_MAX || first > last {
            return Err(format!("\"{part}\" is no processor: 0 to {} are possible", limits::CPU_MAX));
        }
        all.extend(first..=last);
    }
    all.sort_unstable();
    all.dedup();
    if all.is_empty() { Err(wrong()) } else { Ok(all) }
}

fn split_unit(text: &str) -> (&str, &str) {
    let text = text.trim();
    let end = text.find(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | '+' | '-'))).unwrap_or(text.len());
    let (number, unit) = text.split_at(end);
    (number, unit.trim())
}

/// Only what a person would call a number: no `inf`, no `nan`, nothing beyond the range of `f64`.
fn decimal(text: &str) -> Option<f64> {
    let text = text.trim();
    let plausible = |c: char| c.is_ascii_digit() || matches!(c, '.' | '+' | '-' | 'e' | 'E');
    if !text.chars().all(plausible) {
        return None;
    }
    text.parse().ok().filter(|value: &f64| value.is_finite())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_bare_number_is_milliseconds() {
        assert_eq!(duration("20"), Ok(Duration::from_millis(20)));
        assert_eq!(duration("20ms"), Ok(Duration::from_millis(20)));
        assert_eq!(duration(" 1.5 s "), Ok(Duration::from_millis(1500)));
        assert_eq!(duration("250us"), Ok(Duration::from_micros(250)));
        assert_eq!(duration("1.1"), Ok(Duration::from_micros(1100)));
        for wrong in ["", "ms", "fast", "1m", "-1", "1e99", "inf", "nan", "1 2", "999999999s", "--", "."] {
            assert!(duration(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn sizes_and_processors() {
        assert_eq!(bytes("1MiB"), Ok(1 << 20));
        assert_eq!(bytes("64 KiB"), Ok(65_536));
        assert!(
            bytes("1MB").is_err()
                && bytes("99999999999999999999").is_err()
                && bytes("18446744073709551615GiB").is_err()
        );
        assert_eq!(cpus("0-2,5"), Ok(vec![0, 1, 2, 5]));
        assert!(cpus("3-1").is_err() && cpus("").is_err() && cpus("0-99999999999").is_err() && cpus("a").is_err());
    }

    proptest! {
        #[test]
        fn times_survive_being_written_and_read(micros in 0u64..600_000_000_000) {
            let time = Duration::from_micros(micros);
            prop_assert_eq!(duration(&format_duration(time)), Ok(time));
        }

        #[test]
        fn no_text_makes_a_parser_panic(text in ".{0,40}") {
            let _ = (duration(&text), number(&text), bytes(&text), cpus(&text), integer(&text, 0, 10));
        }
    }
}
