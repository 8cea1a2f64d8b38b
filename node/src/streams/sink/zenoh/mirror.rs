//! The mirror of one damper: a thread that takes events from a ring and publishes them over Zenoh.

use super::declarations::Declarations;
use super::encode::encode;
use super::payload::Item;
use super::rmw_output::RmwPresence;
use super::shared::{ROUTES, Shared, Tree, route};
use super::stats::{CommandCounters, MirrorState, Stats};
use super::throttle::Throttle;
use super::topic::Topic;
use crate::estimation::frame::Frame;
use crate::estimation::wire::ModelNames;
use crate::zenoh::session::Encoding;
use crate::zenoh::session::ZenohError;
use crate::zenoh::session::{Inner, Link, SessionState};
use mr_damper_model::pipeline::{Event, Validity};
use mr_damper_model::sample::Stamp;
use rtrb::Consumer;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::{self, JoinHandle, Thread};
use std::time::{Duration, Instant};

/// Longest wait for the thread to stop; afterwards it stops in the background. Closing the session takes about as long again.
const STOP_WAIT: Duration = Duration::from_millis(450);
/// Longest sleep, which bounds the delay after a missed wake-up.
const LONGEST_SLEEP: Duration = Duration::from_millis(50);
/// Events published between two rounds of other work.
const BATCH: usize = 1024;
/// Interval of the checks of connections and losses, and shortest interval between log messages about failed puts.
const CHECK_EVERY: Duration = Duration::from_secs(1);
const REPEAT: Duration = Duration::from_secs(10);
/// Number of estimates whose validity is kept for their residuals, which follow a few samples later.
const KEPT_VALIDITIES: usize = 256;

/// Names of a damper on Zenoh.
#[derive(Debug, Clone)]
pub struct Damper {
    /// Name in keys: the ROS namespace without the leading slash, such as `front_left`.
    pub name: String,
    /// Frame in the headers of ROS messages; used with [`Encoding::Cdr`] only.
    pub frame: Frame,
    /// Entry in the graph of rmw_zenoh; `None` when nodes there do not see the damper.
    pub rmw: Option<RmwPresence>,
}

impl Damper {
    /// A damper whose frame equals its name.
    #[must_use]
    pub fn named(name: &str) -> Self {
        Self { name: name.to_owned(), frame: Frame::new(name), rmw: None }
    }
}

/// The mirror of one damper. Dropping it stops it.
#[derive(Debug)]
pub struct Mirror {
    shared: Arc<Shared>,
    thread: Thread,
    running: Option<(JoinHandle<()>, mpsc::Receiver<()>)>,
}

impl Mirror {
    /// Starts the thread. `dropped` counts the events that did not fit into the ring; the caller increments it.
    ///
    /// # Errors
    /// When the damper's name cannot be part of a key, or the thread cannot be started.
    pub fn start(
        link: &Link,
        damper: Damper,
        names: ModelNames,
        events: Consumer<Event>,
        dropped: Arc<AtomicU64>,
    ) -> Result<Self, ZenohError> {
        let name = damper.name.trim_matches('/').to_owned();
        let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-');
        if !name.split('/').all(|part| !part.is_empty() && part.chars().all(allowed)) {
            return Err(ZenohError::DamperName { name: damper.name });
        }
        let damper = Damper { name, ..damper };
        let shared = Arc::new(Shared::new(damper, link.config().clone(), names, Arc::clone(&dropped)));
        let (sender, ended) = mpsc::sync_channel(1);
        let (of_thread, of_guard, link) = (Arc::clone(&shared), Arc::clone(&shared), link.inner());
        let handle = thread::Builder::new()
            .name("zenoh-mirror".to_owned())
            .spawn(move || {
                let thread = MirrorThread::new(of_thread, link, events);
                if catch_unwind(AssertUnwindSafe(|| thread.run())).is_err() {
                    of_guard.fail("its thread panicked (see the panic's message above)".to_owned());
                }
                // The receiver may have given up waiting.
                let _ = sender.send(());
            })
            .map_err(|source| ZenohError::Thread { name: "zenoh-mirror", source })?;
        Ok(Self { shared, thread: handle.thread().clone(), running: Some((handle, ended)) })
    }

    /// The thread to [`Thread::unpark`] after an event was pushed. Without it, the event is delayed by at most 50 ms.
    #[must_use]
    pub fn waker(&self) -> Thread {
        self.thread.clone()
    }

    /// A handle that changes the names of the running models.
    #[must_use]
    pub fn renamer(&self) -> Renamer {
        Renamer(Arc::clone(&self.shared))
    }

    /// Adds the counters of the commands for this damper to `status`.
    pub fn attach_commands(&self, counters: Arc<CommandCounters>) {
        // A damper has one source of commands, which is attached once.
        let _ = self.shared.commands.set(counters);
    }

    /// The counters.
    #[must_use]
    pub fn stats(&self) -> Stats {
        self.shared.stats()
    }

    /// True while samples are published, or while a client still waits for its router.
    #[must_use]
    pub fn is_alive(&self) -> bool {
        matches!(self.shared.data().state, MirrorState::Connecting | MirrorState::Running)
    }

    /// Publishes the events left in the ring, undeclares everything and ends the thread, within half a second.
    pub fn stop(self) {
        // `Drop` stops it.
    }
}

impl Drop for Mirror {
    fn drop(&mut self) {
        let Some((handle, ended)) = self.running.take() else { return };
        self.shared.stop.store(true, Ordering::Release);
        self.thread.unpark();
        match ended.recv_timeout(STOP_WAIT) {
            Err(mpsc::RecvTimeoutError::Timeout) => {
                let damper = &self.shared.damper;
                tracing::warn!(%damper, "the Zenoh mirror takes long to stop; stopping continues in the background");
            }
            // A panic was already caught and reported.
            Ok(()) | Err(mpsc::RecvTimeoutError::Disconnected) => drop(handle.join()),
        }
    }
}

/// Changes the model names that a mirror publishes.
#[derive(Debug, Clone)]
pub struct Renamer(Arc<Shared>);

impl Renamer {
    /// Sets the names after other models were loaded. Events that are still in the ring get the new names too.
    pub fn rename(&self, names: ModelNames) {
        self.0.set_names(names);
    }
}

/// State of the mirror's thread.
struct MirrorThread {
    shared: Arc<Shared>,
    link: Arc<Inner>,
    events: Consumer<Event>,
    declarations: Option<Declarations>,
    seq: [u64; ROUTES],
    web: [Throttle<Item>; Topic::ALL.len()],
    recent: VecDeque<(Stamp, Validity)>,
    last_check: Option<Instant>,
    dropped_before: u64,
    last_logged_failure: Option<Instant>,
}

impl MirrorThread {
    fn new(shared: Arc<Shared>, link: Arc<Inner>, events: Consumer<Event>) -> Self {
        let rate_hz = shared.config.web_rate_hz;
        Self {
            shared,
            link,
            events,
            declarations: None,
            seq: [0; ROUTES],
            web: std::array::from_fn(|_| Throttle::new(rate_hz)),
            recent: VecDeque::with_capacity(KEPT_VALIDITIES),
            last_check: None,
            dropped_before: 0,
            last_logged_failure: None,
        }
    }

    fn run(mut self) {
        loop {
            // Read before the ring is drained, so that events pushed before the request to stop are still published.
            let stopping = self.shared.stopping();
            self.check_session();
            let drained = self.drain();
            self.poll_web(stopping);
            self.check();
            if stopping && drained {
                break;
            }
            if drained {
                thread::park_timeout(self.sleep_time());
            }
        }
        if let Some(declarations) = self.declarations.take() {
            declarations.close();
        }
        let mut data = self.shared.data();
        if data.state != MirrorState::Failed {
            data.state = MirrorState::Stopped;
        }
    }

    /// Declares everything once the session is open, and detects its end.
    fn check_session(&mut self) {
        if let Some(declarations) = &self.declarations {
            if declarations.session().is_closed() {
                self.declarations = None;
                self.shared.fail("the Zenoh session was closed".to_owned());
            }
            return;
        }
        if self.shared.data().state != MirrorState::Connecting {
            return;
        }
        match self.link.session_state() {
            SessionState::Waiting => {}
            SessionState::Gone => self.shared.fail("the Zenoh session was closed".to_owned()),
            SessionState::Done(session) => match Declarations::declare(session, &self.link, &self.shared) {
                Ok(declarations) => {
                    self.declarations = Some(declarations);
                    self.shared.data().state = MirrorState::Running;
                }
                Err(error) => self.shared.fail(format!("Zenoh refused a declaration: {error}")),
            },
        }
    }

    /// Publishes a batch of events. Returns true when the ring is empty afterwards.
    fn drain(&mut self) -> bool {
        for _ in 0..BATCH {
            let Ok(event) = self.events.pop() else { return true };
            let item = Item::new(event, |stamp| self.validity_at(stamp));
            if let Event::Estimate(estimate) = &event {
                if self.recent.len() == KEPT_VALIDITIES {
                    self.recent.pop_front();
                }
                self.recent.push_back((estimate.stamp, estimate.validity));
            }
            let now = Instant::now();
            let (seq, sent) = self.put(Tree::State, &item, self.shared.config.encoding);
            self.put_rmw(&event, now);
            self.shared.data().note(item, seq, sent, now, &self.shared.clock);
            if let Some(item) = self.web[item.topic() as usize].offer(item, now) {
                self.put_web(&item, now);
            }
        }
        false
    }

    fn validity_at(&self, stamp: Stamp) -> Option<Validity> {
        self.recent.iter().rev().find(|(of, _)| *of == stamp).map(|(_, validity)| *validity)
    }

    fn poll_web(&mut self, flush: bool) {
        let now = Instant::now();
        for index in 0..self.web.len() {
            let web = &mut self.web[index];
            if let Some(item) = if flush { web.flush() } else { web.poll(now) } {
                self.put_web(&item, now);
            }
        }
    }

    fn put_web(&mut self, item: &Item, now: Instant) {
        let (seq, sent) = self.put(Tree::Web, item, Encoding::Json);
        self.shared.data().note_on(route(Tree::Web, item.topic()), item, seq, sent, now);
    }

    /// Publishes a sample. Returns its number on the route, and true when Zenoh took it. A sample that Zenoh did not take
    /// uses a number too, so that consumers can detect the loss.
    fn put(&mut self, tree: Tree, item: &Item, encoding: Encoding) -> (u64, bool) {
        let topic = item.topic();
        let seq = &mut self.seq[route(tree, topic)];
        *seq += 1;
        let seq = *seq;
        let Some(declarations) = &self.declarations else { return (seq, false) };
        let names = self.shared.names();
        let put = match encode(item, seq, encoding, &names, &self.shared.frame.get()) {
            Ok(encoded) => declarations.put(tree, topic, encoded).map_err(|error| error.to_string()),
            Err(error) => Err(error.to_string()),
        };
        if let Err(error) = &put {
            self.log_failure(topic, error);
        }
        (seq, put.is_ok())
    }

    /// Publishes an output for nodes on rmw_zenoh, if `zenoh.rmw` is on.
    fn put_rmw(&mut self, event: &Event, now: Instant) {
        let Some(rmw) = self.declarations.as_mut().and_then(Declarations::rmw) else { return };
        if let Err(error) = rmw.put(event, &self.shared.names(), self.shared.clock.nanos_at(now)) {
            self.log_failure(Topic::of_event(event), &error.to_string());
        }
    }

    fn log_failure(&mut self, topic: Topic, error: &str) {
        if self.last_logged_failure.is_none_or(|at| at.elapsed() > REPEAT) {
            self.last_logged_failure = Some(Instant::now());
            tracing::warn!(damper = %self.shared.damper, topic = topic.name(), "cannot publish over Zenoh: {error}");
        }
    }

    /// Checks connections and losses in the ring, once a second.
    fn check(&mut self) {
        if self.last_check.is_some_and(|at| at.elapsed() < CHECK_EVERY) {
            return;
        }
        self.last_check = Some(Instant::now());
        let connected =
            self.declarations.as_ref().map_or(0, |declarations| self.link.watch(declarations.session()));
        self.shared.data().connected = connected;
        let dropped = self.shared.ring_dropped();
        if dropped > self.dropped_before {
            let lost = dropped - self.dropped_before;
            let damper = &self.shared.damper;
            tracing::warn!(%damper, "{lost} events were lost before Zenoh because the ring was full");
            self.dropped_before = dropped;
        }
    }

    fn sleep_time(&self) -> Duration {
        let now = Instant::now();
        let due = self.web.iter().filter_map(Throttle::deadline).min();
        due.map_or(LONGEST_SLEEP, |due| due.saturating_duration_since(now).min(LONGEST_SLEEP))
    }
}
