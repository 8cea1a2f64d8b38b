//! The one table of parameters: names, types, ranges, defaults, documentation, and where each is kept.
//!
//! The configuration file, ROS parameters, flags, `--help` and the validator of the parameter services all
//! read it, so a parameter is added here and nowhere else.

use super::{Config, InputConfig, Value, use_force_name};
use crate::error::NodeError;
use mr_damper_model::pipeline::UseForce;

/// What values a parameter takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// A truth value.
    Bool,
    /// A whole number in a closed range.
    Integer(i64, i64),
    /// A number in a closed range.
    Double(f64, f64),
    /// Any text.
    Text,
    /// One of some texts.
    Choice(&'static [&'static str]),
    /// A list of texts.
    TextList,
}

/// A parameter of the node.
pub struct Parameter {
    /// Name, as a ROS parameter and (with dots as tables) in the configuration file.
    pub name: &'static str,
    /// Values that it takes.
    pub kind: Kind,
    /// True when it can be changed while the node runs.
    pub runtime: bool,
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
            Kind::Text => "a text".to_owned(),
            Kind::Choice(choices) => format!("one of {}", choices.join(", ")),
            Kind::TextList => "a list of texts".to_owned(),
        }
    }
}

/// The parameter called `name`.
///
/// # Errors
/// [`NodeError::UnknownParameter`] with the nearest name.
pub fn find(name: &str) -> Result<&'static Parameter, NodeError> {
    TABLE.iter().find(|parameter| parameter.name == name).ok_or_else(|| {
        let nearest = TABLE
            .iter()
            .max_by(|a, b| strsim::jaro_winkler(a.name, name).total_cmp(&strsim::jaro_winkler(b.name, name)));
        NodeError::UnknownParameter {
            name: name.to_owned(),
            nearest: nearest.map_or("", |parameter| parameter.name).to_owned(),
        }
    })
}

macro_rules! double {
    ($name:literal, $low:literal..=$high:literal, $runtime:literal, $doc:literal, $($field:ident).+) => {
        Parameter {
            name: $name,
            kind: Kind::Double($low, $high),
            runtime: $runtime,
            doc: $doc,
            get: |c| Value::Double(c.$($field).+),
            set: |c, v| if let Value::Double(x) = v { c.$($field).+ = *x; },
        }
    };
}

macro_rules! text {
    ($name:literal, $kind:expr, $runtime:literal, $doc:literal, $($field:ident).+) => {
        Parameter {
            name: $name,
            kind: $kind,
            runtime: $runtime,
            doc: $doc,
            get: |c| Value::Text(c.$($field).+.clone()),
            set: |c, v| if let Value::Text(t) = v { c.$($field).+.clone_from(t); },
        }
    };
}

macro_rules! list {
    ($name:literal, $doc:literal, $($field:ident).+) => {
        Parameter {
            name: $name,
            kind: Kind::TextList,
            runtime: false,
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
                runtime: false,
                doc: concat!(
                    "message type of the input: empty for ", $own,
                    "; a Float64 is stamped on arrival"
                ),
                get: |c| Value::Text(c.$field.message_type.clone()),
                set: |c, v| if let Value::Text(t) = v { c.$field.message_type.clone_from(t); },
            },
            Parameter {
                name: concat!(stringify!($field), ".joint"),
                kind: Kind::Text,
                runtime: false,
                doc: "joint of a JointState that is read (position, velocity or effort, as fits the input)",
                get: |c| Value::Text(c.$field.joint.clone()),
                set: |c, v| if let Value::Text(t) = v { c.$field.joint.clone_from(t); },
            },
            Parameter {
                name: concat!(stringify!($field), ".sign"),
                kind: Kind::Double(-1.0, 1.0),
                runtime: false,
                doc: "1, or -1 for a sensor that is mounted the other way round (extension and tension are positive)",
                get: |c| Value::Double(c.$field.sign),
                set: |c, v| if let Value::Double(x) = v { c.$field.sign = if *x < 0.0 { -1.0 } else { 1.0 }; },
            },
            Parameter {
                name: concat!(stringify!($field), ".offset"),
                kind: Kind::Double(-1e6, 1e6),
                runtime: false,
                doc: concat!("subtracted from the reading before the sign is applied, ", $unit),
                get: |c| Value::Double(c.$field.offset),
                set: |c, v| if let Value::Double(x) = v { c.$field.offset = *x; },
            },
        ]
    };
}

const MAIN: [Parameter; 21] = [
    text!(
        "model",
        Kind::Text,
        false,
        "free-running model: a preset (`mr-damper presets`) or a model file",
        model
    ),
    text!(
        "arx_model",
        Kind::Text,
        false,
        "ARX model that measured force seeds: a preset, a model file, none, or auto (the thesis' best ARX beside a thesis preset, else none)",
        arx_model
    ),
    Parameter {
        name: "use_measured_force",
        kind: Kind::Choice(&["auto", "never"]),
        runtime: true,
        doc: "auto: measured force seeds the ARX model while it is fresh; never: it serves the residual alone",
        get: |c| Value::Text(use_force_name(c.settings.use_measured_force).to_owned()),
        set: |c, v| {
            if let Value::Text(t) = v {
                c.settings.use_measured_force = if t == "never" { UseForce::Never } else { UseForce::Auto };
            }
        },
    },
    double!(
        "force_timeout_s",
        0.001..=3600.0,
        true,
        "age beyond which measured force counts as lost, s",
        settings.force_timeout_s
    ),
    double!(
        "coast_s",
        0.0..=3600.0,
        true,
        "how long ARX runs on its own predictions after measured force is lost, s",
        settings.coast_s
    ),
    double!(
        "input_timeout_s",
        0.001..=3600.0,
        true,
        "age beyond which displacement and drive count as stale, s",
        settings.input_timeout_s
    ),
    double!(
        "hold_s",
        0.0..=3600.0,
        true,
        "how long the last estimate is held, flagged, when no model can run, s",
        settings.hold_s
    ),
    double!(
        "bumpless_tau_s",
        0.0..=3600.0,
        true,
        "time constant with which the step at a change of mode decays, s",
        settings.bumpless_tau_s
    ),
    double!(
        "gap_s",
        0.001..=3600.0,
        true,
        "gap between displacements beyond which history starts anew, s",
        settings.gap_s
    ),
    double!(
        "residual.window_s",
        0.01..=3600.0,
        true,
        "time constant of the windowed residual figures, s",
        settings.residual_window_s
    ),
    double!(
        "residual.alarm_ratio",
        1.0..=1000.0,
        true,
        "factor over the model's expected RSSE that is no fault yet; a residual that stays above it raises the alarm",
        settings.alarm_ratio
    ),
    double!(
        "residual.alarm_block_s",
        0.05..=10.0,
        true,
        "length of the blocks over which the alarm takes the residual's power, s",
        settings.alarm_block_s
    ),
    double!(
        "residual.false_alarm_interval_s",
        60.0..=1e9,
        true,
        "mean time between false alarms, at least, s",
        settings.false_alarm_interval_s
    ),
    double!(
        "history.duration_s",
        10.0..=3600.0,
        true,
        "length of the raw input that is kept for the action close_loop, s; 30 s of motion are the least that names anything",
        history_duration_s
    ),
    text!(
        "close_loop.out",
        Kind::Text,
        true,
        "directory of the model files that the action close_loop writes, on the node's machine; empty: the system's temporary directory",
        close_loop_out
    ),
    Parameter {
        name: "close_loop.auto_load",
        kind: Kind::Bool,
        runtime: true,
        doc: "true: swap the model that the action close_loop has found in, unasked; false: load_model does, when somebody calls it",
        get: |c| Value::Bool(c.close_loop_auto_load),
        set: |c, v| {
            if let Value::Bool(b) = v {
                c.close_loop_auto_load = *b;
            }
        },
    },
    text!(
        "filter.apply_to",
        Kind::Choice(&["model", "inputs", "output", "none"]),
        true,
        "where the low-pass sits: on displacement, on the model's output (and the force it is compared with), nowhere, or as the model file says",
        filter_apply_to
    ),
    double!(
        "filter.cutoff_hz",
        0.0..=10000.0,
        true,
        "corner of the low-pass, Hz, when filter.apply_to is set; 0: the model file's",
        filter_cutoff_hz
    ),
    double!(
        "align_wait_s",
        0.0..=1.0,
        false,
        "how long a displacement waits for drive, velocity and force of its stamp, where they share stamps, s",
        align_wait_s
    ),
    Parameter {
        name: "domain_id",
        kind: Kind::Integer(-1, 232),
        runtime: false,
        doc: "ROS domain; -1: ROS_DOMAIN_ID from the environment, else 0",
        get: |c| Value::Integer(c.domain_id),
        set: |c, v| {
            if let Value::Integer(n) = v {
                c.domain_id = *n;
            }
        },
    },
    text!(
        "discovery_range",
        Kind::Choice(&["system_default", "localhost", "subnet"]),
        false,
        "who may find the node; system_default: ROS_AUTOMATIC_DISCOVERY_RANGE or ROS_LOCALHOST_ONLY, else localhost",
        discovery_range
    ),
];

const ZENOH: [Parameter; 7] = [
    list!(
        "zenoh.listen",
        "endpoints that the Zenoh mirror listens on, e.g. ['tcp/127.0.0.1:7447']; none: it does not listen",
        zenoh.listen
    ),
    list!("zenoh.connect", "endpoints of Zenoh routers or peers that the mirror connects to", zenoh.connect),
    text!("zenoh.mode", Kind::Choice(&["peer", "client"]), false, "Zenoh mode of the mirror", zenoh.mode),
    text!(
        "zenoh.encoding",
        Kind::Choice(&["cbor", "json", "cdr"]),
        false,
        "encoding of the state/ keys",
        zenoh.encoding
    ),
    double!("zenoh.web_rate_hz", 1.0..=50.0, false, "highest rate of the web/ keys, Hz", zenoh.web_rate_hz),
    double!(
        "zenoh.history_s",
        0.0..=600.0,
        false,
        "length of the history that a late joiner can ask for, s",
        zenoh.history_s
    ),
    Parameter {
        name: "zenoh.allow_non_loopback",
        kind: Kind::Bool,
        runtime: false,
        doc: "allow Zenoh endpoints beyond this machine",
        get: |c| Value::Bool(c.zenoh.allow_non_loopback),
        set: |c, v| {
            if let Value::Bool(b) = v {
                c.zenoh.allow_non_loopback = *b;
            }
        },
    },
];

const INPUTS: [[Parameter; 4]; 5] = [
    input!(displacement, "mr_damper_msgs/msg/Displacement", "m"),
    input!(velocity, "mr_damper_msgs/msg/Velocity", "m/s"),
    input!(coil_current, "mr_damper_msgs/msg/CoilCurrent", "A"),
    input!(command_voltage, "mr_damper_msgs/msg/CommandVoltage", "V"),
    input!(measured_force, "mr_damper_msgs/msg/Force", "N"),
];

/// All parameters.
pub static TABLE: std::sync::LazyLock<Vec<Parameter>> =
    std::sync::LazyLock::new(|| MAIN.into_iter().chain(INPUTS.into_iter().flatten()).chain(ZENOH).collect());

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
