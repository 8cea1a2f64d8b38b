//! The definitions of the standard types, and the macros that assemble a full definition.
//!
//! The definitions of our own types come from the `.msg` files. The macros expand to string
//! literals, so that [`crate::Message::DEFINITION`] is assembled at compile time.

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
    (Float32) => {
        "float32 data\n"
    };
    (Vector3) => {
        "float64 x\nfloat64 y\nfloat64 z\n"
    };
    (Wrench) => {
        "Vector3 force\nVector3 torque\n"
    };
    (WrenchStamped) => {
        "std_msgs/Header header\nWrench wrench\n"
    };
    (Twist) => {
        "Vector3 linear\nVector3 angular\n"
    };
    (TwistStamped) => {
        "std_msgs/Header header\nTwist twist\n"
    };
    (Range) => {
        concat!(
            "uint8 ULTRASOUND=0\nuint8 INFRARED=1\n",
            "std_msgs/Header header\nuint8 radiation_type\nfloat32 field_of_view\nfloat32 min_range\n",
            "float32 max_range\nfloat32 range\nfloat32 variance\n"
        )
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
    (State) => {
        "uint8 id\nstring label\n"
    };
    (Transition) => {
        "uint8 id\nstring label\n"
    };
    (TransitionDescription) => {
        "Transition transition\nState start_state\nState goal_state\n"
    };
    (TransitionEvent) => {
        "uint64 timestamp\nTransition transition\nState start_state\nState goal_state\n"
    };
    (ParameterValue) => {
        concat!(
            "uint8 type\nbool bool_value\nint64 integer_value\nfloat64 double_value\nstring string_value\n",
            "byte[] byte_array_value\nbool[] bool_array_value\nint64[] integer_array_value\n",
            "float64[] double_array_value\nstring[] string_array_value\n"
        )
    };
    (Parameter) => {
        "string name\nParameterValue value\n"
    };
    (FloatingPointRange) => {
        "float64 from_value\nfloat64 to_value\nfloat64 step\n"
    };
    (IntegerRange) => {
        "int64 from_value\nint64 to_value\nuint64 step\n"
    };
    (ParameterDescriptor) => {
        concat!(
            "string name\nuint8 type\nstring description\nstring additional_constraints\nbool read_only\n",
            "bool dynamic_typing\nFloatingPointRange[<=1] floating_point_range\nIntegerRange[<=1] integer_range\n"
        )
    };
    (ParameterEvent) => {
        concat!(
            "builtin_interfaces/Time stamp\nstring node\nParameter[] new_parameters\n",
            "Parameter[] changed_parameters\nParameter[] deleted_parameters\n"
        )
    };
    (SetParametersResult) => {
        "bool successful\nstring reason\n"
    };
    (ListParametersResult) => {
        "string[] names\nstring[] prefixes\n"
    };
    (Log) => {
        concat!(
            "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\n",
            "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\n",
            "string function\nuint32 line\n"
        )
    };
    (FieldType) => {
        "uint8 type_id\nuint64 capacity\nuint64 string_capacity\nstring<=255 nested_type_name\n"
    };
    (Field) => {
        "string name\nFieldType type\nstring default_value\n"
    };
    (IndividualTypeDescription) => {
        "string<=255 type_name\nField[] fields\n"
    };
    (TypeDescription) => {
        "IndividualTypeDescription type_description\nIndividualTypeDescription[] referenced_type_descriptions\n"
    };
    (TypeSource) => {
        "string type_name\nstring encoding\nstring raw_file_contents\n"
    };
    (TypeKeyValue) => {
        "string key\nstring value\n"
    };
}
pub(crate) use text;

/// The part of a full definition that describes one nested type: separator, name and fields.
macro_rules! part {
    (Time) => { $crate::definition::part!("builtin_interfaces" Time) };
    (Header) => { $crate::definition::part!("std_msgs" Header) };
    (Vector3) => { $crate::definition::part!("geometry_msgs" Vector3) };
    (Wrench) => { $crate::definition::part!("geometry_msgs" Wrench) };
    (Twist) => { $crate::definition::part!("geometry_msgs" Twist) };
    (KeyValue) => { $crate::definition::part!("diagnostic_msgs" KeyValue) };
    (DiagnosticStatus) => { $crate::definition::part!("diagnostic_msgs" DiagnosticStatus) };
    (State) => { $crate::definition::part!("lifecycle_msgs" State) };
    (Transition) => { $crate::definition::part!("lifecycle_msgs" Transition) };
    (TransitionDescription) => { $crate::definition::part!("lifecycle_msgs" TransitionDescription) };
    (ParameterValue) => { $crate::definition::part!("rcl_interfaces" ParameterValue) };
    (Parameter) => { $crate::definition::part!("rcl_interfaces" Parameter) };
    (FloatingPointRange) => { $crate::definition::part!("rcl_interfaces" FloatingPointRange) };
    (IntegerRange) => { $crate::definition::part!("rcl_interfaces" IntegerRange) };
    (ParameterDescriptor) => { $crate::definition::part!("rcl_interfaces" ParameterDescriptor) };
    (SetParametersResult) => { $crate::definition::part!("rcl_interfaces" SetParametersResult) };
    (ListParametersResult) => { $crate::definition::part!("rcl_interfaces" ListParametersResult) };
    (FieldType) => { $crate::definition::part!("type_description_interfaces" FieldType) };
    (Field) => { $crate::definition::part!("type_description_interfaces" Field) };
    (IndividualTypeDescription) => { $crate::definition::part!("type_description_interfaces" IndividualTypeDescription) };
    (TypeDescription) => { $crate::definition::part!("type_description_interfaces" TypeDescription) };
    (TypeSource) => { $crate::definition::part!("type_description_interfaces" TypeSource) };
    // `diagnostic_msgs` also has a `KeyValue`.
    (TypeKeyValue) => { $crate::definition::part!("type_description_interfaces" TypeKeyValue as "KeyValue") };
    ($package:literal $name:ident) => { $crate::definition::part!($package $name as stringify!($name)) };
    ($package:literal $name:ident as $called:expr) => {
        concat!(
            "================================================================================\n",
            "MSG: ", $package, "/", $called, "\n",
            $crate::definition::text!($name)
        )
    };
}
pub(crate) use part;

/// A definition followed by the definitions of all nested types: `definition!(text, Header Time)`.
macro_rules! definition {
    ($text:expr $(, $($inside:ident)+)?) => {
        concat!($text $(, $($crate::definition::part!($inside)),+)?)
    };
}
pub(crate) use definition;
