//! Estimates and commands as standard messages, for programs that do not know this project's types.
//!
//! | topic | type | content |
//! |---|---|---|
//! | `force_estimate_wrench` | `geometry_msgs/WrenchStamped` | the force along one axis of the frame, as a load cell publishes it |
//! | `force_estimate_joint_state` | `sensor_msgs/JointState` | the force as effort of one joint |
//! | `force_estimate_float64` | `std_msgs/Float64` | the force in N |
//! | `current_command_float64` | `std_msgs/Float64` | the commanded current in A |
//!
//! These types have no place for validity. So the force is NaN unless the estimate is valid or degraded.

use crate::estimation::wire;
use crate::ros2::participant::{Output, Ros};
use crate::settings::config::{RosArgs, StandardSettings};
use crate::settings::error::NodeError;
use mr_damper_model::pipeline::{Estimate, StampedCommand, Validity};
use mr_damper_msgs::Message;
use mr_damper_msgs::geometry::{Vector3, Wrench, WrenchStamped};
use mr_damper_msgs::standard::{Float64, JointState};

/// An axis of the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Axis {
    X,
    Y,
    Z,
}

impl Axis {
    /// The axis called `name`. The parameter table accepts no other names than these three.
    fn of(name: &str) -> Self {
        match name {
            "y" => Self::Y,
            "z" => Self::Z,
            _ => Self::X,
        }
    }
}

/// The estimates that are published as standard messages.
pub(super) struct StandardEstimates {
    wrench: Option<(Axis, Output<WrenchStamped>)>,
    joint_state: Option<(String, Output<JointState>)>,
    float64: Option<Output<Float64>>,
}

impl StandardEstimates {
    /// Creates the publishers that `settings` selects.
    ///
    /// # Errors
    /// When a topic cannot be published.
    pub(super) fn new(ros: &mut Ros, args: &RosArgs, settings: &StandardSettings) -> Result<Self, NodeError> {
        let joint = if settings.joint.is_empty() { args.damper() } else { &settings.joint };
        Ok(Self {
            wrench: publisher(ros, args, "force_estimate_wrench", settings.wrench)?
                .map(|output| (Axis::of(&settings.axis), output)),
            joint_state: publisher(ros, args, "force_estimate_joint_state", settings.joint_state)?
                .map(|output| (joint.to_owned(), output)),
            float64: publisher(ros, args, "force_estimate_float64", settings.float64)?,
        })
    }

    /// Publishes `estimate`, and returns how many messages the middleware refused.
    pub(super) fn publish(&self, estimate: &Estimate, frame_id: &str) -> u64 {
        let force_n = usable_force_n(estimate);
        let mut refused = 0;
        let mut count = |published: bool| refused += u64::from(!published);
        if let Some((axis, output)) = &self.wrench {
            count(output.publish(wrench(estimate, force_n, *axis, frame_id)).is_ok());
        }
        if let Some((joint, output)) = &self.joint_state {
            count(output.publish(joint_state(estimate, force_n, joint, frame_id)).is_ok());
        }
        if let Some(output) = &self.float64 {
            count(output.publish(Float64 { data: force_n }).is_ok());
        }
        refused
    }
}

/// The publisher of commanded currents as numbers; `None` if `settings` does not select it.
///
/// # Errors
/// When the topic cannot be published.
pub(super) fn command_publisher(
    ros: &mut Ros,
    args: &RosArgs,
    settings: &StandardSettings,
) -> Result<Option<Output<Float64>>, NodeError> {
    publisher(ros, args, "current_command_float64", settings.float64)
}

/// The commanded current as a number.
pub(super) fn current(commanded: &StampedCommand) -> Float64 {
    Float64 { data: commanded.command.current.get() }
}

fn publisher<M: Message>(
    ros: &mut Ros,
    args: &RosArgs,
    topic: &str,
    is_selected: bool,
) -> Result<Option<Output<M>>, NodeError> {
    is_selected.then(|| ros.publish(&args.topic(topic))).transpose()
}

/// The force of an estimate that is valid or degraded, N; else NaN.
fn usable_force_n(estimate: &Estimate) -> f64 {
    match estimate.validity {
        Validity::Valid | Validity::Degraded => estimate.force.get(),
        Validity::Extrapolating | Validity::Stale | Validity::Invalid => f64::NAN,
    }
}

fn wrench(estimate: &Estimate, force_n: f64, axis: Axis, frame_id: &str) -> WrenchStamped {
    let mut force = Vector3::default();
    match axis {
        Axis::X => force.x = force_n,
        Axis::Y => force.y = force_n,
        Axis::Z => force.z = force_n,
    }
    WrenchStamped {
        header: wire::header(estimate.stamp, frame_id),
        wrench: Wrench { force, ..Wrench::default() },
    }
}

fn joint_state(estimate: &Estimate, force_n: f64, joint: &str, frame_id: &str) -> JointState {
    JointState {
        header: wire::header(estimate.stamp, frame_id),
        name: vec![joint.to_owned()],
        effort: vec![force_n],
        ..JointState::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::streams::sink::zenoh::samples;
    use mr_damper_model::pipeline::Event;

    fn estimate(validity: Validity) -> Estimate {
        match samples::estimate(1_500_000_000, -412.5) {
            Event::Estimate(estimate) => Estimate { validity, ..estimate },
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn the_force_is_a_number_only_if_it_can_be_used_without_its_flag() {
        for validity in [Validity::Valid, Validity::Degraded] {
            assert_eq!(usable_force_n(&estimate(validity)), -412.5);
        }
        for validity in [Validity::Extrapolating, Validity::Stale, Validity::Invalid] {
            assert!(usable_force_n(&estimate(validity)).is_nan(), "{validity:?}");
        }
    }

    #[test]
    fn the_messages_have_stamp_frame_and_force_in_their_place() {
        let estimate = estimate(Validity::Valid);
        for (name, force) in [("x", [-412.5, 0.0, 0.0]), ("y", [0.0, -412.5, 0.0]), ("z", [0.0, 0.0, -412.5])]
        {
            let message = wrench(&estimate, -412.5, Axis::of(name), "rod");
            assert_eq!([message.wrench.force.x, message.wrench.force.y, message.wrench.force.z], force);
            assert_eq!(message.wrench.torque, Vector3::default());
            assert_eq!((message.header.stamp.sec, message.header.stamp.nanosec), (1, 500_000_000));
            assert_eq!(message.header.frame_id, "rod");
        }
        let message = joint_state(&estimate, -412.5, "front_left", "rod");
        assert_eq!((message.name, message.effort), (vec!["front_left".to_owned()], vec![-412.5]));
        assert!(message.position.is_empty() && message.velocity.is_empty());
    }
}
