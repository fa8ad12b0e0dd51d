//! Percentiles and the printed form.

use serde_json::{Value, json};

/// Nanoseconds, one a sample.
#[derive(Debug, Default)]
pub struct Samples(Vec<u64>);

impl Samples {
    /// Adds one.
    pub fn add(&mut self, nanos: u64) {
        self.0.push(nanos);
    }

    /// The sample at that share of all, in order: 0.5 is the median; 0 where there is none.
    #[must_use]
    pub fn at(&mut self, share: f64) -> u64 {
        self.0.sort_unstable();
        self.0.get(((self.0.len().max(1) - 1) as f64 * share) as usize).copied().unwrap_or(0)
    }

    /// `n`, `min_ns`, `p50_ns`, `p99_ns`, `p999_ns`, `max_ns`.
    #[must_use]
    pub fn fields(&mut self) -> Value {
        json!({"n": self.0.len(), "min_ns": self.at(0.0), "p50_ns": self.at(0.5), "p99_ns": self.at(0.99),
            "p999_ns": self.at(0.999), "max_ns": self.at(1.0)})
    }
}

/// One line: the benchmark's own fields, and those of its raw limit under `limit`.
#[must_use]
pub fn line(bench: &str, payload: &str, load: &str, sched: &str, own: &mut Samples, limit: &mut Samples) -> String {
    let mut object = own.fields();
    object["bench"] = bench.into();
    object["payload"] = payload.into();
    object["load"] = load.into();
    object["sched"] = sched.into();
    object["limit"] = limit.fields();
    object.to_string()
}
