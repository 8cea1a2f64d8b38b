//! The definitions of the standard types, and how a definition is put together.
//!
//! Those of our own types come from the `.msg` files. These macros yield string literals, so that
//! [`crate::Message::DEFINITION`] is made when the crate is built.

/// The fields and constants of a standard type.
macro_rules! text {
    (Time) => {
        "int32 sec\nuint32 nanosec\n"
    };
    (Header) => {
        "builtin_interfaces/Time stamp\nstring frame_id\n"
    };
    (Float64) => {
        "float64 data\n"
    };
    (Clock) => {
        "builtin_interfaces/Time clock\n"
    };
    (Temperature) => {
        "std_msgs/Header header\nfloat64 temperature\nfloat64 variance\n"
    };
    (JointState) => {
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    };
    (KeyValue) => {
        "string key\nstring value\n"
    };
    (DiagnosticStatus) => {
        concat!(
            "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\n",
            "byte level\nstring name\nstring message\nstring hardware_id\nKeyValue[] values\n"
        )
    };
    (DiagnosticArray) => {
        "std_msgs/Header header\nDiagnosticStatus[] status\n"
    };
}
pub(crate) use text;

/// The part of a definition that holds a type inside it.
macro_rules! part {
    (Time) => { $crate::definition::part!("builtin_interfaces" Time) };
    (Header) => { $crate::definition::part!("std_msgs" Header) };
    (KeyValue) => { $crate::definition::part!("diagnostic_msgs" KeyValue) };
    (DiagnosticStatus) => { $crate::definition::part!("diagnostic_msgs" DiagnosticStatus) };
    ($package:literal $name:ident) => {
        concat!(
            "================================================================================\n",
            "MSG: ", $package, "/", stringify!($name), "\n",
            $crate::definition::text!($name)
        )
    };
}
pub(crate) use part;

/// A definition and those of all types inside it: `definition!(text, Header Time)`.
macro_rules! definition {
    ($text:expr $(, $($inside:ident)+)?) => {
        concat!($text $(, $($crate::definition::part!($inside)),+)?)
    };
}
pub(crate) use definition;
