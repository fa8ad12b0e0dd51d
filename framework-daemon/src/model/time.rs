//! Durations as the clock counts: nanoseconds in 64 bits, 584 years.

use std::time::Duration;

/// A duration in nanoseconds; the longest that 64 bits hold where it is longer.
#[must_use]
pub const fn nanoseconds(time: Duration) -> u64 {
    let nanos = time.as_nanos();
    if nanos > u64::MAX as u128 { u64::MAX } else { nanos as u64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_too_long_is_as_long_as_can_be() {
        assert_eq!(nanoseconds(Duration::from_micros(3)), 3000);
        assert_eq!(nanoseconds(Duration::MAX), u64::MAX);
    }
}
