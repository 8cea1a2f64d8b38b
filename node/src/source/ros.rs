//! Samples from ROS topics, and forces that are asked for by Zenoh.
//!
//! One thread waits on all input topics. Displacement is taken first, everything else after it: what a peer sent
//! before a displacement is there by then, and is sorted before it. What its middleware sent in another order is
//! waited for a little (`collate.rs`). So an estimate does not miss a current of its own stamp because of the
//! order in which topics happen to be sent or polled, and live results are those of a replay.

use super::collate::Collator;
use crate::config::{Config, InputConfig, RosArgs};
use crate::control::Control;
use crate::error::NodeError;
use crate::hot::SampleSink;
use crate::ros::Ros;
use crate::source::zenoh::AskedForce;
use crate::worker::{Stop, Worker};
use futures::stream::{LocalBoxStream, StreamExt};
use mr_damper_model::sample::{Drive, DriveKind, Reading, Sample, Stamp};
use mr_damper_model::units::{Celsius, Metre, MetrePerSecond, Newton};
use mr_damper_msgs::standard::{Clock, Float64, Header, JointState, Temperature};
use mr_damper_msgs::{CoilCurrent, CommandVoltage, Displacement, Force, Message, Velocity};
use ros2_client::Subscription;
use rtrb::Consumer;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll, Wake, Waker};
use std::thread::Thread;
use std::time::{Duration, Instant};

/// Messages taken from all topics before they are sorted and handed on.
const BATCH: usize = 512;
/// Longest sleep: how long a drive or force waits that no displacement comes for.
const NAP: Duration = Duration::from_millis(10);
/// Sleep while a displacement is held back.
const HOLDING_NAP: Duration = Duration::from_millis(1);

/// The input topics that have parameters. The first one is polled first: see the module's comment on the order.
const INPUTS: [&str; 7] = [
    "displacement",
    "coil_current",
    "command_voltage",
    "velocity",
    "measured_force",
    "body_velocity",
    "force_request",
];

/// Counters of the source.
#[derive(Debug, Default)]
pub struct SourceCounters {
    /// Messages taken.
    pub messages: AtomicU64,
    /// Messages that could not be read (broken CDR, a joint that is not in the message).
    pub unreadable: AtomicU64,
    /// Displacements that went on without an input of their stamp, though they had waited for it.
    pub incomplete: AtomicU64,
}

/// One input topic, whatever its message type.
enum Input {
    Displacement(Subscription<Displacement>),
    Velocity(Subscription<Velocity>),
    CoilCurrent(Subscription<CoilCurrent>),
    CommandVoltage(Subscription<CommandVoltage>),
    Force(Subscription<Force>),
    Temperature(Subscription<Temperature>),
    Float(Subscription<Float64>),
    Joint(Subscription<JointState>, String),
}

/// An input topic and what its numbers mean.
struct Channel {
    topic: &'static str,
    input: Input,
    sign: f64,
    offset: f64,
}

/// Stamp (zero: none) and plain value of a message; `None` when it holds no value for us.
type Taken = Option<(i64, f64)>;

/// The running source.
pub struct RosSource {
    worker: Worker,
    counters: Arc<SourceCounters>,
}

impl RosSource {
    /// Subscribes to the input topics and to `/clock`, and starts the thread that takes them.
    ///
    /// # Errors
    /// When a topic cannot be subscribed or the system starts no thread.
    pub fn start(
        ros: &mut Ros,
        args: &RosArgs,
        config: &Config,
        control: &Arc<Control>,
        asked: Consumer<AskedForce>,
        samples: SampleSink,
    ) -> Result<Self, NodeError> {
        let mut channels = Vec::with_capacity(INPUTS.len() + 1);
        for topic in INPUTS {
            let settings = config.input(topic).cloned().unwrap_or_default();
            let input = subscribe(ros, args, topic, &settings)?;
            channels.push(Channel { topic, input, sign: settings.sign, offset: settings.offset });
        }
        channels.push(Channel {
            topic: "case_temperature",
            input: Input::Temperature(ros.subscribe(&args.topic("case_temperature"))?),
            sign: 1.0,
            offset: 0.0,
        });
        let counters = Arc::new(SourceCounters::default());
        let wait = Duration::from_secs_f64(config.align_wait_s);
        let pump = Pump {
            channels,
            clock: ros.subscribe(&args.topic("/clock"))?,
            control: Arc::clone(control),
            asked,
            samples,
            collator: Collator::new(wait),
            counters: Arc::clone(&counters),
        };
        let worker = Worker::start("ros-source", move |stop| pump.run(stop))
            .map_err(NodeError::io("starting the thread that takes ROS messages"))?;
        Ok(Self { worker, counters })
    }

    /// The source's counters.
    #[must_use]
    pub fn counters(&self) -> Arc<SourceCounters> {
        Arc::clone(&self.counters)
    }

    /// True while the thread runs; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.worker.is_alive()
    }

    /// Ends the thread and drops the subscriptions. `Err` when it had panicked.
    ///
    /// # Errors
    /// The panic's payload.
    pub fn stop(self) -> std::thread::Result<()> {
        self.worker.stop()
    }
}

fn subscribe(ros: &mut Ros, args: &RosArgs, topic: &str, settings: &InputConfig) -> Result<Input, NodeError> {
    let name = args.topic(topic);
    Ok(match settings.message_type.as_str() {
        Float64::TYPE => Input::Float(ros.subscribe(&name)?),
        JointState::TYPE => {
            if settings.joint.is_empty() {
                return Err(NodeError::Parameter {
                    name: format!("{topic}.joint"),
                    value: "\"\"".to_owned(),
                    expected: format!("the joint's name, because {topic}.type is {}", JointState::TYPE),
                });
            }
            Input::Joint(ros.subscribe(&name)?, settings.joint.clone())
        }
        _ => match topic {
            "displacement" => Input::Displacement(ros.subscribe(&name)?),
            "velocity" | "body_velocity" => Input::Velocity(ros.subscribe(&name)?),
            "coil_current" => Input::CoilCurrent(ros.subscribe(&name)?),
            "command_voltage" => Input::CommandVoltage(ros.subscribe(&name)?),
            _ => Input::Force(ros.subscribe(&name)?),
        },
    })
}

impl Channel {
    /// True when a message has to wake the thread even if nothing waits for it.
    fn wakes(&self) -> bool {
        self.topic == "displacement" || matches!(self.input, Input::Float(_) | Input::Joint(..))
    }

    /// The channel's messages as plain stamps and values. An `Err` is a message that cannot be read.
    fn values(&self) -> LocalBoxStream<'_, Result<Taken, String>> {
        fn stream<'a, M: Message>(
            subscription: &'a Subscription<M>,
            take: impl Fn(M) -> Taken + 'a,
        ) -> LocalBoxStream<'a, Result<Taken, String>> {
            subscription
                .async_stream()
                .map(move |taken| taken.map(|(message, _)| take(message)).map_err(|e| e.to_string()))
                .boxed_local()
        }
        fn at(header: &Header, value: f64) -> Taken {
            Some((header.stamp.as_nanos(), value))
        }
        match &self.input {
            Input::Displacement(s) => stream(s, |m| at(&m.header, m.displacement)),
            Input::Velocity(s) => stream(s, |m| at(&m.header, m.velocity)),
            Input::CoilCurrent(s) => stream(s, |m| at(&m.header, m.current)),
            Input::CommandVoltage(s) => stream(s, |m| at(&m.header, m.voltage)),
            Input::Force(s) => stream(s, |m| at(&m.header, m.force)),
            Input::Temperature(s) => stream(s, |m| at(&m.header, m.temperature)),
            Input::Float(s) => stream(s, |m| Some((0, m.data))),
            Input::Joint(s, joint) => {
                let column = match self.topic {
                    "displacement" => |m: JointState| m.position,
                    "velocity" | "body_velocity" => |m: JointState| m.velocity,
                    _ => |m: JointState| m.effort,
                };
                stream(s, move |m| {
                    let index = m.name.iter().position(|name| name == joint)?;
                    let stamp = m.header.stamp.as_nanos();
                    column(m).get(index).map(|value| (stamp, *value))
                })
            }
        }
    }

    fn sample(&self, stamp_ns: i64, value: f64, received: Stamp) -> Sample {
        let value = self.sign * (value - self.offset);
        let reading = match self.topic {
            "displacement" => Reading::Displacement(Metre(value)),
            "velocity" => Reading::Velocity(MetrePerSecond(value)),
            "coil_current" => Reading::Drive(Drive::new(DriveKind::CoilCurrent, value)),
            "command_voltage" => Reading::Drive(Drive::new(DriveKind::CommandVoltage, value)),
            "measured_force" => Reading::Force(Newton(value)),
            "body_velocity" => Reading::BodyVelocity(MetrePerSecond(value)),
            "force_request" => Reading::ForceRequest(Newton(value)),
            _ => Reading::CaseTemperature(Celsius(value)),
        };
        // A message without a stamp is taken to be as old as its arrival.
        let stamp = if stamp_ns == 0 { received } else { Stamp::from_nanos(stamp_ns) };
        Sample { stamp, received, reading }
    }
}

/// Wakes the thread that it was made on.
struct Unpark(Thread);

impl Wake for Unpark {
    fn wake(self: Arc<Self>) {
        self.0.unpark();
    }
}

/// The thread: takes messages whenever a topic wakes it, until told to stop.
///
/// An estimate is made when displacement arrives, so displacement wakes it. The others do so only when a displacement
/// waits for them, or when they are stamped on arrival: at 1 kHz, being woken for each costs more than the models.
struct Pump {
    channels: Vec<Channel>,
    clock: Subscription<Clock>,
    control: Arc<Control>,
    /// Forces that are asked for by Zenoh. They wake nobody: they count with the next displacement.
    asked: Consumer<AskedForce>,
    samples: SampleSink,
    collator: Collator,
    counters: Arc<SourceCounters>,
}

impl Pump {
    fn run(self, stop: &Stop) {
        let Self { channels, clock, control, mut asked, mut samples, mut collator, counters } = self;
        let waker = Waker::from(Arc::new(Unpark(std::thread::current())));
        let mut streams: Vec<_> = channels.iter().map(|channel| (channel, channel.values())).collect();
        let mut batch: Vec<Sample> = Vec::with_capacity(BATCH);
        let (time, wants_velocity) = (control.clock(), control.wants_velocity());
        while !stop.is_raised() {
            hear(&clock, &control);
            // What comes before the first simulated time is as old as the system says, and its stamp tells.
            let received = time.now_or_system();
            collator.want_velocity(wants_velocity.load(Ordering::Acquire));
            let was_holding = collator.is_holding();
            for (channel, stream) in &mut streams {
                let mut context =
                    Context::from_waker(if was_holding || channel.wakes() { &waker } else { Waker::noop() });
                while batch.len() < BATCH
                    && let Poll::Ready(Some(taken)) = stream.poll_next_unpin(&mut context)
                {
                    counters.messages.fetch_add(1, Ordering::Relaxed);
                    match taken {
                        Ok(Some((stamp_ns, value))) => batch.push(channel.sample(stamp_ns, value, received)),
                        Ok(None) => {
                            counters.note_unreadable(channel.topic, "the joint is not in the message")
                        }
                        Err(error) => counters.note_unreadable(channel.topic, &error),
                    }
                }
            }
            while batch.len() < BATCH
                && let Ok((stamp, force)) = asked.pop()
            {
                let reading = Reading::ForceRequest(force);
                batch.push(Sample { stamp: stamp.unwrap_or(received), received, reading });
            }
            // A full batch may have left messages behind, and what is waited for now must wake: look again before sleeping.
            let drained = batch.len() < BATCH;
            let mut pushed = false;
            collator.take(&mut batch, Instant::now(), |sample| {
                samples.push(sample);
                pushed = true;
            });
            if pushed {
                samples.flush();
            }
            counters.incomplete.store(collator.incomplete(), Ordering::Relaxed);
            let holding = collator.is_holding();
            if drained && (was_holding || !holding) {
                // A message that came since its topic was polled has left its wake-up behind: parking returns at once.
                std::thread::park_timeout(if holding { HOLDING_NAP } else { NAP });
            }
        }
    }
}

/// Takes what `/clock` has said since the last time.
fn hear(clock: &Subscription<Clock>, control: &Control) {
    // What cannot be read is no time.
    while let Ok(Some((message, _))) = clock.take() {
        control.hear_clock(Stamp::from_nanos(message.clock.as_nanos()));
    }
}

impl SourceCounters {
    /// Counts a message that gave no sample; the log hears of the first and of every doubling.
    fn note_unreadable(&self, topic: &str, why: &str) {
        let count = self.unreadable.fetch_add(1, Ordering::Relaxed) + 1;
        if count.is_power_of_two() {
            tracing::warn!(topic, count, "a message cannot be used: {why}");
        }
    }
}
