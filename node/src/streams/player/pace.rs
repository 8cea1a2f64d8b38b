//! Times at which samples are due: maps the time of the run to real time, through pauses, jumps and changes of speed.

use super::Rate;
use std::time::{Duration, Instant};

/// Messages per second that DDS transmits without loss to best-effort readers on one machine: a third of the rate that was
/// measured on a machine with two cores.
const MAX_MESSAGES_PER_S: f64 = 4000.0;

/// Keeps the spacing of samples. The current time is an argument of its methods.
#[derive(Debug)]
pub(super) struct Pace {
    rate: Rate,
    /// Time at which the run was at `position_s`; `None` while paused.
    running_since: Option<Instant>,
    position_s: f64,
    /// Samples sent since then; used for [`Rate::Max`].
    sent: u64,
    last_sent: Option<Instant>,
}

impl Pace {
    /// Begins at `position_s` of the run, paused.
    pub(super) fn new(rate: Rate, position_s: f64) -> Self {
        Self { rate, running_since: None, position_s, sent: 0, last_sent: None }
    }

    /// Runs at this speed from `now` on.
    pub(super) fn run(&mut self, rate: Rate, now: Instant, next_s: f64) {
        if self.running_since.is_none() || rate != self.rate {
            self.stand(now, next_s);
            self.running_since = Some(now);
            self.rate = rate;
            self.sent = 0;
        }
    }

    /// Pauses at `now`, before the sample at `next_s`.
    pub(super) fn stand(&mut self, now: Instant, next_s: f64) {
        self.position_s = self.position(now, next_s);
        self.running_since = None;
    }

    /// Continues at `position_s` of the run.
    pub(super) fn jump(&mut self, position_s: f64) {
        *self = Self::new(self.rate, position_s);
    }

    /// The position in the run, s, before the sample at `next_s`.
    pub(super) fn position(&self, now: Instant, next_s: f64) -> f64 {
        let gone_s = match (self.running_since, self.rate) {
            (Some(since), Rate::Times(rate)) => now.saturating_duration_since(since).as_secs_f64() * rate,
            _ => 0.0,
        };
        // Not beyond the next sample, even if that is late.
        (self.position_s + gone_s).min(next_s.max(self.position_s))
    }

    /// Time until the sample at `next_s` is due. While paused, it is due as soon as DDS can transmit it.
    pub(super) fn left(&self, now: Instant, next_s: f64) -> Duration {
        let due = match (self.running_since, self.rate) {
            (Some(since), Rate::Times(rate)) => Some(since + seconds((next_s - self.position_s) / rate)),
            (Some(since), Rate::Max) => Some(since + seconds(self.sent as f64 / MAX_MESSAGES_PER_S)),
            (None, _) => self.last_sent.map(|last| last + seconds(1.0 / MAX_MESSAGES_PER_S)),
        };
        due.map_or(Duration::ZERO, |due| due.saturating_duration_since(now))
    }

    /// Notes that the sample at `at_s` was sent.
    pub(super) fn sent(&mut self, now: Instant, at_s: f64) {
        self.sent += 1;
        self.last_sent = Some(now);
        if self.running_since.is_none() || self.rate == Rate::Max {
            self.position_s = at_s;
        }
    }
}

/// A duration, limited to 0 to 3e9 s (about a century).
fn seconds(seconds: f64) -> Duration {
    Duration::from_secs_f64(seconds.clamp(0.0, 3e9))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_jumps_and_speeds_keep_the_spacing() {
        let start = Instant::now();
        let at = |millis: u64| start + Duration::from_millis(millis);
        let left = |pace: &Pace, millis: u64, next_s: f64| {
            (pace.left(at(millis), next_s).as_secs_f64() * 1e3).round()
        };
        let mut pace = Pace::new(Rate::Times(1.0), 5.0);
        pace.run(Rate::Times(1.0), at(0), 5.0);
        assert_eq!(left(&pace, 0, 5.0), 0.0);
        assert_eq!(left(&pace, 200, 6.0), 800.0);
        // Twice the speed from the middle on: half a second of the run is left.
        pace.run(Rate::Times(2.0), at(500), 6.0);
        assert_eq!(left(&pace, 500, 6.0), 250.0);
        // A pause delays the run by its length.
        pace.stand(at(600), 6.0);
        assert_eq!(pace.position(at(9000), 6.0), 5.7);
        pace.run(Rate::Times(2.0), at(10_000), 6.0);
        assert_eq!(left(&pace, 10_000, 6.0), 150.0);
        // A step while paused moves the position.
        pace.stand(at(10_010), 6.0);
        pace.sent(at(10_020), 6.0);
        pace.run(Rate::Times(1.0), at(11_000), 6.5);
        assert_eq!(left(&pace, 11_000, 6.5), 500.0);
        pace.jump(1.0);
        pace.run(Rate::Times(1.0), at(12_000), 1.25);
        assert_eq!(left(&pace, 12_000, 1.25), 250.0);
        // The position does not pass a late sample.
        assert_eq!(pace.position(at(20_000), 1.25), 1.25);
    }

    #[test]
    fn at_max_rate_samples_are_spaced_evenly() {
        let start = Instant::now();
        let mut pace = Pace::new(Rate::Max, 0.0);
        pace.run(Rate::Max, start, 0.0);
        for _ in 0..4000 {
            pace.sent(start, 7.0);
        }
        assert_eq!(pace.left(start, 1e6), Duration::from_secs(1));
    }
}
