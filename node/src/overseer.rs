//! The overseer: keeps the history of raw input, puts the log on `/rosout`, and says on `/diagnostics` how node and model do, once a
//! second.
//!
//! It has a ring of its own from the estimating thread and looks into it a few times a second, unasked: nothing here
//! is in a hurry, and being woken for each sample would cost more than the models.

use crate::clock::Clock;
use crate::config::RosArgs;
use crate::control::Control;
use crate::diagnostics::{Health, Surroundings, Work, twin_advice};
use crate::error::NodeError;
use crate::history::History;
use crate::hot::Inlet;
use crate::ros::{Domain, Ros};
use crate::rosout::Rosout;
use crate::service::Counters;
use crate::sink::ros::SharedNames;
use crate::wire::header;
use crate::worker::{Stop, Worker};
use mr_damper_model::pipeline::Event;
use mr_damper_msgs::standard::DiagnosticArray;
use ros2_client::Publisher;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How often the ring is emptied. It holds two seconds at 1 kHz.
const NAP: Duration = Duration::from_millis(50);
/// How often `/diagnostics` is published.
const PERIOD: Duration = Duration::from_secs(1);

/// The history, as the overseer fills it and a diagnosis reads it.
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

/// What an overseer is made of, before its thread runs.
pub struct Overseeing {
    publisher: Publisher<DiagnosticArray>,
    rosout: Option<Rosout>,
    /// Fully qualified name of the node.
    node: String,
    /// Its namespace, without slashes around it.
    damper: String,
    domain: Domain,
    /// Full name of the topic of estimates.
    estimates: String,
    names: SharedNames,
    control: Arc<Control>,
    history: SharedHistory,
    health: Health,
    work: Work,
    /// The log has been told that the history is full before its time.
    said_dropped: bool,
    /// Events that the ring had no room for.
    lost: u64,
    /// Publishers of the estimates in other processes, at the last look.
    twins: usize,
}

impl Overseeing {
    /// Creates the publisher; `rosout`: where the log goes.
    ///
    /// # Errors
    /// When the topic cannot be published.
    pub fn offer(
        ros: &mut Ros,
        args: &RosArgs,
        control: &Arc<Control>,
        rosout: Option<Rosout>,
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
            work: Work::default(),
            said_dropped: false,
            lost: 0,
            twins: 0,
        })
    }

    /// Starts the thread.
    ///
    /// # Errors
    /// When the system starts no thread.
    pub fn start(self, inlet: Inlet, counters: Counters) -> Result<Overseer, NodeError> {
        let history = Arc::clone(&self.history);
        let worker = Worker::start("overseer", move |stop| self.run(inlet, &counters, stop))
            .map_err(NodeError::io("starting the thread that oversees the model"))?;
        Ok(Overseer { worker, history })
    }

    fn run(mut self, mut inlet: Inlet, counters: &Counters, stop: &Stop) {
        let clock = self.control.clock();
        let mut due = Instant::now() + PERIOD;
        loop {
            // Read before draining: what was said by the time of the end is still published.
            let last_round = stop.is_raised();
            self.drain(&mut inlet);
            if let Some(rosout) = &mut self.rosout {
                rosout.drain(&clock);
            }
            if last_round {
                return;
            }
            if Instant::now() >= due {
                due = (due + PERIOD).max(Instant::now());
                self.look(&inlet, counters, &clock);
            }
            std::thread::park_timeout(NAP);
        }
    }

    fn drain(&mut self, inlet: &mut Inlet) {
        let at = Instant::now();
        let shared = Arc::clone(&self.history);
        let mut history = lock(&shared);
        while let Ok(event) = inlet.events.pop() {
            if let Event::Input(sample) = &event {
                history.push(sample);
            }
            self.health.take(&event, at);
            self.work.take(&event, at);
        }
    }

    /// Once a second: publishes, follows the parameters, says what was lost.
    fn look(&mut self, inlet: &Inlet, counters: &Counters, clock: &Clock) {
        let config = self.control.config();
        let (history_s, dropped) = {
            let mut history = lock(&self.history);
            history.set_duration_s(config.history_duration_s);
            (history.seconds(), history.dropped())
        };
        if dropped > 0 && !self.said_dropped {
            self.said_dropped = true;
            tracing::warn!(
                history_s,
                "the history is full before its time: close_loop sees no more than that; lower history.duration_s or the rate"
            );
        }
        let lost = inlet.dropped.load(Ordering::Relaxed);
        if lost > self.lost {
            tracing::warn!(events = lost - self.lost, "the history has a gap: its ring was full");
            self.lost = lost;
        }
        let twins = self.domain.other_publishers(&self.estimates);
        if twins > self.twins {
            tracing::warn!(publishers = twins, "{}", twin_advice(&self.estimates));
        }
        self.twins = twins;
        let names = self.names.read().unwrap_or_else(PoisonError::into_inner).clone();
        let around = Surroundings {
            node: &self.node,
            damper: &self.damper,
            names: &names,
            false_alarm_interval_s: config.settings.false_alarm_interval_s,
            history_s,
            estimates: (&self.estimates, twins),
        };
        let phase = self.control.phase();
        let now = Instant::now();
        let status =
            vec![self.work.status(now, &around, phase, counters), self.health.residual_status(now, &around)];
        if self
            .publisher
            .publish(DiagnosticArray { header: header(clock.now_or_system(), ""), status })
            .is_err()
        {
            tracing::warn!("/diagnostics was not published");
        }
    }
}

/// Samples are pushed whole: what a thread that panicked left behind is a history.
fn lock(history: &Mutex<History>) -> MutexGuard<'_, History> {
    history.lock().unwrap_or_else(PoisonError::into_inner)
}
