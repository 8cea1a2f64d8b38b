//! Samples from ROS topics, combined with samples that other threads receive: inputs from rmw_zenoh and from a CAN bus, and demanded
//! forces from Zenoh.
//!
//! One thread waits on all input topics. It polls displacement first and all other topics after it: what a peer sent
//! before a displacement has arrived by then, and is sorted before it. If the peer's middleware sent messages in
//! another order, the thread waits a little for them (`collate.rs`). So an estimate does not miss a current with the
//! same stamp because of the order in which topics are sent or polled, and live results are bit-identical to a replay.
//!
//! A message without a stamp gets the time of its sending (`stamp.rs`). Two simultaneous publishers of one input are
//! detected (`writers.rs`).

use super::collate::Collator;
use super::input::{CarriesNumber, Number, ReadNumber, TOPICS, is_estimated_from, joint_of, of_joint};
use super::stamp::{NodeTime, SampleOrigin, Stamper, Ticks, Times};
use super::unusable::UnusableMessages;
use super::writers::Writers;
use crate::estimation::control::Control;
use crate::estimation::estimator::SampleSink;
use crate::estimation::frame::Frame;
use crate::ros2::graph::Writer;
use crate::ros2::participant::Ros;
use crate::settings::config::{Config, InputConfig, RosArgs};
use crate::settings::error::NodeError;
use crate::streams::source::queued::QueuedInput;
use crate::streams::source::zenoh::DemandedForce;
use futures::stream::{LocalBoxStream, Stream, StreamExt};
use mr_damper_base::clock::system_now;
use mr_damper_base::worker::{Stop, Worker};
use mr_damper_model::sample::{Drive, DriveKind, Reading, Sample, Stamp};
use mr_damper_model::units::{Celsius, Metre, MetrePerSecond, Newton};
use mr_damper_msgs::standard::{Clock, Float64, JointState, Temperature};
use mr_damper_msgs::{CoilCurrent, CommandVoltage, Displacement, Force, Message, Velocity};
use ros2_client::{MessageInfo, ReadResult, Subscription};
use rtrb::Consumer;
use std::collections::BTreeMap;
use std::fmt::Display;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, Wake, Waker};
use std::thread::Thread;
use std::time::{Duration, Instant};

/// Maximum number of messages per round; they are then sorted and passed on.
const BATCH: usize = 512;
/// Longest sleep of the thread. A drive or force without a following displacement waits for so long.
const NAP: Duration = Duration::from_millis(10);
/// Longest sleep while a displacement is held back.
const HOLDING_NAP: Duration = Duration::from_millis(1);
/// Time between two updates of the list of publishers.
const UPDATE_EVERY: Duration = Duration::from_millis(200);
/// Number of publishers on rmw_zenoh whose nodes' names are kept.
const NAMED: usize = 64;

/// The source thread's inputs that other threads receive.
pub struct OtherInputs {
    /// Demanded forces. They do not wake the thread, because they take effect with the next displacement.
    pub forces: Consumer<DemandedForce>,
    /// Samples of nodes on rmw_zenoh.
    pub samples: Receiver<QueuedInput>,
    /// Samples of a CAN bus.
    pub can: Receiver<QueuedInput>,
}

/// Counters of the source.
#[derive(Debug, Default)]
pub struct SourceCounters {
    /// Received messages.
    pub messages: AtomicU64,
    /// Messages that could not be used (broken CDR, a missing joint, a malformed rmw_zenoh message, no stamp before the
    /// first `/clock`).
    pub unreadable: AtomicU64,
    /// Displacements that were passed on without an input of the same stamp, after waiting for it.
    pub incomplete: AtomicU64,
    /// The publishers of the inputs, in the order of `TOPICS`.
    writers: Mutex<[Writers; TOPICS.len()]>,
    /// The names of the nodes of publishers on rmw_zenoh.
    names: Mutex<BTreeMap<Writer, String>>,
    /// The messages of `unreadable`, by topic.
    unusable: Mutex<UnusableMessages>,
}

/// The subscription of an input topic, by message type.
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

/// An input topic with its sign and offset.
struct InputChannel {
    topic: &'static str,
    /// Full name of the topic, after remapping.
    full_name: String,
    input: Input,
    sign: f64,
    offset: f64,
}

/// Why a sample without stamp cannot be used before the first simulated time.
const UNTIMED: &str = "it has no stamp, and no time has arrived on /clock";

/// State that is kept per channel.
#[derive(Default)]
struct ChannelHistory {
    stamper: Stamper,
    writers: Writers,
}

/// The running source.
pub struct RosSource {
    worker: Worker,
    counters: Arc<SourceCounters>,
}

impl RosSource {
    /// Subscribes to the input topics and to `/clock`, and starts the thread that receives them.
    ///
    /// # Errors
    /// When a topic cannot be subscribed to or the system cannot start the thread.
    pub fn start(
        ros: &mut Ros,
        args: &RosArgs,
        config: &Config,
        control: &Arc<Control>,
        others: OtherInputs,
        frame: Frame,
        samples: SampleSink,
    ) -> Result<Self, NodeError> {
        let mut channels = Vec::with_capacity(TOPICS.len());
        for topic in TOPICS {
            let settings = config.input(topic).cloned().unwrap_or_default();
            let input = subscribe(ros, args, topic, &settings)?;
            let (full_name, sign, offset) = (args.topic(topic), settings.sign, settings.offset);
            channels.push(InputChannel { topic, full_name, input, sign, offset });
        }
        let counters = Arc::new(SourceCounters::default());
        let wait = Duration::from_secs_f64(config.align_wait_s);
        let thread = SourceThread {
            channels,
            clock: ros.subscribe(&args.topic("/clock"))?,
            control: Arc::clone(control),
            others,
            frame,
            samples,
            collator: Collator::new(wait),
            counters: Arc::clone(&counters),
        };
        let worker = Worker::start("ros-source", move |stop| thread.run(stop))
            .map_err(NodeError::io("starting the thread that receives ROS messages"))?;
        Ok(Self { worker, counters })
    }

    /// The source's thread handle, for waking it.
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

impl InputChannel {
    /// True if each message must wake the thread even when nothing waits for it.
    fn wakes(&self) -> bool {
        self.topic == "displacement" || matches!(self.input, Input::Float(_) | Input::Joint(..))
    }

    /// The channel's messages as plain numbers. An `Err` is a message that could not be decoded.
    fn values(&self) -> LocalBoxStream<'_, ReadResult<(ReadNumber, SampleOrigin)>> {
        fn messages<M: Message>(of: &Subscription<M>) -> impl Stream<Item = ReadResult<(M, SampleOrigin)>> {
            of.async_stream().map(|taken| taken.map(|(message, info)| (message, origin(&info))))
        }
        fn plain<M: CarriesNumber>(
            of: &Subscription<M>,
        ) -> LocalBoxStream<'_, ReadResult<(ReadNumber, SampleOrigin)>> {
            messages(of)
                .map(|message| message.map(|(message, origin)| (Ok(message.taken()), origin)))
                .boxed_local()
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
                .map(|message| {
                    message.map(|(message, origin)| (of_joint(message, self.topic, joint), origin))
                })
                .boxed_local(),
        }
    }

    fn sample(&self, stamp: Stamp, value: f64, received: Stamp) -> Sample {
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
        Sample { stamp, received, reading }
    }
}

/// The data of DDS about a message.
fn origin(info: &MessageInfo) -> SampleOrigin {
    SampleOrigin {
        writer: info.publisher_gid().to_bytes16(),
        sent_ns: info.source_timestamp().map(|at| at.to_nanos()),
        arrived_ns: info.received_timestamp().map_or_else(|| system_now().nanos(), |at| at.to_nanos()),
    }
}

/// A waker that unparks the thread on which it was created.
struct Unpark(Thread);

impl Wake for Unpark {
    fn wake(self: Arc<Self>) {
        self.0.unpark();
    }
}

/// The source thread. It receives messages whenever a topic wakes it, until it is stopped.
///
/// Displacement always wakes it, because an estimate is made when displacement arrives. Other topics wake it only in
/// two cases: when a displacement waits for them, or when their messages may lack a stamp and get the simulated time at
/// which they are received. At 1 kHz, waking for each message would cost more than the models.
struct SourceThread {
    channels: Vec<InputChannel>,
    clock: Subscription<Clock>,
    control: Arc<Control>,
    others: OtherInputs,
    frame: Frame,
    samples: SampleSink,
    collator: Collator,
    counters: Arc<SourceCounters>,
}

/// The state of one polling round.
struct PollingRound<'a> {
    channels: &'a [InputChannel],
    histories: &'a mut [ChannelHistory],
    frame: &'a Frame,
    counters: &'a SourceCounters,
    batch: &'a mut Vec<Sample>,
    times: Times,
    received: Stamp,
    began: Instant,
}

impl PollingRound<'_> {
    /// Converts a number received on channel `index` to a sample.
    fn take(&mut self, index: usize, number: &Number, origin: &SampleOrigin) {
        let (channel, past) = (&self.channels[index], &mut self.histories[index]);
        past.writers.note(origin.writer, self.began);
        let stamp = match number.stamp_ns {
            0 => past.stamper.stamp(channel.topic, origin, &self.times),
            stamp_ns => Some(Stamp::from_nanos(stamp_ns)),
        };
        let Some(stamp) = stamp else {
            self.counters.note_unreadable(&channel.full_name, &UNTIMED);
            return;
        };
        if index == 0 {
            self.frame.observe(&number.frame_id);
        }
        self.batch.push(channel.sample(stamp, number.value, self.received));
    }

    /// Takes a demanded force that came by Zenoh.
    fn take_force(&mut self, stamp: Option<Stamp>, force: Newton) {
        let (received, reading) = (self.received, Reading::ForceRequest(force));
        match stamp {
            None if matches!(self.times.node, NodeTime::Awaited) => {
                self.counters.note_unreadable("force_request", &UNTIMED);
            }
            stamp => self.batch.push(Sample { stamp: stamp.unwrap_or(received), received, reading }),
        }
    }

    fn is_full(&self) -> bool {
        self.batch.len() >= BATCH
    }
}

impl SourceThread {
    fn run(self, stop: &Stop) {
        let Self { channels, clock, control, mut others, frame, mut samples, mut collator, counters } = self;
        let waker = Waker::from(Arc::new(Unpark(std::thread::current())));
        let mut streams: Vec<_> = channels.iter().map(|channel| (channel, channel.values())).collect();
        let mut histories: Vec<ChannelHistory> = channels.iter().map(|_| ChannelHistory::default()).collect();
        let mut batch: Vec<Sample> = Vec::with_capacity(BATCH);
        let (time, wants_velocity) = (control.clock(), control.wants_velocity());
        let (mut ticks, mut updated) = (Ticks::default(), Instant::now());
        while !stop.is_raised() {
            observe_clock(&clock, &control, &mut ticks);
            let (wall, received) = (system_now(), time.now_or_system());
            let node = match time.now() {
                _ if !time.is_simulated() => NodeTime::System,
                Some(now) => NodeTime::Simulated(ticks.at(now)),
                None => NodeTime::Awaited,
            };
            let mut round = PollingRound {
                channels: &channels,
                histories: &mut histories,
                frame: &frame,
                counters: &counters,
                batch: &mut batch,
                times: Times { wall, node },
                received,
                began: Instant::now(),
            };
            collator.want_velocity(wants_velocity.load(Ordering::Acquire));
            let was_holding = collator.is_holding();
            for (index, (channel, stream)) in streams.iter_mut().enumerate() {
                let mut context =
                    Context::from_waker(if was_holding || channel.wakes() { &waker } else { Waker::noop() });
                while !round.is_full()
                    && let Poll::Ready(Some(taken)) = stream.poll_next_unpin(&mut context)
                {
                    counters.messages.fetch_add(1, Ordering::Relaxed);
                    match taken {
                        Ok((Ok(number), origin)) => round.take(index, &number, &origin),
                        Ok((Err(error), _)) => counters.note_unreadable(&channel.full_name, &error),
                        Err(error) => counters.note_unreadable(&channel.full_name, &error),
                    }
                }
            }
            for queue in [&others.samples, &others.can] {
                while !round.is_full()
                    && let Ok(arrived) = queue.try_recv()
                {
                    counters.messages.fetch_add(1, Ordering::Relaxed);
                    round.take(arrived.input, &arrived.number, &arrived.origin);
                }
            }
            while !round.is_full()
                && let Ok((stamp, force)) = others.forces.pop()
            {
                round.take_force(stamp, force);
            }
            let now = round.began;
            let mut counting =
                channels.iter().zip(&histories).filter(|(channel, _)| is_estimated_from(channel.topic));
            samples.note_mixed(counting.any(|(_, past)| past.writers.are_mixed(now)));
            if now.saturating_duration_since(updated) >= UPDATE_EVERY {
                updated = now;
                counters.update(&histories);
            }
            // A full batch may have left messages in the queues, and messages that are waited for now must wake the
            // thread: poll again before sleeping.
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
                // A message that arrived since its topic was polled has left a wake-up behind, so parking returns at
                // once.
                std::thread::park_timeout(if holding { HOLDING_NAP } else { NAP });
            }
        }
    }
}

/// Takes the new messages of `/clock`.
fn observe_clock(clock: &Subscription<Clock>, control: &Control, ticks: &mut Ticks) {
    // Messages that cannot be decoded are skipped.
    while let Ok(Some((message, info))) = clock.take() {
        let (now, origin) = (Stamp::from_nanos(message.clock.as_nanos()), origin(&info));
        ticks.observe(now, origin.sent_ns.unwrap_or(origin.arrived_ns));
        control.hear_clock(now);
    }
}

impl SourceCounters {
    /// The publishers of the inputs, in the order of `TOPICS`.
    #[must_use]
    pub fn writers(&self) -> [Writers; TOPICS.len()] {
        *self.writers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The name of the node of a publisher on rmw_zenoh.
    #[must_use]
    pub fn name_of(&self, writer: &Writer) -> Option<String> {
        self.names.lock().unwrap_or_else(PoisonError::into_inner).get(writer).cloned()
    }

    /// Stores the name of the node of a publisher on rmw_zenoh.
    pub(super) fn name(&self, writer: Writer, node: String) {
        let mut names = self.names.lock().unwrap_or_else(PoisonError::into_inner);
        if names.len() >= NAMED {
            names.pop_first();
        }
        names.insert(writer, node);
    }

    /// Publishes the list of publishers. It skips the update while a reader holds the lock; the next one follows soon.
    fn update(&self, histories: &[ChannelHistory]) {
        if let Ok(mut writers) = self.writers.try_lock() {
            writers.iter_mut().zip(histories).for_each(|(shared, past)| *shared = past.writers);
        }
    }

    /// Counts a message of `topic` that gave no sample. Logs the first of the topic, then at most one per second.
    pub(super) fn note_unreadable(&self, topic: &str, why: &dyn Display) {
        self.unreadable.fetch_add(1, Ordering::Relaxed);
        let due = self.unusable.lock().unwrap_or_else(PoisonError::into_inner).note(topic, Instant::now());
        if let Some(count) = due {
            tracing::warn!(topic, count, "a message cannot be used: {why}");
        }
    }
}
