//! Some thousand faults in one life of a daemon: what it holds does not grow. `scripts/soak` runs a million.

#[test]
fn what_the_daemon_holds_does_not_grow_with_the_number_of_faults() {
    let soak = tests::soak::run(6_000, &[1_000], |_| {});
    assert!(soak.problems.is_empty(), "{soak:#?}");
    assert!(soak.quarantined > 0, "{soak:#?}");
}
