//! What was found of one class, and the printed form.

use serde_json::{Value, json};

use super::layout::Policy;

/// What was found of one class.
#[derive(Debug)]
pub struct Row {
    /// The class.
    pub class: String,
    /// How the threads were scheduled.
    pub policy: Policy,
    /// Strikes.
    pub injected: usize,
    /// Strikes that the daemon survived and wrote down, or refused.
    pub contained: usize,
    /// Of those, with the right slot and symptom.
    pub attributed: usize,
    /// Of those, after which the slot worked again.
    pub recovered: usize,
    /// Of those, after which the slot stopped, as its rules say.
    pub stopped: usize,
    /// Periods that the worst of the others missed.
    pub missed: u64,
    /// The same in a run of the same length without faults.
    pub missed_control: u64,
    /// Most periods that one of the others missed at once.
    pub gap: u64,
    /// The same without faults.
    pub gap_control: u64,
    /// Recovery at the median.
    pub p50_ns: u64,
    /// Recovery at the 99.9th percentile.
    pub p999_ns: u64,
    /// Instances that are never entered again.
    pub quarantined: u64,
    /// All that was not right.
    pub problems: Vec<String>,
}

/// The head of the table.
pub const HEAD: &str = "class                  sched  injected contained attributed recovered stopped  missed/ctl   gap/ctl     p50 us    p99.9 us";

impl Row {
    /// One line of the table.
    #[must_use]
    pub fn text(&self) -> String {
        let Self { class, injected, contained, attributed, recovered, stopped, .. } = self;
        let missed = format!("{}/{}", self.missed, self.missed_control);
        let gap = format!("{}/{}", self.gap, self.gap_control);
        let micros = |nanos: u64| if nanos == 0 { "-".to_owned() } else { format!("{:.1}", nanos as f64 / 1e3) };
        let verdict = if self.problems.is_empty() { String::new() } else { format!("   {}", self.problems.join("; ")) };
        format!(
            "{class:22} {:6} {injected:8} {contained:9} {attributed:10} {recovered:9} {stopped:7} {missed:>11} {gap:>9} {:>10} {:>11}{verdict}",
            self.policy.name(),
            micros(self.p50_ns),
            micros(self.p999_ns),
        )
    }

    /// One line of JSON.
    #[must_use]
    pub fn json(&self) -> Value {
        json!({"class": self.class, "sched": self.policy.name(), "injected": self.injected, "contained": self.contained,
            "attributed": self.attributed, "recovered": self.recovered, "stopped": self.stopped,
            "missed_worst": self.missed, "missed_worst_control": self.missed_control,
            "gap_worst": self.gap, "gap_worst_control": self.gap_control, "quarantined": self.quarantined,
            "p50_ns": self.p50_ns, "p999_ns": self.p999_ns, "problems": self.problems})
    }

    /// Periods that the others missed beyond one a fault and what they miss without any.
    #[must_use]
    pub fn missed_beyond(&self) -> u64 {
        self.missed.saturating_sub(self.missed_control + self.injected as u64)
    }
}
