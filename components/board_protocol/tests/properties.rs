//! Whatever comes over the line: nothing panics, nothing is invented, and good frames behind noise are found.

use board_protocol::{
    Command, Counters, Decoder, DriverPower, Encoder, Encoders, MAX_FRAME_BYTES, Message, Status, StatusFlags,
    Telemetry, Ultrasonic, WheelVelocities,
};
use proptest::prelude::*;

fn command() -> impl Strategy<Value = Command> {
    prop_oneof![
        (-100.0f32..100.0, -100.0f32..100.0).prop_map(|(left_rad_s, right_rad_s)| Command::WheelVelocities(
            WheelVelocities { left_rad_s, right_rad_s }
        )),
        Just(Command::EmergencyStop),
        Just(Command::Release),
        any::<(bool, bool)>().prop_map(|(left, right)| Command::DriverPower(DriverPower { left, right })),
    ]
}

fn telemetry() -> impl Strategy<Value = Telemetry> {
    prop_oneof![
        any::<(u32, [i32; 4])>().prop_map(|(time_us, ticks)| Telemetry::Encoders(Encoders { time_us, ticks })),
        any::<(u32, [u16; 12])>()
            .prop_map(|(time_us, ranges_mm)| Telemetry::Ultrasonic(Ultrasonic { time_us, ranges_mm })),
        any::<(u8, u16)>()
            .prop_map(|(flags, supply_mv)| Telemetry::Status(Status { flags: StatusFlags(flags), supply_mv })),
    ]
}

fn encoded<M: Message>(messages: &[M]) -> Vec<Vec<u8>> {
    let mut encoder = Encoder::new();
    messages.iter().map(|message| encoder.encode(message).to_vec()).collect()
}

fn decoded<M: Message>(bytes: &[u8]) -> (Vec<M>, Counters) {
    let mut decoder = Decoder::new();
    let mut messages = Vec::new();
    decoder.feed(bytes, |message| messages.push(message));
    (messages, decoder.counters())
}

proptest! {
    #[test]
    fn any_bytes_are_survived(bytes in proptest::collection::vec(any::<u8>(), 0..2000)) {
        decoded::<Command>(&bytes);
        decoded::<Telemetry>(&bytes);
    }

    #[test]
    fn sync_heavy_bytes_are_survived(bytes in proptest::collection::vec(
        prop_oneof![Just(0xA5u8), Just(0x5A), 0u8..80], 0..2000)) {
        decoded::<Telemetry>(&bytes);
    }

    #[test]
    fn commands_come_back_in_pieces_of_any_size(
        commands in proptest::collection::vec(command(), 0..300), piece in 1usize..40) {
        let bytes = encoded(&commands).concat();
        let (mut decoder, mut messages) = (Decoder::<Command>::new(), Vec::new());
        bytes.chunks(piece).for_each(|chunk| decoder.feed(chunk, |message| messages.push(message)));
        prop_assert_eq!(&messages, &commands);
        let clean = Counters { frames: u32::try_from(commands.len()).unwrap(), ..Counters::default() };
        prop_assert_eq!(decoder.counters(), clean);
    }

    #[test]
    fn telemetry_comes_back(messages in proptest::collection::vec(telemetry(), 0..50)) {
        prop_assert_eq!(decoded::<Telemetry>(&encoded(&messages).concat()).0, messages);
    }

    /// Noise may hold back at most what it can pretend to be the beginning of: one longest frame.
    #[test]
    fn frames_after_noise_are_found(
        noise in proptest::collection::vec(any::<u8>(), 0..200), messages in proptest::collection::vec(telemetry(), 1..20)) {
        let mut bytes = noise;
        bytes.extend(encoded(&messages).concat());
        bytes.extend([0; MAX_FRAME_BYTES]);
        prop_assert!(decoded::<Telemetry>(&bytes).0.ends_with(&messages));
    }

    #[test]
    fn a_flipped_bit_costs_one_frame_and_is_counted(
        messages in proptest::collection::vec(telemetry(), 3..10), bit in 0usize..56) {
        let mut frames = encoded(&messages);
        frames[1][bit / 8] ^= 1 << (bit % 8);
        let mut bytes = frames.concat();
        bytes.extend([0; MAX_FRAME_BYTES]);
        let (received, counters) = decoded::<Telemetry>(&bytes);
        prop_assert_eq!(received.len(), messages.len() - 1);
        prop_assert_eq!(counters.lost, 1);
        prop_assert!(counters.checksum_errors + counters.skipped_bytes > 0);
    }

    #[test]
    fn gaps_are_counted(messages in proptest::collection::vec(telemetry(), 20..300), gap in 1usize..18) {
        let mut frames = encoded(&messages);
        frames.drain(1..=gap);
        prop_assert_eq!(decoded::<Telemetry>(&frames.concat()).1.lost, u32::try_from(gap).unwrap());
    }
}

#[test]
fn a_speed_that_is_no_number_is_rejected() {
    let wild = Command::WheelVelocities(WheelVelocities { left_rad_s: f32::NAN, right_rad_s: 0.0 });
    let (messages, counters) = decoded::<Command>(&encoded(&[wild]).concat());
    assert!(messages.is_empty());
    assert_eq!(counters.rejected, 1);
}

#[test]
fn a_telemetry_frame_is_not_a_command() {
    let status = Telemetry::Status(Status { flags: StatusFlags::EMERGENCY, supply_mv: 11_900 });
    let (messages, counters) = decoded::<Command>(&encoded(&[status]).concat());
    assert!(messages.is_empty());
    assert_eq!((counters.frames, counters.rejected), (0, 1));
}

#[test]
fn the_layout_on_the_line_is_the_documented_one() {
    let frame = Encoder::new().encode(&Command::DriverPower(DriverPower { left: true, right: false }));
    assert_eq!(&frame[..6], [0xA5, 0x5A, 1, 0, 0x04, 1]);
    assert_eq!(frame[6..], board_protocol::crc16(&frame[2..6]).to_le_bytes());
}
