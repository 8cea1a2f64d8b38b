//! `rcl_interfaces`: parameters of a node and their services, and the log topic `/rosout`.

use serde::{Deserialize, Serialize};

use crate::definition::{definition, text};
use crate::message::{message, service};
use crate::nan;
use crate::standard::Time;

/// `rcl_interfaces/msg/ParameterValue`: a value of one of nine types. Only the field that matches `type`
/// is used.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ParameterValue {
    /// One of the constants of this type.
    pub r#type: u8,
    /// A Boolean.
    pub bool_value: bool,
    /// An integer.
    pub integer_value: i64,
    /// A floating-point number.
    #[serde(deserialize_with = "nan::or_null")]
    pub double_value: f64,
    /// A string.
    pub string_value: String,
    /// Bytes.
    pub byte_array_value: Vec<u8>,
    /// Booleans.
    pub bool_array_value: Vec<bool>,
    /// Integers.
    pub integer_array_value: Vec<i64>,
    /// Floating-point numbers.
    pub double_array_value: Vec<f64>,
    /// Strings.
    pub string_array_value: Vec<String>,
}
message!(
    ParameterValue,
    "rcl_interfaces" / "msg" / "ParameterValue",
    "115fc089a387e23c7ecd3525c9189c379109119d6ab82e8dfbde0fdf6a7f9b68",
    text!(ParameterValue)
);

impl ParameterValue {
    /// The parameter does not exist.
    pub const NOT_SET: u8 = 0;
    /// A Boolean.
    pub const BOOL: u8 = 1;
    /// An integer.
    pub const INTEGER: u8 = 2;
    /// A floating-point number.
    pub const DOUBLE: u8 = 3;
    /// A string.
    pub const STRING: u8 = 4;
    /// Bytes.
    pub const BYTE_ARRAY: u8 = 5;
    /// Booleans.
    pub const BOOL_ARRAY: u8 = 6;
    /// Integers.
    pub const INTEGER_ARRAY: u8 = 7;
    /// Floating-point numbers.
    pub const DOUBLE_ARRAY: u8 = 8;
    /// Strings.
    pub const STRING_ARRAY: u8 = 9;
}

/// `rcl_interfaces/msg/Parameter`: a name and a value.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// The name.
    pub name: String,
    /// The value.
    pub value: ParameterValue,
}
message!(
    Parameter,
    "rcl_interfaces" / "msg" / "Parameter",
    "ddfe6442cffc462317adb5c92536a7b6dd55858c5c3e1e328165a6b73c2831af",
    definition!(text!(Parameter), ParameterValue)
);

/// `rcl_interfaces/msg/FloatingPointRange`: allowed values of a floating-point parameter.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FloatingPointRange {
    /// Smallest value.
    #[serde(deserialize_with = "nan::or_null")]
    pub from_value: f64,
    /// Largest value.
    #[serde(deserialize_with = "nan::or_null")]
    pub to_value: f64,
    /// Step between allowed values; 0 allows any value.
    #[serde(deserialize_with = "nan::or_null")]
    pub step: f64,
}
message!(
    FloatingPointRange,
    "rcl_interfaces" / "msg" / "FloatingPointRange",
    "e6af23a23c177fee5f3075c8b1e435162a9b63c863d78c06017460b49684262d",
    text!(FloatingPointRange)
);

/// `rcl_interfaces/msg/IntegerRange`: allowed values of an integer parameter.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct IntegerRange {
    /// Smallest value.
    pub from_value: i64,
    /// Largest value.
    pub to_value: i64,
    /// Step between allowed values; 0 and 1 allow any value.
    pub step: u64,
}
message!(
    IntegerRange,
    "rcl_interfaces" / "msg" / "IntegerRange",
    "f7b7fdc0f65f07702e099218e13288c3963bcb9345bde78b560e6cd19800fc5a",
    text!(IntegerRange)
);

/// `rcl_interfaces/msg/ParameterDescriptor`: type, description and allowed values of a parameter.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ParameterDescriptor {
    /// The name.
    pub name: String,
    /// A constant of [`ParameterValue`].
    pub r#type: u8,
    /// Description, with the unit.
    pub description: String,
    /// Constraints that the ranges do not express, as text for people.
    pub additional_constraints: String,
    /// Whether the parameter is fixed while the node runs.
    pub read_only: bool,
    /// Whether the parameter's type may change.
    pub dynamic_typing: bool,
    /// At most one.
    pub floating_point_range: Vec<FloatingPointRange>,
    /// At most one.
    pub integer_range: Vec<IntegerRange>,
}
message!(
    ParameterDescriptor,
    "rcl_interfaces" / "msg" / "ParameterDescriptor",
    "52175dbfda6c51153101d33d2a9da05743f66f02d5ab2ca9ec4709b46b73d704",
    definition!(text!(ParameterDescriptor), FloatingPointRange IntegerRange)
);

/// `rcl_interfaces/msg/ParameterEvent`: changed parameters of a node, on `/parameter_events`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ParameterEvent {
    /// Time of the change.
    pub stamp: Time,
    /// Full name of the node.
    pub node: String,
    /// Parameters that did not exist before.
    pub new_parameters: Vec<Parameter>,
    /// Parameters whose value changed.
    pub changed_parameters: Vec<Parameter>,
    /// Parameters that no longer exist.
    pub deleted_parameters: Vec<Parameter>,
}
message!(
    ParameterEvent,
    "rcl_interfaces" / "msg" / "ParameterEvent",
    "043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204",
    definition!(text!(ParameterEvent), Time Parameter ParameterValue)
);

/// `rcl_interfaces/msg/SetParametersResult`: the result of setting a parameter.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetParametersResult {
    /// Whether the parameter was set.
    pub successful: bool,
    /// On failure, the cause and what to do.
    pub reason: String,
}
message!(
    SetParametersResult,
    "rcl_interfaces" / "msg" / "SetParametersResult",
    "cfcc0fb0371ee5159b403960ef4300f8f9d2f1fd6117c8666b7f9654d528a9b1",
    text!(SetParametersResult)
);

/// `rcl_interfaces/msg/ListParametersResult`: names of parameters.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ListParametersResult {
    /// The parameters.
    pub names: Vec<String>,
    /// Prefixes of their names, up to the last dot.
    pub prefixes: Vec<String>,
}
message!(
    ListParametersResult,
    "rcl_interfaces" / "msg" / "ListParametersResult",
    "237ae3428413dcbcfb452b510c42355f3a2b021dc091afa3e18526d57022f1cd",
    text!(ListParametersResult)
);

/// `rcl_interfaces/msg/Log`: a line of the log, on `/rosout`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Log {
    /// Time of the entry.
    pub stamp: Time,
    /// One of the constants of this type.
    pub level: u8,
    /// Name of the logger: the full name of the node, with dots.
    pub name: String,
    /// The line.
    pub msg: String,
    /// Source file.
    pub file: String,
    /// Function, or module.
    pub function: String,
    /// Line of the source file.
    pub line: u32,
}
message!(
    Log,
    "rcl_interfaces" / "msg" / "Log",
    "e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac",
    definition!(text!(Log), Time)
);

impl Log {
    /// For developers.
    pub const DEBUG: u8 = 10;
    /// Normal operation.
    pub const INFO: u8 = 20;
    /// Needs attention.
    pub const WARN: u8 = 30;
    /// Something does not work.
    pub const ERROR: u8 = 40;
    /// The node exits.
    pub const FATAL: u8 = 50;
}

service! {
    /// `rcl_interfaces/srv/GetParameters`: values of parameters.
    GetParameters("rcl_interfaces", "bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc"):
        GetParametersRequest => GetParametersResponse
}

/// Request of [`GetParameters`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetParametersRequest {
    /// The parameters.
    pub names: Vec<String>,
}
message!(
    GetParametersRequest,
    "rcl_interfaces" / "srv" / "GetParameters_Request",
    "135a9e1c3d7cebef792f6687d7ddf99949b21a0bd9a320d863a9110a3f5cf4d6",
    "string[] names\n"
);

/// Response of [`GetParameters`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GetParametersResponse {
    /// The values in the order of the names; not set if the parameter does not exist.
    pub values: Vec<ParameterValue>,
}
message!(
    GetParametersResponse,
    "rcl_interfaces" / "srv" / "GetParameters_Response",
    "9fa773b46e39cc5d02db6224d8fd520bb9caeeffc2b27c96c1e59431baba9f2a",
    definition!("ParameterValue[] values\n", ParameterValue)
);

service! {
    /// `rcl_interfaces/srv/GetParameterTypes`: types of parameters.
    GetParameterTypes("rcl_interfaces", "da199c878688b3e530bdfe3ca8f74cb9fa0c303101e980a9e8f260e25e1c80ca"):
        GetParameterTypesRequest => GetParameterTypesResponse
}

/// Request of [`GetParameterTypes`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetParameterTypesRequest {
    /// The parameters.
    pub names: Vec<String>,
}
message!(
    GetParameterTypesRequest,
    "rcl_interfaces" / "srv" / "GetParameterTypes_Request",
    "87d7ec5ef545d4daa289d500025d31fb2437bc8b8365ca367161c4dac4be33fd",
    "string[] names\n"
);

/// Response of [`GetParameterTypes`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct GetParameterTypesResponse {
    /// Constants of [`ParameterValue`], in the order of the names.
    pub types: Vec<u8>,
}
message!(
    GetParameterTypesResponse,
    "rcl_interfaces" / "srv" / "GetParameterTypes_Response",
    "ac1335dce67c478e669434f6ac2fbff34fcd529580f272d3006785ba8b54e47f",
    "uint8[] types\n"
);

service! {
    /// `rcl_interfaces/srv/SetParameters`: sets parameters one by one.
    SetParameters("rcl_interfaces", "56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0"):
        SetParametersRequest => SetParametersResponse
}

/// Request of [`SetParameters`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SetParametersRequest {
    /// The parameters.
    pub parameters: Vec<Parameter>,
}
message!(
    SetParametersRequest,
    "rcl_interfaces" / "srv" / "SetParameters_Request",
    "130d46386b7e84ea9ecf60608a4d83cbe5e5cb7c6cc5b712b7a4e3a6c254e932",
    definition!("Parameter[] parameters\n", Parameter ParameterValue)
);

/// Response of [`SetParameters`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetParametersResponse {
    /// The results in the order of the parameters.
    pub results: Vec<SetParametersResult>,
}
message!(
    SetParametersResponse,
    "rcl_interfaces" / "srv" / "SetParameters_Response",
    "7a0e8140a0b8d98308fa81a5403a766e610af29a239caf54b7553227906fc266",
    definition!("SetParametersResult[] results\n", SetParametersResult)
);

service! {
    /// `rcl_interfaces/srv/SetParametersAtomically`: sets all parameters or none.
    SetParametersAtomically("rcl_interfaces", "0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd"):
        SetParametersAtomicallyRequest => SetParametersAtomicallyResponse
}

/// Request of [`SetParametersAtomically`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SetParametersAtomicallyRequest {
    /// The parameters.
    pub parameters: Vec<Parameter>,
}
message!(
    SetParametersAtomicallyRequest,
    "rcl_interfaces" / "srv" / "SetParametersAtomically_Request",
    "db0bd950ed5ed867a0e90b225e44dea382d762c0762ff3e0ee842190042a59e5",
    definition!("Parameter[] parameters\n", Parameter ParameterValue)
);

/// Response of [`SetParametersAtomically`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetParametersAtomicallyResponse {
    /// The result for all parameters together.
    pub result: SetParametersResult,
}
message!(
    SetParametersAtomicallyResponse,
    "rcl_interfaces" / "srv" / "SetParametersAtomically_Response",
    "31b1a38c5b0b9d893ee24da45f69638f4561c78461d82d52750f429b534502b8",
    definition!("SetParametersResult result\n", SetParametersResult)
);

service! {
    /// `rcl_interfaces/srv/ListParameters`: names of parameters.
    ListParameters("rcl_interfaces", "3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d"):
        ListParametersRequest => ListParametersResponse
}

/// Request of [`ListParameters`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ListParametersRequest {
    /// Prefixes of the names to list; empty lists every name.
    pub prefixes: Vec<String>,
    /// Dots allowed in a name below its prefix, plus one; 0 allows any number.
    pub depth: u64,
}
message!(
    ListParametersRequest,
    "rcl_interfaces" / "srv" / "ListParameters_Request",
    "a1b0b5d6b967a5b8ac5bc8563c3ea678f349e312a6a4967227c5a96bc5ce38df",
    "uint64 DEPTH_RECURSIVE=0\nstring[] prefixes\nuint64 depth\n"
);

/// Response of [`ListParameters`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ListParametersResponse {
    /// The names.
    pub result: ListParametersResult,
}
message!(
    ListParametersResponse,
    "rcl_interfaces" / "srv" / "ListParameters_Response",
    "31b937b82de3612426be79f231e386259f97e8dc843e3f2845288b4bfa296bdd",
    definition!("ListParametersResult result\n", ListParametersResult)
);

service! {
    /// `rcl_interfaces/srv/DescribeParameters`: descriptions of parameters.
    DescribeParameters("rcl_interfaces", "845b484d71eb0673dae682f2e3ba3c4851a65a3dcfb97bddd82c5b57e91e4cff"):
        DescribeParametersRequest => DescribeParametersResponse
}

/// Request of [`DescribeParameters`].
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DescribeParametersRequest {
    /// The parameters.
    pub names: Vec<String>,
}
message!(
    DescribeParametersRequest,
    "rcl_interfaces" / "srv" / "DescribeParameters_Request",
    "05dd1c2bc87dec2627105c8070d6f9725c781a4f2ab852975bf105462b82b644",
    "string[] names\n"
);

/// Response of [`DescribeParameters`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DescribeParametersResponse {
    /// The descriptors in the order of the names.
    pub descriptors: Vec<ParameterDescriptor>,
}
message!(
    DescribeParametersResponse,
    "rcl_interfaces" / "srv" / "DescribeParameters_Response",
    "ad6747319613c6131589e062e095b469a46cc764f7d0f12a001a49e6cd893995",
    definition!("ParameterDescriptor[] descriptors\n", ParameterDescriptor FloatingPointRange IntegerRange)
);
