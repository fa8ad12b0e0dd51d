//! Both components on the bench.

use component_sdk::prelude::*;
use component_sdk::testing::Bench;
use paper_example::{First, ScanRequest, Second, StampRequest};

#[test]
fn first_logs_the_second_answer_before_the_first() {
    let mut bench = Bench::<First>::new().unwrap();
    bench.answer("time", |_: &StampRequest| Ok(Time { sec: 7, nanosec: 5 }));
    bench.answer("laser", |request: &ScanRequest| {
        let ranges = (0..request.rays).map(|_| 2.5).collect();
        Ok(LaserScan { ranges, ..LaserScan::default() })
    });
    bench.execute().unwrap();
    let logs: Vec<_> = Bench::<First>::logs().into_iter().map(|(_, text)| text).collect();
    let expected = [
        "round 1: asked for a time stamp, then for a scan",
        "round 1: the scan of 0.000000000 s: 181 rays, nearest 2.50 m",
        "round 1: the time stamp: 7.000000005 s",
    ];
    assert_eq!(logs, expected);
}

#[test]
fn second_answers_one_query_in_each_period_in_the_order_of_the_questions() {
    let mut bench = Bench::<Second>::new().unwrap();
    let stamp = bench.ask::<_, Time>("time", StampRequest { round: 1 }).unwrap();
    let scan = bench.ask::<_, LaserScan>("laser", ScanRequest { rays: 3 }).unwrap();
    assert_eq!(bench.answered(&scan).unwrap_err(), Status::NoData, "the handler only queues");
    bench.execute().unwrap();
    assert_eq!(bench.answered(&stamp).unwrap(), Time { sec: 1, nanosec: 0 });
    assert_eq!(bench.answered(&scan).unwrap_err(), Status::NoData);
    bench.execute().unwrap();
    let scan = bench.answered(&scan).unwrap();
    assert!(scan.ranges.iter().all(|range| (range - 2.0).abs() < 1e-6), "a wall on each side: {:?}", scan.ranges);
    bench.execute().unwrap();
}
