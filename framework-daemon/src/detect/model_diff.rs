//! A signal against a model of it, both filtered over a sliding window: the paper's comparison of an encoder with its reference
//! (its figure 10). The means over the last `T` of both are taken; their difference beyond `D` is the fault.
//!
//! Each value comes with the time at which it was written. Between its values a signal is taken for a straight line, and both
//! means are taken over the same window, which ends where the slower one of the two was last heard: neither the rate nor the phase of
//! the samples shows in the difference. Holding each value until the next was the alternative: of two copies of one ramp the
//! rarer one then lags by half its period.
//!
//! A counter is compared by its rate: a mean of its values would keep for ever what the two were apart once.
//!
//! Until both windows are full, nothing is compared; a gap as long as the window begins a signal anew, as its writer's reset
//! does. What is not a number agrees with nothing: of the target it is a fault at once, of the model it begins its signal anew.

use std::collections::VecDeque;

/// Points kept for each window: the exactness of its edges.
const POINTS_PER_WINDOW: u64 = 64;
/// Two neighbouring stretches together are at least as long as a window's part; two windows are kept.
const POINTS_MAX: usize = 4 * POINTS_PER_WINDOW as usize + 4;

/// What of the signals is compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Measure {
    /// Their means.
    #[default]
    Value,
    /// How much they change in a second, on average.
    Rate,
}

/// Whose value it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Of the component that is watched.
    Target,
    /// Of its model.
    Model,
}

/// What the integrator demands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Demand {
    /// Length of the sliding window in nanoseconds, more than 0.
    pub window_ns: u64,
    /// Largest difference of the filtered signals.
    pub threshold: f64,
    /// What is compared.
    pub measure: Measure,
}

/// The filtered signals at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Where the window ends, in nanoseconds.
    pub at_ns: u64,
    /// The target's mean, or its rate per second.
    pub target: f64,
    /// The model's.
    pub model: f64,
    /// Whether this is where they part or meet.
    pub change: Option<Change>,
}

impl Reading {
    /// By how much they differ.
    #[must_use]
    pub fn difference(&self) -> f64 {
        (self.target - self.model).abs()
    }
}

/// From within the threshold to beyond it, or back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// They differ by more than the threshold from now on.
    Parted,
    /// They agree again.
    Met,
}

/// A target, its model, and what both said within the last two windows.
#[derive(Debug)]
pub struct Comparison {
    demand: Demand,
    target: Track,
    model: Track,
    parted: bool,
}

impl Comparison {
    /// Nothing was heard yet.
    #[must_use]
    pub fn new(demand: Demand) -> Self {
        let track = || Track::new(demand.window_ns);
        Self { demand, target: track(), model: track(), parted: false }
    }

    /// What it compares by.
    #[must_use]
    pub const fn demand(&self) -> &Demand {
        &self.demand
    }

    /// Takes a value in. `None`: there is nothing to compare yet. Allocates nothing.
    pub fn note(&mut self, side: Side, value: f64, at_ns: u64) -> Option<Reading> {
        if !value.is_finite() {
            self.begin(side);
            return (side == Side::Target).then(|| self.judge(at_ns, value, f64::NAN));
        }
        match side {
            Side::Target => self.target.push(value, at_ns),
            Side::Model => self.model.push(value, at_ns),
        }
        let to_ns = self.target.last_ns()?.min(self.model.last_ns()?);
        let from_ns = to_ns.checked_sub(self.demand.window_ns)?;
        let filter = |track: &Track| track.filtered(from_ns, to_ns, self.demand.measure);
        let (target, model) = (filter(&self.target)?, filter(&self.model)?);
        Some(self.judge(to_ns, target, model))
    }

    /// The writer of that side begins anew. A target that does is no longer the one that was found wrong.
    pub fn begin(&mut self, side: Side) {
        match side {
            Side::Target => {
                self.target.points.clear();
                self.parted = false;
            }
            Side::Model => self.model.points.clear(),
        }
    }

    fn judge(&mut self, at_ns: u64, target: f64, model: f64) -> Reading {
        let mut reading = Reading { at_ns, target, model, change: None };
        // A difference that is not a number is beyond any threshold.
        let parted = !matches!(
            reading.difference().partial_cmp(&self.demand.threshold),
            Some(std::cmp::Ordering::Less | std::cmp::Ordering::Equal)
        );
        reading.change = match (self.parted, parted) {
            (false, true) => Some(Change::Parted),
            (true, false) => Some(Change::Met),
            _ => None,
        };
        self.parted = parted;
        reading
    }
}

/// One value of a signal.
#[derive(Clone, Copy, Debug)]
struct Point {
    at_ns: u64,
    value: f64,
    /// Under the signal, from the point before to this one, in value times nanoseconds. Exact also where values between the two
    /// were let go.
    area: f64,
}

/// What a signal was within the last two windows: as many points for any rate.
#[derive(Debug)]
struct Track {
    window_ns: u64,
    points: VecDeque<Point>,
}

impl Track {
    fn new(window_ns: u64) -> Self {
        Self { window_ns: window_ns.max(1), points: VecDeque::with_capacity(POINTS_MAX + 1) }
    }

    fn last_ns(&self) -> Option<u64> {
        self.points.back().map(|point| point.at_ns)
    }

    fn push(&mut self, value: f64, at_ns: u64) {
        match self.points.back().copied() {
            // Two threads that write one port may overtake each other.
            Some(last) if at_ns <= last.at_ns => return,
            Some(last) if at_ns - last.at_ns > self.window_ns => self.points.clear(),
            Some(last) => return self.go_on(last, value, at_ns),
            None => {}
        }
        self.points.push_back(Point { at_ns, value, area: 0.0 });
    }

    fn go_on(&mut self, last: Point, value: f64, at_ns: u64) {
        let mut area = under((last.at_ns, last.value), (at_ns, value));
        let before_last = self.points.len().checked_sub(2).and_then(|place| self.points.get(place));
        let part_ns = (self.window_ns / POINTS_PER_WINDOW).max(1);
        if before_last.is_some_and(|before| at_ns - before.at_ns < part_ns) {
            self.points.pop_back();
            area += last.area;
        }
        self.points.push_back(Point { at_ns, value, area });
        let oldest_ns = at_ns.saturating_sub(2 * self.window_ns);
        // The first point that counts may lie before: the line from it to the next one leads into the window.
        while self.points.get(1).is_some_and(|second| second.at_ns <= oldest_ns) || self.points.len() > POINTS_MAX {
            self.points.pop_front();
        }
    }

    /// Filtered over that window; `None`: it does not reach as far.
    fn filtered(&self, from_ns: u64, to_ns: u64, measure: Measure) -> Option<f64> {
        let (first, last) = (self.points.front()?, self.points.back()?);
        if first.at_ns > from_ns || last.at_ns < to_ns {
            return None;
        }
        let length_ns = (to_ns - from_ns) as f64;
        Some(match measure {
            Measure::Value => self.area(from_ns, to_ns) / length_ns,
            Measure::Rate => (self.value_at(to_ns)? - self.value_at(from_ns)?) / (length_ns * 1e-9),
        })
    }

    fn stretches(&self) -> impl Iterator<Item = (&Point, &Point)> {
        self.points.iter().zip(self.points.iter().skip(1))
    }

    fn value_at(&self, at_ns: u64) -> Option<f64> {
        let spans = |(one, other): &(&Point, &Point)| (one.at_ns..=other.at_ns).contains(&at_ns);
        self.stretches().find(spans).map(|(one, other)| on_line(one, other, at_ns))
    }

    fn area(&self, from_ns: u64, to_ns: u64) -> f64 {
        let part = |(one, other): (&Point, &Point)| {
            let (begin, end) = (one.at_ns.max(from_ns), other.at_ns.min(to_ns));
            match (begin, end) {
                _ if begin >= end => 0.0,
                _ if (begin, end) == (one.at_ns, other.at_ns) => other.area,
                _ => under((begin, on_line(one, other, begin)), (end, on_line(one, other, end))),
            }
        };
        self.stretches().map(part).sum()
    }
}

fn under((from_ns, from): (u64, f64), (to_ns, to): (u64, f64)) -> f64 {
    // Halved first: the sum of two large values may be none.
    (from / 2.0 + to / 2.0) * (to_ns - from_ns) as f64
}

fn on_line(one: &Point, other: &Point, at_ns: u64) -> f64 {
    let share = (at_ns - one.at_ns) as f64 / (other.at_ns - one.at_ns).max(1) as f64;
    one.value * (1.0 - share) + other.value * share
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const MS: u64 = 1_000_000;

    fn demand(window_ms: u64, threshold: f64) -> Demand {
        Demand { window_ns: window_ms * MS, threshold, measure: Measure::Value }
    }

    /// Both signals, sampled as these times say, in the order of time; the last reading.
    fn run(
        comparison: &mut Comparison,
        (target, target_ms): (impl Fn(f64) -> f64, &[u64]),
        (model, model_ms): (impl Fn(f64) -> f64, &[u64]),
    ) -> Vec<Reading> {
        let mut all: Vec<(u64, Side)> = target_ms.iter().map(|at| (*at, Side::Target)).collect();
        all.extend(model_ms.iter().map(|at| (*at, Side::Model)));
        all.sort_by_key(|(at, _)| *at);
        let note = |(at, side): (u64, Side)| {
            let seconds = at as f64 / 1e3;
            let value = if side == Side::Target { target(seconds) } else { model(seconds) };
            comparison.note(side, value, at * MS)
        };
        all.into_iter().filter_map(note).collect()
    }

    fn every(period: u64, phase: u64, until: u64) -> Vec<u64> {
        (0..).map(|step| phase + step * period).take_while(|at| *at <= until).collect()
    }

    #[test]
    fn nothing_is_compared_before_both_windows_are_full() {
        let mut comparison = Comparison::new(demand(100, 0.5));
        let readings = run(&mut comparison, (|_| 9.0, &every(10, 0, 95)), (|_| 0.0, &every(10, 0, 1000)));
        assert_eq!(readings, []);
        let readings = run(&mut comparison, (|_| 9.0, &[1010]), (|_| 0.0, &[]));
        assert_eq!(readings, [], "a gap as long as the window begins the signal anew");
    }

    #[test]
    fn a_step_is_found_when_its_share_of_the_window_is_beyond_the_threshold() {
        let mut comparison = Comparison::new(demand(200, 5.0));
        let times = every(10, 0, 2000);
        // Power off at one second: 10 less. Half a window later the means differ by 5.
        let broken = |at: f64| if at <= 1.0 { 10.0 } else { 0.0 };
        let readings = run(&mut comparison, (broken, &times), (|_| 10.0, &times));
        let changes: Vec<_> =
            readings.iter().filter_map(|reading| Some((reading.at_ns / MS, reading.change?))).collect();
        assert!(matches!(changes[..], [(1100..=1120, Change::Parted)]), "{changes:?}");
    }

    #[test]
    fn of_a_counter_the_rate_counts_and_not_where_it_began() {
        let mut comparison = Comparison::new(Demand { measure: Measure::Rate, ..demand(200, 5.0) });
        let (target, model) = (every(20, 3, 3000), every(50, 17, 3000));
        let counted = |at: f64| if at < 2.0 { 1e6 + 60.0 * at } else { 1e6 + 120.0 };
        let readings = run(&mut comparison, (counted, &target), (|at| 60.0 * at, &model));
        let first = readings.first().unwrap();
        assert!((first.target - 60.0).abs() < 1e-6 && (first.model - 60.0).abs() < 1e-6, "{first:?}");
        let parted: Vec<_> = readings.iter().filter(|reading| reading.change == Some(Change::Parted)).collect();
        assert!(matches!(parted[..], [one] if one.at_ns > 2000 * MS && one.at_ns < 2060 * MS), "{parted:?}");
    }

    #[test]
    fn a_target_that_is_no_number_is_a_fault_and_a_model_that_is_none_is_not() {
        let mut comparison = Comparison::new(demand(100, 0.5));
        run(&mut comparison, (|_| 1.0, &every(10, 0, 300)), (|_| 1.0, &every(10, 0, 300)));
        assert_eq!(comparison.note(Side::Model, f64::NAN, 310 * MS), None);
        let reading = comparison.note(Side::Target, f64::INFINITY, 310 * MS).unwrap();
        assert_eq!(reading.change, Some(Change::Parted));
        assert_eq!(
            comparison.note(Side::Target, f64::NAN, 320 * MS).unwrap().change,
            Some(Change::Parted),
            "begun anew"
        );
        let later = every(10, 330, 600);
        assert_eq!(run(&mut comparison, (|_| 1.0, &later), (|_| 1.0, &later)).last().unwrap().difference(), 0.0);
    }

    proptest! {
        /// The same straight line, sampled with any rates and phases, is no difference.
        #[test]
        fn rate_and_phase_do_not_show(
            (period_a, period_b) in (1..90u64, 1..90u64),
            (phase_a, phase_b) in (0..90u64, 0..90u64),
            (slope, offset) in (-100.0..100.0f64, -1000.0..1000.0f64),
            rate: bool,
        ) {
            let measure = if rate { Measure::Rate } else { Measure::Value };
            let mut comparison = Comparison::new(Demand { measure, ..demand(100, 1e-3) });
            let line = |at: f64| offset + slope * at;
            let (a, b) = (every(period_a, phase_a, 1500), every(period_b, phase_b, 1500));
            let readings = run(&mut comparison, (line, &a), (line, &b));
            prop_assert!(!readings.is_empty());
            for reading in readings {
                prop_assert!(reading.difference() < 1e-6, "{reading:?}");
                prop_assert_eq!(reading.change, None);
            }
        }

        /// Wherever it is sampled, a constant difference is that.
        #[test]
        fn a_constant_difference_is_found_as_it_is(
            gaps_a in prop::collection::vec(1..90u64, 40..200),
            gaps_b in prop::collection::vec(1..90u64, 40..200),
            (base, difference) in (-1e3..1e3f64, -50.0..50.0f64),
        ) {
            let times = |gaps: &[u64]| gaps.iter().scan(0, |at, gap| { *at += gap; Some(*at) }).collect::<Vec<u64>>();
            let threshold = 10.0;
            let mut comparison = Comparison::new(demand(100, threshold));
            let readings =
                run(&mut comparison, (|_| base + difference, &times(&gaps_a)), (|_| base, &times(&gaps_b)));
            prop_assert!(!readings.is_empty());
            for reading in &readings {
                prop_assert!((reading.difference() - difference.abs()).abs() < 1e-6, "{reading:?}");
            }
            let parted = readings.iter().filter(|reading| reading.change.is_some()).count();
            prop_assert_eq!(parted, usize::from(difference.abs() > threshold + 1e-6));
        }

        /// However the signals go on, what is reported alternates, and memory is bounded.
        #[test]
        fn parting_and_meeting_alternate_and_memory_is_bounded(
            values in prop::collection::vec((any::<bool>(), -20.0..20.0f64, 0..40u64, 0..50u8), 0..2000),
        ) {
            let mut comparison = Comparison::new(demand(50, 5.0));
            let (mut now, mut parted) = (0, false);
            let capacity = comparison.target.points.capacity();
            for (is_target, value, gap, odd) in values {
                now += gap * MS / 16;
                let side = if is_target { Side::Target } else { Side::Model };
                let value = if odd == 0 { f64::NAN } else { value };
                if odd == 0 && is_target { parted = false; }
                if let Some(reading) = comparison.note(side, value, now) {
                    prop_assert!(reading.at_ns <= now);
                    match reading.change {
                        Some(Change::Parted) => { prop_assert!(!parted); parted = true; }
                        Some(Change::Met) => { prop_assert!(parted); parted = false; }
                        None => prop_assert_eq!(parted, reading.difference() > 5.0),
                    }
                }
                for track in [&comparison.target, &comparison.model] {
                    prop_assert!(track.points.len() <= POINTS_MAX && track.points.capacity() == capacity);
                }
            }
        }

        /// Any rate: as many points for a thousand values in a window as for fifty, and nearly the same mean.
        #[test]
        fn a_fast_signal_is_filtered_as_a_slow_one(frequency in 0.5..5.0f64, phase in 0.0..6.0f64) {
            let window_ns = 200 * MS;
            let (mut fast, mut slow) = (Track::new(window_ns), Track::new(window_ns));
            let signal = |at_ns: u64| (frequency * at_ns as f64 * 1e-9 + phase).sin();
            (0..20_000).map(|step| step * 50_000).for_each(|at| fast.push(signal(at), at));
            (0..500).map(|step| step * 2 * MS).for_each(|at| slow.push(signal(at), at));
            let mean = |track: &Track| track.filtered(700 * MS, 900 * MS, Measure::Value).unwrap();
            prop_assert!((mean(&fast) - mean(&slow)).abs() < 1e-3);
            prop_assert!(fast.points.len() <= POINTS_MAX);
        }
    }
}
