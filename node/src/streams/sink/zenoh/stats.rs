//! Counters of the mirror: whether samples still flow, and how many were lost.

use serde::Serialize;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Length of the window over which rates are measured.
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
    /// Failed; [`Stats::failure`] says why. The ring is still drained if the thread is alive.
    Failed,
}

/// Counters of one route (one key).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RouteStats {
    /// The key.
    pub key: String,
    /// Samples passed to Zenoh. Zenoh drops samples silently when a consumer does not keep up; only a gap in `seq` at the
    /// consumer shows this.
    pub sent: u64,
    /// Samples that Zenoh refused, or that came while there was no session.
    pub dropped: u64,
    /// Time since the mirror took the last sample, s; `None` before the first.
    pub age_s: Option<f64>,
    /// Rate over about the last second, samples per second.
    pub rate_hz: f64,
}

/// Counters of the commands received over Zenoh.
#[derive(Debug, Default)]
pub struct CommandCounters {
    obeyed: AtomicU64,
    refused: AtomicU64,
    last_refusal: Mutex<Option<String>>,
}

impl CommandCounters {
    /// Counts an accepted command.
    pub fn execute(&self) {
        self.obeyed.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts a refused command and keeps the reason.
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

/// Values of the counters of the commands under `cmd/`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct CommandStats {
    /// Accepted commands.
    pub obeyed: u64,
    /// Refused commands.
    pub refused: u64,
    /// Reason of the last refusal.
    pub last_refusal: Option<String>,
}

/// Counters of the messages to and from nodes on rmw_zenoh.
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

    /// Counts an input that was accepted.
    pub fn take(&self) {
        self.taken.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts inputs that were lost in transit.
    pub fn lose(&self, count: u64) {
        self.lost.fetch_add(count, Ordering::Relaxed);
    }

    /// Counts an input that was refused, and keeps the reason.
    pub fn refuse(&self, why: &str) {
        self.refused.fetch_add(1, Ordering::Relaxed);
        *self.last_refusal.lock().unwrap_or_else(PoisonError::into_inner) = Some(why.to_owned());
    }

    /// Counts a publisher whose type differs from the input's type, and returns the number of such publishers so far.
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

/// Values of the counters of the messages to and from nodes on rmw_zenoh.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RmwStats {
    /// Messages passed to Zenoh.
    pub sent: u64,
    /// Messages that Zenoh refused.
    pub dropped: u64,
    /// Input samples that were accepted.
    pub taken: u64,
    /// Input samples that were lost in transit, as gaps in their sequence numbers show.
    pub lost: u64,
    /// Input samples that were refused.
    pub refused: u64,
    /// Publishers of inputs with another type or type hash, whose samples are ignored.
    pub mismatched: u64,
    /// Reason of the last refusal.
    pub last_refusal: Option<String>,
}

/// Counters of a mirror.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Stats {
    /// State of the mirror.
    pub state: MirrorState,
    /// Reason of the failure, in the state [`MirrorState::Failed`].
    pub failure: Option<String>,
    /// Number of connected routers and peers.
    pub connected: usize,
    /// Events that were lost because the ring to the mirror was full. They leave no gap in `seq`, because their routes are
    /// not known.
    pub ring_dropped: u64,
    /// Events that the mirror took from the ring.
    pub events: u64,
    /// Queries that were answered.
    pub queries_answered: u64,
    /// Queries that were refused because too many were waiting.
    pub queries_refused: u64,
    /// Counters of commands; `None` when no commands are accepted.
    pub commands: Option<CommandStats>,
    /// Counters of the traffic with nodes on rmw_zenoh; `None` when `zenoh.rmw` is off.
    pub rmw: Option<RmwStats>,
    /// Counters of the routes: first `state/`, then `web/`, each in the order of [`super::Topic::ALL`].
    pub routes: Vec<RouteStats>,
}

/// Counts the samples of one route.
#[derive(Debug, Default)]
pub(super) struct RouteCount {
    sent: u64,
    dropped: u64,
    last: Option<Instant>,
    window: Option<(Instant, u32)>,
    rate_hz: f64,
}

impl RouteCount {
    /// Counts a sample that was `sent`, or that Zenoh refused.
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
        // If the last complete window ended long ago, the open window gives the better rate.
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
