//! State that the mirror's threads share: counters, history, names of the models.
//!
//! The mirror and the queries of consumers share a mutex; the estimating thread never takes it.

use super::history::History;
use super::mirror::Damper;
use super::payload::Item;
use super::rmw_output::RmwPresence;
use super::stats::{CommandCounters, MirrorState, RouteCount, Stats};
use super::topic::Topic;
use crate::estimation::frame::Frame;
use crate::estimation::wire::ModelNames;
use crate::zenoh::session::ZenohConfig;
use mr_damper_model::pipeline::{AlarmChange, Event, Mode, Residual, Validity};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// Routes of `state/` and of `web/`.
pub(super) const ROUTES: usize = 2 * Topic::ALL.len();

/// The two subtrees of routes, `state/` and `web/`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Tree {
    State,
    Web,
}

/// Index of a route.
pub(super) const fn route(tree: Tree, topic: Topic) -> usize {
    match tree {
        Tree::State => topic as usize,
        Tree::Web => Topic::ALL.len() + topic as usize,
    }
}

/// A clock that never goes back: the machine's time at the start plus the time of the monotonic clock since then.
#[derive(Debug, Clone, Copy)]
pub(super) struct Clock {
    start: Instant,
    start_ns: i64,
}

impl Clock {
    pub(super) fn new() -> Self {
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { start: Instant::now(), start_ns: i64::try_from(since_1970.as_nanos()).unwrap_or(i64::MAX) }
    }

    /// Nanoseconds since 1970 at an instant.
    pub(super) fn nanos_at(&self, at: Instant) -> i64 {
        let elapsed_ns = at.saturating_duration_since(self.start).as_nanos();
        self.start_ns.saturating_add(i64::try_from(elapsed_ns).unwrap_or(i64::MAX))
    }
}

/// State that the threads of one mirror share.
#[derive(Debug)]
pub(super) struct Shared {
    /// Name of the damper in keys.
    pub(super) damper: String,
    /// Frame in the headers of ROS messages.
    pub(super) frame: Frame,
    /// The damper's entry in the graph of rmw_zenoh, if any.
    pub(super) rmw: Option<RmwPresence>,
    pub(super) config: ZenohConfig,
    pub(super) clock: Clock,
    pub(super) stop: AtomicBool,
    ring_dropped: Arc<AtomicU64>,
    names: Mutex<Arc<ModelNames>>,
    pub(super) commands: OnceLock<Arc<CommandCounters>>,
    data: Mutex<MirrorData>,
}

/// The state that changes while the mirror runs.
#[derive(Debug)]
pub(super) struct MirrorData {
    pub(super) state: MirrorState,
    pub(super) failure: Option<String>,
    pub(super) connected: usize,
    pub(super) events: u64,
    pub(super) queries_answered: u64,
    pub(super) queries_refused: u64,
    pub(super) routes: [RouteCount; ROUTES],
    /// The last sample of each route and its number, for late joiners.
    pub(super) last: [Option<(Item, u64)>; ROUTES],
    pub(super) history: History,
    /// Mode after the last transition or estimate.
    pub(super) mode: Option<Mode>,
    /// Validity of the last estimate.
    pub(super) validity: Validity,
    /// The last residual.
    pub(super) residual: Option<Residual>,
    /// The change that raised the alarm, while the alarm is active.
    pub(super) alarm: Option<AlarmChange>,
}

impl MirrorData {
    /// Records an event that was published under `state/`.
    pub(super) fn note(&mut self, item: Item, seq: u64, sent: bool, at: Instant, clock: &Clock) {
        self.events += 1;
        self.note_on(route(Tree::State, item.topic()), &item, seq, sent, at);
        match &item.event {
            Event::Estimate(estimate) => {
                (self.mode, self.validity) = (Some(estimate.mode), estimate.validity)
            }
            Event::Transition(transition) => self.mode = Some(transition.to),
            Event::Residual(residual) => self.residual = Some(*residual),
            Event::Alarm(alarm) => self.alarm = alarm.raised.then_some(*alarm),
            Event::Input(_) | Event::Refusal(_) | Event::Command(_) => {}
        }
        self.history.push(item, seq, clock.nanos_at(at));
    }

    /// Records a sample that was published on a route.
    pub(super) fn note_on(&mut self, route: usize, item: &Item, seq: u64, sent: bool, at: Instant) {
        self.routes[route].note(sent, at);
        self.last[route] = Some((*item, seq));
    }
}

impl Shared {
    pub(super) fn new(
        damper: Damper,
        config: ZenohConfig,
        names: ModelNames,
        ring_dropped: Arc<AtomicU64>,
    ) -> Self {
        let data = MirrorData {
            state: MirrorState::Connecting,
            failure: None,
            connected: 0,
            events: 0,
            queries_answered: 0,
            queries_refused: 0,
            routes: std::array::from_fn(|_| RouteCount::default()),
            last: [None; ROUTES],
            history: History::new(config.history_s),
            mode: None,
            validity: Validity::Invalid,
            residual: None,
            alarm: None,
        };
        let Damper { name, frame, rmw } = damper;
        Self {
            damper: name,
            frame,
            rmw,
            config,
            clock: Clock::new(),
            stop: AtomicBool::new(false),
            ring_dropped,
            names: Mutex::new(Arc::new(names)),
            commands: OnceLock::new(),
            data: Mutex::new(data),
        }
    }

    /// The full key of `tail` for this damper.
    pub(super) fn key(&self, tail: &str) -> String {
        format!("mr_damper/{}/{tail}", self.damper)
    }

    /// The key of a route.
    pub(super) fn route_key(&self, tree: Tree, topic: Topic) -> String {
        let tree = match tree {
            Tree::State => "state",
            Tree::Web => "web",
        };
        self.key(&format!("{tree}/{}", topic.name()))
    }

    pub(super) fn stopping(&self) -> bool {
        self.stop.load(Ordering::Acquire)
    }

    pub(super) fn ring_dropped(&self) -> u64 {
        self.ring_dropped.load(Ordering::Relaxed)
    }

    pub(super) fn names(&self) -> Arc<ModelNames> {
        Arc::clone(&self.names.lock().unwrap_or_else(PoisonError::into_inner))
    }

    pub(super) fn set_names(&self, names: ModelNames) {
        *self.names.lock().unwrap_or_else(PoisonError::into_inner) = Arc::new(names);
    }

    /// Locks the changing state. If a thread panicked while it held the lock, its counters are still usable.
    pub(super) fn data(&self) -> MutexGuard<'_, MirrorData> {
        self.data.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Marks the mirror as failed and logs it once.
    pub(super) fn fail(&self, why: String) {
        let mut data = self.data();
        if data.state != MirrorState::Failed {
            let damper = &self.damper;
            tracing::error!(%damper, "Zenoh mirror failed: {why}; estimates continue without it");
            data.state = MirrorState::Failed;
            data.failure = Some(why);
        }
    }

    pub(super) fn stats(&self) -> Stats {
        let now = Instant::now();
        let data = self.data();
        let trees = [Tree::State, Tree::Web];
        let of_tree = |tree| Topic::ALL.into_iter().map(move |topic| (tree, topic));
        let one = |(tree, topic)| data.routes[route(tree, topic)].stats(self.route_key(tree, topic), now);
        Stats {
            state: data.state,
            failure: data.failure.clone(),
            connected: data.connected,
            ring_dropped: self.ring_dropped(),
            events: data.events,
            queries_answered: data.queries_answered,
            queries_refused: data.queries_refused,
            commands: self.commands.get().map(|counters| counters.stats()),
            rmw: self.rmw.as_ref().map(|presence| presence.counters().stats()),
            routes: trees.into_iter().flat_map(of_tree).map(one).collect(),
        }
    }
}
