//! Decimation for `web/`: a topic's newest sample, at a bounded rate, and never without its last one.

use std::time::{Duration, Instant};

/// Lets one value through a period. A value that comes too early waits, and a newer one takes its place; so
/// the last one of a burst (a change of mode, say) arrives at most a period late.
#[derive(Debug)]
pub(super) struct Throttle<T> {
    period: Duration,
    due: Option<Instant>,
    waiting: Option<T>,
}

impl<T> Throttle<T> {
    pub(super) fn new(rate_hz: f64) -> Self {
        Self { period: Duration::from_secs_f64(1.0 / rate_hz), due: None, waiting: None }
    }

    /// Takes a value and returns the one to publish now, if any.
    pub(super) fn offer(&mut self, value: T, now: Instant) -> Option<T> {
        self.waiting = Some(value);
        self.poll(now)
    }

    /// The value whose time has come.
    pub(super) fn poll(&mut self, now: Instant) -> Option<T> {
        if self.waiting.is_none() || self.due.is_some_and(|due| now < due) {
            return None;
        }
        // The grid is kept while samples flow, so that the mean rate is the one asked for; after a pause
        // it starts anew, so that nothing is caught up in a burst.
        let next = self.due.map(|due| due + self.period).filter(|next| *next > now);
        self.due = Some(next.unwrap_or(now + self.period));
        self.waiting.take()
    }

    /// The value that waits, whether its time has come or not.
    pub(super) fn flush(&mut self) -> Option<T> {
        self.waiting.take()
    }

    /// When to poll; `None` when nothing waits.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.waiting.as_ref().and(self.due)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn keeps_the_rate_and_the_last_value() {
        let start = Instant::now();
        let mut throttle = Throttle::new(25.0);
        let sent: Vec<u32> = (0..1000).filter_map(|k| throttle.offer(k, start + MS * k)).collect();
        assert_eq!(sent.len(), 25, "{sent:?}");
        assert_eq!(sent[..3], [0, 40, 80]);
        // 960 was the last one through; 999 waits until 1000 ms.
        assert_eq!(throttle.deadline(), Some(start + MS * 1000));
        assert_eq!(throttle.poll(start + MS * 999), None);
        assert_eq!(throttle.poll(start + MS * 1000), Some(999));
        assert_eq!(throttle.deadline(), None);
    }

    #[test]
    fn catches_nothing_up_after_a_pause() {
        let start = Instant::now();
        let mut throttle = Throttle::new(50.0);
        assert_eq!(throttle.offer(1, start), Some(1));
        assert_eq!(throttle.offer(2, start + MS * 500), Some(2));
        assert_eq!(throttle.offer(3, start + MS * 501), None);
        assert_eq!(throttle.flush(), Some(3));
    }
}
