//! CDR of every message. The first byte of the input selects the type; the rest is the payload with its four header
//! bytes.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_msgs::{
    CoilCurrent, CommandVoltage, CurrentCommand, Displacement, EffectValue, Force, ForceEstimate,
    ForceResidual, ModeChange, Velocity,
};
use mr_damper_msgs::{
    MESSAGES, Message, action, cdr, geometry, lifecycle, rcl, rosbag2, srv, standard, type_description,
};
use std::sync::Once;

/// Name and test of a type.
type Entry = (&'static str, fn(&[u8]));

macro_rules! entries {
    ($($type:ty),+ $(,)?) => { &[$((<$type>::TYPE, comes_back::<$type>)),+] };
}

/// Every message, and every part of a service or action.
const ALL: &[Entry] = entries![
    CoilCurrent,
    CommandVoltage,
    CurrentCommand,
    Displacement,
    EffectValue,
    Force,
    ForceEstimate,
    ForceResidual,
    ModeChange,
    Velocity,
    action::CloseLoopGoal,
    action::CloseLoopResult,
    action::CloseLoopFeedback,
    action::DesignGoal,
    action::DesignResult,
    action::DesignFeedback,
    action::IdentifyGoal,
    action::IdentifyResult,
    action::IdentifyFeedback,
    lifecycle::State,
    lifecycle::Transition,
    lifecycle::TransitionDescription,
    lifecycle::TransitionEvent,
    lifecycle::GetStateRequest,
    lifecycle::GetStateResponse,
    lifecycle::ChangeStateRequest,
    lifecycle::ChangeStateResponse,
    lifecycle::GetAvailableStatesRequest,
    lifecycle::GetAvailableStatesResponse,
    lifecycle::GetAvailableTransitionsRequest,
    lifecycle::GetAvailableTransitionsResponse,
    rcl::ParameterValue,
    rcl::Parameter,
    rcl::FloatingPointRange,
    rcl::IntegerRange,
    rcl::ParameterDescriptor,
    rcl::ParameterEvent,
    rcl::SetParametersResult,
    rcl::ListParametersResult,
    rcl::Log,
    rcl::GetParametersRequest,
    rcl::GetParametersResponse,
    rcl::GetParameterTypesRequest,
    rcl::GetParameterTypesResponse,
    rcl::SetParametersRequest,
    rcl::SetParametersResponse,
    rcl::SetParametersAtomicallyRequest,
    rcl::SetParametersAtomicallyResponse,
    rcl::ListParametersRequest,
    rcl::ListParametersResponse,
    rcl::DescribeParametersRequest,
    rcl::DescribeParametersResponse,
    rosbag2::PauseRequest,
    rosbag2::PauseResponse,
    rosbag2::ResumeRequest,
    rosbag2::ResumeResponse,
    rosbag2::TogglePausedRequest,
    rosbag2::TogglePausedResponse,
    rosbag2::IsPausedRequest,
    rosbag2::IsPausedResponse,
    rosbag2::GetRateRequest,
    rosbag2::GetRateResponse,
    rosbag2::SetRateRequest,
    rosbag2::SetRateResponse,
    rosbag2::PlayNextRequest,
    rosbag2::PlayNextResponse,
    rosbag2::BurstRequest,
    rosbag2::BurstResponse,
    rosbag2::SeekRequest,
    rosbag2::SeekResponse,
    srv::LoadModelRequest,
    srv::LoadModelResponse,
    srv::ResetRequest,
    srv::ResetResponse,
    srv::SetModeRequest,
    srv::SetModeResponse,
    standard::Float64,
    standard::Time,
    standard::Header,
    standard::Clock,
    standard::Temperature,
    standard::JointState,
    standard::KeyValue,
    standard::DiagnosticStatus,
    standard::DiagnosticArray,
    type_description::FieldType,
    type_description::Field,
    type_description::IndividualTypeDescription,
    type_description::TypeDescription,
    type_description::TypeSource,
    type_description::KeyValue,
    type_description::GetTypeDescriptionRequest,
    type_description::GetTypeDescriptionResponse,
    standard::Float32,
    standard::Range,
    geometry::Vector3,
    geometry::Wrench,
    geometry::WrenchStamped,
    geometry::Twist,
    geometry::TwistStamped,
];

fuzz_target!(|bytes: &[u8]| {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let missing = MESSAGES.iter().find(|of| ALL.iter().all(|(name, _)| *name != of.type_name));
        assert!(missing.is_none(), "{missing:?} is not among the tested types");
    });
    if let Some((which, payload)) = bytes.split_first() {
        let (_, check) = ALL[usize::from(*which) % ALL.len()];
        check(payload);
    }
});

/// A message that was read can be written, the result reads as the same message, and without its last byte it is refused.
fn comes_back<M: Message>(payload: &[u8]) {
    let message: M = match cdr::from_slice(payload) {
        Ok(message) => message,
        Err(error) => return assert!(error.to_string().starts_with(M::TYPE), "{error}"),
    };
    let written = cdr::to_vec(&message).expect("what was read can be written");
    let again: M = cdr::from_slice(&written).unwrap_or_else(|error| panic!("our own bytes: {error}"));
    // Compares bytes, because a message may hold NaN.
    assert_eq!(cdr::to_vec(&again).expect("written before"), written);
    assert!(
        cdr::from_slice::<M>(&written[..written.len() - 1]).is_err(),
        "{message:?} is accepted without its last byte"
    );
    // Strings and lists take no more memory than the input justifies.
    assert!(written.len() <= 2 * payload.len() + 8, "{} bytes became {}", payload.len(), written.len());
}
