//! A callback that returned, but late.

/// True beyond the budget; exactly in time is in time.
#[must_use]
pub const fn is_overrun(took_ns: u64, budget_ns: u64) -> bool {
    took_ns > budget_ns
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn more_time_never_makes_an_overrun(took in any::<u64>(), budget in any::<u64>(), more in any::<u64>()) {
            prop_assert!(!is_overrun(took, took));
            prop_assert!(is_overrun(took, budget) || !is_overrun(took, budget.saturating_add(more)));
        }
    }
}
