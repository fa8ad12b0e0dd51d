//! The torture campaign, short: each class of misbehaviour twenty times in one life of a daemon beside twenty other slots.
//!
//! `scripts/torture` runs it longer, under both scheduling policies, and prints a table.

use tests::campaign::classes::group;
use tests::campaign::layout::Policy;
use tests::campaign::row::{HEAD, Row};
use tests::campaign::run;

const STRIKES: usize = 20;

/// Every class of the group is contained, blamed and answered; the others run on.
fn torture(name: &str) {
    let classes = group(name);
    assert!(!classes.is_empty());
    let rows: Vec<_> = classes.iter().map(|class| run::run(class, STRIKES, Policy::Other)).collect();
    let wrong: Vec<_> = rows.iter().filter(|row| !row.problems.is_empty()).map(Row::text).collect();
    assert!(wrong.is_empty(), "\n{HEAD}\n{}", wrong.join("\n"));
}

#[test]
fn panics_are_contained() {
    torture("panics");
}

#[test]
fn instructions_that_trap_are_contained() {
    torture("instructions");
}

#[test]
fn bad_addresses_are_contained() {
    torture("memory");
}

#[test]
fn the_end_of_the_process_is_not_for_components() {
    torture("process");
}

#[test]
fn callbacks_that_do_not_return_are_contained() {
    torture("hangs");
}

#[test]
fn threads_of_components_are_contained() {
    torture("threads");
}

#[test]
fn floating_point_control_is_nobodys_but_its_owners() {
    torture("float");
}

#[test]
fn bad_pointers_given_to_the_host_are_contained() {
    torture("calls");
}

#[test]
fn forged_handles_and_numbers_are_refused() {
    torture("forged");
}

#[test]
fn faults_while_others_wait_are_contained() {
    torture("parked");
}

#[test]
fn faults_in_every_callback_are_contained() {
    torture("hooks");
}
