//! Publishes events on ROS topics.
//!
//! ```text
//! estimating thread ─→ ring of commands ─→ [ros-commands] ─→ current_command
//!                   └→ ring of reports ──→ [ros-sink] ─────→ force_estimate, force_residual, mode
//! ```
//!
//! Each thread also publishes its standard messages (`standard.rs`), if there are any.
//!
//! Publishing allocates and wakes the middleware's thread, so it runs here and never on the estimating thread. Commands have
//! their own ring and thread, so that estimates cannot delay them; a command that is late anyway is dropped. No write waits for
//! a reader (`ros.rs`, `lagging_readers.rs`). These threads do not log, because logging can be slow; `event_log.rs` does that.

use super::standard::{self, StandardEstimates};
use crate::estimation::estimator::EventReceiver;
use crate::estimation::frame::Frame;
use crate::estimation::wire::{self, SharedNames};
use crate::ros2::participant::{Output, Ros};
use crate::settings::config::{RosArgs, StandardSettings};
use crate::settings::error::NodeError;
use mr_damper_base::clock::Clock;
use mr_damper_base::latency::Latency;
use mr_damper_base::worker::{Stop, Worker};
use mr_damper_model::pipeline::{Estimate, Event, StampedCommand};
use mr_damper_model::sample::Stamp;
use mr_damper_msgs::standard::Float64;
use mr_damper_msgs::{CurrentCommand, ForceEstimate, ForceResidual, ModeChange};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::Thread;
use std::time::{Duration, Instant};

/// Longest sleep of a thread that is not woken.
const IDLE: Duration = Duration::from_millis(100);

/// Maximum age of a command when it is published, if `deadline_s` is not set: the default validity time of a request.
pub const COMMAND_AGE: Duration = Duration::from_millis(100);

/// Counters of the sink.
#[derive(Debug, Default)]
pub struct RosSinkCounters {
    /// Estimates published.
    pub estimates: AtomicU64,
    /// Residuals published.
    pub residuals: AtomicU64,
    /// Commands published.
    pub commands: AtomicU64,
    /// Commands that were not published because they were late.
    pub late_commands: AtomicU64,
    /// Messages that the middleware refused.
    pub failed: AtomicU64,
    /// Time from the receipt of a displacement to the publication of its estimate.
    pub latency: Latency,
    /// Part of this time that is spent on making the message and passing it to the middleware.
    pub publishing: Latency,
    /// Estimates that were published later than `deadline_s` after the receipt of their displacement.
    pub missed: AtomicU64,
}

/// State that both threads share.
#[derive(Clone)]
struct Shared {
    clock: Arc<Clock>,
    /// `deadline_s`, if set.
    deadline: Option<Duration>,
    frame: Frame,
    counters: Arc<RosSinkCounters>,
}

impl Shared {
    /// Time since `received`; `None` with simulated time, where it is unknown.
    fn age(&self, received: Stamp) -> Option<Duration> {
        self.clock.took_since(received)
    }

    fn count(&self, published: bool, count: &AtomicU64) {
        let count = if published { count } else { &self.counters.failed };
        count.fetch_add(1, Ordering::Relaxed);
    }
}

/// The read ends of the sink's rings.
pub struct EventReceivers {
    /// Ring of [`crate::estimation::estimator::EventFilter::Commands`].
    pub commands: EventReceiver,
    /// Ring of [`crate::estimation::estimator::EventFilter::Reports`].
    pub reports: EventReceiver,
}

/// How the sink publishes.
pub struct SinkSettings<'a> {
    /// `deadline_s`, if set. Estimates older than it are published and counted; commands older than it ([`COMMAND_AGE`] when it is
    /// `None`) are dropped and counted.
    pub deadline: Option<Duration>,
    /// Frame of the outputs.
    pub frame: Frame,
    /// Standard messages to publish, too.
    pub standard: &'a StandardSettings,
}

/// The running sink.
pub struct RosSink {
    commands: Worker,
    reports: Worker,
    counters: Arc<RosSinkCounters>,
}

impl RosSink {
    /// Creates the publishers and starts the threads.
    ///
    /// # Errors
    /// When a topic cannot be published or a thread cannot be started.
    pub fn start(
        ros: &mut Ros,
        args: &RosArgs,
        names: SharedNames,
        clock: Arc<Clock>,
        settings: SinkSettings<'_>,
        receivers: EventReceivers,
    ) -> Result<Self, NodeError> {
        let SinkSettings { deadline, frame, standard } = settings;
        let counters = Arc::new(RosSinkCounters::default());
        let shared = Shared { clock, deadline, frame, counters: Arc::clone(&counters) };
        let commands = Commands {
            publisher: ros.publish(&args.topic("current_command"))?,
            float64: standard::command_publisher(ros, args, standard)?,
            shared: shared.clone(),
        };
        let reports = Reports {
            estimate: ros.publish(&args.topic("force_estimate"))?,
            residual: ros.publish(&args.topic("force_residual"))?,
            mode: ros.publish_state(&args.topic("mode"))?,
            standard: StandardEstimates::new(ros, args, standard)?,
            names,
            shared,
        };
        let starting = NodeError::io("starting a thread that publishes ROS messages");
        let commands = Worker::start("ros-commands", move |stop| {
            drain(receivers.commands, stop, |e| commands.publish(e))
        });
        let reports =
            Worker::start("ros-sink", move |stop| drain(receivers.reports, stop, |e| reports.publish(e)));
        let (commands, reports) = commands.and_then(|commands| Ok((commands, reports?))).map_err(starting)?;
        Ok(Self { commands, reports, counters })
    }

    /// The thread that publishes commands, to unpark after a push.
    #[must_use]
    pub fn commands_thread(&self) -> Thread {
        self.commands.thread()
    }

    /// The thread that publishes everything else, to unpark after a push.
    #[must_use]
    pub fn reports_thread(&self) -> Thread {
        self.reports.thread()
    }

    /// The sink's counters.
    #[must_use]
    pub fn counters(&self) -> Arc<RosSinkCounters> {
        Arc::clone(&self.counters)
    }

    /// True while the threads run; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.commands.is_alive() && self.reports.is_alive()
    }

    /// Publishes the events that are left in the rings, ends the threads and drops the publishers.
    ///
    /// # Errors
    /// The panic's payload when a thread has panicked.
    pub fn stop(self) -> std::thread::Result<()> {
        let commands = self.commands.stop();
        self.reports.stop().and(commands)
    }
}

/// Publishes the events of a ring until `stop` is raised.
fn drain(mut receiver: EventReceiver, stop: &Stop, mut publish: impl FnMut(&Event)) {
    loop {
        // Read before draining, so that events that are in the ring when stop is raised are still published.
        let last_round = stop.is_raised();
        while let Ok(event) = receiver.events.pop() {
            publish(&event);
        }
        if last_round {
            return;
        }
        std::thread::park_timeout(IDLE);
    }
}

struct Commands {
    publisher: Output<CurrentCommand>,
    float64: Option<Output<Float64>>,
    shared: Shared,
}

impl Commands {
    fn publish(&self, event: &Event) {
        let Event::Command(commanded) = event else { return };
        let counters = &self.shared.counters;
        if is_late(commanded, &self.shared) {
            counters.late_commands.fetch_add(1, Ordering::Relaxed);
            return;
        }
        let published =
            self.publisher.publish(wire::current_command(commanded, &self.shared.frame.get())).is_ok();
        self.shared.count(published, &counters.commands);
        if let Some(output) = &self.float64
            && output.publish(standard::current(commanded)).is_err()
        {
            counters.failed.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// True for a command that is too old to be published.
fn is_late(commanded: &StampedCommand, shared: &Shared) -> bool {
    shared.age(commanded.known_at).is_some_and(|age| age > shared.deadline.unwrap_or(COMMAND_AGE))
}

struct Reports {
    estimate: Output<ForceEstimate>,
    residual: Output<ForceResidual>,
    mode: Output<ModeChange>,
    standard: StandardEstimates,
    names: SharedNames,
    shared: Shared,
}

impl Reports {
    fn publish(&self, event: &Event) {
        let Shared { frame, counters, .. } = &self.shared;
        match event {
            Event::Estimate(estimate) => self.publish_estimate(estimate),
            Event::Residual(residual) => {
                let published = self.residual.publish(wire::force_residual(residual, &frame.get())).is_ok();
                self.shared.count(published, &counters.residuals);
            }
            Event::Transition(transition) => {
                if self.mode.publish(wire::mode_change(transition, &frame.get())).is_err() {
                    counters.failed.fetch_add(1, Ordering::Relaxed);
                }
            }
            Event::Refusal(_) | Event::Alarm(_) | Event::Command(_) | Event::Input(_) => {}
        }
    }

    fn publish_estimate(&self, estimate: &Estimate) {
        let began = Instant::now();
        // A poisoned lock is harmless: a writer panicked, but the names are always complete.
        let names = self.names.read().unwrap_or_else(std::sync::PoisonError::into_inner);
        let frame = self.shared.frame.get();
        let message = wire::force_estimate(estimate, &names, &frame);
        drop(names);
        let published = self.estimate.publish(message).is_ok();
        let counters = &self.shared.counters;
        self.shared.count(published, &counters.estimates);
        let refused = self.standard.publish(estimate, &frame);
        if refused > 0 {
            counters.failed.fetch_add(refused, Ordering::Relaxed);
        }
        counters.publishing.add(began.elapsed());
        if let Some(took) = estimate.received.and_then(|received| self.shared.age(received)) {
            counters.latency.add(took);
            if self.shared.deadline.is_some_and(|deadline| took > deadline) {
                counters.missed.fetch_add(1, Ordering::Relaxed);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_base::clock::system_now;
    use mr_damper_model::inverse::{CurrentCommand, LimitedBy};
    use mr_damper_model::units::{Ampere, Newton};

    fn commanded(known_at: Stamp) -> StampedCommand {
        let command = CurrentCommand {
            current: Ampere(0.6),
            requested: Newton(300.0),
            expected: Newton(299.5),
            achievable: [Newton(80.0), Newton(900.0)],
            is_achievable: true,
            dissipative: true,
            limited_by: LimitedBy::None,
            substituted: false,
        };
        StampedCommand { stamp: known_at, known_at, command }
    }

    fn shared(simulated: bool, deadline: Option<Duration>) -> Shared {
        let clock = Arc::new(Clock::new(simulated));
        Shared { clock, deadline, frame: Frame::new(""), counters: Arc::default() }
    }

    #[test]
    fn a_command_is_late_after_its_deadline_or_after_100_ms_without_one() {
        let ago = |ms: i64| commanded(system_now().shifted(-ms * 1_000_000));
        for (deadline_ms, in_time_ms, late_ms) in
            [(None, 0, 101), (Some(20), 0, 21), (Some(5000), 4000, 5001)]
        {
            let shared = shared(false, deadline_ms.map(Duration::from_millis));
            assert!(!is_late(&ago(in_time_ms), &shared), "{deadline_ms:?}");
            assert!(is_late(&ago(late_ms), &shared), "{deadline_ms:?}");
        }
    }

    #[test]
    fn with_simulated_time_no_command_is_late() {
        let shared = shared(true, None);
        shared.clock.observe(Stamp::from_nanos(5_000_000_000));
        assert!(!is_late(&commanded(Stamp::from_nanos(0)), &shared));
    }
}
