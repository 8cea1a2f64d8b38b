//! Commands over Zenoh: their content, and the rules by which they are accepted.
//!
//! | key below `cmd/` | field | effect |
//! |---|---|---|
//! | `force_request` | `force_n` | demands a force, like the ROS topic with this name |
//! | `load_model` | `model` | loads a preset, or a file in `zenoh.model_dir` given by its bare name |
//! | `set_mode` | `mode` | `auto`, `arx`, `model`, `fault`: like the ROS service with this name |
//!
//! Each command also has `seq`, which grows from command to command of a key, and `deadline_ns`, the time (since 1970)
//! after which it must not be executed. An intercepted command that is sent again has an old `seq`; a delayed command
//! has an old deadline. A restarted node does not remember any `seq`, so deadlines must not be far ahead.
//!
//! The payload is JSON, or CBOR if the encoding says so. An unknown field is an error, because the node could not do
//! what it asks for.

use mr_damper_model::sample::Stamp;
use mr_damper_model::units::Newton;
use serde::Deserialize;
use serde::de::DeserializeOwned;

/// Largest distance of a deadline from now, s.
const AHEAD_S: f64 = 10.0;
/// Longest command, bytes; a typical one needs less than a tenth of it.
const LONGEST: usize = 4096;

/// The kinds of commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CommandKind {
    /// Demand a force.
    ForceRequest,
    /// Load another model.
    LoadModel,
    /// Fix the mode, or release it.
    SetMode,
}

impl CommandKind {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::ForceRequest, Self::LoadModel, Self::SetMode];

    /// Last part of the key.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::ForceRequest => "force_request",
            Self::LoadModel => "load_model",
            Self::SetMode => "set_mode",
        }
    }

    /// The kind called `name`.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// All names, for messages.
    #[must_use]
    pub fn names() -> String {
        Self::ALL.map(Self::name).join(", ")
    }
}

/// An accepted command.
#[derive(Debug, Clone, PartialEq)]
pub enum ZenohCommand {
    /// Demands this force, with this stamp; `None`: now.
    Force(Option<Stamp>, Newton),
    /// Loads the model with this name.
    Model(String),
    /// Fixes the mode with this name; `auto` releases it.
    Mode(String),
}

/// The reason why a command is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CommandRefusal {
    /// It cannot be decoded.
    #[error("it cannot be read: {0}")]
    Unreadable(String),
    /// Its deadline has passed.
    #[error("its deadline was {late_s:.3} s ago; check that the sender's clock agrees with the node's")]
    Late {
        /// Time since the deadline, s.
        late_s: f64,
    },
    /// Its deadline is too far ahead.
    #[error("its deadline is {ahead_s:.1} s ahead, but may be {AHEAD_S} s at most")]
    Early {
        /// Time until the deadline, s.
        ahead_s: f64,
    },
    /// It was received before, or a newer one was.
    #[error("its seq is {seq}, but must be above {last}; use nanoseconds since 1970")]
    Old {
        /// The command's number.
        seq: u64,
        /// The number of the last command on the same key.
        last: u64,
    },
    /// The command cannot be executed.
    #[error("{0}")]
    Impossible(String),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ForceRequest {
    seq: u64,
    deadline_ns: i64,
    stamp_ns: Option<i64>,
    force_n: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LoadModel {
    seq: u64,
    deadline_ns: i64,
    model: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SetMode {
    seq: u64,
    deadline_ns: i64,
    mode: String,
}

/// Decides which commands for one damper are accepted.
#[derive(Debug, Default)]
pub struct CommandCheck {
    last: [Option<u64>; CommandKind::ALL.len()],
}

impl CommandCheck {
    /// Checks the command `payload` at the time `now_ns` (since 1970).
    ///
    /// # Errors
    /// The reason why it is refused. Its number can then still be used.
    pub fn accept(
        &mut self,
        kind: CommandKind,
        payload: &[u8],
        is_cbor: bool,
        now_ns: i64,
    ) -> Result<ZenohCommand, CommandRefusal> {
        let (seq, deadline_ns, command) = match kind {
            CommandKind::ForceRequest => {
                let ForceRequest { seq, deadline_ns, stamp_ns, force_n } = read(payload, is_cbor)?;
                if !force_n.is_finite() {
                    return Err(CommandRefusal::Impossible(format!(
                        "force_n is {force_n}, but must be a finite number"
                    )));
                }
                (seq, deadline_ns, ZenohCommand::Force(stamp_ns.map(Stamp::from_nanos), Newton(force_n)))
            }
            CommandKind::LoadModel => {
                let LoadModel { seq, deadline_ns, model } = read(payload, is_cbor)?;
                (seq, deadline_ns, ZenohCommand::Model(model))
            }
            CommandKind::SetMode => {
                let SetMode { seq, deadline_ns, mode } = read(payload, is_cbor)?;
                (seq, deadline_ns, ZenohCommand::Mode(mode))
            }
        };
        let left_s = (i128::from(deadline_ns) - i128::from(now_ns)) as f64 * 1e-9;
        if left_s < 0.0 {
            return Err(CommandRefusal::Late { late_s: -left_s });
        }
        if left_s > AHEAD_S {
            return Err(CommandRefusal::Early { ahead_s: left_s });
        }
        let last = &mut self.last[kind as usize];
        match *last {
            Some(last) if seq <= last => Err(CommandRefusal::Old { seq, last }),
            _ => {
                *last = Some(seq);
                Ok(command)
            }
        }
    }
}

fn read<T: DeserializeOwned>(payload: &[u8], is_cbor: bool) -> Result<T, CommandRefusal> {
    if payload.len() > LONGEST {
        return Err(CommandRefusal::Unreadable(format!(
            "it has {} bytes; at most {LONGEST} are allowed",
            payload.len()
        )));
    }
    if is_cbor {
        ciborium::from_reader(payload).map_err(|error| CommandRefusal::Unreadable(error.to_string()))
    } else {
        serde_json::from_slice(payload).map_err(|error| CommandRefusal::Unreadable(error.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Write;

    const NOW: i64 = 1_800_000_000_000_000_000;
    const SECOND: i64 = 1_000_000_000;

    #[test]
    fn commands_and_their_fate_as_text() {
        let ok = NOW + SECOND;
        let force =
            |seq: u64, deadline: i64| format!(r#"{{"seq":{seq},"deadline_ns":{deadline},"force_n":350.5}}"#);
        let script = [
            (CommandKind::ForceRequest, "as it should be", force(5, ok)),
            (CommandKind::ForceRequest, "sent again", force(5, ok)),
            (CommandKind::ForceRequest, "overtaken", force(4, ok)),
            (CommandKind::ForceRequest, "late", force(6, NOW - SECOND / 4)),
            (CommandKind::ForceRequest, "good for too long", force(6, NOW + 60 * SECOND)),
            (CommandKind::ForceRequest, "the end of time", force(6, i64::MAX)),
            (CommandKind::ForceRequest, "its number was still free", force(6, ok)),
            (
                CommandKind::ForceRequest,
                "with a stamp",
                format!(r#"{{"seq":7,"stamp_ns":{NOW},"deadline_ns":{ok},"force_n":-2}}"#),
            ),
            (CommandKind::ForceRequest, "no force", format!(r#"{{"seq":8,"deadline_ns":{ok}}}"#)),
            (CommandKind::ForceRequest, "null", format!(r#"{{"seq":8,"deadline_ns":{ok},"force_n":null}}"#)),
            (
                CommandKind::ForceRequest,
                "in pounds",
                format!(r#"{{"seq":8,"deadline_ns":{ok},"force_lbf":1}}"#),
            ),
            (
                CommandKind::ForceRequest,
                "out of range",
                format!(r#"{{"seq":8,"deadline_ns":{ok},"force_n":1e999}}"#),
            ),
            (CommandKind::ForceRequest, "no JSON", "350".to_owned()),
            (CommandKind::ForceRequest, "nothing", String::new()),
            (
                CommandKind::LoadModel,
                "numbers of each key are its own",
                format!(r#"{{"seq":1,"deadline_ns":{ok},"model":"thesis/fuzzy-tanh/rp3-cs"}}"#),
            ),
            (CommandKind::SetMode, "a mode", format!(r#"{{"seq":1,"deadline_ns":{ok},"mode":"model"}}"#)),
            (
                CommandKind::SetMode,
                "a number below zero",
                format!(r#"{{"seq":-1,"deadline_ns":{ok},"mode":"auto"}}"#),
            ),
            (
                CommandKind::SetMode,
                "very long",
                format!(r#"{{"seq":2,"deadline_ns":{ok},"mode":"{}"}}"#, "m".repeat(5000)),
            ),
        ];
        let (mut check, mut text) = (CommandCheck::default(), String::new());
        for (kind, what, payload) in script {
            let fate = match check.accept(kind, payload.as_bytes(), false, NOW) {
                Ok(command) => format!("{command:?}"),
                Err(refusal) => format!("refused: {refusal}"),
            };
            writeln!(text, "{} {what}: {fate}", kind.name()).expect("a text");
        }
        insta::assert_snapshot!(text);
    }

    #[test]
    fn a_force_in_json_is_parsed_exactly() {
        // A number that a fast parser rounds to its neighbour.
        let force_n = 1.411_178_216_845_334_5e277;
        let payload = format!(r#"{{"seq":1,"deadline_ns":{},"force_n":{force_n:e}}}"#, NOW + SECOND);
        let taken = CommandCheck::default().accept(CommandKind::ForceRequest, payload.as_bytes(), false, NOW);
        assert_eq!(taken, Ok(ZenohCommand::Force(None, Newton(force_n))));
    }

    #[test]
    fn cbor_commands_follow_the_same_rules() {
        let cbor = |value: &ciborium::Value| {
            let mut bytes = Vec::new();
            ciborium::into_writer(value, &mut bytes).expect("a value");
            bytes
        };
        let map = |force_n: f64| {
            ciborium::Value::Map(vec![
                ("seq".into(), 1.into()),
                ("deadline_ns".into(), (NOW + SECOND).into()),
                ("force_n".into(), force_n.into()),
            ])
        };
        let mut check = CommandCheck::default();
        for odd in [f64::NAN, f64::INFINITY] {
            let refused = check.accept(CommandKind::ForceRequest, &cbor(&map(odd)), true, NOW);
            assert!(matches!(refused, Err(CommandRefusal::Impossible(_))), "{refused:?}");
        }
        let taken = check.accept(CommandKind::ForceRequest, &cbor(&map(12.5)), true, NOW);
        assert_eq!(taken, Ok(ZenohCommand::Force(None, Newton(12.5))));
        let refused = check.accept(CommandKind::ForceRequest, b"\x9f\x9f\x9f\x9f", true, NOW);
        assert!(matches!(refused, Err(CommandRefusal::Unreadable(_))), "{refused:?}");
    }
}
