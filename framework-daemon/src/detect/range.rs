//! A value outside its range: the paper's `min` and `max`, constants or linear functions of another value.

/// Inclusive bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Least value.
    pub min: f64,
    /// Greatest value.
    pub max: f64,
}

impl Bounds {
    /// True where `value` lies within. What is not a number lies nowhere, and within a bound that is none lies nothing.
    #[must_use]
    #[inline]
    pub fn hold(&self, value: f64) -> bool {
        // Both false where either is no number.
        value >= self.min && value <= self.max
    }

    /// The bound that `value` crosses; `None`: it lies within. What is not a number lies nowhere, and within a bound that is none
    /// lies nothing; what is infinite lies where its side is open.
    #[must_use]
    #[inline]
    pub fn crossed(&self, value: f64) -> Option<f64> {
        if self.hold(value) {
            return None;
        }
        Some(if value.is_nan() {
            f64::NAN
        } else if value >= self.min {
            self.max
        } else {
            self.min
        })
    }
}

/// `slope * x + offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linear {
    /// Factor.
    pub slope: f64,
    /// What is added.
    pub offset: f64,
}

impl Linear {
    /// Its value at `x`.
    #[must_use]
    pub fn at(&self, x: f64) -> f64 {
        // Without a slope it does not depend on what is infinite.
        if self.slope == 0.0 && !x.is_nan() { self.offset } else { self.slope * x + self.offset }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn bounds_are_inclusive_and_nan_is_never_within() {
        let bounds = Bounds { min: 3.0, max: 300.0 };
        assert_eq!(bounds.crossed(3.0), None);
        assert_eq!(bounds.crossed(0.0), Some(3.0));
        assert_eq!(bounds.crossed(300.1), Some(300.0));
        assert!(bounds.crossed(f64::NAN).is_some());
        assert_eq!(bounds.crossed(f64::INFINITY), Some(300.0));
        let open = Bounds { min: 3.0, max: f64::INFINITY };
        assert_eq!((open.crossed(f64::INFINITY), open.crossed(f64::NEG_INFINITY)), (None, Some(3.0)));
        let unknown = Bounds { min: 3.0, max: f64::NAN };
        assert!(unknown.crossed(5.0).is_some(), "a limit that depends on what is no number is kept by nothing");
    }

    #[test]
    fn a_line_is_a_line() {
        let line = Linear { slope: 0.5, offset: 10.0 };
        assert_eq!((line.at(4.0), line.at(-20.0)), (12.0, 0.0));
        assert_eq!(Linear { slope: 0.0, offset: 1.0 }.at(f64::INFINITY), 1.0);
        assert!(line.at(f64::NAN).is_nan());
    }

    proptest! {
        #[test]
        fn what_crosses_a_bound_lies_beyond_it(value: f64, min in -1e6..1e6f64, width in 0.0..1e6f64) {
            let bounds = Bounds { min, max: min + width };
            match bounds.crossed(value) {
                None => prop_assert!(bounds.min <= value && value <= bounds.max),
                Some(limit) if limit.is_nan() => prop_assert!(value.is_nan()),
                Some(limit) => prop_assert!((limit == bounds.min && value < limit) || (limit == bounds.max && value > limit)),
            }
        }
    }
}
