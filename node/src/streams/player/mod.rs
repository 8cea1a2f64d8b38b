//! Plays runs onto the node's input topics, with their original spacing.
//!
//! The player is an ordinary client of the service: it has its own DDS participant and publishes like a sensor's node.

mod control;
mod keys;
mod pace;
mod replay_services;
mod timing;

pub use control::Control;
pub use keys::Keys;
pub use timing::{Next, Timing};

use crate::estimation::wire::header;
use crate::ros2::participant::{DdsThreadEnded, NotTaken, Output, Ros};
use crate::settings::config::{Config, RosArgs};
use crate::settings::error::{NodeError, PartError};
use crate::settings::interrupt::Interrupt;
use crate::settings::task::Task;
use mr_damper_base::clock::system_now;
use mr_damper_model::sample::{Drive, DriveKind, Reading, Run, Sample, Stamp};
use mr_damper_msgs::standard::{Clock, Temperature, Time};
use mr_damper_msgs::{CoilCurrent, CommandVoltage, Displacement, Force, Message, Velocity};
use ros2_client::NodeOptions;
use rustdds::GUID;
use std::str::FromStr;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Default name of the player's node.
pub const NODE: &str = "mr_damper_replay";

/// Longest time between checks of signals and keyboard.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Speed of playing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rate {
    /// A multiple of the original speed.
    Times(f64),
    /// As fast as DDS transmits without loss.
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

/// Numbers of samples that were played.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Played {
    /// Samples published.
    pub samples: u64,
    /// Samples that the middleware did not accept.
    pub failed: u64,
}

impl Played {
    /// Checks that all samples were published.
    ///
    /// # Errors
    /// [`SamplesRefused`].
    pub fn check(&self) -> Result<(), SamplesRefused> {
        if self.failed == 0 { Ok(()) } else { Err(SamplesRefused { samples: self.failed }) }
    }
}

/// The middleware refused samples of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the middleware did not accept {samples} samples")]
pub struct SamplesRefused {
    /// Number of samples.
    pub samples: u64,
}

impl PartError for SamplesRefused {}

/// The part of a run to play, and how to play it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaybackOptions {
    /// Speed.
    pub rate: Rate,
    /// Start, in seconds into the run.
    pub start: f64,
    /// Duration, s; `None` plays to the end.
    pub duration: Option<f64>,
    /// Keep the recorded stamps and publish /clock.
    pub clock: bool,
    /// Rate of /clock in Hz of real time; `None` publishes it with each sample, but at least a millisecond apart.
    pub clock_hz: Option<f64>,
}

impl Default for PlaybackOptions {
    fn default() -> Self {
        Self { rate: Rate::Times(1.0), start: 0.0, duration: None, clock: false, clock_hz: None }
    }
}

/// Publishers for the input topics. `None` is a topic that the player does not publish.
pub struct Player {
    ros: Ros,
    node: String,
    control: Arc<Control>,
    services: Option<Task>,
    displacement: Output<Displacement>,
    velocity: Option<Output<Velocity>>,
    coil_current: Option<Output<CoilCurrent>>,
    command_voltage: Option<Output<CommandVoltage>>,
    force: Option<Output<Force>>,
    temperature: Option<Output<Temperature>>,
    body_velocity: Option<Output<Velocity>>,
    force_request: Option<Output<Force>>,
    clock: Option<Output<Clock>>,
}

impl Player {
    /// The topics that the player publishes, by their names in the node; remapping uses these names.
    pub const TOPICS: [&str; 9] = [
        "displacement",
        "velocity",
        "coil_current",
        "command_voltage",
        "measured_force",
        "case_temperature",
        "body_velocity",
        "force_request",
        "/clock",
    ];

    /// The services that the player may offer, by their names relative to the node.
    pub const SERVICES: [&str; 9] = [
        "~/pause",
        "~/resume",
        "~/toggle_paused",
        "~/is_paused",
        "~/get_rate",
        "~/set_rate",
        "~/play_next",
        "~/burst",
        "~/seek",
    ];

    /// Joins the domain as `mr_damper_replay`, in the namespace of the ROS arguments, and publishes all input topics. With `clock` it also
    /// publishes /clock.
    ///
    /// # Errors
    /// When ROS does not start.
    pub fn start(config: &Config, ros_args: &RosArgs, clock: bool) -> Result<Self, NodeError> {
        Self::start_with(config, ros_args, clock, &|_| true)
    }

    /// Starts like [`Player::start`], but publishes only the topics of the channels that `runs` have, so that other nodes can publish the
    /// other inputs.
    ///
    /// # Errors
    /// When ROS does not start.
    pub fn start_for(
        runs: &[Run],
        config: &Config,
        ros_args: &RosArgs,
        clock: bool,
    ) -> Result<Self, NodeError> {
        Self::start_with(config, ros_args, clock, &|topic| runs.iter().any(|run| has_channel(run, topic)))
    }

    /// Starts with publishers on the topics for which `is_played` is true, and on `displacement`, which every run has.
    fn start_with(
        config: &Config,
        args: &RosArgs,
        clock: bool,
        is_played: &dyn Fn(&str) -> bool,
    ) -> Result<Self, NodeError> {
        let name = args.node.as_deref().unwrap_or(NODE);
        let mut ros = Ros::start(config, args, NodeOptions::new().enable_rosout(false), name)?;
        Ok(Self {
            displacement: ros.publish_run(&args.topic("displacement"))?,
            velocity: output(&mut ros, args, "velocity", is_played)?,
            coil_current: output(&mut ros, args, "coil_current", is_played)?,
            command_voltage: output(&mut ros, args, "command_voltage", is_played)?,
            force: output(&mut ros, args, "measured_force", is_played)?,
            temperature: output(&mut ros, args, "case_temperature", is_played)?,
            body_velocity: output(&mut ros, args, "body_velocity", is_played)?,
            force_request: output(&mut ros, args, "force_request", is_played)?,
            clock: if clock { Some(ros.publish(&args.topic("/clock"))?) } else { None },
            ros,
            node: name.to_owned(),
            control: Arc::default(),
            services: None,
        })
    }

    /// Offers the services of `ros2 bag play` below the node's name: `~/pause`, `~/resume`, `~/toggle_paused`,
    /// `~/is_paused`, `~/get_rate`, `~/set_rate`, `~/play_next`, `~/burst`, `~/seek`.
    ///
    /// # Errors
    /// When DDS refuses a service, or the system cannot start a thread.
    pub fn offer_services(&mut self, ros_args: &RosArgs) -> Result<(), NodeError> {
        self.services = Some(replay_services::offer(&mut self.ros, ros_args, &self.node, &self.control)?);
        Ok(())
    }

    /// Fails once the player can no longer publish.
    ///
    /// # Errors
    /// The errors of [`Ros::check`].
    pub fn check(&self) -> Result<(), DdsThreadEnded> {
        self.ros.check()
    }

    /// The control for pausing, stepping, jumping and changing the speed.
    #[must_use]
    pub fn control(&self) -> &Control {
        &self.control
    }

    /// Waits until displacement, force and a drive, if they are played, have subscribers; false after `timeout` or on a signal.
    pub fn wait_for_listener(&self, timeout: Duration, interrupt: &Interrupt) -> bool {
        let deadline = Instant::now() + timeout;
        let is_read = |publisher: GUID| self.ros.readers_of(publisher) > 0;
        let force = self.force.as_ref().map(Output::guid);
        let current = self.coil_current.as_ref().map(Output::guid);
        let voltage = self.command_voltage.as_ref().map(Output::guid);
        let listened = || {
            let has_no_drive = current.is_none() && voltage.is_none();
            is_read(self.displacement.guid())
                && force.is_none_or(is_read)
                && (has_no_drive || current.is_some_and(is_read) || voltage.is_some_and(is_read))
        };
        while !listened() {
            if Instant::now() >= deadline
                || !interrupt.sleep_until(Instant::now() + Duration::from_millis(20))
            {
                return listened();
            }
        }
        // This side sees the match first; the peer needs a moment until it has discovered the writers.
        interrupt.sleep_until(Instant::now() + Duration::from_millis(300))
    }

    /// Plays one run; `at` is called with the number of seconds played so far. Samples of a channel that the player does not publish count
    /// as failed.
    ///
    /// Stamps are shifted so that the first sample, and the first sample after a jump, are now. A pause does not change the
    /// shift. With a clock the recorded stamps are kept.
    pub fn play(
        &self,
        run: &Run,
        options: &PlaybackOptions,
        played: &mut Played,
        interrupt: &Interrupt,
        keys: Option<&Keys>,
        at: &dyn Fn(f64),
    ) {
        let Some((first, last)) = run.span() else { return };
        self.control.begin(options.rate, (first, last));
        let mut playing = Playing {
            player: self,
            options,
            first,
            timing: Timing::new(&self.control, options.rate, options.start, interrupt, keys),
            last_clock: None,
            next_tick: None,
        };
        let mut from = Some(options.start);
        while let Some(from_s) = from {
            from = playing.stretch(run, from_s, played, at);
        }
        self.control.end();
    }

    /// Publishes the time of the run.
    fn tell_time(&self, stamp: Stamp) -> bool {
        let clock = Clock { clock: Time::from_nanos_saturating(stamp.nanos()) };
        self.clock.as_ref().is_none_or(|publisher| publisher.publish(clock).is_ok())
    }

    fn publish(&self, sample: &Sample) -> Result<(), NotTaken> {
        let header = header(sample.stamp, "");
        let variance = 0.0;
        match sample.reading {
            Reading::Displacement(x) => {
                self.displacement.publish(Displacement { header, displacement: x.get(), variance })
            }
            Reading::Velocity(v) => {
                publish(self.velocity.as_ref(), Velocity { header, velocity: v.get(), variance })
            }
            Reading::Drive(Drive::CoilCurrent(i)) => {
                publish(self.coil_current.as_ref(), CoilCurrent { header, current: i.get(), variance })
            }
            Reading::Drive(Drive::CommandVoltage(u)) => {
                publish(self.command_voltage.as_ref(), CommandVoltage { header, voltage: u.get(), variance })
            }
            Reading::Force(f) => publish(self.force.as_ref(), Force { header, force: f.get(), variance }),
            Reading::CaseTemperature(t) => {
                publish(self.temperature.as_ref(), Temperature { header, temperature: t.get(), variance })
            }
            Reading::BodyVelocity(v) => {
                publish(self.body_velocity.as_ref(), Velocity { header, velocity: v.get(), variance })
            }
            Reading::ForceRequest(f) => {
                publish(self.force_request.as_ref(), Force { header, force: f.get(), variance })
            }
        }
    }

    /// Leaves the domain.
    pub fn stop(self) {
        let Self { ros, services, displacement, velocity, coil_current, command_voltage, force, .. } = self;
        let Self { temperature, body_velocity, force_request, clock, .. } = self;
        if services.is_some_and(|services| services.stop().is_err()) {
            tracing::error!("the thread that answers the player's services has panicked");
        }
        // Publishers must be dropped before their node.
        drop((displacement, velocity, coil_current, command_voltage, force));
        drop((temperature, body_velocity, force_request, clock));
        ros.stop();
    }
}

/// True if `run` has samples for the input topic `topic`.
fn has_channel(run: &Run, topic: &str) -> bool {
    match topic {
        "displacement" => true,
        "velocity" => run.velocity_m_s.is_some(),
        "coil_current" => run.drive_kind() == Some(DriveKind::CoilCurrent),
        "command_voltage" => run.drive_kind() == Some(DriveKind::CommandVoltage),
        "measured_force" => run.force_n.is_some(),
        "case_temperature" => run.case_temp_c.is_some(),
        "body_velocity" => run.body_velocity_m_s.is_some(),
        "force_request" => run.force_request_n.is_some(),
        _ => false,
    }
}

/// A publisher on the input topic `topic`, if it is played.
fn output<M: Message>(
    ros: &mut Ros,
    args: &RosArgs,
    topic: &str,
    is_played: &dyn Fn(&str) -> bool,
) -> Result<Option<Output<M>>, NodeError> {
    is_played(topic).then(|| ros.publish_run(&args.topic(topic))).transpose()
}

/// Publishes on `output`; without one, the message counts as not taken.
fn publish<M: Message>(output: Option<&Output<M>>, message: M) -> Result<(), NotTaken> {
    output.ok_or(NotTaken)?.publish(message)
}

/// A run while it is played.
struct Playing<'a> {
    player: &'a Player,
    options: &'a PlaybackOptions,
    /// Stamp of the run's first sample.
    first: Stamp,
    timing: Timing<'a>,
    /// The last /clock time that was published with a sample.
    last_clock: Option<Stamp>,
    /// When /clock is published next, if it has its own rate.
    next_tick: Option<Instant>,
}

impl Playing<'_> {
    /// Plays from `from_s` to the end, or until a jump; returns the target of the jump, in seconds.
    fn stretch(&mut self, run: &Run, from_s: f64, played: &mut Played, at: &dyn Fn(f64)) -> Option<f64> {
        let options = self.options;
        let to_s = options.duration.map_or(f64::INFINITY, |duration| options.start + duration);
        let shift_ns =
            if options.clock { 0 } else { system_now().nanos() - self.first.nanos() - (from_s * 1e9) as i64 };
        for sample in run.samples() {
            let run_s = sample.stamp.since(self.first).get();
            if run_s < from_s {
                continue;
            }
            if run_s >= to_s {
                break;
            }
            match self.next(run_s, played) {
                Next::Play => {}
                Next::Jump(to_s) => {
                    self.last_clock = None;
                    return Some(to_s);
                }
                Next::End => break,
            }
            let stamp = sample.stamp.shifted(shift_ns);
            let due = self.last_clock.is_none_or(|last| stamp.since(last).get() >= 1e-3);
            if options.clock && options.clock_hz.is_none() && due {
                self.last_clock = Some(stamp);
                played.failed += u64::from(!self.player.tell_time(stamp));
            }
            let taken = self.player.publish(&Sample { stamp, ..sample }).is_ok();
            self.timing.played(run_s);
            played.samples += 1;
            played.failed += u64::from(!taken);
            at((run_s - options.start).max(0.0));
        }
        None
    }

    /// Waits until the sample at `next_s` is due, or until a jump or the end is requested. Meanwhile /clock is published.
    fn next(&mut self, next_s: f64, played: &mut Played) -> Next {
        let Self { player, options, first, timing, next_tick, .. } = self;
        timing.next(*first, next_s, |now, position_s| {
            let tell = |at_s: f64| player.tell_time(first.shifted((at_s * 1e9).round() as i64));
            tick(options, next_tick, now, || played.failed += u64::from(!tell(position_s)))
        })
    }
}

/// Calls `tell` if /clock has its own rate and is due; returns the time until it is due again. While paused, it is called
/// with the same time.
fn tick(
    options: &PlaybackOptions,
    next_tick: &mut Option<Instant>,
    now: Instant,
    tell: impl FnOnce(),
) -> Duration {
    let Some(hz) = options.clock_hz.filter(|_| options.clock) else { return LOOK_EVERY };
    let due = *next_tick.get_or_insert(now);
    if now < due {
        return due - now;
    }
    tell();
    let period = Duration::from_secs_f64(1.0 / hz);
    // Missed ticks are not told later.
    let next = if due + period > now { due + period } else { now + period };
    *next_tick = Some(next);
    next - now
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_model::sample::Trace;

    #[test]
    fn only_the_channels_of_a_run_have_topics() {
        let topics = |run: &Run| -> Vec<&str> {
            Player::TOPICS.into_iter().filter(|topic| has_channel(run, topic)).collect()
        };
        let mut run = Run::default();
        assert_eq!(topics(&run), ["displacement"]);
        run.force_n = Some(Trace::default());
        run.drive = Some((DriveKind::CommandVoltage, Trace::default()));
        assert_eq!(topics(&run), ["displacement", "command_voltage", "measured_force"]);
        run.drive = Some((DriveKind::CoilCurrent, Trace::default()));
        run.velocity_m_s = Some(Trace::default());
        run.case_temp_c = Some(Trace::default());
        run.body_velocity_m_s = Some(Trace::default());
        run.force_request_n = Some(Trace::default());
        let all_but_voltage = [
            "displacement",
            "velocity",
            "coil_current",
            "measured_force",
            "case_temperature",
            "body_velocity",
            "force_request",
        ];
        assert_eq!(topics(&run), all_but_voltage);
    }
}
