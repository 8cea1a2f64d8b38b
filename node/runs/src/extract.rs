//! Reads one number from a message: which ROS types can carry a quantity, and where the number is in them.
//!
//! | quantity | types |
//! |---|---|
//! | length | `mr_damper_msgs/msg/Displacement`, `sensor_msgs/msg/Range`, position of a joint |
//! | velocity | `mr_damper_msgs/msg/Velocity`, linear axis of `geometry_msgs/msg/TwistStamped`, velocity of a joint |
//! | force | `mr_damper_msgs/msg/Force`, force axis of `geometry_msgs/msg/WrenchStamped`, effort of a joint |
//! | current | `mr_damper_msgs/msg/CoilCurrent`, effort of a joint |
//! | voltage | `mr_damper_msgs/msg/CommandVoltage`, effort of a joint |
//! | temperature | `sensor_msgs/msg/Temperature` |
//! | each of them | `std_msgs/msg/Float64`, `std_msgs/msg/Float32` |
//!
//! A joint is one entry of a `sensor_msgs/msg/JointState`, selected by name. Values are SI; temperatures are in °C.
//! [`Extractor`] reads serialised messages, as in bags; [`CarriesValue`] is for decoded messages.

use mr_damper_msgs::geometry::{TwistStamped, Vector3, WrenchStamped};
use mr_damper_msgs::standard::{Float32, Float64, JointState, Range, Temperature};
use mr_damper_msgs::{
    CdrError, CoilCurrent, CommandVoltage, Descriptor, Displacement, Force, Message, Velocity, cdr,
};
use std::fmt;

/// A kind of physical quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dimension {
    /// m.
    Length,
    /// m/s.
    Velocity,
    /// N.
    Force,
    /// A.
    Current,
    /// V.
    Voltage,
    /// °C.
    Temperature,
}

impl Dimension {
    pub(super) const ALL: [Self; 6] =
        [Self::Length, Self::Velocity, Self::Force, Self::Current, Self::Voltage, Self::Temperature];
}

/// An axis of a vector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// The first.
    X,
    /// The second.
    Y,
    /// The third.
    Z,
}

/// The axis that is used if none is named.
pub const DEFAULT_AXIS: Axis = Axis::Z;

/// One of a joint's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointField {
    /// Position, in m.
    Position,
    /// Velocity, in m/s.
    Velocity,
    /// Effort, in N.
    Effort,
}

/// The place of the number in a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum MessagePart {
    /// The message holds one number.
    Whole,
    /// At one joint.
    Joint(String, JointField),
    /// Along one axis.
    Axis(Axis),
}

/// Stamp and number of a message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedValue {
    /// The header's stamp, ns; `None` for types without header.
    pub stamp_ns: Option<i64>,
    /// The number; `None` if the publisher left it out.
    pub value: Option<f64>,
}

/// The value of a channel from a reading in SI: `sign * (reading - offset)`.
#[must_use]
pub fn calibrated(reading: f64, sign: f64, offset: f64) -> f64 {
    sign * (reading - offset)
}

/// The reason why a type cannot carry a quantity.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum UnsuitableSource {
    /// The type does not carry the quantity.
    #[error("{found} has no {of}; accepted types are {}", of.accepted())]
    Type {
        /// The type.
        found: String,
        /// The wanted quantity.
        of: Dimension,
    },
    /// An IMU was given for a velocity.
    #[error(
        "sensor_msgs/msg/Imu holds an acceleration, and a velocity integrated from it drifts, so this is not \
         supported: record the velocity of a state estimator as mr_damper_msgs/msg/Velocity or geometry_msgs/msg/TwistStamped"
    )]
    Imu,
    /// No joint was named.
    #[error("sensor_msgs/msg/JointState holds several joints: name one after a colon, as in {topic}:JOINT")]
    NoJoint {
        /// The topic.
        topic: String,
    },
    /// A joint or axis was named for a type that has neither.
    #[error("{found} has neither joints nor axes: leave out `:{part}`")]
    NoParts {
        /// The type.
        found: &'static str,
        /// The named joint or axis.
        part: String,
    },
    /// The named axis does not exist.
    #[error("{found} has axes x, y and z, not `{part}`")]
    Axis {
        /// The type.
        found: &'static str,
        /// The named joint or axis.
        part: String,
    },
}

/// The reason why a message gave no number.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ExtractFault {
    /// The bytes do not decode as this type.
    #[error(transparent)]
    Bytes(#[from] CdrError),
    /// The message does not contain the joint.
    #[error("joint `{joint}` is not among: {}", found.join(", "))]
    Joint {
        /// The joint.
        joint: String,
        /// The joints that it contains.
        found: Vec<String>,
    },
}

/// A message that can carry a number.
pub trait CarriesValue: Message {
    /// The message's stamp and the number at `part`.
    ///
    /// # Errors
    /// [`ExtractFault::Joint`] when the message does not contain the joint.
    fn taken(&self, part: &MessagePart) -> Result<StampedValue, ExtractFault>;
}

macro_rules! carries_one {
    ($($message:ty: $field:ident),+) => {
        $(impl CarriesValue for $message {
            fn taken(&self, _: &MessagePart) -> Result<StampedValue, ExtractFault> {
                let value = f64::from(self.$field);
                Ok(StampedValue { stamp_ns: Some(self.header.stamp.as_nanos()), value: Some(value) })
            }
        })+
    };
}
carries_one!(
    Displacement: displacement, Velocity: velocity, Force: force, CoilCurrent: current, CommandVoltage: voltage,
    Temperature: temperature, Range: range
);

macro_rules! carries_number {
    ($($message:ty),+) => {
        $(impl CarriesValue for $message {
            fn taken(&self, _: &MessagePart) -> Result<StampedValue, ExtractFault> {
                Ok(StampedValue { stamp_ns: None, value: Some(f64::from(self.data)) })
            }
        })+
    };
}
carries_number!(Float64, Float32);

macro_rules! carries_axes {
    ($($message:ty: $body:ident.$vector:ident),+) => {
        $(impl CarriesValue for $message {
            fn taken(&self, part: &MessagePart) -> Result<StampedValue, ExtractFault> {
                let value = along(&self.$body.$vector, part);
                Ok(StampedValue { stamp_ns: Some(self.header.stamp.as_nanos()), value: Some(value) })
            }
        })+
    };
}
carries_axes!(WrenchStamped: wrench.force, TwistStamped: twist.linear);

fn along(vector: &Vector3, part: &MessagePart) -> f64 {
    match part {
        MessagePart::Axis(Axis::X) => vector.x,
        MessagePart::Axis(Axis::Y) => vector.y,
        _ => vector.z,
    }
}

impl CarriesValue for JointState {
    fn taken(&self, part: &MessagePart) -> Result<StampedValue, ExtractFault> {
        let stamp_ns = Some(self.header.stamp.as_nanos());
        let MessagePart::Joint(joint, field) = part else {
            return Ok(StampedValue { stamp_ns, value: None });
        };
        let Some(index) = self.name.iter().position(|name| name == joint) else {
            return Err(ExtractFault::Joint { joint: joint.clone(), found: self.name.clone() });
        };
        // Publishers leave arrays empty that they do not know.
        let values = match field {
            JointField::Position => &self.position,
            JointField::Velocity => &self.velocity,
            JointField::Effort => &self.effort,
        };
        Ok(StampedValue { stamp_ns, value: values.get(index).copied() })
    }
}

type Read = fn(&[u8], &MessagePart) -> Result<StampedValue, ExtractFault>;

/// A type that can carry a quantity.
struct Accepted {
    of: Descriptor,
    read: Read,
    parts: Parts,
}

/// The parts of a type from which one must be chosen.
enum Parts {
    None,
    Axes,
    Joints(JointField),
}

const fn accepted<M: CarriesValue>(parts: Parts) -> Accepted {
    Accepted { of: Descriptor::of::<M>(), read: read::<M>, parts }
}

fn read<M: CarriesValue>(bytes: &[u8], part: &MessagePart) -> Result<StampedValue, ExtractFault> {
    cdr::from_slice::<M>(bytes)?.taken(part)
}

/// Reads a `Range`. Before ROS 2 Iron it lacked its last field, the variance: four zero bytes are added for it then.
fn read_range(bytes: &[u8], part: &MessagePart) -> Result<StampedValue, ExtractFault> {
    match cdr::from_slice::<Range>(bytes) {
        Ok(range) => range.taken(part),
        Err(error) => match cdr::from_slice::<Range>(&[bytes, &[0; 4]].concat()) {
            Ok(range) => range.taken(part),
            Err(_) => Err(error.into()),
        },
    }
}

const RANGE: Accepted = Accepted { of: Descriptor::of::<Range>(), read: read_range, parts: Parts::None };
const FLOAT64: Accepted = accepted::<Float64>(Parts::None);
const FLOAT32: Accepted = accepted::<Float32>(Parts::None);

const fn joint(field: JointField) -> Accepted {
    accepted::<JointState>(Parts::Joints(field))
}

impl Dimension {
    /// The types that can carry the quantity; the native type comes first.
    const fn types(self) -> &'static [Accepted] {
        match self {
            Self::Length => {
                const {
                    &[
                        accepted::<Displacement>(Parts::None),
                        RANGE,
                        joint(JointField::Position),
                        FLOAT64,
                        FLOAT32,
                    ]
                }
            }
            Self::Velocity => {
                const {
                    &[
                        accepted::<Velocity>(Parts::None),
                        accepted::<TwistStamped>(Parts::Axes),
                        joint(JointField::Velocity),
                        FLOAT64,
                        FLOAT32,
                    ]
                }
            }
            Self::Force => {
                const {
                    &[
                        accepted::<Force>(Parts::None),
                        accepted::<WrenchStamped>(Parts::Axes),
                        joint(JointField::Effort),
                        FLOAT64,
                        FLOAT32,
                    ]
                }
            }
            Self::Current => {
                const { &[accepted::<CoilCurrent>(Parts::None), joint(JointField::Effort), FLOAT64, FLOAT32] }
            }
            Self::Voltage => {
                const { &[accepted::<CommandVoltage>(Parts::None), joint(JointField::Effort), FLOAT64, FLOAT32] }
            }
            Self::Temperature => const { &[accepted::<Temperature>(Parts::None), FLOAT64, FLOAT32] },
        }
    }

    /// The names of the types that can carry the quantity; the native type comes first.
    #[must_use]
    pub fn accepted(self) -> String {
        let names: Vec<_> = self.types().iter().map(|accepted| accepted.of.type_name).collect();
        names.join(", ")
    }

    /// True if `type_name` can carry the quantity.
    #[must_use]
    pub fn takes(self, type_name: &str) -> bool {
        self.types().iter().any(|accepted| accepted.of.type_name == type_name)
    }
}

impl fmt::Display for Dimension {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Length => "length",
            Self::Velocity => "velocity",
            Self::Force => "force",
            Self::Current => "current",
            Self::Voltage => "voltage",
            Self::Temperature => "temperature",
        })
    }
}

impl fmt::Display for Axis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
        })
    }
}

/// Reads one number from serialised messages of one type.
#[derive(Debug, Clone)]
pub struct Extractor {
    /// The messages' type.
    pub of: Descriptor,
    /// The place of the number in them.
    pub part: MessagePart,
    read: Read,
}

impl Extractor {
    /// An extractor for `quantity` in messages of `type_name` on `topic`, at the joint or axis `part`.
    ///
    /// # Errors
    /// When the type cannot carry the quantity, or has no such part.
    pub fn new(
        quantity: Dimension,
        topic: &str,
        type_name: &str,
        part: Option<&str>,
    ) -> Result<Self, UnsuitableSource> {
        let Some(accepted) = quantity.types().iter().find(|accepted| accepted.of.type_name == type_name)
        else {
            let is_velocity_of_imu = quantity == Dimension::Velocity && type_name == IMU;
            let found = if type_name.is_empty() { "an unknown type" } else { type_name }.to_owned();
            return Err(if is_velocity_of_imu {
                UnsuitableSource::Imu
            } else {
                UnsuitableSource::Type { found, of: quantity }
            });
        };
        let found = accepted.of.type_name;
        let part = match (&accepted.parts, part.filter(|part| !part.is_empty())) {
            (Parts::None, None) => MessagePart::Whole,
            (Parts::None, Some(part)) => {
                return Err(UnsuitableSource::NoParts { found, part: part.to_owned() });
            }
            (Parts::Joints(field), Some(joint)) => MessagePart::Joint(joint.to_owned(), *field),
            (Parts::Joints(_), None) => return Err(UnsuitableSource::NoJoint { topic: topic.to_owned() }),
            (Parts::Axes, None) => MessagePart::Axis(DEFAULT_AXIS),
            (Parts::Axes, Some(part)) => match axis(part) {
                Some(axis) => MessagePart::Axis(axis),
                None => return Err(UnsuitableSource::Axis { found, part: part.to_owned() }),
            },
        };
        Ok(Self { of: accepted.of, part, read: accepted.read })
    }

    /// Stamp and number of a message; `cdr` includes the encapsulation header.
    ///
    /// # Errors
    /// When the bytes do not decode as this type, or the message does not contain the joint.
    pub fn read(&self, cdr: &[u8]) -> Result<StampedValue, ExtractFault> {
        (self.read)(cdr, &self.part)
    }

    /// True if messages have no stamp; their samples are stamped on arrival.
    #[must_use]
    pub fn is_unstamped(&self) -> bool {
        matches!(self.of.type_name, Float64::TYPE | Float32::TYPE)
    }
}

/// An unsupported type that users often try for velocities.
const IMU: &str = "sensor_msgs/msg/Imu";

/// The axis with this name in upper or lower case, for example `z`, `force.z`, `linear.z`.
fn axis(name: &str) -> Option<Axis> {
    let plain = name.strip_prefix("force.").or_else(|| name.strip_prefix("linear.")).unwrap_or(name);
    match plain.to_ascii_lowercase().as_str() {
        "x" => Some(Axis::X),
        "y" => Some(Axis::Y),
        "z" => Some(Axis::Z),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_msgs::geometry::{Twist, Wrench};
    use mr_damper_msgs::standard::{Header, Time};

    fn header() -> Header {
        Header { stamp: Time { sec: 1, nanosec: 5 }, frame_id: "rig".to_owned() }
    }

    fn read<M: Message>(
        of: Dimension,
        part: Option<&str>,
        message: &M,
    ) -> Result<StampedValue, ExtractFault> {
        let extractor = Extractor::new(of, "/t", M::TYPE, part).expect("it fits");
        extractor.read(&cdr::to_vec(message).expect("it can be written"))
    }

    fn stamped(value: f64) -> Result<StampedValue, ExtractFault> {
        Ok(StampedValue { stamp_ns: Some(1_000_000_005), value: Some(value) })
    }

    #[test]
    fn each_type_gives_its_number() {
        let (header, variance) = (header(), 9.0);
        let own = header.clone();
        assert_eq!(
            read(Dimension::Length, None, &Displacement { header: own, displacement: 0.25, variance }),
            stamped(0.25)
        );
        let range = Range { header: header.clone(), range: 0.375, max_range: 4.0, ..Range::default() };
        assert_eq!(read(Dimension::Length, None, &range), stamped(0.375));
        let vector = Vector3 { x: 1.0, y: 2.0, z: 3.0 };
        let wrench = WrenchStamped {
            header: header.clone(),
            wrench: Wrench { force: vector, torque: Vector3::default() },
        };
        let twist = TwistStamped { header, twist: Twist { linear: vector, angular: Vector3::default() } };
        for (part, value) in [(None, 3.0), (Some("z"), 3.0), (Some("X"), 1.0), (Some("y"), 2.0)] {
            assert_eq!(read(Dimension::Force, part, &wrench), stamped(value));
            assert_eq!(read(Dimension::Velocity, part, &twist), stamped(value));
        }
        assert_eq!(read(Dimension::Force, Some("force.x"), &wrench), stamped(1.0));
        for of in Dimension::ALL {
            let taken = Ok(StampedValue { stamp_ns: None, value: Some(0.25) });
            assert_eq!(read(of, None, &Float64 { data: 0.25 }), taken, "{of}");
            assert_eq!(read(of, None, &Float32 { data: 0.25 }), taken, "{of}");
        }
    }

    #[test]
    fn a_joint_gives_position_velocity_or_effort_by_the_quantity() {
        let joints = JointState {
            header: header(),
            name: vec!["front".to_owned(), "rear".to_owned()],
            position: vec![1.0, 2.0],
            velocity: vec![3.0, 4.0],
            effort: vec![5.0],
        };
        assert_eq!(read(Dimension::Length, Some("rear"), &joints), stamped(2.0));
        assert_eq!(read(Dimension::Velocity, Some("rear"), &joints), stamped(4.0));
        for of in [Dimension::Force, Dimension::Current, Dimension::Voltage] {
            assert_eq!(read(of, Some("front"), &joints), stamped(5.0), "{of}");
        }
        let nothing = Ok(StampedValue { stamp_ns: Some(1_000_000_005), value: None });
        assert_eq!(read(Dimension::Force, Some("rear"), &joints), nothing, "its effort is not published");
        let fault = read(Dimension::Length, Some("knee"), &joints).expect_err("no such joint").to_string();
        assert_eq!(fault, "joint `knee` is not among: front, rear");
    }

    #[test]
    fn a_range_of_humble_without_variance_is_read() {
        let range = Range { header: header(), range: 0.375, variance: 1.0, ..Range::default() };
        let bytes = cdr::to_vec(&range).expect("it can be written");
        let extractor = Extractor::new(Dimension::Length, "/t", Range::TYPE, None).expect("it fits");
        assert_eq!(extractor.read(&bytes[..bytes.len() - 4]), stamped(0.375));
        // Cut anywhere else, the bytes do not decode.
        for length in 0..bytes.len() - 4 {
            assert!(extractor.read(&bytes[..length]).is_err(), "{length}");
        }
    }

    #[test]
    fn an_unfit_type_or_part_is_an_error_with_a_reason() {
        let why = |of, type_name: &str, part: Option<&str>| {
            Extractor::new(of, "/t", type_name, part).expect_err("unfit").to_string()
        };
        let imu = why(Dimension::Velocity, IMU, None);
        assert!(imu.contains("drifts") && imu.contains("TwistStamped"), "{imu}");
        assert!(
            why(Dimension::Length, IMU, None)
                .starts_with("sensor_msgs/msg/Imu has no length; accepted types")
        );
        let cell = why(Dimension::Temperature, JointState::TYPE, Some("a"));
        assert!(
            cell.contains("has no temperature; accepted types are sensor_msgs/msg/Temperature"),
            "{cell}"
        );
        assert!(why(Dimension::Length, JointState::TYPE, None).contains("as in /t:JOINT"));
        assert!(why(Dimension::Length, Range::TYPE, Some("z")).contains("leave out `:z`"));
        assert!(why(Dimension::Force, WrenchStamped::TYPE, Some("w")).contains("axes x, y and z, not `w`"));
        assert!(why(Dimension::Force, WrenchStamped::TYPE, Some("torque.x")).contains("not `torque.x`"));
        assert!(why(Dimension::Force, "", None).starts_with("an unknown type has no force"));
    }
}
