//! What the mirror counts: the answer to "does it still flow, and what was lost?".

use serde::Serialize;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Over which rates are measured.
const WINDOW: Duration = Duration::from_secs(1);

/// State of a mirror.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MirrorState {
    /// A client waits for its router.
    Connecting,
    /// Samples are published.
    Running,
    /// Stopped on request.
    Stopped,
    /// Broken; [`Stats::failure`] says why. The ring is still drained if the thread lives.
    Failed,
}

/// Counters of one route, that is of one key.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RouteStats {
    /// The key.
    pub key: String,
    /// Samples given to Zenoh. Zenoh drops without a word when a consumer does not keep up: only a gap in
    /// `seq` at the consumer shows that.
    pub sent: u64,
    /// Samples that Zenoh refused, or that came while there was no session.
    pub dropped: u64,
    /// Age of the last sample, in s since the mirror took it; none before the first.
    pub age_s: Option<f64>,
    /// Samples a second, over the last second or so.
    pub rate_hz: f64,
}

/// Counters of the commands that came by Zenoh.
#[derive(Debug, Default)]
pub struct CommandCounters {
    obeyed: AtomicU64,
    refused: AtomicU64,
    last_refusal: Mutex<Option<String>>,
}

impl CommandCounters {
    /// Counts a command that was obeyed.
    pub fn obey(&self) {
        self.obeyed.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts one that was not, and keeps why.
    pub fn refuse(&self, why: &str) {
        self.refused.fetch_add(1, Ordering::Relaxed);
        *self.last_refusal.lock().unwrap_or_else(PoisonError::into_inner) = Some(why.to_owned());
    }

    /// The counters at present.
    #[must_use]
    pub fn stats(&self) -> CommandStats {
        CommandStats {
            obeyed: self.obeyed.load(Ordering::Relaxed),
            refused: self.refused.load(Ordering::Relaxed),
            last_refusal: self.last_refusal.lock().unwrap_or_else(PoisonError::into_inner).clone(),
        }
    }
}

/// What became of the commands under `cmd/`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct CommandStats {
    /// Obeyed.
    pub obeyed: u64,
    /// Not obeyed.
    pub refused: u64,
    /// Why the last of these was not.
    pub last_refusal: Option<String>,
}

/// Counters of what goes to and comes from nodes on rmw_zenoh.
#[derive(Debug, Default)]
pub struct RmwCounters {
    sent: AtomicU64,
    dropped: AtomicU64,
    taken: AtomicU64,
    lost: AtomicU64,
    refused: AtomicU64,
    mismatched: AtomicU64,
    last_refusal: Mutex<Option<String>>,
}

impl RmwCounters {
    /// Counts a message that was published, or that Zenoh refused.
    pub(super) fn put(&self, sent: bool) {
        let count = if sent { &self.sent } else { &self.dropped };
        count.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts an input that was handed on.
    pub fn take(&self) {
        self.taken.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts inputs that were lost on their way.
    pub fn lose(&self, count: u64) {
        self.lost.fetch_add(count, Ordering::Relaxed);
    }

    /// Counts an input that was not handed on, and keeps why.
    pub fn refuse(&self, why: &str) {
        self.refused.fetch_add(1, Ordering::Relaxed);
        *self.last_refusal.lock().unwrap_or_else(PoisonError::into_inner) = Some(why.to_owned());
    }

    /// Counts a publisher whose type is not that of the input, and returns how many there were.
    pub fn mismatch(&self) -> u64 {
        self.mismatched.fetch_add(1, Ordering::Relaxed) + 1
    }

    /// The counters at present.
    #[must_use]
    pub fn stats(&self) -> RmwStats {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        RmwStats {
            sent: read(&self.sent),
            dropped: read(&self.dropped),
            taken: read(&self.taken),
            lost: read(&self.lost),
            refused: read(&self.refused),
            mismatched: read(&self.mismatched),
            last_refusal: self.last_refusal.lock().unwrap_or_else(PoisonError::into_inner).clone(),
        }
    }
}

/// What went to nodes on rmw_zenoh, and came from them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RmwStats {
    /// Messages given to Zenoh.
    pub sent: u64,
    /// Messages that Zenoh refused.
    pub dropped: u64,
    /// Inputs that were handed on.
    pub taken: u64,
    /// Samples of inputs whose numbers are missing: lost on the way here.
    pub lost: u64,
    /// Samples of inputs that could not be used.
    pub refused: u64,
    /// Publishers of inputs with another type or hash, which are not heard.
    pub mismatched: u64,
    /// Why the last sample was refused.
    pub last_refusal: Option<String>,
}

/// Counters of a mirror.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stats {
    /// State of the mirror.
    pub state: MirrorState,
    /// Why it failed.
    pub failure: Option<String>,
    /// Routers and peers that are connected now.
    pub connected: usize,
    /// Events that were lost because the ring to the mirror was full. They leave no gap in `seq`, as
    /// nobody knows which routes they belonged to.
    pub ring_dropped: u64,
    /// Events that the mirror took from the ring.
    pub events: u64,
    /// Queries that were answered.
    pub queries_answered: u64,
    /// Queries that were turned away because too many waited.
    pub queries_refused: u64,
    /// What became of commands; none where none are taken.
    pub commands: Option<CommandStats>,
    /// What nodes on rmw_zenoh get and send; none where they see nothing.
    pub rmw: Option<RmwStats>,
    /// The routes: those of `state/`, then those of `web/`, in the order of [`super::Topic::ALL`].
    pub routes: Vec<RouteStats>,
}

/// Counts one route.
#[derive(Debug, Default)]
pub(super) struct RouteCount {
    sent: u64,
    dropped: u64,
    last: Option<Instant>,
    window: Option<(Instant, u32)>,
    rate_hz: f64,
}

impl RouteCount {
    /// Notes a sample, and whether Zenoh took it.
    pub(super) fn note(&mut self, sent: bool, now: Instant) {
        if sent {
            self.sent += 1;
        } else {
            self.dropped += 1;
        }
        self.last = Some(now);
        match &mut self.window {
            Some((since, count)) if now - *since < WINDOW => *count += 1,
            Some((since, count)) => {
                self.rate_hz = f64::from(*count) / (now - *since).as_secs_f64();
                self.window = Some((now, 1));
            }
            None => self.window = Some((now, 1)),
        }
    }

    pub(super) fn stats(&self, key: String, now: Instant) -> RouteStats {
        let age = self.last.map(|last| now.saturating_duration_since(last));
        // A window that is still open says more than a closed one that is long past.
        let rate_hz = match self.window {
            Some((since, count)) if now.saturating_duration_since(since) >= WINDOW || self.rate_hz == 0.0 => {
                f64::from(count) / now.saturating_duration_since(since).max(WINDOW).as_secs_f64()
            }
            _ => self.rate_hz,
        };
        RouteStats {
            key,
            sent: self.sent,
            dropped: self.dropped,
            age_s: age.map(|age| age.as_secs_f64()),
            rate_hz,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rate_and_age_follow_the_flow() {
        let start = Instant::now();
        let mut count = RouteCount::default();
        assert_eq!(count.stats(String::new(), start).age_s, None);
        for k in 0..3000 {
            count.note(k % 10 != 0, start + Duration::from_millis(k));
        }
        let stats = count.stats("k".into(), start + Duration::from_millis(3000));
        assert_eq!((stats.sent, stats.dropped), (2700, 300));
        assert!((stats.rate_hz - 1000.0).abs() < 1.0, "{stats:?}");
        assert!(stats.age_s.is_some_and(|age_s| (age_s - 0.001).abs() < 1e-6), "{stats:?}");
        let silent = count.stats("k".into(), start + Duration::from_millis(60_000));
        assert!(silent.rate_hz < 20.0, "{silent:?}");
        assert!(silent.age_s.is_some_and(|age_s| age_s > 57.0), "{silent:?}");
    }
}
