//! The running demo: service, player, event collector and listener, and the live screen.

use super::Args;
use super::error::DemoError;
use crate::commands::context::CliContext;
use crate::estimation::estimator::EventReceiver;
use crate::nodes::damper_node::DamperNode;
use crate::ros2::participant::Ros;
use crate::settings::config::Config;
use crate::settings::error::NodeError;
use crate::settings::interrupt::Interrupt;
use crate::settings::task::Task;
use crate::streams::player::{PlaybackOptions, Played, Player};
use crate::watchdogs::diagnostics::Counters;
use futures::stream::StreamExt;
use mr_damper_base::clock::system_now;
use mr_damper_model::pipeline::AlarmChange;
use mr_damper_model::sample::{Run, Stamp};
use mr_damper_msgs::ForceEstimate;
use mr_damper_reports::Recording;
use mr_damper_views::live::{Counts, Histogram, Key, LiveSummary, RunInfo, Terminal, plain};
use ros2_client::NodeOptions;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Interval between frames of the screen.
const FRAME: Duration = Duration::from_millis(50);
/// Interval between plain lines.
const LINE: Duration = Duration::from_secs(1);
/// Interval at which the event ring is polled. The ring holds three seconds of events.
const COLLECT: Duration = Duration::from_millis(2);
/// How long the player waits until it has discovered the service.
const FIND: Duration = Duration::from_secs(10);
/// How long the last samples may take to arrive.
const ARRIVE: Duration = Duration::from_secs(1);
/// How long the results of a sample may take to reach the listener, the collector and the history.
const SETTLE: Duration = Duration::from_millis(150);

/// The observations of one run.
pub(super) struct RunObservations {
    pub(super) recording: Recording,
    pub(super) counts: Counts,
    pub(super) ended_early: bool,
    to_node: Histogram,
    round_trip: Histogram,
}

impl RunObservations {
    /// Counts and latencies as text.
    pub(super) fn traffic(&self) -> Vec<(String, String)> {
        let c = &self.counts;
        let row = |name: &str, value: String| (name.to_owned(), value);
        let latency = |h: &Histogram| match (h.quantile_s(0.5), h.quantile_s(0.99)) {
            (Some(median_s), Some(p99_s)) => format!(
                "median {:.2} ms, 99 % {:.2} ms, longest {:.1} ms",
                median_s * 1e3,
                p99_s * 1e3,
                h.max_s() * 1e3
            ),
            _ => "no message arrived".to_owned(),
        };
        vec![
            row("samples", format!("{} published, {} taken, {} refused", c.sent, c.taken, c.refused)),
            row("estimates", format!("{} published, {} received by a subscriber", c.estimates, c.received)),
            row("lost in full queues", c.lost.to_string()),
            row(
                "estimated without an input of the same stamp, which did not arrive in time",
                c.incomplete.to_string(),
            ),
            row("from stamp to node", latency(&self.to_node)),
            row("from stamp to a subscriber's estimate", latency(&self.round_trip)),
        ]
    }
}

/// State that the threads share.
struct Shared {
    summary: Mutex<LiveSummary>,
    /// Events since the recording was last taken.
    recording: Mutex<Recording>,
    sent: AtomicU64,
    received: AtomicU64,
    /// Events that the collector's ring had no room for.
    unseen: Arc<AtomicU64>,
    done: AtomicBool,
    start: Instant,
}

impl Shared {
    fn summary(&self) -> MutexGuard<'_, LiveSummary> {
        lock(&self.summary)
    }

    fn take_recording(&self) -> Recording {
        std::mem::take(&mut lock(&self.recording))
    }

    fn counts(&self, counters: &Counters) -> Counts {
        let load = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        Counts {
            sent: load(&self.sent),
            taken: load(&counters.estimator.samples),
            refused: load(&counters.estimator.refused),
            lost: load(&counters.estimator.overflow) + load(&counters.source.unreadable) + load(&self.unseen),
            incomplete: load(&counters.source.incomplete),
            estimates: load(&counters.ros_sink.estimates),
            received: load(&self.received),
        }
    }
}

/// Locks `mutex`, also after a panic of another thread: each change of the shared state is complete in itself.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The service with its player, listener and collector. They keep running from one run to the next.
pub(super) struct LiveNode<'a> {
    service: DamperNode,
    player: Player,
    listener: Listener,
    collector: JoinHandle<()>,
    shared: Arc<Shared>,
    args: &'a Args,
    context: &'a CliContext,
}

impl<'a> LiveNode<'a> {
    /// Starts the service, its player, listener and collector, and waits until the player has discovered the service.
    ///
    /// # Errors
    /// When one of them does not start, or the service is not discovered over DDS.
    pub(super) fn start(config: &Config, args: &'a Args, context: &'a CliContext) -> Result<Self, NodeError> {
        let (service, receiver) = DamperNode::start(config, &context.ros_args, true)?;
        let receiver = receiver.ok_or(DemoError::NoEventRing)?;
        let shared = Arc::new(Shared {
            summary: Mutex::default(),
            recording: Mutex::default(),
            sent: AtomicU64::new(0),
            received: AtomicU64::new(0),
            unseen: Arc::clone(&receiver.dropped),
            done: AtomicBool::new(false),
            start: Instant::now(),
        });
        let listener = Listener::start(config, context, Arc::clone(&shared))?;
        let player = Player::start(config, &context.ros_args, false)?;
        let collecting = Arc::clone(&shared);
        let collector = std::thread::Builder::new()
            .name("demo-collector".to_owned())
            .spawn(move || collect(receiver, &collecting))
            .map_err(NodeError::io("starting the thread that collects events"))?;
        let live = Self { service, player, listener, collector, shared, args, context };
        if live.player.wait_for_listener(FIND, &context.interrupt) || context.interrupt.is_raised() {
            return Ok(live);
        }
        live.stop()?;
        Err(DemoError::NotDiscovered { within_s: FIND.as_secs() }.into())
    }

    /// Plays `run` and shows it on the screen.
    ///
    /// # Errors
    /// When a thread dies.
    pub(super) fn play(&self, run: &Run, info: RunInfo) -> Result<RunObservations, NodeError> {
        let (shared, interrupt) = (&self.shared, &self.context.interrupt);
        let counters = self.service.counters();
        *shared.summary() = LiveSummary::new(info);
        drop(shared.take_recording());
        let before = shared.counts(&counters);
        let (shown, played) = std::thread::scope(|scope| {
            let (player, counters) = (&self.player, &counters);
            let player =
                scope.spawn(move || play_and_wait(player, run, shared, counters, before.taken, interrupt));
            let shown = self.show(before, &|| player.is_finished());
            (shown, player.join().map_err(|_| DemoError::ThreadDied { thread: "playing" }))
        });
        shown?;
        let played = played?;
        if played.failed > 0 {
            tracing::warn!(failed = played.failed, "the middleware did not accept all samples");
        }
        let summary = shared.summary();
        Ok(RunObservations {
            recording: shared.take_recording(),
            counts: shared.counts(&counters).since(&before),
            ended_early: interrupt.is_raised(),
            to_node: summary.to_node.clone(),
            round_trip: summary.round_trip.clone(),
        })
    }

    /// The service's history as runs.
    pub(super) fn history(&self) -> Vec<Run> {
        let config = self.service.control().config();
        lock(&self.service.history()).runs(config.history_duration_s, config.settings.gap_s)
    }

    /// Loads the model, as the service `load_model` does; returns the changes of the alarm that followed.
    ///
    /// # Errors
    /// The errors of [`crate::estimation::control::Control::load_model`].
    pub(super) fn load_model(&self, path: &str) -> Result<Vec<AlarmChange>, NodeError> {
        drop(self.shared.take_recording());
        self.service.control().load_model(path)?;
        std::thread::sleep(SETTLE);
        Ok(self.shared.take_recording().alarms)
    }

    /// Stops everything, the listener before the service, so that the service need not wait for it.
    ///
    /// # Errors
    /// When a thread has died.
    pub(super) fn stop(self) -> Result<(), NodeError> {
        self.player.stop();
        let (listened, served) = (self.listener.stop(), self.service.stop());
        self.shared.done.store(true, Ordering::Release);
        self.collector.join().map_err(|_| DemoError::ThreadDied { thread: "collecting" })?;
        listened?;
        Ok(served?)
    }

    /// Shows the summary until the player has finished, the user ends the demo, or a thread of the service dies.
    fn show(&self, before: Counts, finished: &dyn Fn() -> bool) -> Result<(), NodeError> {
        let (shared, context) = (&self.shared, self.context);
        let counters = self.service.counters();
        let mut terminal = if self.args.no_screen || context.quiet { None } else { Terminal::start() };
        let mut next_line = Instant::now() + LINE;
        let mut alarm_said = false;
        while !finished() {
            if let Some(thread) = self.service.dead_thread() {
                context.interrupt.raise();
                return Err(DemoError::ThreadDied { thread }.into());
            }
            let summary = {
                let mut summary = shared.summary();
                summary.counts = shared.counts(&counters).since(&before);
                summary.now_s = shared.start.elapsed().as_secs_f64();
                summary.clone()
            };
            match &mut terminal {
                Some(terminal) => {
                    let drawn = terminal.draw(&summary);
                    if drawn.is_err() || terminal.key(FRAME) == Some(Key::End) {
                        // A lost terminal ends the demo, as the key does.
                        context.interrupt.raise();
                    }
                }
                None => {
                    if let (Some(alarm), false) = (&summary.alarm, alarm_said || context.quiet) {
                        println!("{}", alarm.text());
                        alarm_said = true;
                    }
                    if Instant::now() >= next_line && !context.quiet {
                        next_line += LINE;
                        println!("{}", plain::line(&summary));
                    }
                    context.interrupt.sleep_until(Instant::now() + FRAME);
                }
            }
            if context.interrupt.is_raised() {
                break;
            }
        }
        Ok(())
    }
}

/// Plays the run and waits until the service has taken all its samples. `before` is the number of samples that the service
/// had taken before.
fn play_and_wait(
    player: &Player,
    run: &Run,
    shared: &Shared,
    counters: &Counters,
    before: u64,
    interrupt: &Interrupt,
) -> Played {
    let mut played = Played::default();
    player.play(run, &PlaybackOptions::default(), &mut played, interrupt, None, &|at_s| {
        shared.sent.fetch_add(1, Ordering::Relaxed);
        shared.summary().played_s = at_s;
    });
    let deadline = Instant::now() + ARRIVE;
    let taken = || counters.estimator.samples.load(Ordering::Relaxed) - before;
    while taken() < played.samples && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(10));
    }
    // The results of the last samples are still on their way to the listener and the history.
    std::thread::sleep(SETTLE);
    played
}

/// Moves events from the ring to the recording and the summary until the service has ended and the ring is empty.
fn collect(mut receiver: EventReceiver, shared: &Shared) {
    loop {
        let last_round = shared.done.load(Ordering::Acquire);
        if !receiver.events.is_empty() {
            let seen_s = shared.start.elapsed().as_secs_f64();
            let (mut summary, mut recording) = (shared.summary(), lock(&shared.recording));
            while let Ok(event) = receiver.events.pop() {
                recording.take(&event);
                summary.take(&event, seen_s);
            }
        }
        if last_round {
            return;
        }
        std::thread::sleep(COLLECT);
    }
}

/// An ordinary subscriber that receives the estimates over DDS.
struct Listener {
    listening: Task,
    ros: Ros,
}

impl Listener {
    fn start(config: &Config, context: &CliContext, shared: Arc<Shared>) -> Result<Self, NodeError> {
        let args = &context.ros_args;
        let options = NodeOptions::new().enable_rosout(false);
        let mut ros = Ros::start(config, args, options, "mr_damper_demo_listener")?;
        let subscription = ros.subscribe::<ForceEstimate>(&args.topic("force_estimate"))?;
        let listen = |stopped| async move {
            let received = subscription.async_stream().for_each(|taken| {
                let arrived = system_now();
                if let Ok((estimate, _)) = taken {
                    shared.received.fetch_add(1, Ordering::Relaxed);
                    let stamp = Stamp::from_nanos(estimate.header.stamp.as_nanos());
                    shared.summary().round_trip.note(arrived.since(stamp).get());
                }
                std::future::ready(())
            });
            tokio::select! {
                () = received => {}
                _ = stopped => {}
            }
        };
        Ok(Self { listening: Task::start("demo-listener", listen)?, ros })
    }

    fn stop(self) -> Result<(), DemoError> {
        let ended = self.listening.stop().map_err(|_| DemoError::ThreadDied { thread: "listening" });
        self.ros.stop();
        ended
    }
}
