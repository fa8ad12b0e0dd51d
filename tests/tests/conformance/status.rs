//! The codes of the statuses. Who returns them is shown where that is done.

use component_sdk::status::Status;

/// The second generation's column of the table.
const SECOND_GENERATION: [(Status, u32); 21] = [
    (Status::NoData, 1),
    (Status::Cancelled, 2),
    (Status::Unsubscribed, 3),
    (Status::WrongId, 4),
    (Status::UnknownState, 5),
    (Status::NotActivated, 6),
    (Status::Activated, 7),
    (Status::NotAllowed, 8),
    (Status::Active, 9),
    (Status::Passive, 10),
    (Status::Disconnected, 11),
    (Status::IncompatibleService, 12),
    (Status::PortAlreadyUsed, 13),
    (Status::UnknownPort, 14),
    (Status::ServiceUnavailable, 15),
    (Status::UnknownComponent, 16),
    (Status::Timeout, 17),
    (Status::Error, 512),
    (Status::ErrorCommunication, 513),
    (Status::ErrorUnknown, 514),
    (Status::ErrorFatal, 515),
];

const OWN: [Status; 6] = [
    Status::ProviderGone,
    Status::ProviderStopped,
    Status::ProviderReplaced,
    Status::Cycle,
    Status::Overload,
    Status::Closed,
];

/// The statuses whose codes are in that range.
fn within(codes: std::ops::Range<u32>) -> Vec<Status> {
    Status::ALL.iter().copied().filter(|status| codes.contains(&status.code())).collect()
}

#[test]
fn ok_is_zero() {
    // Success is the `Ok` of a result: no status has its code, on either way across the border.
    assert_eq!(within(0..1), []);
    assert_eq!(Status::from_code(0), Status::Error);
}

#[test]
fn g2_values_are_kept() {
    for (status, code) in SECOND_GENERATION {
        assert_eq!((status.code(), Status::from_code(code)), (code, status));
    }
    assert_eq!(within(0..1024).len(), SECOND_GENERATION.len(), "no others are among them");
}

#[test]
fn status_marker_has_no_use() {
    assert_eq!(within(256..512), [], "neither the marker nor what the first generation has above it");
    assert_eq!(Status::from_code(256), Status::Error);
}

#[test]
fn error_is_512() {
    assert_eq!(Status::Error.code(), 512);
    // Whatever nobody knows is one.
    assert!([18, 257, 511, 516, 1023, 4096, u32::MAX].iter().all(|code| Status::from_code(*code) == Status::Error));
}

#[test]
fn error_communication_reserved() {
    let reserved = [Status::ErrorCommunication, Status::ErrorUnknown, Status::ErrorFatal];
    assert_eq!(within(513..1024), reserved);
}

#[test]
fn own_codes_begin_at_1024() {
    assert_eq!(within(1024..u32::MAX), OWN);
    let codes: Vec<u32> = OWN.iter().map(|status| status.code()).collect();
    assert_eq!(codes, (1024..1030).collect::<Vec<u32>>());
}
