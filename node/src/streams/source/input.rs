//! The input topics: the message type of each, and where the number is in the message.

use crate::settings::config::{Config, InputConfig, RosArgs};
use crate::settings::error::NodeError;
use mr_damper_base::shown;
use mr_damper_msgs::standard::{Float64, Header, JointState, Temperature};
use mr_damper_msgs::{
    CdrError, CoilCurrent, CommandVoltage, Descriptor, Displacement, Force, Message, Velocity, cdr,
};

/// The input topics. The first one is polled first; `ros.rs` explains the order.
pub const TOPICS: [&str; 8] = [
    "displacement",
    "coil_current",
    "command_voltage",
    "velocity",
    "measured_force",
    "body_velocity",
    "force_request",
    "case_temperature",
];

/// The number of a message, with stamp and frame from its header.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Number {
    /// Stamp, ns; 0: none.
    pub(super) stamp_ns: i64,
    /// The number as it is in the message.
    pub(super) value: f64,
    /// Frame; empty: none.
    pub(super) frame_id: String,
}

impl Number {
    fn new(header: Header, value: f64) -> Self {
        Self { stamp_ns: header.stamp.as_nanos(), value, frame_id: header.frame_id }
    }
}

/// The number read from a message, or why the message does not contain it.
pub(super) type ReadNumber = Result<Number, JointError>;

/// Maximum number of joints that a [`JointError`] names.
const LISTED_JOINTS: usize = 8;

/// Reasons why a `JointState` does not contain the number of an input.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum JointError {
    /// The message does not name the joint.
    #[error(
        "the joint {joint} is not in the message, which has {}; set {input}.joint to the joint of this damper",
        listed(joints, *others)
    )]
    Absent {
        /// The joint that is read.
        joint: String,
        /// The input, by its name in the node.
        input: &'static str,
        /// The first joints of the message.
        joints: Vec<String>,
        /// Number of further joints.
        others: usize,
    },
    /// The message names the joint, but the number is not there.
    #[error(
        "the joint {joint} has no {quantity} in the message; let its publisher send the {quantity} of each joint, or set {input}.joint \
         to another joint"
    )]
    NoNumber {
        /// The joint that is read.
        joint: String,
        /// The input, by its name in the node.
        input: &'static str,
        /// The missing quantity.
        quantity: &'static str,
    },
}

impl JointError {
    fn absent(joint: &str, input: &'static str, all: &[String]) -> Self {
        let joints: Vec<String> = all.iter().take(LISTED_JOINTS).map(|name| shown::name(name)).collect();
        let others = all.len().saturating_sub(joints.len());
        Self::Absent { joint: joint.to_owned(), input, joints, others }
    }
}

/// The joints of a message in words.
fn listed(joints: &[String], others: usize) -> String {
    match (joints, others) {
        ([], _) => "no joints".to_owned(),
        (joints, 0) => format!("the joints {}", joints.join(", ")),
        (joints, others) => format!("the joints {} and {others} more", joints.join(", ")),
    }
}

/// A message with one number.
pub(super) trait CarriesNumber: Message {
    /// The message's number.
    fn taken(self) -> Number;
}

macro_rules! carries {
    ($($message:ty: $field:ident),+) => {
        $(impl CarriesNumber for $message {
            fn taken(self) -> Number {
                Number::new(self.header, self.$field)
            }
        })+
    };
}
carries!(
    Displacement: displacement, Velocity: velocity, CoilCurrent: current, CommandVoltage: voltage, Force: force,
    Temperature: temperature
);

impl CarriesNumber for Float64 {
    fn taken(self) -> Number {
        Number { value: self.data, ..Number::default() }
    }
}

/// The number of one joint: position, velocity or effort, depending on `topic`.
///
/// # Errors
/// When the message does not name the joint, or does not have the number.
pub(super) fn of_joint(message: JointState, topic: &'static str, joint: &str) -> ReadNumber {
    let Some(index) = message.name.iter().position(|name| name == joint) else {
        return Err(JointError::absent(joint, topic, &message.name));
    };
    let (column, quantity) = match topic {
        "displacement" => (message.position, "position"),
        "velocity" | "body_velocity" => (message.velocity, "velocity"),
        _ => (message.effort, "effort"),
    };
    match column.get(index) {
        Some(value) => Ok(Number::new(message.header, *value)),
        None => Err(JointError::NoNumber { joint: joint.to_owned(), input: topic, quantity }),
    }
}

/// The joint that is read for `topic`.
///
/// # Errors
/// When no joint is named.
pub(super) fn joint_of(topic: &str, settings: &InputConfig) -> Result<String, NodeError> {
    if settings.joint.is_empty() {
        return Err(NodeError::Parameter {
            name: format!("{topic}.joint"),
            value: "\"\"".to_owned(),
            expected: format!("the joint's name, because {topic}.type is {}", JointState::TYPE),
        });
    }
    Ok(settings.joint.clone())
}

/// An input as it appears in the ROS graph.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InputTopic {
    /// Full name.
    pub topic: String,
    /// DDS name of the messages' type.
    pub dds_type_name: &'static str,
    /// True if the topic should have one publisher only. Joints of one topic may come from several.
    pub has_one_publisher: bool,
    /// True if estimates depend on it.
    pub is_estimated_from: bool,
}

/// True for an input that estimates depend on. The other inputs only determine the commanded current.
pub(super) fn is_estimated_from(topic: &str) -> bool {
    !matches!(topic, "body_velocity" | "force_request")
}

/// The inputs of a node, in the order of `TOPICS`.
///
/// # Errors
/// When an input is of type `JointState` and no joint is named.
pub fn inputs(args: &RosArgs, config: &Config) -> Result<Vec<InputTopic>, NodeError> {
    let input = |name: &'static str| {
        let of = Reader::of(name, &config.input(name).cloned().unwrap_or_default())?.of;
        let has_one_publisher = of.type_name != JointState::TYPE;
        Ok(InputTopic {
            topic: args.topic(name),
            dds_type_name: of.dds_type_name,
            has_one_publisher,
            is_estimated_from: is_estimated_from(name),
        })
    };
    TOPICS.into_iter().map(input).collect()
}

type Read = dyn Fn(&[u8]) -> Result<ReadNumber, CdrError> + Send + Sync;

/// Reads the messages of one topic from their bytes.
pub(super) struct Reader {
    /// The messages' type.
    pub(super) of: Descriptor,
    read: Box<Read>,
}

impl Reader {
    /// The reader of `topic`, one of [`TOPICS`].
    ///
    /// # Errors
    /// When the input is of type `JointState` and no joint is named.
    pub(super) fn of(topic: &'static str, settings: &InputConfig) -> Result<Self, NodeError> {
        Ok(match settings.message_type.as_str() {
            Float64::TYPE => Self::plain::<Float64>(),
            JointState::TYPE => {
                let joint = joint_of(topic, settings)?;
                Self {
                    of: Descriptor::of::<JointState>(),
                    read: Box::new(move |bytes| Ok(of_joint(cdr::from_slice(bytes)?, topic, &joint))),
                }
            }
            _ => match topic {
                "displacement" => Self::plain::<Displacement>(),
                "velocity" | "body_velocity" => Self::plain::<Velocity>(),
                "coil_current" => Self::plain::<CoilCurrent>(),
                "command_voltage" => Self::plain::<CommandVoltage>(),
                "case_temperature" => Self::plain::<Temperature>(),
                _ => Self::plain::<Force>(),
            },
        })
    }

    fn plain<M: CarriesNumber>() -> Self {
        let read = |bytes: &[u8]| Ok(Ok(cdr::from_slice::<M>(bytes)?.taken()));
        Self { of: Descriptor::of::<M>(), read: Box::new(read) }
    }

    /// Reads the number of a message.
    ///
    /// # Errors
    /// When the bytes do not decode as this type.
    pub(super) fn read(&self, bytes: &[u8]) -> Result<ReadNumber, CdrError> {
        (self.read)(bytes)
    }

    /// True if messages have no stamp. Under simulated time, each of them must wake the source thread.
    pub(super) fn is_unstamped(&self) -> bool {
        self.of.type_name == Float64::TYPE
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_msgs::standard::Time;

    fn settings(of: &str, joint: &str) -> InputConfig {
        InputConfig { message_type: of.to_owned(), joint: joint.to_owned(), ..InputConfig::default() }
    }

    fn read<M: Message>(topic: &'static str, settings: &InputConfig, message: &M) -> ReadNumber {
        let reader = Reader::of(topic, settings).expect("it can be read");
        assert_eq!(reader.of, Descriptor::of::<M>(), "{topic}");
        assert_eq!(reader.is_unstamped(), M::TYPE == Float64::TYPE, "{topic}");
        reader.read(&cdr::to_vec(message).expect("it can be written")).expect("it can be read")
    }

    #[test]
    fn each_topic_is_read_from_its_message_type() {
        let header = Header { stamp: Time { sec: 1, nanosec: 5 }, frame_id: "rig".to_owned() };
        let own = InputConfig::default();
        let number = |value| Number { stamp_ns: 1_000_000_005, value, frame_id: "rig".to_owned() };
        let (variance, expected) = (9.0, Ok(number(0.25)));
        for topic in TOPICS {
            let header = header.clone();
            let taken = match topic {
                "displacement" => read(topic, &own, &Displacement { header, displacement: 0.25, variance }),
                "coil_current" => read(topic, &own, &CoilCurrent { header, current: 0.25, variance }),
                "command_voltage" => read(topic, &own, &CommandVoltage { header, voltage: 0.25, variance }),
                "velocity" | "body_velocity" => {
                    read(topic, &own, &Velocity { header, velocity: 0.25, variance })
                }
                "case_temperature" => read(topic, &own, &Temperature { header, temperature: 0.25, variance }),
                _ => read(topic, &own, &Force { header, force: 0.25, variance }),
            };
            assert_eq!(taken, expected, "{topic}");
            let unstamped = read(topic, &settings(Float64::TYPE, ""), &Float64 { data: 0.25 });
            let plain = Number { value: 0.25, ..Number::default() };
            assert_eq!(unstamped, Ok(plain), "{topic}: without stamp and frame");
        }
        let joints = JointState {
            header,
            name: vec!["front".to_owned(), "rear".to_owned()],
            position: vec![1.0, 2.0],
            velocity: vec![3.0, 4.0],
            effort: vec![5.0],
        };
        for (topic, joint, value) in [
            ("displacement", "rear", Some(2.0)),
            ("velocity", "rear", Some(4.0)),
            ("measured_force", "front", Some(5.0)),
            ("measured_force", "rear", None),
            ("displacement", "middle", None),
        ] {
            let taken = read(topic, &settings(JointState::TYPE, joint), &joints);
            assert_eq!(taken.ok(), value.map(number), "{topic} {joint}");
        }
        let nameless = Reader::of("displacement", &settings(JointState::TYPE, ""));
        let why = nameless.err().expect("a joint is missing").to_string();
        assert!(why.contains("displacement.joint"), "{why}");
    }

    #[test]
    fn a_missing_joint_is_named_with_the_joints_of_the_message_and_the_parameter() {
        let message = |names: &[&str]| JointState {
            name: names.iter().map(|name| (*name).to_owned()).collect(),
            ..JointState::default()
        };
        let why = |names: &[&str], topic, joint| {
            of_joint(message(names), topic, joint).expect_err("the number is missing").to_string()
        };
        assert_eq!(
            why(&["front", "rear"], "displacement", "middle"),
            "the joint middle is not in the message, which has the joints front, rear; set displacement.joint to the joint of this \
             damper"
        );
        assert!(why(&[], "velocity", "middle").contains("which has no joints; set velocity.joint"));
        let many = ["a", "b", "c", "d", "e", "f", "g", "h", "i", "j"];
        assert!(why(&many, "displacement", "x").contains("the joints a, b, c, d, e, f, g, h and 2 more;"));
        assert!(why(&["a\u{1b}"], "displacement", "x").contains("the joints a\\u{1b};"));
        let unfilled = why(&["front"], "measured_force", "front");
        assert!(unfilled.starts_with("the joint front has no effort in the message"), "{unfilled}");
    }
}
