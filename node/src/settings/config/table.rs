//! The table of parameters: names, types, ranges, defaults, descriptions and storage.
//!
//! The configuration file, ROS parameters, flags, `--help` and the parameter services all use it, so a new parameter is
//! added only here.

use super::{Config, InputConfig, Value};
use crate::settings::error::NodeError;
use mr_damper_base::shown;

/// The accepted values of a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ParameterKind {
    /// A truth value.
    Bool,
    /// A whole number in a closed range.
    Integer(i64, i64),
    /// A number in a closed range.
    Double(f64, f64),
    /// 1 or -1.
    Sign,
    /// Any text.
    Text,
    /// One of several texts.
    Choice(&'static [&'static str]),
    /// A list of texts.
    TextList,
    /// A list of numbers in a closed range.
    DoubleList(f64, f64),
}

/// Largest number of items in a list of numbers.
const MOST_NUMBERS: usize = 64;

/// When a parameter can be set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mutability {
    /// At the start.
    Never,
    /// While the node is not configured.
    Unconfigured,
    /// Always.
    Running,
}

/// A parameter of the node.
pub struct Parameter {
    /// Name, as a ROS parameter and (with dots as tables) in the configuration file.
    pub name: &'static str,
    /// The accepted values.
    pub kind: ParameterKind,
    /// When it can be set.
    pub mutability: Mutability,
    /// Description, with the unit.
    pub doc: &'static str,
    pub(crate) get: fn(&Config) -> Value,
    pub(crate) set: fn(&mut Config, &Value),
}

impl Parameter {
    /// The name as a flag: `force_timeout_s` is `--force-timeout-s`, `zenoh.listen` is `--zenoh-listen`. Three flags are shorter: those
    /// that other programs and commands have, too.
    #[must_use]
    pub fn flag(&self) -> String {
        match self.name {
            "can.interface" => "can".to_owned(),
            "can.dbc" => "dbc".to_owned(),
            "can.map" => "map".to_owned(),
            name => name.replace(['.', '_'], "-"),
        }
    }

    /// The value without any configuration, as text; `None` if that is empty.
    #[must_use]
    pub fn default_text(&self) -> Option<String> {
        match (self.get)(&Config::default()) {
            Value::Text(text) if text.is_empty() => None,
            Value::TextList(list) if list.is_empty() => None,
            Value::DoubleList(list) if list.is_empty() => None,
            Value::Text(text) => Some(text),
            value => Some(value.to_string()),
        }
    }

    /// Description, accepted values and default, for help and for ROS tools.
    #[must_use]
    pub fn help(&self) -> String {
        let default = self.default_text().unwrap_or_else(|| "empty".to_owned());
        format!("{} [{}; default: {default}]", self.doc, self.expected())
    }

    /// Advice for a parameter that cannot be set in the present state, as the end of a sentence.
    #[must_use]
    pub fn instead(&self) -> &'static str {
        match self.name {
            "model" => "; load_model changes it on the running node",
            _ => "; deactivate the node and clean it up first",
        }
    }

    /// `value`, converted to the parameter's type.
    ///
    /// # Errors
    /// When the type or the range is wrong; the message says what is accepted.
    pub fn check(&self, value: &Value) -> Result<Value, NodeError> {
        let fits = match (self.kind, value) {
            (ParameterKind::Bool, Value::Bool(_)) | (ParameterKind::Text, Value::Text(_)) => {
                Some(value.clone())
            }
            (ParameterKind::Integer(low, high), Value::Integer(n)) if (low..=high).contains(n) => {
                Some(value.clone())
            }
            (ParameterKind::Double(low, high), Value::Double(x)) if (low..=high).contains(x) => {
                Some(value.clone())
            }
            // In YAML, users write 1 for 1.0.
            (ParameterKind::Double(low, high), Value::Integer(n)) if (low..=high).contains(&(*n as f64)) => {
                Some(Value::Double(*n as f64))
            }
            (ParameterKind::Sign, Value::Double(x)) if x.abs() == 1.0 => Some(value.clone()),
            (ParameterKind::Sign, Value::Integer(n)) if n.abs() == 1 => Some(Value::Double(*n as f64)),
            (ParameterKind::Choice(choices), Value::Text(text)) if choices.contains(&text.as_str()) => {
                Some(value.clone())
            }
            (ParameterKind::TextList, Value::TextList(_)) => Some(value.clone()),
            (ParameterKind::TextList, Value::Text(text)) => Some(Value::TextList(vec![text.clone()])),
            (ParameterKind::DoubleList(low, high), Value::DoubleList(list))
                if list.len() <= MOST_NUMBERS && list.iter().all(|x| (low..=high).contains(x)) =>
            {
                Some(value.clone())
            }
            // An empty list has no type in YAML and TOML.
            (ParameterKind::DoubleList(..), Value::TextList(list)) if list.is_empty() => {
                Some(Value::DoubleList(Vec::new()))
            }
            _ => None,
        };
        fits.ok_or_else(|| NodeError::Parameter {
            name: self.name.to_owned(),
            value: value.to_string(),
            expected: self.expected(),
        })
    }

    /// The accepted values, as text.
    #[must_use]
    pub fn expected(&self) -> String {
        match self.kind {
            ParameterKind::Bool => "true or false".to_owned(),
            ParameterKind::Integer(low, high) => format!("a whole number from {low} to {high}"),
            ParameterKind::Double(low, high) => format!("a number from {low} to {high}"),
            ParameterKind::Sign => "1 or -1".to_owned(),
            ParameterKind::Text => "a text".to_owned(),
            ParameterKind::Choice(choices) => {
                let shown: Vec<&str> =
                    choices.iter().map(|choice| if choice.is_empty() { "\"\"" } else { choice }).collect();
                format!("one of {}", shown.join(", "))
            }
            ParameterKind::TextList => "a list of texts".to_owned(),
            ParameterKind::DoubleList(low, high) => {
                format!("a list of at most {MOST_NUMBERS} numbers from {low} to {high}")
            }
        }
    }
}

/// True if the parameter called `name` exists.
#[must_use]
pub fn is_known(name: &str) -> bool {
    TABLE.iter().any(|parameter| parameter.name == name)
}

/// The parameter called `name`.
///
/// # Errors
/// [`NodeError::UnknownParameter`], with the name that it resembles.
pub fn find(name: &str) -> Result<&'static Parameter, NodeError> {
    TABLE.iter().find(|parameter| parameter.name == name).ok_or_else(|| NodeError::UnknownParameter {
        name: name.to_owned(),
        nearest: shown::nearest(name, TABLE.iter().map(|parameter| parameter.name)).map(str::to_owned),
    })
}

macro_rules! number {
    ($variant:ident, $name:literal, $low:literal..=$high:literal, $mutability:ident, $doc:literal, $($field:ident).+) => {
        Parameter {
            name: $name,
            kind: ParameterKind::$variant($low, $high),
            mutability: $mutability,
            doc: $doc,
            get: |c| Value::$variant(c.$($field).+),
            set: |c, v| if let Value::$variant(x) = v { c.$($field).+ = *x; },
        }
    };
}

macro_rules! double {
    ($($rest:tt)*) => { number!(Double, $($rest)*) };
}

macro_rules! integer {
    ($($rest:tt)*) => { number!(Integer, $($rest)*) };
}

macro_rules! text {
    ($name:literal, $kind:expr, $mutability:ident, $doc:literal, $($field:ident).+) => {
        Parameter {
            name: $name,
            kind: $kind,
            mutability: $mutability,
            doc: $doc,
            get: |c| Value::Text(c.$($field).+.clone()),
            set: |c, v| if let Value::Text(t) = v { c.$($field).+.clone_from(t); },
        }
    };
}

macro_rules! truth {
    ($name:literal, $mutability:ident, $doc:literal, $($field:ident).+) => {
        Parameter {
            name: $name,
            kind: ParameterKind::Bool,
            mutability: $mutability,
            doc: $doc,
            get: |c| Value::Bool(c.$($field).+),
            set: |c, v| if let Value::Bool(b) = v { c.$($field).+ = *b; },
        }
    };
}

macro_rules! double_list {
    ($name:literal, $low:literal..=$high:literal, $mutability:ident, $doc:literal, $($field:ident).+) => {
        Parameter {
            name: $name,
            kind: ParameterKind::DoubleList($low, $high),
            mutability: $mutability,
            doc: $doc,
            get: |c| Value::DoubleList(c.$($field).+.clone()),
            set: |c, v| if let Value::DoubleList(x) = v { c.$($field).+.clone_from(x); },
        }
    };
}

macro_rules! list {
    ($name:literal, $doc:literal, $($field:ident).+) => {
        Parameter {
            name: $name,
            kind: ParameterKind::TextList,
            mutability: Never,
            doc: $doc,
            get: |c| Value::TextList(c.$($field).+.clone()),
            set: |c, v| if let Value::TextList(t) = v { c.$($field).+.clone_from(t); },
        }
    };
}

/// The four parameters of one input.
macro_rules! input {
    ($field:ident, $own:literal, $unit:literal) => {
        [
            Parameter {
                name: concat!(stringify!($field), ".type"),
                kind: ParameterKind::Choice(&["", $own, "std_msgs/msg/Float64", "sensor_msgs/msg/JointState"]),
                mutability: Never,
                doc: concat!(
                    "message type of the input: empty for ", $own,
                    "; a Float64 gets the time of its sending as stamp"
                ),
                get: |c| Value::Text(c.$field.message_type.clone()),
                set: |c, v| if let Value::Text(t) = v { c.$field.message_type.clone_from(t); },
            },
            Parameter {
                name: concat!(stringify!($field), ".joint"),
                kind: ParameterKind::Text,
                mutability: Never,
                doc: "joint of a JointState that is read (position, velocity or effort, depending on the input)",
                get: |c| Value::Text(c.$field.joint.clone()),
                set: |c, v| if let Value::Text(t) = v { c.$field.joint.clone_from(t); },
            },
            Parameter {
                name: concat!(stringify!($field), ".sign"),
                kind: ParameterKind::Sign,
                mutability: Never,
                doc: "1, or -1 for a sensor that is mounted in the opposite direction (extension and tension are positive)",
                get: |c| Value::Double(c.$field.sign),
                set: |c, v| if let Value::Double(x) = v { c.$field.sign = *x; },
            },
            Parameter {
                name: concat!(stringify!($field), ".offset"),
                kind: ParameterKind::Double(-1e6, 1e6),
                mutability: Never,
                doc: concat!("subtracted from the reading before the sign is applied, ", $unit),
                get: |c| Value::Double(c.$field.offset),
                set: |c, v| if let Value::Double(x) = v { c.$field.offset = *x; },
            },
        ]
    };
}

mod can;
mod group;
mod list;

pub(super) use group::groups;

/// All parameters.
pub static TABLE: std::sync::LazyLock<Vec<Parameter>> = std::sync::LazyLock::new(|| list::all().collect());

/// Access to the inputs' configuration by topic name.
impl Config {
    /// The configuration of the input topic called `topic`; `None` for an unknown topic.
    #[must_use]
    pub fn input(&self, topic: &str) -> Option<&InputConfig> {
        match topic {
            "displacement" => Some(&self.displacement),
            "velocity" => Some(&self.velocity),
            "coil_current" => Some(&self.coil_current),
            "command_voltage" => Some(&self.command_voltage),
            "measured_force" => Some(&self.measured_force),
            "body_velocity" => Some(&self.body_velocity),
            "force_request" => Some(&self.force_request),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_parameter_accepts_its_default_and_keeps_a_new_value() {
        let mut config = Config::default();
        for parameter in TABLE.iter() {
            let default = config.get(parameter.name).expect("in the table");
            assert_eq!(parameter.check(&default).ok(), Some(default.clone()), "{}", parameter.name);
            let other = match parameter.kind {
                ParameterKind::Bool => Value::Bool(default != Value::Bool(true)),
                ParameterKind::Integer(_, high) => Value::Integer(high),
                ParameterKind::Double(_, high) => Value::Double(high),
                ParameterKind::Sign => Value::Double(-1.0),
                ParameterKind::Text => Value::Text("other".into()),
                ParameterKind::Choice(choices) => Value::Text((*choices.last().expect("choices")).to_owned()),
                ParameterKind::TextList => Value::TextList(vec!["a".into()]),
                ParameterKind::DoubleList(low, high) => Value::DoubleList(vec![low, high]),
            };
            config.set(parameter.name, &other).expect("in range");
            assert_eq!(config.get(parameter.name).expect("in the table"), other, "{}", parameter.name);
        }
        let mut names: Vec<_> = TABLE.iter().map(|p| p.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), TABLE.len(), "names are unique");
    }

    #[test]
    fn errors_say_what_is_accepted() {
        let mut config = Config::default();
        let refusal = config.set("coast_s", &Value::Double(-1.0)).expect_err("negative").to_string();
        assert_eq!(refusal, "parameter coast_s is -1, but must be a number from 0 to 3600");
        let refusal = config.set("coast", &Value::Double(1.0)).expect_err("unknown").to_string();
        assert!(refusal.contains("coast_s"), "{refusal}");
        let refusal = config.set("coast_s", &Value::Text("long".into())).expect_err("text").to_string();
        assert!(refusal.contains("\"long\""), "{refusal}");
        assert_eq!(config, Config::default());
    }
}
