//! The component on the bench: what it wires, and when.

use std::time::Duration;

use component_sdk::testing::Bench;
use skill_switch::SkillSwitch;

/// What was wired in this period.
fn wired(bench: &mut Bench<SkillSwitch>, known: &mut usize) -> Vec<String> {
    bench.execute().unwrap();
    let all = Bench::<SkillSwitch>::wirings();
    all[std::mem::replace(known, all.len())..].to_vec()
}

#[test]
fn the_next_one_knows_the_course_before_it_drives() {
    let mut bench = Bench::<SkillSwitch>::with(&[("each", "1"), ("overlap", "0.2")]).unwrap();
    bench.start().unwrap();
    let mut known = 0;
    let handed_over =
        |who: &str, other: &str| vec![format!("motors.command - {who}.command"), format!("{other}.course -")];
    let first = wired(&mut bench, &mut known);
    assert_eq!(first[0], "avoider_a.course - planner.course");
    assert_eq!(first[1..], handed_over("avoider_a", "avoider_b"));
    for (who, other) in [("avoider_b", "avoider_a"), ("avoider_a", "avoider_b")] {
        bench.advance(Duration::from_millis(900));
        assert!(wired(&mut bench, &mut known).is_empty());
        bench.advance(Duration::from_millis(100));
        assert_eq!(wired(&mut bench, &mut known), [format!("{who}.course - planner.course")]);
        bench.advance(Duration::from_millis(100));
        assert!(wired(&mut bench, &mut known).is_empty());
        bench.advance(Duration::from_millis(100));
        assert_eq!(wired(&mut bench, &mut known), handed_over(who, other));
    }
}
