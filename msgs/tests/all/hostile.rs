//! Bytes that are not messages: reading never panics, never allocates memory for missing bytes, and reports the
//! place.

use mr_damper_msgs::standard::{DiagnosticArray, Float64, Header, JointState, Time};
use mr_damper_msgs::{CdrError, Force, ForceEstimate, Message, ModeChange, Reasons, cdr};
use proptest::prelude::*;

const LITTLE: [u8; 4] = [0, 1, 0, 0];

fn payload(body: &[u8]) -> Vec<u8> {
    [&LITTLE, body].concat()
}

fn error<M: Message>(bytes: &[u8]) -> String {
    cdr::from_slice::<M>(bytes).expect_err("not a message").to_string()
}

#[test]
fn errors_name_the_type_and_the_place() {
    assert_eq!(
        cdr::from_slice::<Force>(&[0, 1]),
        Err(CdrError::NoHeader { type_name: "mr_damper_msgs/msg/Force", len: 2 })
    );
    assert_eq!(error::<Force>(&[]), "mr_damper_msgs/msg/Force: payload of 0 bytes has no 4-byte CDR header");
    // A stamp and an empty frame; the padding and the force are missing.
    let cut = payload(&[1, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0, 0]);
    assert_eq!(error::<Force>(&cut), "mr_damper_msgs/msg/Force: at byte 17 of 17: unexpected end of input");
    assert_eq!(
        error::<Force>(&[0, 7, 0, 0, 9]),
        "mr_damper_msgs/msg/Force: encoding 00 07 is not plain CDR (00 00 or 00 01); set the sender to XCDR1, \
         final types"
    );
}

/// From rclpy (Kilted, Fast CDR): `serialize_message` of a joint without velocity. The padding holds leftover
/// memory, and eight extra bytes follow the message.
const RCLPY_JOINT_STATE: &[u8] = b"\
    \x00\x01\x00\x00\x01\x00\x00\x00\x02\x00\x00\x00\x02\x00\x00\x00b\x00\xde\x54\x01\x00\x00\x00\
    \x04\x00\x00\x00rrr\x00\x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\xe0\x3f\x00\x00\x00\x00\
    \x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\xc0\x54\x7f\x00\x00\xd0\x02\x53\x54";

#[test]
fn bytes_after_the_message_are_ignored() {
    let expected = JointState {
        header: Header { stamp: Time { sec: 1, nanosec: 2 }, frame_id: "b".into() },
        name: vec!["rrr".into()],
        position: vec![0.5],
        velocity: vec![],
        effort: vec![-2.0],
    };
    let ours = cdr::to_vec(&expected).expect("writable");
    assert_eq!((ours.len(), RCLPY_JOINT_STATE.len()), (60, 68));
    assert_eq!(cdr::from_slice(RCLPY_JOINT_STATE), Ok(expected.clone()));
    assert_eq!(cdr::from_slice(&[&ours, &[7; 100][..]].concat()), Ok(expected));
}

#[test]
fn header_options_are_ignored() {
    assert_eq!(cdr::from_slice::<Float64>(&[0, 1, 0, 3, 0, 0, 0, 0, 0, 0, 0, 0]), Ok(Float64 { data: 0.0 }));
}

/// Fast CDR leaves previous buffer content in the padding.
#[test]
fn padding_may_hold_anything() {
    let force = Force { force: 512.0, variance: 4.0, ..Force::default() };
    let mut bytes = cdr::to_vec(&force).expect("writable");
    assert_eq!(bytes[17..20], [0; 3], "the padding between the empty frame and the force");
    bytes[17..20].copy_from_slice(b"t/r");
    assert_eq!(cdr::from_slice(&bytes), Ok(force));
}

#[test]
fn impossible_values_are_refused() {
    // A frame of two bytes that are not UTF-8, with its terminator.
    let text = payload(&[0, 0, 0, 0, 0, 0, 0, 0, 3, 0, 0, 0, 0xff, 0xfe, 0]);
    assert!(error::<Header>(&text).contains("UTF-8"), "{}", error::<Header>(&text));
    let request = mr_damper_msgs::srv::SetModeRequest { mode: 1, automatic: true };
    let mut bytes = cdr::to_vec(&request).expect("writable");
    *bytes.last_mut().expect("a Boolean") = 2;
    assert!(error::<mr_damper_msgs::srv::SetModeRequest>(&bytes).contains("Boolean"));
}

/// Lengths of 2^32 - 1 with no data behind them. Allocating that much memory would end the test.
#[test]
fn huge_lengths_are_refused() {
    let huge = u32::MAX.to_le_bytes();
    let string = payload(&[&[0; 8], &huge[..], b"abc\0"].concat());
    assert!(error::<Header>(&string).contains("end of input"));
    // Sequences of strings, numbers and messages, after a header with an empty frame.
    let start = [&[0; 8][..], &[1, 0, 0, 0, 0, 0, 0, 0]].concat();
    let strings = payload(&[&start, &huge[..]].concat());
    assert!(error::<JointState>(&strings).contains("end of input"));
    let numbers = payload(&[&start, &[0; 4][..], &huge[..], &[0; 64]].concat());
    assert!(error::<JointState>(&numbers).contains("end of input"));
    let messages = payload(&[&start, &huge[..], &[0; 64]].concat());
    assert!(error::<DiagnosticArray>(&messages).contains("end of input"));
}

#[test]
fn a_buffer_is_reused() {
    let mut buffer = Vec::new();
    let long = ModeChange { reason: "measured force is old".repeat(4), ..ModeChange::default() };
    cdr::write_into(&long, &mut buffer).expect("writable");
    let (place, capacity) = (buffer.as_ptr(), buffer.capacity());
    let short = ForceEstimate { force: 3.5, reasons: Reasons::LATE, ..ForceEstimate::default() };
    cdr::write_into(&short, &mut buffer).expect("writable");
    assert_eq!((buffer.as_ptr(), buffer.capacity()), (place, capacity));
    assert_eq!(buffer, cdr::to_vec(&short).expect("writable"));
}

/// Random bytes may be read as any message, but the message must be writable and survive a second round trip
/// unchanged.
fn no_panic<M: Message>(bytes: &[u8]) {
    if let Ok(message) = cdr::from_slice::<M>(bytes) {
        let written = cdr::to_vec(&message).expect("writable");
        let again: M = cdr::from_slice(&written).expect("our own bytes");
        assert_eq!(cdr::to_vec(&again).expect("writable"), written);
    }
}

fn header() -> impl Strategy<Value = Header> {
    (any::<i32>(), any::<u32>(), any::<String>())
        .prop_map(|(sec, nanosec, frame_id)| Header { stamp: Time { sec, nanosec }, frame_id })
}

prop_compose! {
    fn estimate()(
        header in header(),
        numbers in any::<[f64; 5]>(),
        model in any::<String>(),
        bytes in any::<[u8; 2]>(),
        bits in any::<u32>(),
        band_calibrated in any::<bool>(),
    ) -> ForceEstimate {
        let [force, std_dev, input_age, band_low, band_high] = numbers;
        let ([mode, validity], reasons) = (bytes, Reasons::from_bits(bits));
        ForceEstimate {
            header, force, std_dev, model, mode, validity, reasons, input_age, band_low, band_high, band_calibrated,
        }
    }
}

prop_compose! {
    fn joints()(
        header in header(),
        name in proptest::collection::vec(any::<String>(), 0..4),
        lists in any::<[[f64; 2]; 3]>(),
    ) -> JointState {
        let [position, velocity, effort] = lists.map(|list| list.to_vec());
        JointState { header, name, position, velocity, effort }
    }
}

proptest! {
    #[test]
    fn noise_does_not_panic(
        kind in 0u8..3,
        // Small numbers give lengths that sometimes fit.
        body in proptest::collection::vec(prop_oneof![Just(0u8), 0u8..5, any::<u8>()], 0..300),
    ) {
        let bytes = [&[0, kind, 0, 0][..], &body].concat();
        no_panic::<ForceEstimate>(&bytes);
        no_panic::<JointState>(&bytes);
        no_panic::<DiagnosticArray>(&bytes);
    }

    #[test]
    fn a_damaged_message_does_not_panic(message in joints(), at in any::<prop::sample::Index>(), byte: u8) {
        let mut bytes = cdr::to_vec(&message).expect("writable");
        let at = at.index(bytes.len());
        bytes[at] = byte;
        no_panic::<JointState>(&bytes);
        no_panic::<DiagnosticArray>(&bytes);
    }

    #[test]
    fn every_message_round_trips(estimate in estimate(), joints in joints()) {
        let bytes = cdr::to_vec(&estimate).expect("writable");
        prop_assert_eq!(cdr::from_slice::<ForceEstimate>(&bytes).expect("our own bytes"), estimate);
        let bytes = cdr::to_vec(&joints).expect("writable");
        prop_assert_eq!(cdr::from_slice::<JointState>(&bytes).expect("our own bytes"), joints.clone());
        prop_assert!(cdr::from_slice::<JointState>(&bytes[..bytes.len() - 1]).is_err());
    }
}
