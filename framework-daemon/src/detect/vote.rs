//! Redundant values, one of which is handed on: voting over sensors that measure the same.
//!
//! A vote is a function of the values that are there. None of the methods computes a value of its own: each names a member,
//! whose whole object is handed on. With three members, two of which agree, the third never wins, whatever it says, unless it lies
//! between the two.

use crate::model::limits::VOTERS;

/// How the winner is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// The member in the middle; of two in the middle the one with the lower value.
    #[default]
    Median,
    /// The member with whom most agree; of several the one nearest to the middle.
    Majority,
    /// The member nearest to the mean of those who are within the tolerance of the median.
    Weighted,
}

/// Some of the members, each a bit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Members(u64);

impl Members {
    /// That one, too.
    pub const fn add(&mut self, member: usize) {
        self.0 |= 1 << member;
    }

    /// That one no more.
    pub const fn remove(&mut self, member: usize) {
        self.0 &= !(1 << member);
    }

    /// True of one of them.
    #[must_use]
    pub const fn has(self, member: usize) -> bool {
        self.0 & (1 << member) != 0
    }

    /// How many they are.
    #[must_use]
    pub const fn count(self) -> usize {
        self.0.count_ones() as usize
    }

    /// Each of them.
    pub fn iter(self) -> impl Iterator<Item = usize> {
        (0..VOTERS).filter(move |member| self.has(*member))
    }
}

impl FromIterator<usize> for Members {
    fn from_iter<I: IntoIterator<Item = usize>>(members: I) -> Self {
        let mut all = Self::default();
        members.into_iter().for_each(|member| all.add(member));
        all
    }
}

/// How a vote ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Whose value it is, and what that is; `None`: no member has a number.
    pub winner: Option<(usize, f64)>,
    /// Who agrees with the winner within the tolerance, itself among them.
    pub agreeing: Members,
    /// Who is outvoted: does not agree where most do, or has no number.
    pub minority: Members,
}

/// Votes. `values`: of each member what it says, `None` where it is left out; at most [`VOTERS`] of them. `tolerance`: the
/// largest difference that counts as equal. Allocates nothing.
#[must_use]
pub fn vote(method: Method, tolerance: f64, values: &[Option<f64>]) -> Outcome {
    let mut sorted = [(0.0, 0); VOTERS];
    let mut count = 0;
    let mut minority = Members::default();
    for (member, value) in values.iter().enumerate().take(VOTERS) {
        match value {
            Some(value) if value.is_finite() => {
                sorted[count] = (*value, member);
                count += 1;
            }
            Some(_) => minority.add(member),
            None => {}
        }
    }
    let sorted = &mut sorted[..count];
    sorted.sort_unstable_by(|one, other| one.0.total_cmp(&other.0).then(one.1.cmp(&other.1)));
    let chosen = match method {
        Method::Median => middle(count),
        Method::Majority => most_agreed(sorted, tolerance),
        Method::Weighted => nearest_to_mean(sorted, tolerance),
    };
    let Some((value, winner)) = chosen.and_then(|place| sorted.get(place)).copied() else {
        return Outcome { winner: None, agreeing: Members::default(), minority };
    };
    let agrees = |other: f64| (other - value).abs() <= tolerance;
    let agreeing: Members = sorted.iter().filter(|(other, _)| agrees(*other)).map(|(_, member)| *member).collect();
    if agreeing.count() * 2 > count {
        sorted.iter().filter(|(other, _)| !agrees(*other)).for_each(|(_, member)| minority.add(*member));
    }
    Outcome { winner: Some((winner, value)), agreeing, minority }
}

fn middle(count: usize) -> Option<usize> {
    count.checked_sub(1).map(|last| last / 2)
}

/// Ranks, not sums of distances, break a tie: they do not depend on how large the values are.
fn most_agreed(sorted: &[(f64, usize)], tolerance: f64) -> Option<usize> {
    let middle = middle(sorted.len())?;
    let friends = |value: f64| sorted.iter().filter(|(other, _)| (other - value).abs() <= tolerance).count();
    let better = |place: &usize| {
        let count = sorted.get(*place).map_or(0, |(value, _)| friends(*value));
        (count, std::cmp::Reverse((place.abs_diff(middle), *place)))
    };
    (0..sorted.len()).max_by_key(better)
}

fn nearest_to_mean(sorted: &[(f64, usize)], tolerance: f64) -> Option<usize> {
    let middle = middle(sorted.len())?;
    let median = sorted.get(middle)?.0;
    let kept = sorted.iter().map(|(value, _)| *value).filter(|value| (value - median).abs() <= tolerance);
    let count = kept.clone().count().max(1) as f64;
    // Each divided before it is added: the sum of large values may be none.
    let mean: f64 = kept.map(|value| value / count).sum();
    let distance = |place: usize| sorted.get(place).map_or(f64::INFINITY, |(value, _)| (value - mean).abs());
    let nearer = |one: &usize, other: &usize| {
        distance(*one).total_cmp(&distance(*other)).then(one.abs_diff(middle).cmp(&other.abs_diff(middle)))
    };
    (0..sorted.len()).min_by(nearer)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const METHODS: [Method; 3] = [Method::Median, Method::Majority, Method::Weighted];

    fn any_value() -> impl Strategy<Value = Option<f64>> {
        prop_oneof![
            4 => (-10.0..10.0f64).prop_map(Some),
            2 => any::<f64>().prop_map(Some),
            1 => Just(Some(f64::NAN)),
            1 => Just(None),
        ]
    }

    fn shuffled() -> impl Strategy<Value = (Vec<Option<f64>>, Vec<usize>)> {
        prop::collection::vec(any_value(), 0..=9).prop_flat_map(|values| {
            let order = Just((0..values.len()).collect::<Vec<_>>()).prop_shuffle();
            (Just(values), order)
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2_000))]

        /// Two of three agree: whatever the third one says, what wins lies between the two, or is one of them.
        #[test]
        fn a_single_liar_among_three_never_wins(
            honest in -1e6..1e6f64, apart in 0.0..1.0f64, liar: f64, place in 0..3usize, tolerance in 1.0..5.0f64,
        ) {
            let (low, high) = (honest, honest + apart);
            let mut values = vec![Some(low), Some(high)];
            values.insert(place, Some(liar));
            for method in METHODS {
                let outcome = vote(method, tolerance, &values);
                let (winner, value) = outcome.winner.unwrap();
                prop_assert!((low..=high).contains(&value), "{method:?} {values:?}: {value}");
                let lies = !liar.is_finite() || (liar - value).abs() > tolerance;
                prop_assert_eq!(outcome.minority.has(place), lies, "{:?} {:?}", method, values);
                prop_assert!(!outcome.minority.has(winner));
                if lies {
                    prop_assert_eq!(outcome.minority.count(), 1, "no honest one is called a liar");
                }
            }
        }

        /// Who wins does not depend on the order in which members stand: the winning value is the same, and so is each one's lot.
        #[test]
        fn the_order_of_members_does_not_matter((values, order) in shuffled(), tolerance in 0.0..5.0f64) {
            let moved: Vec<_> = order.iter().map(|place| values[*place]).collect();
            for method in METHODS {
                let (one, other) = (vote(method, tolerance, &values), vote(method, tolerance, &moved));
                prop_assert_eq!(one.winner.map(|(_, value)| value), other.winner.map(|(_, value)| value));
                for (now, before) in order.iter().enumerate() {
                    prop_assert_eq!(one.minority.has(*before), other.minority.has(now));
                    prop_assert_eq!(one.agreeing.has(*before), other.agreeing.has(now));
                }
            }
        }

        /// What is not a number never wins and is always outvoted; who is left out is neither.
        #[test]
        fn nan_never_wins(values in prop::collection::vec(any_value(), 0..=VOTERS), tolerance in 0.0..5.0f64) {
            for method in METHODS {
                let outcome = vote(method, tolerance, &values);
                prop_assert_eq!(outcome.winner.is_some(), values.iter().flatten().any(|value| value.is_finite()));
                if let Some((winner, value)) = outcome.winner {
                    prop_assert!(value.is_finite() && values[winner] == Some(value) && outcome.agreeing.has(winner));
                }
                for (member, value) in values.iter().enumerate() {
                    prop_assert!(!(outcome.agreeing.has(member) && outcome.minority.has(member)));
                    match value {
                        Some(value) if !value.is_finite() => prop_assert!(outcome.minority.has(member)),
                        Some(_) => {}
                        None => prop_assert!(!outcome.minority.has(member) && !outcome.agreeing.has(member)),
                    }
                }
            }
        }
    }
}
