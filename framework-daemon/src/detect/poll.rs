//! A vote that goes on: what members said when, and since when each is at odds with the others, or silent. Pure.

use super::vote::{Members, Method, Outcome, vote};
use crate::model::limits::VOTERS;

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
    /// Too few agreed in the last vote, which was told.
    few: bool,
    /// Enough agreed in the last vote.
    agrees: bool,
    /// Who agreed in the last vote in which enough did, and when each had said that.
    agreed: Members,
    agreed_ns: [u64; VOTERS],
    /// Who agreed no more when it was told last that too few do, and since when that may be.
    lost: [Option<u64>; VOTERS],
    /// There was a vote.
    has_begun: bool,
    /// When it was voted last, or looked who is silent, or members were expected first.
    looked_ns: Option<u64>,
    /// Until then it is not told that too few agree.
    pardon_ns: u64,
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
            agrees: false,
            agreed: Members::default(),
            agreed_ns: [0; VOTERS],
            lost: [None; VOTERS],
            has_begun: false,
            looked_ns: None,
            pardon_ns: 0,
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
        self.expect(now_ns);
        (self.said[member], self.heard_ns[member]) = (Some(value), Some(now_ns));
        let was_fresh = self.fresh.has(member);
        self.fresh.add(member);
        let all_delivered = (0..self.members).all(|other| self.fresh.has(other) || self.is_silent(other, now_ns));
        ((was_fresh && self.has_begun) || all_delivered).then(|| self.vote(now_ns))
    }

    /// All members are to speak from now on, if that is not known yet.
    pub fn expect(&mut self, now_ns: u64) {
        self.looked_ns.get_or_insert(now_ns);
        self.heard_ns.iter_mut().for_each(|heard_ns| _ = heard_ns.get_or_insert(now_ns));
    }

    /// That too few agree is forgiven: its members have the time again in which each may be silent, and if too few agree then,
    /// that is told anew.
    pub fn forgive(&mut self, now_ns: u64) {
        (self.few, self.looked_ns) = (false, Some(now_ns));
        self.pardon_ns = now_ns.saturating_add(self.demand.max_age_ns);
    }

    /// Too few agreed when it was voted or looked last, and that was not forgiven.
    #[must_use]
    pub const fn is_few(&self) -> bool {
        self.few
    }

    /// Enough agreed when it was voted last. Not so before the first vote, when nobody knows yet; nor by being forgiven.
    #[must_use]
    pub const fn agrees(&self) -> bool {
        self.agrees
    }

    /// Of each member since when it may be wrong or silent by which too few agree, as was told last: it said then what enough
    /// agreed with, and no more. Where enough never agreed, since ever. `None`: it is not by that one.
    #[must_use]
    pub const fn lost_ns(&self) -> &[Option<u64>; VOTERS] {
        &self.lost
    }

    fn lose(&mut self, agreeing: Members) {
        let (before, never) = (self.agreed, self.agreed.count() == 0);
        for (member, lost) in self.lost.iter_mut().enumerate() {
            let is_lost = member < self.members && !agreeing.has(member) && (never || before.has(member));
            *lost = is_lost.then(|| self.agreed_ns[member]);
        }
    }

    /// When to [`look`](Self::look) next, if nobody delivers until then; `None`: nobody is expected, or all are known to be
    /// silent.
    #[must_use]
    pub fn due_ns(&self) -> Option<u64> {
        let expected = (0..self.members).filter(|member| !self.silent.has(*member));
        let heard = expected.filter_map(|member| self.heard_ns(member));
        let looked = self.looked_ns.filter(|_| !self.few);
        heard.chain(looked).min().map(|at_ns| at_ns.saturating_add(self.demand.max_age_ns).saturating_add(1))
    }

    /// Looks who has fallen silent, where nobody delivers who would make a vote. Nothing is handed on, and nobody is
    /// outvoted by what is old; that too few are left is told, that there are enough again is for the next vote. `None`: nothing
    /// changed. Allocates nothing.
    pub fn look(&mut self, now_ns: u64) -> Option<Vote> {
        if self.due_ns().is_none_or(|due_ns| now_ns < due_ns) {
            return None;
        }
        let (values, silent) = self.present(now_ns);
        let outcome = vote(self.demand.method, self.demand.tolerance, &values[..self.members]);
        let (fell_silent, spoke) = self.changes(silent);
        let is_short = outcome.agreeing.count() < self.demand.require;
        let falls_short = is_short && !self.few && now_ns >= self.pardon_ns;
        self.agrees &= !is_short;
        if falls_short {
            self.lose(outcome.agreeing);
        }
        (self.silent, self.few, self.looked_ns) = (silent, self.few || falls_short, Some(now_ns));
        self.expect(now_ns);
        let (fell_out, came_back) = (Members::default(), Members::default());
        let few = falls_short.then_some(true);
        let changes = Vote { values, outcome, passes: None, fell_out, came_back, fell_silent, spoke, few };
        (few.is_some() || fell_silent.count() + spoke.count() > 0).then_some(changes)
    }

    /// Who is silent now and was not, and who was and is not.
    fn changes(&self, silent: Members) -> (Members, Members) {
        let fell_silent = silent.iter().filter(|member| !self.silent.has(*member)).collect();
        (fell_silent, self.silent.iter().filter(|member| !silent.has(*member)).collect())
    }

    /// What each said, and who is silent.
    fn present(&self, now_ns: u64) -> ([Option<f64>; VOTERS], Members) {
        let (mut values, mut silent) = ([None; VOTERS], Members::default());
        for (member, value) in values.iter_mut().enumerate().take(self.members) {
            if self.is_silent(member, now_ns) {
                silent.add(member);
            } else {
                *value = self.said[member];
            }
        }
        (values, silent)
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
        let (values, silent) = self.present(now_ns);
        let (fell_silent, spoke) = self.changes(silent);
        let Demand { method, tolerance, require, .. } = self.demand;
        let outcome = vote(method, tolerance, &values[..self.members]);
        let falls_short = outcome.agreeing.count() < require;
        let few = falls_short && (self.few || now_ns >= self.pardon_ns);
        let members = (0..self.members).filter(|member| values[*member].is_some());
        let (is_out, was_out) = (outcome.minority, self.outvoted);
        // One that is left alone agrees with nobody.
        let agreeing = if outcome.agreeing.count() > 1 { outcome.agreeing } else { Members::default() };
        let result = Vote {
            values,
            outcome,
            passes: outcome.winner.map(|(member, _)| member).filter(|_| !falls_short),
            fell_out: members.clone().filter(|member| is_out.has(*member) && !was_out.has(*member)).collect(),
            came_back: members.filter(|member| agreeing.has(*member) && was_out.has(*member)).collect(),
            fell_silent,
            spoke,
            few: (few != self.few).then_some(few),
        };
        result.fell_out.iter().for_each(|member| self.outvoted.add(member));
        result.came_back.iter().for_each(|member| self.outvoted.remove(member));
        (self.silent, self.few, self.fresh, self.has_begun) = (silent, few, Members::default(), true);
        (self.looked_ns, self.agrees) = (Some(now_ns), !falls_short);
        if result.few == Some(true) {
            self.lose(outcome.agreeing);
        }
        if !falls_short {
            self.agreed = outcome.agreeing;
            outcome.agreeing.iter().for_each(|member| self.agreed_ns[member] = self.heard_ns[member].unwrap_or(now_ns));
        }
        result
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

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

    #[test]
    fn all_fall_silent_at_once_and_that_is_found_by_the_clock_once() {
        let mut poll = poll(2);
        assert_eq!((poll.due_ns(), poll.look(1_000)), (None, None), "nobody is expected yet");
        round(&mut poll, [1.0, 1.0, 9.0], 1_000);
        assert_eq!((poll.due_ns(), poll.look(1_100)), (Some(1_101), None));
        let vote = poll.look(1_101).unwrap();
        assert_eq!((vote.few, vote.passes, vote.fell_silent), (Some(true), None, members([0, 1, 2])));
        assert_eq!((poll.due_ns(), poll.look(5_000)), (None, None), "once");
        // One alone is not enough, and what it says is right only if another one says the same.
        assert_eq!(poll.deliver(2, 9.0, 6_000).map(|vote| (vote.few, vote.came_back)), Some((None, members([]))));
        assert_eq!(poll.look(6_101).map(|vote| (vote.few, vote.fell_silent)), Some((None, members([2]))));
        assert_eq!(poll.deliver(0, 1.0, 7_000).and_then(|vote| vote.few), None);
        assert_eq!(poll.deliver(1, 1.0, 7_000), None);
        let vote = poll.deliver(0, 1.0, 7_010).unwrap();
        assert_eq!((vote.few, vote.spoke), (Some(false), members([1])));
        assert_eq!(poll.look(7_111).and_then(|vote| vote.few), Some(true), "and again");
    }

    #[test]
    fn those_that_are_reset_over_and_over_and_those_that_never_speak_are_found_as_well() {
        let mut reset = poll(2);
        round(&mut reset, [1.0; 3], 0);
        for at in [50, 100] {
            (0..3).for_each(|member| reset.begin(member));
            assert_eq!(reset.look(at), None);
        }
        assert_eq!(reset.look(101).and_then(|vote| vote.few), Some(true));
        let mut mute = poll(2);
        mute.expect(7);
        assert_eq!(mute.look(107), None);
        assert_eq!(mute.look(108).and_then(|vote| vote.few), Some(true));
        let mut slow = poll(2);
        assert_eq!((slow.deliver(0, 1.0, 0), slow.deliver(1, 1.0, 0)), (None, None));
        assert_eq!((slow.deliver(0, 1.0, 90), slow.deliver(1, 1.0, 90)), (None, None), "the first vote waits for all");
        let vote = slow.look(101).unwrap();
        assert_eq!((vote.few, vote.fell_silent), (None, members([2])), "two are enough");
    }

    #[test]
    fn nobody_agrees_before_the_first_vote_and_by_looking() {
        let mut poll = poll(2);
        assert!(!poll.agrees() && !poll.is_few());
        poll.expect(0);
        assert_eq!((poll.deliver(0, 1.0, 50), poll.deliver(1, 1.0, 50)), (None, None));
        assert!(!poll.agrees(), "two of three, but there was no vote");
        assert_eq!(poll.look(101).map(|vote| vote.few), Some(None));
        assert!(!poll.agrees());
        assert_eq!(poll.deliver(0, 1.0, 102).and_then(|vote| vote.passes), Some(0));
        assert!(poll.agrees());
        assert_eq!(poll.deliver(0, 9.0, 103), None);
        assert_eq!(poll.deliver(0, 9.0, 104).and_then(|vote| vote.few), Some(true));
        assert!(!poll.agrees());
    }

    #[test]
    fn those_by_whom_too_few_agree_are_those_that_agreed_before_since_they_said_so() {
        let lost = |poll: &Poll| -> Vec<_> { poll.lost_ns().iter().take(3).copied().collect() };
        let mut early = poll(2);
        round(&mut early, [1.0, 5.0, 9.0], 7);
        assert_eq!(lost(&early), [Some(0), None, Some(0)], "nobody ever agreed with the one in the middle");
        let mut later = poll(2);
        round(&mut later, [1.0, 1.0, 9.0], 10);
        round(&mut later, [1.0, 1.0, 9.0], 20);
        assert_eq!(round(&mut later, [1.0, 5.0, 9.0], 30).few, Some(true));
        assert_eq!(lost(&later), [Some(20), None, None], "the third was outvoted before");
        let mut silent = poll(2);
        round(&mut silent, [1.0; 3], 10);
        assert_eq!((silent.deliver(2, 1.0, 90), silent.deliver(2, 1.0, 100).map(|vote| vote.few)), (None, Some(None)));
        assert_eq!(silent.look(201).and_then(|vote| vote.few), Some(true));
        assert_eq!(lost(&silent), [Some(10), Some(10), Some(100)]);
    }

    #[test]
    fn what_is_forgiven_is_told_anew_when_its_time_is_over() {
        let mut poll = poll(2);
        round(&mut poll, [1.0; 3], 0);
        assert_eq!(poll.look(101).and_then(|vote| vote.few), Some(true));
        poll.forgive(1_000);
        assert!(!poll.is_few() && !poll.agrees(), "that it is forgiven makes nobody agree");
        let vote = poll.deliver(0, 1.0, 1_050).unwrap();
        assert_eq!((vote.few, vote.passes), (None, None), "it has time, but nothing passes");
        assert_eq!(poll.deliver(0, 1.0, 1_100).and_then(|vote| vote.few), Some(true));
        assert_eq!(poll.look(1_201).map(|vote| (vote.few, vote.fell_silent)), Some((None, members([0]))));
        poll.forgive(2_000);
        assert_eq!((poll.due_ns(), poll.look(2_101).and_then(|vote| vote.few)), (Some(2_101), Some(true)));
        poll.forgive(3_000);
        assert_eq!((poll.deliver(0, 1.0, 3_001).map(|vote| vote.few), poll.deliver(1, 1.0, 3_001)), (Some(None), None));
        assert_eq!(poll.deliver(0, 1.0, 3_002).map(|vote| (vote.few, vote.passes)), Some((None, Some(0))));
        assert_eq!(poll.look(3_101), None, "two are enough");
    }

    /// Somebody says something, or it is looked who is silent; so much later.
    fn any_step() -> impl Strategy<Value = (usize, Option<f64>, u64)> {
        let value = prop_oneof![Just(Some(0.0)), Just(Some(3.0)), Just(Some(f64::NAN)), Just(None)];
        (0..3usize, value, 0..80u64)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2_000))]

        /// A mixed history: faults and their end alternate for each member, and nothing passes that too few agree to.
        #[test]
        fn what_is_told_alternates(
            steps in prop::collection::vec(any_step(), 0..300),
            require in 1..=3usize,
        ) {
            let mut poll = poll(require);
            let (mut now, mut out, mut silent, mut few) = (0, [false; 3], [false; 3], false);
            for (member, value, gap) in steps {
                now += gap;
                let delivered = value.map(|value| poll.deliver(member, value, now));
                let is_look = delivered.is_none();
                let Some(vote) = delivered.unwrap_or_else(|| poll.look(now)) else { continue };
                prop_assert_eq!(vote.passes.is_some(), !is_look && vote.outcome.agreeing.count() >= require);
                prop_assert!(is_look || poll.agrees() == vote.passes.is_some());
                prop_assert!(!(is_look && vote.few == Some(false)));
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
                prop_assert_eq!(few, poll.is_few());
                prop_assert!(!(few && poll.agrees()));
                let is_lost = |member: &usize| poll.lost_ns()[*member].is_some();
                if vote.few == Some(true) {
                    prop_assert!((0..3).any(|member| is_lost(&member)));
                    prop_assert!((0..3).filter(is_lost).all(|member| !vote.outcome.agreeing.has(member)));
                    prop_assert!(poll.lost_ns().iter().flatten().all(|since| *since <= now));
                }
            }
        }

        /// Whoever looks when he is told to finds, within the age, that nobody speaks any more, whatever was before.
        #[test]
        fn silence_of_all_is_always_found_in_time(steps in prop::collection::vec(any_step(), 1..100), require in 1..=3usize) {
            let mut poll = poll(require);
            let mut now = 0;
            poll.expect(now);
            for (member, value, gap) in steps {
                now += gap;
                match value {
                    Some(value) => _ = poll.deliver(member, value, now),
                    None => _ = poll.look(now),
                }
            }
            let last = now;
            while let Some(due) = poll.due_ns() {
                prop_assert!(due <= last + 101, "{due}");
                now = now.max(due);
                let _ = poll.look(now);
            }
            prop_assert!(poll.is_few());
        }
    }
}
