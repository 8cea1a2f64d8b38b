//! Events to ROS topics, and to the log.
//!
//! Publishing allocates and wakes the middleware's thread, so it happens here and never on the estimating
//! thread. Refused samples are logged: the first at once, then no more than one line a second for each kind,
//! with a count.

use crate::clock::Clock;
use crate::config::RosArgs;
use crate::diagnostics::ALARM_ADVICE;
use crate::error::NodeError;
use crate::hot::Inlet;
use crate::latency::Latency;
use crate::ros::Ros;
use crate::wire::{self, ModelNames};
use crate::worker::{Stop, Worker};
use mr_damper_model::pipeline::{AlarmChange, Event, Refusal, Refused};
use mr_damper_model::sample::{Channel, Stamp};
use mr_damper_msgs::{CurrentCommand, ForceEstimate, ForceResidual, ModeChange};
use ros2_client::Publisher;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, RwLock};
use std::time::{Duration, Instant};

/// How long the thread sleeps when nobody wakes it.
const IDLE: Duration = Duration::from_millis(100);
/// Spacing of log lines on refused samples of one kind.
const LOG_EVERY: Duration = Duration::from_secs(1);

/// Counters of the sink.
#[derive(Debug, Default)]
pub struct RosSinkCounters {
    /// Estimates published.
    pub estimates: AtomicU64,
    /// Residuals published.
    pub residuals: AtomicU64,
    /// Samples refused by the pipeline.
    pub refused: AtomicU64,
    /// Messages that the middleware did not take.
    pub failed: AtomicU64,
    /// From the receipt of a displacement to the publishing of its estimate.
    pub latency: Latency,
    /// Of that, the making of the message, and its hand-over to the middleware.
    pub publishing: Latency,
    /// Estimates that were published later than `deadline_s` after the receipt of their displacement.
    pub missed: AtomicU64,
}

/// The names of the models that run; swapped with them.
pub type SharedNames = Arc<RwLock<ModelNames>>;

/// The running sink.
pub struct RosSink {
    worker: Worker,
    counters: Arc<RosSinkCounters>,
}

struct Publishers {
    estimate: Publisher<ForceEstimate>,
    residual: Publisher<ForceResidual>,
    mode: Publisher<ModeChange>,
    command: Publisher<CurrentCommand>,
}

impl RosSink {
    /// Creates the publishers and starts the thread. Estimates older than `deadline` are published all the same, and counted.
    ///
    /// # Errors
    /// When a topic cannot be published or the system starts no thread.
    pub fn start(
        ros: &mut Ros,
        args: &RosArgs,
        names: SharedNames,
        clock: Arc<Clock>,
        deadline: Option<Duration>,
        inlet: Inlet,
    ) -> Result<Self, NodeError> {
        let publishers = Publishers {
            estimate: ros.publish(&args.topic("force_estimate"))?,
            residual: ros.publish(&args.topic("force_residual"))?,
            mode: ros.publish(&args.topic("mode"))?,
            command: ros.publish(&args.topic("current_command"))?,
        };
        let counters = Arc::new(RosSinkCounters::default());
        let frame_id = wire::frame_id(&args.namespace());
        let publishing = Publishing {
            publishers,
            names,
            clock,
            deadline,
            frame_id,
            counters: Arc::clone(&counters),
            log: RefusalLog::default(),
        };
        let worker = Worker::start("ros-sink", move |stop| publishing.run(inlet, stop))
            .map_err(NodeError::io("starting the thread that publishes ROS messages"))?;
        Ok(Self { worker, counters })
    }

    /// The sink's thread, for waking.
    #[must_use]
    pub fn thread(&self) -> std::thread::Thread {
        self.worker.thread()
    }

    /// The sink's counters.
    #[must_use]
    pub fn counters(&self) -> Arc<RosSinkCounters> {
        Arc::clone(&self.counters)
    }

    /// True while the thread runs; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.worker.is_alive()
    }

    /// Publishes what is left in the ring, ends the thread and drops the publishers. `Err` when it had panicked.
    ///
    /// # Errors
    /// The panic's payload.
    pub fn stop(self) -> std::thread::Result<()> {
        self.worker.stop()
    }
}

struct Publishing {
    publishers: Publishers,
    names: SharedNames,
    clock: Arc<Clock>,
    /// How old an estimate may be when it is published.
    deadline: Option<Duration>,
    frame_id: String,
    counters: Arc<RosSinkCounters>,
    log: RefusalLog,
}

impl Publishing {
    fn run(mut self, mut inlet: Inlet, stop: &Stop) {
        loop {
            // Read before draining: what is in the ring when stop is set is still published.
            let last_round = stop.is_raised();
            while let Ok(event) = inlet.events.pop() {
                self.publish(&event);
            }
            self.log.flush();
            if last_round {
                return;
            }
            std::thread::park_timeout(IDLE);
        }
    }

    fn publish(&mut self, event: &Event) {
        let published = match event {
            Event::Estimate(estimate) => {
                let began = Instant::now();
                // A poisoned lock only means that a writer panicked between two whole names.
                let names = self.names.read().unwrap_or_else(std::sync::PoisonError::into_inner);
                let message = wire::force_estimate(estimate, &names, &self.frame_id);
                drop(names);
                self.counters.estimates.fetch_add(1, Ordering::Relaxed);
                let published = self.publishers.estimate.publish(message).is_ok();
                self.counters.publishing.add(began.elapsed());
                self.note_latency(estimate.received);
                published
            }
            Event::Residual(residual) => {
                self.counters.residuals.fetch_add(1, Ordering::Relaxed);
                self.publishers.residual.publish(wire::force_residual(residual, &self.frame_id)).is_ok()
            }
            Event::Transition(transition) => {
                tracing::info!(
                    from = transition.from.name(),
                    to = transition.to.name(),
                    reason = transition.cause.text(),
                    "mode"
                );
                self.publishers.mode.publish(wire::mode_change(transition, &self.frame_id)).is_ok()
            }
            Event::Refusal(refusal) => {
                self.counters.refused.fetch_add(1, Ordering::Relaxed);
                self.log.note(refusal);
                true
            }
            Event::Alarm(alarm) => {
                self.say_alarm(alarm);
                true
            }
            Event::Command(commanded) => {
                self.publishers.command.publish(wire::current_command(commanded, &self.frame_id)).is_ok()
            }
            Event::Input(_) => true,
        };
        if !published {
            self.counters.failed.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Counts how long an estimate took. Simulated time says nothing of that.
    fn note_latency(&self, received: Option<Stamp>) {
        if let Some(took) = received.and_then(|received| self.clock.took_since(received)) {
            self.counters.latency.add(took);
            if self.deadline.is_some_and(|deadline| took > deadline) {
                self.counters.missed.fetch_add(1, Ordering::Relaxed);
            }
        }
    }

    fn say_alarm(&self, alarm: &AlarmChange) {
        let names = self.names.read().unwrap_or_else(std::sync::PoisonError::into_inner);
        let (model, stamp_ns) = (names.free.as_str(), alarm.stamp.nanos());
        if alarm.raised {
            tracing::warn!(
                model,
                stamp_ns,
                ratio = format!("{:.2}", alarm.ratio),
                "residual alarm: the model is off by more than its noise explains; {ALARM_ADVICE}"
            );
        } else {
            tracing::info!(model, stamp_ns, "the residual alarm is over");
        }
    }
}

/// Log lines on refused samples, thinned out.
#[derive(Default)]
struct RefusalLog {
    kinds: Vec<RefusalKind>,
}

struct RefusalKind {
    channel: Channel,
    why: Refused,
    since_last: u64,
    last_line: Instant,
    example: Refusal,
}

impl RefusalLog {
    fn note(&mut self, refusal: &Refusal) {
        let channel = refusal.sample.reading.channel();
        match self.kinds.iter_mut().find(|kind| kind.channel == channel && kind.why == refusal.why) {
            Some(kind) => {
                kind.since_last += 1;
                kind.example = *refusal;
            }
            None => {
                warn(refusal, 1);
                self.kinds.push(RefusalKind {
                    channel,
                    why: refusal.why,
                    since_last: 0,
                    last_line: Instant::now(),
                    example: *refusal,
                });
            }
        }
    }

    fn flush(&mut self) {
        for kind in &mut self.kinds {
            if kind.since_last > 0 && kind.last_line.elapsed() >= LOG_EVERY {
                warn(&kind.example, kind.since_last);
                kind.since_last = 0;
                kind.last_line = Instant::now();
            }
        }
    }
}

fn warn(refusal: &Refusal, count: u64) {
    let advice = match refusal.why {
        Refused::NotFinite => "check who publishes it",
        Refused::Repeated | Refused::TimeBack => "check the publisher's stamps, and that only one publishes",
        Refused::OutOfRange => {
            "check the sensor's unit and offset, or raise the parameter plausible.* that bounds it"
        }
        Refused::TooFast => {
            "check the sensor for spikes and its unit, or raise the parameter plausible.speed_max_m_s"
        }
        Refused::WrongDrive => "load a model that was identified on this kind of drive",
    };
    tracing::warn!(
        channel = refusal.sample.reading.channel().name(),
        value = refusal.sample.reading.get(),
        stamp_ns = refusal.sample.stamp.nanos(),
        count,
        "sample refused: {}; {advice}",
        refusal.why.text(),
    );
}
