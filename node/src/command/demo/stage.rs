//! The demo while it runs: service, player, collector and listener, and what is shown meanwhile.

use super::{Act, Args};
use crate::command::Surroundings;
use crate::error::NodeError;
use crate::hot::{Inlet, now};
use crate::interrupt::Interrupt;
use crate::live::{Board, Counts, Histogram, Terminal, plain};
use crate::player::{Plan, Played, Player};
use crate::report::Recording;
use crate::ros::{Ros, run_async};
use crate::service::{Counters, Service};
use futures::stream::StreamExt;
use mr_damper_model::sample::{Run, Stamp};
use mr_damper_msgs::ForceEstimate;
use ros2_client::NodeOptions;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tokio::sync::oneshot;

/// Spacing of the screen's pictures.
const FRAME: Duration = Duration::from_millis(50);
/// Spacing of plain lines.
const LINE: Duration = Duration::from_secs(1);
/// Spacing of looks into the ring of events, which holds three seconds of them.
const COLLECT: Duration = Duration::from_millis(2);
/// How long the player waits for the service to be found.
const FIND: Duration = Duration::from_secs(10);
/// How long the last samples may take to arrive.
const ARRIVE: Duration = Duration::from_secs(1);

/// What was seen.
pub(super) struct Shown {
    pub(super) recording: Recording,
    pub(super) counts: Counts,
    pub(super) ended_early: bool,
    to_node: Histogram,
    round_trip: Histogram,
}

impl Shown {
    /// Counts and latencies in words.
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
            _ => "nothing came".to_owned(),
        };
        vec![
            row("samples", format!("{} published, {} taken, {} refused", c.sent, c.taken, c.refused)),
            row("estimates", format!("{} published, {} heard by a subscriber", c.estimates, c.heard)),
            row("lost in full queues", c.lost.to_string()),
            row("estimated without an input of their stamp, waited for in vain", c.incomplete.to_string()),
            row("from stamp to node", latency(&self.to_node)),
            row("from stamp to a subscriber's estimate", latency(&self.round_trip)),
        ]
    }
}

/// What the threads share.
struct Shared {
    board: Mutex<Board>,
    sent: AtomicU64,
    heard: AtomicU64,
    /// Events that the collector's ring had no room for.
    unseen: Arc<AtomicU64>,
    done: AtomicBool,
    start: Instant,
}

impl Shared {
    fn board(&self) -> MutexGuard<'_, Board> {
        // Each change of the board is whole: a panic elsewhere does not spoil it.
        self.board.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn counts(&self, counters: &Counters) -> Counts {
        let load = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        Counts {
            sent: load(&self.sent),
            taken: load(&counters.hot.samples),
            refused: load(&counters.ros_sink.refused),
            lost: load(&counters.hot.overflow) + load(&counters.source.unreadable) + load(&self.unseen),
            incomplete: load(&counters.source.incomplete),
            estimates: load(&counters.ros_sink.estimates),
            heard: load(&self.heard),
        }
    }
}

/// Plays the act and shows it.
pub(super) fn perform(act: &Act, args: &Args, around: &Surroundings) -> Result<Shown, NodeError> {
    let (service, inlet) = Service::start(&act.config, &around.ros_args, true)?;
    let inlet = inlet.ok_or_else(|| NodeError::Failed("the service gave no events to watch".to_owned()))?;
    let shared = Arc::new(Shared {
        board: Mutex::new(Board::new(act.headline()?)),
        sent: AtomicU64::new(0),
        heard: AtomicU64::new(0),
        unseen: Arc::clone(&inlet.dropped),
        done: AtomicBool::new(false),
        start: Instant::now(),
    });
    let counters = service.counters();
    let listener = Listener::start(act, around, Arc::clone(&shared))?;
    let (recording, played) = std::thread::scope(|scope| {
        let collector = scope.spawn(|| collect(inlet, &shared));
        let player = scope.spawn(|| play(act, around, &shared, &counters));
        let shown = show(&shared, &service, args, around, &|| player.is_finished());
        let played = player.join().unwrap_or_else(|_| Err(died("playing")));
        // The listener goes first: it has heard all that it will, and the service must not wait for it.
        let ended = listener.stop().and(service.stop());
        shared.done.store(true, Ordering::Release);
        let recording = collector.join().map_err(|_| died("collecting"));
        (recording, shown.and(played).and_then(|played| ended.map(|()| played)))
    });
    let (recording, played) = (recording?, played?);
    if played.failed > 0 {
        tracing::warn!(failed = played.failed, "samples were not taken by the middleware");
    }
    let board = shared.board();
    Ok(Shown {
        recording,
        counts: shared.counts(&counters),
        ended_early: around.interrupt.is_raised(),
        to_node: board.to_node.clone(),
        round_trip: board.round_trip.clone(),
    })
}

fn died(what: &str) -> NodeError {
    NodeError::Failed(format!("the thread that was {what} died; the log above says why. Please report it"))
}

/// Takes events out of the ring until the service has ended and the ring is empty.
fn collect(mut inlet: Inlet, shared: &Shared) -> Recording {
    let mut recording = Recording::default();
    loop {
        let last_round = shared.done.load(Ordering::Acquire);
        if !inlet.events.is_empty() {
            let seen_s = shared.start.elapsed().as_secs_f64();
            let mut board = shared.board();
            while let Ok(event) = inlet.events.pop() {
                recording.take(&event);
                board.take(&event, seen_s);
            }
        }
        if last_round {
            return recording;
        }
        std::thread::sleep(COLLECT);
    }
}

/// Plays the run, and waits until the service has taken it.
fn play(act: &Act, around: &Surroundings, shared: &Shared, counters: &Counters) -> Result<Played, NodeError> {
    let player = Player::start(&act.config, &around.ros_args, false)?;
    let mut played = Played::default();
    if !player.wait_for_listener(FIND, &around.interrupt) && !around.interrupt.is_raised() {
        player.stop();
        return Err(NodeError::Failed(format!(
            "the demo's service was not found over DDS within {} s; is multicast allowed on the loopback interface?",
            FIND.as_secs()
        )));
    }
    play_run(&player, &act.played, shared, &mut played, &around.interrupt);
    let deadline = Instant::now() + ARRIVE;
    while counters.hot.samples.load(Ordering::Relaxed) < played.samples && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(10));
    }
    // What the last samples caused is still on its way to the listener.
    std::thread::sleep(Duration::from_millis(100));
    player.stop();
    Ok(played)
}

fn play_run(player: &Player, run: &Run, shared: &Shared, played: &mut Played, interrupt: &Interrupt) {
    player.play(run, &Plan::default(), played, interrupt, None, &|at_s| {
        shared.sent.fetch_add(1, Ordering::Relaxed);
        shared.board().played_s = at_s;
    });
}

/// Shows the board until the player has finished, somebody ends it, or a thread of the service dies.
fn show(
    shared: &Shared,
    service: &Service,
    args: &Args,
    around: &Surroundings,
    finished: &dyn Fn() -> bool,
) -> Result<(), NodeError> {
    let counters = service.counters();
    let mut terminal = if args.no_screen || around.quiet { None } else { Terminal::start() };
    let mut next_line = Instant::now() + LINE;
    while !finished() {
        if let Some(thread) = service.dead_thread() {
            around.interrupt.raise();
            return Err(died(thread));
        }
        let board = {
            let mut board = shared.board();
            board.counts = shared.counts(&counters);
            board.now_s = shared.start.elapsed().as_secs_f64();
            board.clone()
        };
        match &mut terminal {
            Some(terminal) => {
                let drawn = terminal.draw(&board);
                if drawn.is_err() || terminal.key(FRAME).is_some() {
                    // A terminal that is gone ends the demo as its user would have.
                    around.interrupt.raise();
                }
            }
            None => {
                if Instant::now() >= next_line && !around.quiet {
                    next_line += LINE;
                    println!("{}", plain::line(&board));
                }
                around.interrupt.sleep_until(Instant::now() + FRAME);
            }
        }
        if around.interrupt.is_raised() {
            break;
        }
    }
    Ok(())
}

/// A subscriber like any other: it hears the estimates over DDS.
struct Listener {
    stop: oneshot::Sender<()>,
    thread: JoinHandle<()>,
    ros: Ros,
}

impl Listener {
    fn start(act: &Act, around: &Surroundings, shared: Arc<Shared>) -> Result<Self, NodeError> {
        let args = &around.ros_args;
        let options = NodeOptions::new().enable_rosout(false);
        let mut ros = Ros::start(&act.config, args, options, "mr_damper_demo_listener")?;
        let subscription = ros.subscribe::<ForceEstimate>(&args.topic("force_estimate"))?;
        let (stop, stopped) = oneshot::channel();
        let listen = async move {
            let heard = subscription.async_stream().for_each(|taken| {
                let arrived = now();
                if let Ok((estimate, _)) = taken {
                    shared.heard.fetch_add(1, Ordering::Relaxed);
                    let stamp = Stamp::from_nanos(estimate.header.stamp.as_nanos());
                    shared.board().round_trip.note(arrived.since(stamp).get());
                }
                std::future::ready(())
            });
            tokio::select! {
                () = heard => {}
                _ = stopped => {}
            }
        };
        let thread = run_async("demo-listener", listen)?;
        Ok(Self { stop, thread, ros })
    }

    fn stop(self) -> Result<(), NodeError> {
        // It fails only when the thread has ended already.
        let _ = self.stop.send(());
        let ended = self.thread.join().map_err(|_| died("listening"));
        self.ros.stop();
        ended
    }
}
