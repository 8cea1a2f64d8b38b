//! The input topics: which message each carries, and where in it its number is.

use crate::config::InputConfig;
use crate::error::NodeError;
use mr_damper_msgs::standard::{Float64, Header, JointState, Temperature};
use mr_damper_msgs::{
    CdrError, CoilCurrent, CommandVoltage, Descriptor, Displacement, Force, Message, Velocity, cdr,
};

/// The input topics. The first one is polled first: see the comment of `ros.rs` on the order.
pub(super) const TOPICS: [&str; 8] = [
    "displacement",
    "coil_current",
    "command_voltage",
    "velocity",
    "measured_force",
    "body_velocity",
    "force_request",
    "case_temperature",
];

/// Stamp (ns; zero: none) and plain value of a message; `None` when it holds no value for us.
pub(super) type Taken = Option<(i64, f64)>;

/// A message that holds one number.
pub(super) trait Carries: Message {
    /// Its stamp and that number.
    fn taken(self) -> (i64, f64);
}

macro_rules! carries {
    ($($message:ty: $field:ident),+) => {
        $(impl Carries for $message {
            fn taken(self) -> (i64, f64) {
                let Header { stamp, .. } = self.header;
                (stamp.as_nanos(), self.$field)
            }
        })+
    };
}
carries!(
    Displacement: displacement, Velocity: velocity, CoilCurrent: current, CommandVoltage: voltage, Force: force,
    Temperature: temperature
);

impl Carries for Float64 {
    fn taken(self) -> (i64, f64) {
        (0, self.data)
    }
}

/// The number of one joint: position, velocity or effort, whichever `topic` is about.
pub(super) fn of_joint(message: JointState, topic: &str, joint: &str) -> Taken {
    let index = message.name.iter().position(|name| name == joint)?;
    let column = match topic {
        "displacement" => message.position,
        "velocity" | "body_velocity" => message.velocity,
        _ => message.effort,
    };
    column.get(index).map(|value| (message.header.stamp.as_nanos(), *value))
}

/// The joint that `topic` is taken from.
///
/// # Errors
/// When none is named.
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

type Read = dyn Fn(&[u8]) -> Result<Taken, CdrError> + Send + Sync;

/// Reads the messages of one topic out of their bytes.
pub(super) struct Reader {
    /// The messages' type.
    pub(super) of: Descriptor,
    read: Box<Read>,
}

impl Reader {
    /// The reader of `topic`, one of [`TOPICS`].
    ///
    /// # Errors
    /// When a joint is to be taken and none is named.
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

    fn plain<M: Carries>() -> Self {
        let read = |bytes: &[u8]| Ok(Some(cdr::from_slice::<M>(bytes)?.taken()));
        Self { of: Descriptor::of::<M>(), read: Box::new(read) }
    }

    /// Stamp and value of a message.
    ///
    /// # Errors
    /// When the bytes are none of this type.
    pub(super) fn read(&self, bytes: &[u8]) -> Result<Taken, CdrError> {
        (self.read)(bytes)
    }

    /// True where samples are stamped on arrival, so that each has to wake the thread that takes them.
    pub(super) fn stamps_on_arrival(&self) -> bool {
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

    fn read<M: Message>(topic: &'static str, settings: &InputConfig, message: &M) -> Taken {
        let reader = Reader::of(topic, settings).expect("it can be read");
        assert_eq!(reader.of, Descriptor::of::<M>(), "{topic}");
        assert_eq!(reader.stamps_on_arrival(), M::TYPE == Float64::TYPE, "{topic}");
        reader.read(&cdr::to_vec(message).expect("it can be written")).expect("it can be read")
    }

    #[test]
    fn each_topic_has_its_message_and_its_number() {
        let header = Header { stamp: Time { sec: 1, nanosec: 5 }, frame_id: "rig".to_owned() };
        let own = InputConfig::default();
        let (variance, expected) = (9.0, Some((1_000_000_005, 0.25)));
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
            let number = read(topic, &settings(Float64::TYPE, ""), &Float64 { data: 0.25 });
            assert_eq!(number, Some((0, 0.25)), "{topic}: stamped on arrival");
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
            assert_eq!(taken, value.map(|value| (1_000_000_005, value)), "{topic} {joint}");
        }
        let nameless = Reader::of("displacement", &settings(JointState::TYPE, ""));
        let why = nameless.err().expect("a joint is missing").to_string();
        assert!(why.contains("displacement.joint"), "{why}");
    }
}
