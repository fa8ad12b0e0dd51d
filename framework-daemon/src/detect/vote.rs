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

/// What a voter demands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demand {
    /// How the winner is found.
    pub method: Method,
    /// Largest difference that counts as equal.
    pub tolerance: f64,
    /// A member that said nothing for longer is left out, in nanoseconds.
    pub max_age_ns: u64,
    /// How many must agree, or nothing is handed on.
    pub require: usize,
}

/// What members said, and since when each is at odds with the others.
#[derive(Debug)]
pub struct Poll {
    demand: Demand,
    members: usize,
    said: [Option<f64>; VOTERS],
    /// When each was heard last, or expected first.
    heard_ns: [Option<u64>; VOTERS],
    /// Delivered since the last vote.
    fresh: Members,
    /// Outvoted in the last vote in which they took part.
    outvoted: Members,
    /// Left out of the last vote because they said nothing.
    silent: Members,
    /// Too few agreed in the last vote.
    few: bool,
    /// There was a vote.
    has_begun: bool,
}

/// A vote, and what it changed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vote {
    /// What each said; `None`: left out.
    pub values: [Option<f64>; VOTERS],
    /// How it ended.
    pub outcome: Outcome,
    /// Whose object is handed on.
    pub passes: Option<usize>,
    /// Outvoted now, and not in the vote before.
    pub fell_out: Members,
    /// Agree again.
    pub came_back: Members,
    /// Left out for their silence from now on.
    pub fell_silent: Members,
    /// Heard again.
    pub spoke: Members,
    /// Too few agree (true) or enough again (false), where that is new.
    pub few: Option<bool>,
}

impl Poll {
    /// Of so many members, at most [`VOTERS`], none of which said anything yet.
    #[must_use]
    pub fn new(demand: Demand, members: usize) -> Self {
        Self {
            demand,
            members: members.min(VOTERS),
            said: [None; VOTERS],
            heard_ns: [None; VOTERS],
            fresh: Members::default(),
            outvoted: Members::default(),
            silent: Members::default(),
            few: false,
            has_begun: false,
        }
    }

    /// What it votes by.
    #[must_use]
    pub const fn demand(&self) -> &Demand {
        &self.demand
    }

    /// When a member was heard last, or expected first.
    #[must_use]
    pub fn heard_ns(&self, member: usize) -> Option<u64> {
        self.heard_ns.get(member).copied().flatten()
    }

    /// A member delivers. It is voted when all that are not silent have delivered since the last vote, or when one delivers a
    /// second time: the fastest one sets the pace, and of the others counts what they said last. The first vote waits for all,
    /// as long as each may be silent: slots start one after the other. Allocates nothing.
    pub fn deliver(&mut self, member: usize, value: f64, now_ns: u64) -> Option<Vote> {
        if member >= self.members {
            return None;
        }
        self.heard_ns.iter_mut().for_each(|heard_ns| _ = heard_ns.get_or_insert(now_ns));
        (self.said[member], self.heard_ns[member]) = (Some(value), Some(now_ns));
        let was_fresh = self.fresh.has(member);
        self.fresh.add(member);
        let all_delivered = (0..self.members).all(|other| self.fresh.has(other) || self.is_silent(other, now_ns));
        ((was_fresh && self.has_begun) || all_delivered).then(|| self.vote(now_ns))
    }

    /// A member was reset or replaced: what it said, that it was outvoted or silent, counts no more.
    pub fn begin(&mut self, member: usize) {
        if member < self.members {
            (self.said[member], self.heard_ns[member]) = (None, None);
            self.outvoted.remove(member);
            self.fresh.remove(member);
            self.silent.remove(member);
        }
    }

    fn is_silent(&self, member: usize, now_ns: u64) -> bool {
        self.heard_ns(member).is_some_and(|heard_ns| now_ns.saturating_sub(heard_ns) > self.demand.max_age_ns)
    }

    fn vote(&mut self, now_ns: u64) -> Vote {
        let mut values = [None; VOTERS];
        let mut silent = Members::default();
        for (member, value) in values.iter_mut().enumerate().take(self.members) {
            if self.is_silent(member, now_ns) {
                silent.add(member);
            } else {
                *value = self.said[member];
            }
        }
        let Demand { method, tolerance, require, .. } = self.demand;
        let outcome = vote(method, tolerance, &values[..self.members]);
        let few = outcome.agreeing.count() < require;
        let members = (0..self.members).filter(|member| values[*member].is_some());
        let (is_out, was_out) = (outcome.minority, self.outvoted);
        let result = Vote {
            values,
            outcome,
            passes: outcome.winner.map(|(member, _)| member).filter(|_| !few),
            fell_out: members.clone().filter(|member| is_out.has(*member) && !was_out.has(*member)).collect(),
            came_back: members.clone().filter(|member| outcome.agreeing.has(*member) && was_out.has(*member)).collect(),
            fell_silent: silent.iter().filter(|member| !self.silent.has(*member)).collect(),
            spoke: self.silent.iter().filter(|member| !silent.has(*member)).collect(),
            few: (few != self.few).then_some(few),
        };
        result.fell_out.iter().for_each(|member| self.outvoted.add(member));
        result.came_back.iter().for_each(|member| self.outvoted.remove(member));
        (self.silent, self.few, self.fresh, self.has_begun) = (silent, few, Members::default(), true);
        result
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const METHODS: [Method; 3] = [Method::Median, Method::Majority, Method::Weighted];

    fn poll(require: usize) -> Poll {
        Poll::new(Demand { method: Method::Median, tolerance: 1.0, max_age_ns: 100, require }, 3)
    }

    fn members(all: impl IntoIterator<Item = usize>) -> Members {
        all.into_iter().collect()
    }

    /// All three say something at that time; the vote that the last one makes.
    fn round(poll: &mut Poll, values: [f64; 3], now_ns: u64) -> Vote {
        assert_eq!(poll.deliver(0, values[0], now_ns), None);
        assert_eq!(poll.deliver(1, values[1], now_ns), None);
        poll.deliver(2, values[2], now_ns).unwrap()
    }

    #[test]
    fn one_that_drifts_away_is_told_once_and_once_when_it_is_back() {
        let mut poll = poll(2);
        let drift = [0.0, 0.5, 0.9, 1.1, 5.0, 20.0, 1.2, 0.8, 0.1];
        let told: Vec<_> =
            drift.iter().zip(0..).map(|(away, at)| round(&mut poll, [3.0, 3.0, 3.0 + away], at)).collect();
        let changes = |of: fn(&Vote) -> Members| -> Vec<usize> {
            told.iter().enumerate().filter(|(_, vote)| of(vote).has(2)).map(|(at, _)| at).collect()
        };
        assert_eq!((changes(|vote| vote.fell_out), changes(|vote| vote.came_back)), (vec![3], vec![7]));
        assert!(told.iter().all(|vote| vote.passes.is_some_and(|winner| winner != 2 || vote.outcome.agreeing.has(2))));
    }

    #[test]
    fn who_is_silent_is_left_out_when_its_time_is_over_and_the_fastest_sets_the_pace() {
        let mut poll = poll(2);
        assert_eq!(round(&mut poll, [1.0; 3], 0).few, None);
        assert_eq!(poll.deliver(0, 1.0, 50), None);
        assert_eq!(poll.deliver(1, 1.0, 50), None, "the third one has time");
        let vote = poll.deliver(0, 1.0, 60).unwrap();
        assert_eq!((vote.outcome.agreeing.count(), vote.fell_silent), (3, Members::default()), "it counts as it was");
        assert_eq!(poll.deliver(1, 1.0, 101), None);
        let vote = poll.deliver(0, 1.0, 101).unwrap();
        assert_eq!((vote.fell_silent, vote.outcome.agreeing), (members([2]), members([0, 1])));
        assert_eq!(poll.deliver(2, 1.0, 105), None);
        assert_eq!(poll.deliver(1, 1.0, 105), None);
        assert_eq!(poll.deliver(0, 1.0, 105).unwrap().spoke, members([2]));
    }

    #[test]
    fn where_too_few_agree_nothing_passes_and_it_is_told_once() {
        let mut poll = poll(2);
        let few: Vec<_> = [[1.0, 5.0, 9.0], [1.0, 5.0, 9.0], [1.0, 1.0, 9.0]]
            .into_iter()
            .zip(0..)
            .map(|(values, at)| round(&mut poll, values, at))
            .map(|vote| (vote.few, vote.passes, vote.fell_out))
            .collect();
        let nobody = Members::default();
        assert_eq!(few, [(Some(true), None, nobody), (None, None, nobody), (Some(false), Some(1), members([2]))]);
    }

    #[test]
    fn a_member_that_begins_anew_is_neither_outvoted_nor_silent() {
        let mut poll = poll(2);
        assert_eq!(round(&mut poll, [1.0, 1.0, 9.0], 0).fell_out, members([2]));
        poll.begin(2);
        assert_eq!(poll.deliver(0, 1.0, 500), None);
        assert_eq!(poll.deliver(1, 1.0, 500), None);
        let vote = poll.deliver(2, 9.0, 560).unwrap();
        assert_eq!((vote.fell_silent, vote.fell_out), (Members::default(), members([2])), "its successor errs, too");
    }

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

        /// A mixed history: faults and their end alternate for each member, and nothing passes that too few agree to.
        #[test]
        fn what_is_told_alternates(
            steps in prop::collection::vec((0..3usize, prop_oneof![Just(0.0), Just(3.0), Just(f64::NAN)], 0..80u64), 0..300),
            require in 1..=3usize,
        ) {
            let mut poll = poll(require);
            let (mut now, mut out, mut silent, mut few) = (0, [false; 3], [false; 3], false);
            for (member, value, gap) in steps {
                now += gap;
                let Some(vote) = poll.deliver(member, value, now) else { continue };
                prop_assert_eq!(vote.passes.is_some(), vote.outcome.agreeing.count() >= require);
                for (changes, state) in [(vote.fell_out, true), (vote.came_back, false)] {
                    for member in changes.iter() {
                        prop_assert!(out[member] != state);
                        out[member] = state;
                    }
                }
                for (changes, state) in [(vote.fell_silent, true), (vote.spoke, false)] {
                    for member in changes.iter() {
                        prop_assert!(silent[member] != state);
                        silent[member] = state;
                    }
                }
                if let Some(now_few) = vote.few {
                    prop_assert!(few != now_few);
                    few = now_few;
                }
            }
        }
    }
}
