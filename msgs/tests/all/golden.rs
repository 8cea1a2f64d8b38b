//! Compares our bytes, type hashes and field names with the results of PyPI rosbags for the same
//! definitions.
//!
//! `golden/generate.py` writes the tables; `generate.py --check` checks that they are up to date.

use std::collections::BTreeSet;

use mr_damper_msgs::action::{
    CloseLoopFeedback, CloseLoopGoal, CloseLoopResult, DesignFeedback, DesignGoal, DesignResult,
    IdentifyFeedback, IdentifyGoal, IdentifyResult,
};
use mr_damper_msgs::geometry::{Twist, TwistStamped, Vector3, Wrench, WrenchStamped};
use mr_damper_msgs::lifecycle::{
    ChangeState, ChangeStateRequest, ChangeStateResponse, GetAvailableStates, GetAvailableStatesRequest,
    GetAvailableStatesResponse, GetAvailableTransitions, GetAvailableTransitionsRequest,
    GetAvailableTransitionsResponse, GetState, GetStateRequest, GetStateResponse, State, Transition,
    TransitionDescription, TransitionEvent,
};
use mr_damper_msgs::rcl::{
    DescribeParameters, DescribeParametersRequest, DescribeParametersResponse, FloatingPointRange,
    GetParameterTypes, GetParameterTypesRequest, GetParameterTypesResponse, GetParameters,
    GetParametersRequest, GetParametersResponse, IntegerRange, ListParameters, ListParametersRequest,
    ListParametersResponse, ListParametersResult, Log, Parameter, ParameterDescriptor, ParameterEvent,
    ParameterValue, SetParameters, SetParametersAtomically, SetParametersAtomicallyRequest,
    SetParametersAtomicallyResponse, SetParametersRequest, SetParametersResponse, SetParametersResult,
};
use mr_damper_msgs::rosbag2::{
    Burst, BurstRequest, BurstResponse, GetRate, GetRateRequest, GetRateResponse, IsPaused, IsPausedRequest,
    IsPausedResponse, Pause, PauseRequest, PauseResponse, PlayNext, PlayNextRequest, PlayNextResponse,
    Resume, ResumeRequest, ResumeResponse, Seek, SeekRequest, SeekResponse, SetRate, SetRateRequest,
    SetRateResponse, TogglePaused, TogglePausedRequest, TogglePausedResponse,
};
use mr_damper_msgs::srv::{
    LoadModel, LoadModelRequest, LoadModelResponse, Reset, ResetRequest, ResetResponse, SetMode,
    SetModeRequest, SetModeResponse,
};
use mr_damper_msgs::standard::{
    Clock, DiagnosticArray, DiagnosticStatus, Float32, Float64, Header, JointState, KeyValue, Range,
    Temperature, Time,
};
use mr_damper_msgs::type_description::{
    self, Field, FieldType, GetTypeDescription, GetTypeDescriptionRequest, GetTypeDescriptionResponse,
    IndividualTypeDescription, TypeDescription, TypeSource,
};
use mr_damper_msgs::{
    CoilCurrent, CommandVoltage, CurrentCommand, Descriptor, Displacement, EffectValue, Force, ForceEstimate,
    ForceResidual, MESSAGES, Message, ModeChange, Service, Velocity, cdr, msgdef, rihs01,
};

type TypeKeyValue = type_description::KeyValue;

const CDR: &str = include_str!("golden/cdr.tsv");
const HASHES: &str = include_str!("golden/hashes.tsv");

/// Runs `$check::<M>()` for every message type of the crate.
macro_rules! for_every_message {
    ($check:ident) => {
        for_every_message!(
            $check: CoilCurrent CommandVoltage CurrentCommand Displacement EffectValue Force ForceEstimate ForceResidual
            ModeChange Velocity Time DiagnosticArray DiagnosticStatus KeyValue Clock JointState Temperature
            Float64 Float32 Range Vector3 Wrench WrenchStamped Twist TwistStamped Header LoadModelRequest LoadModelResponse ResetRequest ResetResponse SetModeRequest
            SetModeResponse CloseLoopGoal CloseLoopResult CloseLoopFeedback DesignGoal DesignResult
            DesignFeedback IdentifyGoal IdentifyResult
            IdentifyFeedback State Transition TransitionDescription TransitionEvent GetStateRequest
            GetStateResponse ChangeStateRequest ChangeStateResponse GetAvailableStatesRequest
            GetAvailableStatesResponse GetAvailableTransitionsRequest GetAvailableTransitionsResponse
            ParameterValue Parameter FloatingPointRange IntegerRange ParameterDescriptor ParameterEvent
            SetParametersResult ListParametersResult Log GetParametersRequest GetParametersResponse
            GetParameterTypesRequest GetParameterTypesResponse SetParametersRequest SetParametersResponse
            SetParametersAtomicallyRequest SetParametersAtomicallyResponse ListParametersRequest
            ListParametersResponse DescribeParametersRequest DescribeParametersResponse FieldType Field
            IndividualTypeDescription TypeDescription TypeSource TypeKeyValue GetTypeDescriptionRequest
            GetTypeDescriptionResponse PauseRequest PauseResponse ResumeRequest ResumeResponse
            TogglePausedRequest TogglePausedResponse IsPausedRequest IsPausedResponse GetRateRequest
            GetRateResponse SetRateRequest SetRateResponse PlayNextRequest PlayNextResponse BurstRequest
            BurstResponse SeekRequest SeekResponse
        )
    };
    ($check:ident: $($message:ident)+) => { [$($check::<$message>()),+] };
}

fn rows<const N: usize>(table: &'static str) -> Vec<[&'static str; N]> {
    let rows: Vec<[&str; N]> = table
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| line.split('\t').collect::<Vec<_>>().try_into().expect("columns"))
        .collect();
    assert!(!rows.is_empty());
    rows
}

fn unhex(text: &str) -> Vec<u8> {
    text.as_bytes()
        .chunks(2)
        .map(|pair| u8::from_str_radix(str::from_utf8(pair).expect("ASCII"), 16).expect("hexadecimal"))
        .collect()
}

/// Checks the golden cases of one type and returns how many there are.
fn golden_cases<M: Message>() -> usize {
    let mut cases = 0;
    for [type_name, case, json, little, big] in rows(CDR) {
        if type_name != M::TYPE {
            continue;
        }
        cases += 1;
        let message: M = serde_json::from_str(json).unwrap_or_else(|e| panic!("{type_name} {case}: {e}"));
        let (little, big) = (unhex(little), unhex(big));
        assert_eq!(cdr::to_vec(&message).expect("writable"), little, "{type_name} {case}: bytes written");
        // NaN is not equal to itself, so messages are compared by their debug text.
        for bytes in [&little, &big] {
            let read: M = cdr::from_slice(bytes).unwrap_or_else(|e| panic!("{case}: {e}"));
            assert_eq!(format!("{read:?}"), format!("{message:?}"), "{type_name} {case}: message read");
        }
        // The reverse: our JSON equals the table's, with its field names and null for NaN.
        let ours = serde_json::to_value(&message).expect("JSON");
        let theirs: serde_json::Value = serde_json::from_str(json).expect("JSON");
        assert_eq!(ours, theirs, "{type_name} {case}: JSON");
        every_cut_is_refused::<M>(&little, case);
    }
    assert!(cases > 0, "{} has no golden case", M::TYPE);
    cases
}

/// No proper prefix of a message can be read as one. This is exact, because none of our types ends in an
/// optional field.
fn every_cut_is_refused<M: Message>(bytes: &[u8], case: &str) {
    for len in 0..bytes.len() {
        // rosbags pads nothing at the end, so every byte counts.
        let error = cdr::from_slice::<M>(&bytes[..len]).expect_err(case).to_string();
        assert!(error.starts_with(M::TYPE), "{error}");
    }
}

#[test]
fn bytes_equal_those_of_rosbags() {
    let checked: usize = for_every_message!(golden_cases).iter().sum();
    assert_eq!(checked, rows::<5>(CDR).len(), "the table has cases for types that the crate does not define");
}

fn hashed<M: Message>() -> &'static str {
    let computed = rihs01::hash(M::TYPE, M::DEFINITION).expect("readable definition");
    assert_eq!(computed, M::TYPE_HASH, "{}: the definition changed; put the new hash in the source", M::TYPE);
    assert_eq!(golden_hash(M::TYPE), M::TYPE_HASH, "{}", M::TYPE);
    M::TYPE
}

fn hashed_service<S: Service>() -> &'static str {
    assert_eq!(rihs01::service_hash::<S>().expect("readable definitions"), S::TYPE_HASH, "{}", S::TYPE);
    assert_eq!(golden_hash(S::TYPE), S::TYPE_HASH, "{}", S::TYPE);
    S::TYPE
}

fn golden_hash(type_name: &str) -> &'static str {
    let row = rows(HASHES).into_iter().find(|[name, _]| *name == type_name);
    row.unwrap_or_else(|| panic!("{type_name} is not in hashes.tsv"))[1]
}

#[test]
fn hashes_equal_those_of_rosbags_and_rosidl() {
    let mut checked = BTreeSet::from(for_every_message!(hashed));
    checked.extend([
        hashed_service::<LoadModel>(),
        hashed_service::<Reset>(),
        hashed_service::<SetMode>(),
        hashed_service::<GetState>(),
        hashed_service::<ChangeState>(),
        hashed_service::<GetAvailableStates>(),
        hashed_service::<GetAvailableTransitions>(),
        hashed_service::<GetParameters>(),
        hashed_service::<GetParameterTypes>(),
        hashed_service::<SetParameters>(),
        hashed_service::<SetParametersAtomically>(),
        hashed_service::<ListParameters>(),
        hashed_service::<DescribeParameters>(),
        hashed_service::<GetTypeDescription>(),
        hashed_service::<Pause>(),
        hashed_service::<Resume>(),
        hashed_service::<TogglePaused>(),
        hashed_service::<IsPaused>(),
        hashed_service::<GetRate>(),
        hashed_service::<SetRate>(),
        hashed_service::<PlayNext>(),
        hashed_service::<Burst>(),
        hashed_service::<Seek>(),
    ]);
    let golden: BTreeSet<&str> = rows(HASHES).iter().map(|[name, _]| *name).collect();
    assert_eq!(checked, golden);
}

/// The definition and the struct have the same fields in the same order, and the definition holds exactly
/// the nested types.
fn defined<M: Message>() -> &'static str {
    let all = msgdef::parse_all(M::TYPE, M::DEFINITION).expect("readable");
    let fields: Vec<String> = all[M::TYPE].fields.iter().map(|field| field.name.clone()).collect();
    // A derived `Debug` prints the fields in order.
    let printed = format!("{:#?}", M::default());
    let own: Vec<&str> = printed
        .lines()
        .filter(|line| line.starts_with("    ") && !line.starts_with("     "))
        .filter_map(|line| line.trim().split_once(": ").map(|(name, _)| name))
        .collect();
    if !fields.is_empty() {
        assert_eq!(own, fields, "{}", M::TYPE);
    }

    let description = rihs01::type_description(M::TYPE, M::DEFINITION).expect("complete");
    for name in all.keys() {
        assert!(
            description.contains(&format!("\"type_name\": \"{name}\"")),
            "{}: {name} is defined but not used",
            M::TYPE
        );
    }
    assert!(M::DEFINITION.is_empty() || M::DEFINITION.ends_with('\n'), "{}", M::TYPE);
    assert!(M::TYPE.starts_with(M::PACKAGE) && M::TYPE.ends_with(M::NAME), "{}", M::TYPE);
    assert_eq!(
        M::DDS_TYPE,
        M::TYPE.rsplit_once('/').map(|(f, n)| f.replace('/', "::") + "::dds_::" + n + "_").expect("a slash")
    );
    M::TYPE
}

#[test]
fn definitions_and_structs_agree() {
    let defined = for_every_message!(defined);
    assert_eq!(defined.len(), 100);
    let topics: BTreeSet<&str> = defined.into_iter().filter(|name| name.contains("/msg/")).collect();
    let listed: BTreeSet<&str> = MESSAGES.iter().map(|message: &Descriptor| message.type_name).collect();
    assert_eq!(listed, topics);
    assert_eq!(listed.len(), MESSAGES.len(), "a message is listed twice");
}

#[test]
fn a_definition_has_the_form_that_rosbag2_writes() {
    let rule = "=".repeat(80);
    let tail = format!(
        "bool alarm\n{rule}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n{rule}\n\
         MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    );
    assert!(ForceResidual::DEFINITION.ends_with(&tail), "{}", ForceResidual::DEFINITION);
}
