//! How fast a value changes, from one to the next.

/// Change per second from `before` to `now`, `elapsed_ns` later; not negative. `None`: one of them is no number, and has none. A step
/// to or from the infinite is infinitely fast; to stay there is no change. Two values at one moment lie a nanosecond apart.
#[must_use]
pub fn per_second(before: f64, now: f64, elapsed_ns: u64) -> Option<f64> {
    if before.is_nan() || now.is_nan() {
        return None;
    }
    if before == now {
        return Some(0.0);
    }
    Some((now - before).abs() / (elapsed_ns.max(1) as f64 / 1e9))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn infinite_values_have_a_rate_and_no_numbers_have_none() {
        let [up, down] = [f64::INFINITY, f64::NEG_INFINITY];
        assert_eq!(per_second(1.0, 3.0, 500_000_000), Some(4.0));
        assert_eq!([per_second(up, up, 1), per_second(down, down, 1)], [Some(0.0); 2]);
        assert_eq!([per_second(1.0, up, 1), per_second(down, 0.0, 1), per_second(down, up, 1)], [Some(up); 3]);
        assert_eq!([per_second(f64::NAN, 1.0, 1), per_second(1.0, f64::NAN, 1)], [None; 2]);
    }

    proptest! {
        #[test]
        fn it_is_the_same_both_ways_and_falls_with_time(a in -1e9..1e9f64, b in -1e9..1e9f64, elapsed in 1..u64::MAX / 2) {
            let rate = per_second(a, b, elapsed).unwrap();
            prop_assert!(rate >= 0.0);
            prop_assert_eq!(per_second(b, a, elapsed), Some(rate));
            prop_assert!(per_second(a, b, elapsed * 2).unwrap() <= rate);
        }
    }
}
