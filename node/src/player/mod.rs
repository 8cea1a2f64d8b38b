//! Plays runs onto the node's input topics, with their original spacing.
//!
//! A client of the service like any other: it has a participant of its own, and publishes as a recorder's peer would.

mod keys;

pub use keys::Keys;

use crate::clock::system_now;
use crate::config::{Config, RosArgs};
use crate::error::NodeError;
use crate::interrupt::Interrupt;
use crate::ros::Ros;
use crate::wire::header;
use mr_damper_model::sample::{Drive, Reading, Run, Sample, Stamp};
use mr_damper_msgs::standard::{Clock, Temperature, Time};
use mr_damper_msgs::{CoilCurrent, CommandVoltage, Displacement, Force, Velocity};
use ros2_client::{NodeOptions, Publisher};
use std::str::FromStr;
use std::time::{Duration, Instant};

/// Name of the node, unless it is given another.
pub const NODE: &str = "mr_damper_replay";

/// Messages a second that DDS carries without loss to best effort readers on one machine: a third of what a two-core
/// machine was seen to carry.
const MAX_MESSAGES_PER_S: f64 = 4000.0;

/// How fast to play.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rate {
    /// A multiple of the original speed.
    Times(f64),
    /// As fast as DDS carries without loss.
    Max,
}

impl FromStr for Rate {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if text == "max" {
            return Ok(Self::Max);
        }
        match text.parse::<f64>() {
            Ok(rate) if rate > 0.0 && rate.is_finite() => Ok(Self::Times(rate)),
            _ => Err("give a positive number, or max"),
        }
    }
}

/// What was played.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Played {
    /// Samples published.
    pub samples: u64,
    /// Samples that the middleware did not take.
    pub failed: u64,
}

/// What part of a run is played, and how.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// Speed.
    pub rate: Rate,
    /// Seconds into the run.
    pub start: f64,
    /// Seconds to play; `None`: to the end.
    pub duration: Option<f64>,
    /// Keep stamps, publish /clock.
    pub clock: bool,
}

impl Default for Plan {
    fn default() -> Self {
        Self { rate: Rate::Times(1.0), start: 0.0, duration: None, clock: false }
    }
}

/// Publishers for all input topics.
pub struct Player {
    ros: Ros,
    displacement: Publisher<Displacement>,
    velocity: Publisher<Velocity>,
    coil_current: Publisher<CoilCurrent>,
    command_voltage: Publisher<CommandVoltage>,
    force: Publisher<Force>,
    temperature: Publisher<Temperature>,
    body_velocity: Publisher<Velocity>,
    force_request: Publisher<Force>,
    clock: Option<Publisher<Clock>>,
}

impl Player {
    /// Joins the domain as `mr_damper_replay`, in the namespace of the ROS arguments; `clock`: to publish /clock.
    ///
    /// # Errors
    /// When ROS does not start.
    pub fn start(config: &Config, ros_args: &RosArgs, clock: bool) -> Result<Self, NodeError> {
        let args = ros_args;
        let name = args.node.as_deref().unwrap_or(NODE);
        let mut ros = Ros::start(config, args, NodeOptions::new().enable_rosout(false), name)?;
        Ok(Self {
            displacement: ros.publish(&args.topic("displacement"))?,
            velocity: ros.publish(&args.topic("velocity"))?,
            coil_current: ros.publish(&args.topic("coil_current"))?,
            command_voltage: ros.publish(&args.topic("command_voltage"))?,
            force: ros.publish(&args.topic("measured_force"))?,
            temperature: ros.publish(&args.topic("case_temperature"))?,
            body_velocity: ros.publish(&args.topic("body_velocity"))?,
            force_request: ros.publish(&args.topic("force_request"))?,
            clock: if clock { Some(ros.publish("/clock")?) } else { None },
            ros,
        })
    }

    /// Waits until somebody listens on every topic that matters; false after `timeout` or on a signal.
    pub fn wait_for_listener(&self, timeout: Duration, interrupt: &Interrupt) -> bool {
        let deadline = Instant::now() + timeout;
        let node = self.ros.node();
        let listened = || {
            self.displacement.get_subscription_count(node) > 0
                && self.force.get_subscription_count(node) > 0
                && self.coil_current.get_subscription_count(node)
                    + self.command_voltage.get_subscription_count(node)
                    > 0
        };
        while !listened() {
            if Instant::now() >= deadline
                || !interrupt.sleep_until(Instant::now() + Duration::from_millis(20))
            {
                return listened();
            }
        }
        // Matching is seen on our side first; the peer needs a moment to hear of our writers.
        interrupt.sleep_until(Instant::now() + Duration::from_millis(300))
    }

    /// Plays one run; `at` is told how many seconds of it have been played.
    pub fn play(
        &self,
        run: &Run,
        plan: &Plan,
        played: &mut Played,
        interrupt: &Interrupt,
        keys: Option<&Keys>,
        at: &dyn Fn(f64),
    ) {
        let Some(first) = run.samples().next().map(|sample| sample.stamp) else { return };
        let from_s = plan.start;
        let to_s = plan.duration.map_or(f64::INFINITY, |d| from_s + d);
        let shift_ns =
            if plan.clock { 0 } else { system_now().nanos() - first.nanos() - (from_s * 1e9) as i64 };
        let mut pace = Pace::new(plan.rate);
        let mut last_clock: Option<Stamp> = None;
        for sample in run.samples() {
            let run_s = sample.stamp.since(first).get();
            if run_s < from_s {
                continue;
            }
            if run_s >= to_s || interrupt.is_raised() {
                break;
            }
            if let Some(keys) = keys {
                pace.add_pause(keys.wait_while_paused(interrupt));
            }
            if !pace.wait(run_s - from_s, interrupt) {
                break;
            }
            let stamp = sample.stamp.shifted(shift_ns);
            if plan.clock && last_clock.is_none_or(|last| stamp.since(last).get() >= 1e-3) {
                last_clock = Some(stamp);
                let clock = Clock { clock: Time::from_nanos_saturating(stamp.nanos()) };
                let taken = self.clock.as_ref().is_none_or(|publisher| publisher.publish(clock).is_ok());
                played.failed += u64::from(!taken);
            }
            let taken = self.publish(&Sample { stamp, ..sample });
            played.samples += 1;
            played.failed += u64::from(!taken);
            at(run_s - from_s);
        }
    }

    fn publish(&self, sample: &Sample) -> bool {
        let header = header(sample.stamp, "");
        let variance = 0.0;
        match sample.reading {
            Reading::Displacement(x) => {
                self.displacement.publish(Displacement { header, displacement: x.get(), variance }).is_ok()
            }
            Reading::Velocity(v) => {
                self.velocity.publish(Velocity { header, velocity: v.get(), variance }).is_ok()
            }
            Reading::Drive(Drive::CoilCurrent(i)) => {
                self.coil_current.publish(CoilCurrent { header, current: i.get(), variance }).is_ok()
            }
            Reading::Drive(Drive::CommandVoltage(u)) => {
                self.command_voltage.publish(CommandVoltage { header, voltage: u.get(), variance }).is_ok()
            }
            Reading::Force(f) => self.force.publish(Force { header, force: f.get(), variance }).is_ok(),
            Reading::CaseTemperature(t) => {
                self.temperature.publish(Temperature { header, temperature: t.get(), variance }).is_ok()
            }
            Reading::BodyVelocity(v) => {
                self.body_velocity.publish(Velocity { header, velocity: v.get(), variance }).is_ok()
            }
            Reading::ForceRequest(f) => {
                self.force_request.publish(Force { header, force: f.get(), variance }).is_ok()
            }
        }
    }

    /// Leaves the domain.
    pub fn stop(self) {
        let Self { ros, .. } = self;
        ros.stop();
    }
}

/// Keeps the spacing of samples.
struct Pace {
    rate: Rate,
    start: Instant,
    sent: u64,
}

impl Pace {
    fn new(rate: Rate) -> Self {
        Self { rate, start: Instant::now(), sent: 0 }
    }

    fn add_pause(&mut self, pause: Duration) {
        self.start += pause;
    }

    /// Waits until the sample at `run_s` is due; false when interrupted.
    fn wait(&mut self, run_s: f64, interrupt: &Interrupt) -> bool {
        let due_s = match self.rate {
            Rate::Times(rate) => run_s / rate,
            Rate::Max => self.sent as f64 / MAX_MESSAGES_PER_S,
        };
        self.sent += 1;
        let due = self.start + Duration::from_secs_f64(due_s.max(0.0));
        let left = due.saturating_duration_since(Instant::now());
        if left > Duration::from_millis(50) {
            return interrupt.sleep_until(due);
        }
        if !left.is_zero() {
            std::thread::sleep(left);
        }
        true
    }
}
