//! Samples from ROS topics, with what comes by Zenoh among them: from rmw_zenoh's topics, and forces that are asked for.
//!
//! One thread waits on all input topics. Displacement is taken first, everything else after it: what a peer sent
//! before a displacement is there by then, and is sorted before it. What its middleware sent in another order is
//! waited for a little (`collate.rs`). So an estimate does not miss a current of its own stamp because of the
//! order in which topics happen to be sent or polled, and live results are those of a replay.

use super::collate::Collator;
use super::input::{Carries, TOPICS, Taken, joint_of, of_joint};
use crate::config::{Config, InputConfig, RosArgs};
use crate::control::Control;
use crate::error::NodeError;
use crate::hot::SampleSink;
use crate::ros::Ros;
use crate::source::zenoh::ByZenoh;
use crate::worker::{Stop, Worker};
use futures::stream::{LocalBoxStream, Stream, StreamExt};
use mr_damper_model::sample::{Drive, DriveKind, Reading, Sample, Stamp};
use mr_damper_model::units::{Celsius, Metre, MetrePerSecond, Newton};
use mr_damper_msgs::standard::{Clock, Float64, JointState, Temperature};
use mr_damper_msgs::{CoilCurrent, CommandVoltage, Displacement, Force, Message, Velocity};
use ros2_client::Subscription;
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

/// Counters of the source.
#[derive(Debug, Default)]
pub struct SourceCounters {
    /// Messages taken.
    pub messages: AtomicU64,
    /// Messages that could not be used (broken CDR, a joint that is not in the message, no message of rmw_zenoh's).
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
        by_zenoh: ByZenoh,
        samples: SampleSink,
    ) -> Result<Self, NodeError> {
        let mut channels = Vec::with_capacity(TOPICS.len());
        for topic in TOPICS {
            let settings = config.input(topic).cloned().unwrap_or_default();
            let input = subscribe(ros, args, topic, &settings)?;
            channels.push(Channel { topic, input, sign: settings.sign, offset: settings.offset });
        }
        let counters = Arc::new(SourceCounters::default());
        let wait = Duration::from_secs_f64(config.align_wait_s);
        let pump = Pump {
            channels,
            clock: ros.subscribe(&args.topic("/clock"))?,
            control: Arc::clone(control),
            by_zenoh,
            samples,
            collator: Collator::new(wait),
            counters: Arc::clone(&counters),
        };
        let worker = Worker::start("ros-source", move |stop| pump.run(stop))
            .map_err(NodeError::io("starting the thread that takes ROS messages"))?;
        Ok(Self { worker, counters })
    }

    /// The source's thread, for waking.
    #[must_use]
    pub fn thread(&self) -> Thread {
        self.worker.thread()
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
        JointState::TYPE => Input::Joint(ros.subscribe(&name)?, joint_of(topic, settings)?),
        _ => match topic {
            "displacement" => Input::Displacement(ros.subscribe(&name)?),
            "velocity" | "body_velocity" => Input::Velocity(ros.subscribe(&name)?),
            "coil_current" => Input::CoilCurrent(ros.subscribe(&name)?),
            "command_voltage" => Input::CommandVoltage(ros.subscribe(&name)?),
            "case_temperature" => Input::Temperature(ros.subscribe(&name)?),
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
        fn messages<M: Message>(of: &Subscription<M>) -> impl Stream<Item = Result<M, String>> {
            of.async_stream()
                .map(|taken| taken.map(|(message, _)| message).map_err(|error| error.to_string()))
        }
        fn plain<M: Carries>(of: &Subscription<M>) -> LocalBoxStream<'_, Result<Taken, String>> {
            messages(of).map(|message| message.map(|message| Some(message.taken()))).boxed_local()
        }
        match &self.input {
            Input::Displacement(of) => plain(of),
            Input::Velocity(of) => plain(of),
            Input::CoilCurrent(of) => plain(of),
            Input::CommandVoltage(of) => plain(of),
            Input::Force(of) => plain(of),
            Input::Temperature(of) => plain(of),
            Input::Float(of) => plain(of),
            Input::Joint(of, joint) => messages(of)
                .map(|message| message.map(|message| of_joint(message, self.topic, joint)))
                .boxed_local(),
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
    by_zenoh: ByZenoh,
    samples: SampleSink,
    collator: Collator,
    counters: Arc<SourceCounters>,
}

impl Pump {
    fn run(self, stop: &Stop) {
        let Self { channels, clock, control, mut by_zenoh, mut samples, mut collator, counters } = self;
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
                && let Ok(arrived) = by_zenoh.samples.try_recv()
            {
                counters.messages.fetch_add(1, Ordering::Relaxed);
                batch.push(channels[arrived.input].sample(arrived.stamp_ns, arrived.value, received));
            }
            while batch.len() < BATCH
                && let Ok((stamp, force)) = by_zenoh.forces.pop()
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
    pub(super) fn note_unreadable(&self, topic: &str, why: &str) {
        let count = self.unreadable.fetch_add(1, Ordering::Relaxed) + 1;
        if count.is_power_of_two() {
            tracing::warn!(topic, count, "a message cannot be used: {why}");
        }
    }
}
