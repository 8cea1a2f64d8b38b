//! The one table of parameters: names, types, ranges, defaults, documentation, and where each is kept.
//!
//! The configuration file, ROS parameters, flags, `--help` and the validator of the parameter services all
//! read it, so a parameter is added here and nowhere else.

use super::{Config, InputConfig, Value};
use crate::error::NodeError;

/// What values a parameter takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
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
    /// One of some texts.
    Choice(&'static [&'static str]),
    /// A list of texts.
    TextList,
}

/// When a parameter can be set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
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
    /// Values that it takes.
    pub kind: Kind,
    /// When it can be set.
    pub change: Change,
    /// What it does, with its unit.
    pub doc: &'static str,
    pub(crate) get: fn(&Config) -> Value,
    pub(crate) set: fn(&mut Config, &Value),
}

impl Parameter {
    /// The name as a flag: `force_timeout_s` is `--force-timeout-s`, `zenoh.listen` is `--zenoh-listen`.
    #[must_use]
    pub fn flag(&self) -> String {
        self.name.replace(['.', '_'], "-")
    }

    /// What to do where it cannot be set any more, as the end of a sentence.
    #[must_use]
    pub fn instead(&self) -> &'static str {
        match self.name {
            "model" => "; load_model changes it on the running node",
            _ => "; deactivate the node and clean it up before",
        }
    }

    /// `value`, brought to the parameter's type.
    ///
    /// # Errors
    /// When type or range do not fit; the message says what would.
    pub fn check(&self, value: &Value) -> Result<Value, NodeError> {
        let fits = match (self.kind, value) {
            (Kind::Bool, Value::Bool(_)) | (Kind::Text, Value::Text(_)) => Some(value.clone()),
            (Kind::Integer(low, high), Value::Integer(n)) if (low..=high).contains(n) => Some(value.clone()),
            (Kind::Double(low, high), Value::Double(x)) if (low..=high).contains(x) => Some(value.clone()),
            // YAML and people write 1 for 1.0.
            (Kind::Double(low, high), Value::Integer(n)) if (low..=high).contains(&(*n as f64)) => {
                Some(Value::Double(*n as f64))
            }
            (Kind::Sign, Value::Double(x)) if x.abs() == 1.0 => Some(value.clone()),
            (Kind::Sign, Value::Integer(n)) if n.abs() == 1 => Some(Value::Double(*n as f64)),
            (Kind::Choice(choices), Value::Text(text)) if choices.contains(&text.as_str()) => {
                Some(value.clone())
            }
            (Kind::TextList, Value::TextList(_)) => Some(value.clone()),
            (Kind::TextList, Value::Text(text)) => Some(Value::TextList(vec![text.clone()])),
            _ => None,
        };
        fits.ok_or_else(|| NodeError::Parameter {
            name: self.name.to_owned(),
            value: value.to_string(),
            expected: self.expected(),
        })
    }

    /// What the parameter takes, in words.
    #[must_use]
    pub fn expected(&self) -> String {
        match self.kind {
            Kind::Bool => "true or false".to_owned(),
            Kind::Integer(low, high) => format!("a whole number from {low} to {high}"),
            Kind::Double(low, high) => format!("a number from {low} to {high}"),
            Kind::Sign => "1 or -1".to_owned(),
            Kind::Text => "a text".to_owned(),
            Kind::Choice(choices) => {
                let shown: Vec<&str> =
                    choices.iter().map(|choice| if choice.is_empty() { "\"\"" } else { choice }).collect();
                format!("one of {}", shown.join(", "))
            }
            Kind::TextList => "a list of texts".to_owned(),
        }
    }
}

/// Whether there is a parameter called `name`.
#[must_use]
pub fn is_known(name: &str) -> bool {
    TABLE.iter().any(|parameter| parameter.name == name)
}

/// Characters of an unknown name that are compared with those of known ones.
const COMPARED: usize = 200;

/// The parameter called `name`.
///
/// # Errors
/// [`NodeError::UnknownParameter`] with the nearest name.
pub fn find(name: &str) -> Result<&'static Parameter, NodeError> {
    TABLE.iter().find(|parameter| parameter.name == name).ok_or_else(|| {
        // What is longer by far than any name is near to none, and comparing it would take minutes.
        let compared: String = name.chars().take(COMPARED).collect();
        let likeness = |parameter: &Parameter| strsim::jaro_winkler(parameter.name, &compared);
        let nearest = TABLE.iter().max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
        NodeError::UnknownParameter {
            name: name.to_owned(),
            nearest: nearest.map_or("", |parameter| parameter.name).to_owned(),
        }
    })
}

macro_rules! number {
    ($variant:ident, $name:literal, $low:literal..=$high:literal, $change:ident, $doc:literal, $($field:ident).+) => {
        Parameter {
            name: $name,
            kind: Kind::$variant($low, $high),
            change: $change,
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
    ($name:literal, $kind:expr, $change:ident, $doc:literal, $($field:ident).+) => {
        Parameter {
            name: $name,
            kind: $kind,
            change: $change,
            doc: $doc,
            get: |c| Value::Text(c.$($field).+.clone()),
            set: |c, v| if let Value::Text(t) = v { c.$($field).+.clone_from(t); },
        }
    };
}

macro_rules! truth {
    ($name:literal, $change:ident, $doc:literal, $($field:ident).+) => {
        Parameter {
            name: $name,
            kind: Kind::Bool,
            change: $change,
            doc: $doc,
            get: |c| Value::Bool(c.$($field).+),
            set: |c, v| if let Value::Bool(b) = v { c.$($field).+ = *b; },
        }
    };
}

macro_rules! list {
    ($name:literal, $doc:literal, $($field:ident).+) => {
        Parameter {
            name: $name,
            kind: Kind::TextList,
            change: Never,
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
                kind: Kind::Choice(&["", $own, "std_msgs/msg/Float64", "sensor_msgs/msg/JointState"]),
                change: Never,
                doc: concat!(
                    "message type of the input: empty for ", $own,
                    "; a Float64 is stamped when it was sent"
                ),
                get: |c| Value::Text(c.$field.message_type.clone()),
                set: |c, v| if let Value::Text(t) = v { c.$field.message_type.clone_from(t); },
            },
            Parameter {
                name: concat!(stringify!($field), ".joint"),
                kind: Kind::Text,
                change: Never,
                doc: "joint of a JointState that is read (position, velocity or effort, as fits the input)",
                get: |c| Value::Text(c.$field.joint.clone()),
                set: |c, v| if let Value::Text(t) = v { c.$field.joint.clone_from(t); },
            },
            Parameter {
                name: concat!(stringify!($field), ".sign"),
                kind: Kind::Sign,
                change: Never,
                doc: "1, or -1 for a sensor that is mounted the other way round (extension and tension are positive)",
                get: |c| Value::Double(c.$field.sign),
                set: |c, v| if let Value::Double(x) = v { c.$field.sign = *x; },
            },
            Parameter {
                name: concat!(stringify!($field), ".offset"),
                kind: Kind::Double(-1e6, 1e6),
                change: Never,
                doc: concat!("subtracted from the reading before the sign is applied, ", $unit),
                get: |c| Value::Double(c.$field.offset),
                set: |c, v| if let Value::Double(x) = v { c.$field.offset = *x; },
            },
        ]
    };
}

mod list;

/// All parameters.
pub static TABLE: std::sync::LazyLock<Vec<Parameter>> = std::sync::LazyLock::new(|| list::all().collect());

/// Input configuration by topic name, for the source.
impl Config {
    /// The configuration of the input topic called `topic`; `None` for another topic.
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
    fn every_parameter_takes_its_own_default_and_keeps_what_it_is_told() {
        let mut config = Config::default();
        for parameter in TABLE.iter() {
            let default = config.get(parameter.name).expect("in the table");
            assert_eq!(parameter.check(&default).ok(), Some(default.clone()), "{}", parameter.name);
            let other = match parameter.kind {
                Kind::Bool => Value::Bool(default != Value::Bool(true)),
                Kind::Integer(_, high) => Value::Integer(high),
                Kind::Double(_, high) => Value::Double(high),
                Kind::Sign => Value::Double(-1.0),
                Kind::Text => Value::Text("other".into()),
                Kind::Choice(choices) => Value::Text((*choices.last().expect("choices")).to_owned()),
                Kind::TextList => Value::TextList(vec!["a".into()]),
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
    fn refusals_say_what_would_fit() {
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
