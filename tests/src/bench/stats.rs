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

/// What was measured, and how.
#[derive(Clone, Copy, Debug)]
pub struct Setting<'a> {
    /// Name of the benchmark.
    pub bench: &'a str,
    /// What it was about.
    pub payload: &'a str,
    /// `idle`, `cpu100`.
    pub load: &'a str,
    /// `other`, `fifo`.
    pub sched: &'a str,
}

impl Setting<'_> {
    /// The benchmark's own fields, and those of its raw limit under `limit`, where it has one.
    #[must_use]
    pub fn line(&self, own: &mut Samples, limit: Option<&mut Samples>) -> Value {
        let mut object = own.fields();
        object["bench"] = self.bench.into();
        object["payload"] = self.payload.into();
        object["load"] = self.load.into();
        object["sched"] = self.sched.into();
        if let Some(limit) = limit {
            object["limit"] = limit.fields();
        }
        object
    }
}
