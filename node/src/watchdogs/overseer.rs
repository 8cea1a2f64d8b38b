//! The overseer thread. It keeps the history of raw input, logs the events of the pipeline, publishes the log on
//! `/rosout`, publishes the state of node and model on `/diagnostics` once per second, and follows the values of the
//! model's effects.
//!
//! It has its own ring from the estimating thread and polls it a few times per second. Its work is not urgent, and
//! waking it for each sample would cost more than the models.

use crate::estimation::control::Control;
use crate::estimation::estimator::EventReceiver;
use crate::estimation::frame::Frame;
use crate::estimation::wire::{SharedNames, header};
use crate::ros2::participant::{Domain, Output, Ros};
use crate::ros2::rosout::Rosout;
use crate::settings::config::RosArgs;
use crate::settings::error::NodeError;
use crate::streams::can::CanNews;
use crate::streams::source::{self, InputTopic};
use crate::watchdogs::diagnostics::{
    CLOCK_ADVICE, Counters, Health, NodeStatus, Publishers, StatusContext, publishers_advice, twin_advice,
};
use crate::watchdogs::effect_watch::EffectWatch;
use crate::watchdogs::event_log::EventLog;
use crate::watchdogs::fleet_rows::FleetRows;
use crate::watchdogs::history::History;
use mr_damper_base::clock::Clock;
use mr_damper_base::worker::{Stop, Worker};
use mr_damper_model::pipeline::Event;
use mr_damper_msgs::standard::DiagnosticArray;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Time between two reads of the ring, which holds two seconds at 1 kHz.
const NAP: Duration = Duration::from_millis(50);
/// Period of `/diagnostics`.
const PERIOD: Duration = Duration::from_secs(1);
/// How long the node waits for simulated time before it warns.
const CLOCK_PATIENCE: Duration = Duration::from_secs(5);

/// The history, filled by the overseer and read by a diagnosis.
pub type SharedHistory = Arc<Mutex<History>>;

/// The running overseer.
pub struct Overseer {
    worker: Worker,
    history: SharedHistory,
}

impl Overseer {
    /// The history of raw input.
    #[must_use]
    pub fn history(&self) -> SharedHistory {
        Arc::clone(&self.history)
    }

    /// True while the thread runs; false after a panic.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        self.worker.is_alive()
    }

    /// Ends the thread and drops the publisher. `Err` when it had panicked.
    ///
    /// # Errors
    /// The panic's payload.
    pub fn stop(self) -> std::thread::Result<()> {
        self.worker.stop()
    }
}

/// The parts of an overseer, before its thread runs.
pub struct Overseeing {
    publisher: Output<DiagnosticArray>,
    rosout: Option<Rosout>,
    /// Fully qualified name of the node.
    node: String,
    /// The node's namespace, without leading and trailing slash.
    damper: String,
    domain: Domain,
    /// Full name of the topic of estimates.
    estimates: String,
    names: SharedNames,
    control: Arc<Control>,
    history: SharedHistory,
    health: Health,
    node_status: NodeStatus,
    effects: EffectWatch,
    /// Rows on disk, if they are requested.
    rows: Option<FleetRows>,
    log: EventLog,
    /// True once the log says that the history is full early.
    said_dropped: bool,
    /// Events lost so far because the ring was full.
    lost: u64,
    /// Publishers of the estimates in other processes, at the last check.
    twins: usize,
    inputs: Vec<InputTopic>,
    /// Inputs with more than one publisher, at the last check.
    publishers: Vec<Publishers>,
    sim_time: SimTime,
    can_news: CanNews,
}

/// Watches whether the node waits for simulated time.
#[derive(Debug, Default)]
struct SimTime {
    waiting_since: Option<Instant>,
    said: bool,
}

impl SimTime {
    /// True if simulated time has not arrived for [`CLOCK_PATIENCE`] by `now`. Logs one line when that begins and one
    /// when it ends.
    fn is_missing(&mut self, clock: &Clock, now: Instant) -> bool {
        if clock.now().is_some() {
            if std::mem::take(self).said {
                tracing::info!("simulated time has arrived, or the node uses the system's clock again");
            }
            return false;
        }
        let since = *self.waiting_since.get_or_insert(now);
        let is_missing = now.saturating_duration_since(since) >= CLOCK_PATIENCE;
        if is_missing && !std::mem::replace(&mut self.said, true) {
            tracing::warn!("{CLOCK_ADVICE}");
        }
        is_missing
    }
}

impl Overseeing {
    /// Creates the publishers. `rosout` receives the log, and `frame` is the frame of the outputs.
    ///
    /// # Errors
    /// When the topic cannot be published.
    pub fn offer(
        ros: &mut Ros,
        args: &RosArgs,
        control: &Arc<Control>,
        rosout: Option<Rosout>,
        frame: Frame,
    ) -> Result<Self, NodeError> {
        Ok(Self {
            publisher: ros.publish_seldom(&args.topic("/diagnostics"))?,
            rosout,
            node: args.full_name(),
            damper: args.namespace().trim_matches('/').to_owned(),
            domain: ros.domain(),
            estimates: args.topic("force_estimate"),
            names: control.names(),
            control: Arc::clone(control),
            history: Arc::new(Mutex::new(History::new(control.config().history_duration_s))),
            health: Health::default(),
            node_status: NodeStatus::default(),
            effects: EffectWatch::offer(ros, args, control, frame)?,
            rows: None,
            log: EventLog::default(),
            said_dropped: false,
            lost: 0,
            twins: 0,
            inputs: source::inputs(args, &control.config())?,
            publishers: Vec::new(),
            sim_time: SimTime::default(),
            can_news: CanNews::default(),
        })
    }

    /// Starts the thread.
    ///
    /// # Errors
    /// When the system cannot start the thread.
    pub fn start(self, receiver: EventReceiver, counters: Counters) -> Result<Overseer, NodeError> {
        let history = Arc::clone(&self.history);
        let worker = Worker::start("overseer", move |stop| self.run(receiver, &counters, stop))
            .map_err(NodeError::io("starting the thread that oversees the model"))?;
        Ok(Overseer { worker, history })
    }

    fn run(mut self, mut receiver: EventReceiver, counters: &Counters, stop: &Stop) {
        let clock = self.control.clock();
        let mut due = Instant::now() + PERIOD;
        loop {
            // Read before draining, so that events before the stop are still processed.
            let last_round = stop.is_raised();
            self.drain(&mut receiver);
            if let Some(rosout) = &mut self.rosout {
                rosout.drain(&clock);
            }
            if last_round {
                return;
            }
            if Instant::now() >= due {
                due = (due + PERIOD).max(Instant::now());
                self.look(&receiver, counters, &clock);
            }
            std::thread::park_timeout(NAP);
        }
    }

    fn drain(&mut self, receiver: &mut EventReceiver) {
        let at = Instant::now();
        let shared = Arc::clone(&self.history);
        let names = self.names.read().unwrap_or_else(PoisonError::into_inner).clone();
        while let Ok(event) = receiver.events.pop() {
            if let Event::Input(sample) = &event {
                lock(&shared).push(sample);
            }
            self.health.take(&event, at);
            self.node_status.take(&event, at);
            let window = self.effects.take(&event);
            if let Some(rows) = &mut self.rows {
                rows.take(&event, window.as_ref());
            }
            self.log.take(&event, &names);
        }
        self.log.flush();
    }

    /// Runs once per second: publishes, applies changed parameters, and logs losses.
    fn look(&mut self, receiver: &EventReceiver, counters: &Counters, clock: &Clock) {
        let config = self.control.config();
        self.effects.refresh(&config);
        FleetRows::follow(&mut self.rows, &config, &self.damper);
        let (history_s, dropped) = {
            let mut history = lock(&self.history);
            history.set_duration_s(config.history_duration_s);
            (history.seconds(), history.dropped())
        };
        if dropped > 0 && !self.said_dropped {
            self.said_dropped = true;
            tracing::warn!(
                history_s,
                "the history is full before history.duration_s: close_loop gets only this much; lower history.duration_s or the sample rate"
            );
        }
        let lost = receiver.dropped.load(Ordering::Relaxed);
        if lost > self.lost {
            tracing::warn!(events = lost - self.lost, "the history has a gap: its ring was full");
            self.lost = lost;
        }
        if let Some(can) = &counters.can {
            self.can_news.since_last(can).iter().for_each(|news| tracing::warn!("CAN bus: {news}"));
        }
        let twins = self.domain.other_publishers(&self.estimates);
        if twins > self.twins {
            tracing::warn!(publishers = twins, "{}", twin_advice(&self.estimates));
        }
        self.twins = twins;
        self.look_at_publishers(counters);
        let now = Instant::now();
        let clock_missing = self.sim_time.is_missing(clock, now);
        let names = self.names.read().unwrap_or_else(PoisonError::into_inner).clone();
        let context = StatusContext {
            node: &self.node,
            damper: &self.damper,
            names: &names,
            false_alarm_interval_s: config.settings.false_alarm_interval_s,
            history_s,
            estimates: (&self.estimates, twins),
            publishers: &self.publishers,
            clock_missing,
        };
        let lifecycle = self.control.lifecycle_state();
        let mut status = vec![
            self.node_status.status(now, &context, lifecycle, counters),
            self.health.residual_status(now, &context),
        ];
        status.extend(self.effects.status(&context));
        let message = DiagnosticArray { header: header(clock.now_or_system(), ""), status };
        if let Err(error) = self.publisher.publish(message) {
            tracing::warn!("cannot publish /diagnostics: {error}");
        }
    }
}

impl Overseeing {
    /// Looks up the publishers of the inputs, and logs every change.
    fn look_at_publishers(&mut self, counters: &Counters) {
        let found = Publishers::of(&self.inputs, &self.domain, &counters.source);
        for publishers in found.iter().filter(|publishers| !self.publishers.contains(publishers)) {
            tracing::warn!("{}", publishers_advice(publishers));
        }
        let is_left = |before: &&Publishers| !found.iter().any(|now| now.topic == before.topic);
        for before in self.publishers.iter().filter(is_left) {
            tracing::info!(topic = before.topic, "the input has at most one publisher again");
        }
        self.publishers = found;
    }
}

/// Locks `history`. A panic of the last holder does no harm: samples are pushed as a whole.
fn lock(history: &Mutex<History>) -> MutexGuard<'_, History> {
    history.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_model::sample::Stamp;

    #[test]
    fn simulated_time_is_missing_after_a_delay_until_it_arrives() {
        let (clock, begin) = (Clock::new(true), Instant::now());
        let mut sim_time = SimTime::default();
        let mut missing = |s: u64| sim_time.is_missing(&clock, begin + Duration::from_secs(s));
        assert_eq!([0, 4, 5, 6].map(&mut missing), [false, false, true, true]);
        clock.observe(Stamp::from_nanos(1));
        assert!(!missing(7));
        clock.simulate(false);
        assert!(!missing(20), "the system's time is always known");
        clock.simulate(true);
        assert_eq!([21, 25, 26].map(&mut missing), [false, false, true]);
    }
}
