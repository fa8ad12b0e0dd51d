//! When to try again to open a device that is lost.

/// Paces attempts: the first at once, the next after a pause each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Retry {
    next_ns: u64,
}

/// Time between two attempts, in ns: short against a person's patience, long against what an attempt costs.
const PAUSE_NS: u64 = 250_000_000;

impl Retry {
    /// Whether to try now (`now_ns` on the monotonic clock). True at most every 250 ms.
    pub fn is_due(&mut self, now_ns: u64) -> bool {
        let due = now_ns >= self.next_ns;
        if due {
            self.next_ns = now_ns.saturating_add(PAUSE_NS);
        }
        due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_once_and_then_with_pauses() {
        let mut retry = Retry::default();
        let tries = (0..100).filter(|step| retry.is_due(step * 10_000_000)).count();
        assert_eq!(tries, 4);
    }
}
