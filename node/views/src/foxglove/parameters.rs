//! Parameters of nodes, as viewers get them.

use super::protocol::ParameterValue;
use mr_damper_msgs::rcl;
use serde_json::{Value, json};

/// The value of a node's parameter in the protocol's form.
///
/// The value is left out for a number that JSON does not have (NaN, infinite), and for a list of bytes, which no node of this project has.
pub(super) fn parameter_value(name: String, parameter: &rcl::ParameterValue) -> ParameterValue {
    use rcl::ParameterValue as Ros;
    let doubles = &parameter.double_array_value;
    let (value, kind) = match parameter.r#type {
        Ros::BOOL => (json!(parameter.bool_value), None),
        Ros::INTEGER => (json!(parameter.integer_value), None),
        Ros::DOUBLE if parameter.double_value.is_finite() => (json!(parameter.double_value), Some("float64")),
        Ros::STRING => (json!(parameter.string_value), None),
        Ros::BOOL_ARRAY => (json!(parameter.bool_array_value), None),
        Ros::INTEGER_ARRAY => (json!(parameter.integer_array_value), None),
        Ros::DOUBLE_ARRAY if doubles.iter().all(|value| value.is_finite()) => {
            (json!(doubles), Some("float64_array"))
        }
        Ros::STRING_ARRAY => (json!(parameter.string_array_value), None),
        _ => (Value::Null, None),
    };
    ParameterValue { name, value: Some(value).filter(|value| !value.is_null()), kind }
}
