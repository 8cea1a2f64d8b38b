//! The ROS 2 interface package `mr_damper_msgs`, in Rust.
//!
//! This directory is both a ROS 2 package that colcon builds (`package.xml`, `msg/`, `srv/`, `action/`) and
//! this crate, which implements the same interface without a ROS installation. The definition files are the
//! only source of both: the crate includes their text, and tests compare the structs, constants, bytes and type
//! hashes with it and with an independent implementation.
//!
//! SI units (REP-103). Positive displacement and velocity extend the damper; positive force is tension on the
//! rod.
//!
//! ```
//! use mr_damper_msgs::{Force, Message, Mode, cdr, standard::{Header, Time}};
//!
//! let stamp = Time::from_nanos(1_700_000_000_123_456_789)?;
//! let force = Force { header: Header { stamp, frame_id: "damper".into() }, force: -512.0, variance: 4.0 };
//!
//! let mut buffer = Vec::new(); // keep it: the next message reuses its memory
//! cdr::write_into(&force, &mut buffer)?;
//! assert_eq!(buffer[..4], [0, 1, 0, 0]); // little endian CDR
//! assert_eq!(cdr::from_slice::<Force>(&buffer)?, force);
//!
//! assert_eq!(Force::TYPE, "mr_damper_msgs/msg/Force");
//! assert_eq!(Force::DDS_TYPE, "mr_damper_msgs::msg::dds_::Force_");
//! assert_eq!(Mode::try_from(1)?.name(), "arx_coast");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The crate does no I/O and depends on no middleware.

pub mod action;
pub mod cdr;
mod definition;
pub mod geometry;
pub mod lifecycle;
mod message;
mod mr_damper;
pub mod msgdef;
mod nan;
pub mod rcl;
pub mod rihs01;
pub mod rosbag2;
pub mod srv;
pub mod standard;
mod state;
mod time;
pub mod type_description;

pub use cdr::CdrError;
pub use message::{Action, Descriptor, Message, Service};
pub use mr_damper::{
    CoilCurrent, CommandVoltage, CurrentCommand, Displacement, EffectValue, Force, ForceEstimate,
    ForceResidual, ModeChange, Velocity,
};
pub use state::{LimitedBy, Mode, Reasons, UnknownValue, Validity};
pub use time::TimeOutOfRange;

/// All topic messages of this crate, our own first. The parts of services and actions are not listed.
pub const MESSAGES: &[Descriptor] = &[
    Descriptor::of::<CoilCurrent>(),
    Descriptor::of::<CommandVoltage>(),
    Descriptor::of::<CurrentCommand>(),
    Descriptor::of::<Displacement>(),
    Descriptor::of::<EffectValue>(),
    Descriptor::of::<Force>(),
    Descriptor::of::<ForceEstimate>(),
    Descriptor::of::<ForceResidual>(),
    Descriptor::of::<ModeChange>(),
    Descriptor::of::<Velocity>(),
    Descriptor::of::<standard::Time>(),
    Descriptor::of::<standard::DiagnosticArray>(),
    Descriptor::of::<standard::DiagnosticStatus>(),
    Descriptor::of::<standard::KeyValue>(),
    Descriptor::of::<standard::Clock>(),
    Descriptor::of::<standard::JointState>(),
    Descriptor::of::<standard::Temperature>(),
    Descriptor::of::<standard::Float64>(),
    Descriptor::of::<standard::Float32>(),
    Descriptor::of::<standard::Range>(),
    Descriptor::of::<standard::Header>(),
    Descriptor::of::<geometry::Vector3>(),
    Descriptor::of::<geometry::Wrench>(),
    Descriptor::of::<geometry::WrenchStamped>(),
    Descriptor::of::<geometry::Twist>(),
    Descriptor::of::<geometry::TwistStamped>(),
    Descriptor::of::<lifecycle::State>(),
    Descriptor::of::<lifecycle::Transition>(),
    Descriptor::of::<lifecycle::TransitionDescription>(),
    Descriptor::of::<lifecycle::TransitionEvent>(),
    Descriptor::of::<rcl::ParameterValue>(),
    Descriptor::of::<rcl::Parameter>(),
    Descriptor::of::<rcl::FloatingPointRange>(),
    Descriptor::of::<rcl::IntegerRange>(),
    Descriptor::of::<rcl::ParameterDescriptor>(),
    Descriptor::of::<rcl::ParameterEvent>(),
    Descriptor::of::<rcl::SetParametersResult>(),
    Descriptor::of::<rcl::ListParametersResult>(),
    Descriptor::of::<rcl::Log>(),
    Descriptor::of::<type_description::FieldType>(),
    Descriptor::of::<type_description::Field>(),
    Descriptor::of::<type_description::IndividualTypeDescription>(),
    Descriptor::of::<type_description::TypeDescription>(),
    Descriptor::of::<type_description::TypeSource>(),
    Descriptor::of::<type_description::KeyValue>(),
];
