//! Decimation for `web/`: publishes a topic's newest sample at a bounded rate, and always the last one of a burst.

use std::time::{Duration, Instant};

/// Passes one value per period. A value that comes too early waits until a newer one replaces it or the period ends, so
/// the last value of a burst (for example a change of mode) is at most one period late.
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

    /// Offers a value; returns the value to publish now, if any.
    pub(super) fn offer(&mut self, value: T, now: Instant) -> Option<T> {
        self.waiting = Some(value);
        self.poll(now)
    }

    /// The waiting value, if its time has come.
    pub(super) fn poll(&mut self, now: Instant) -> Option<T> {
        if self.waiting.is_none() || self.due.is_some_and(|due| now < due) {
            return None;
        }
        // While samples flow, publishing times stay on a fixed grid, so that the mean rate is exact. After a pause the
        // grid restarts; missed times are not made up for.
        let next = self.due.map(|due| due + self.period).filter(|next| *next > now);
        self.due = Some(next.unwrap_or(now + self.period));
        self.waiting.take()
    }

    /// The waiting value, even if its time has not come.
    pub(super) fn flush(&mut self) -> Option<T> {
        self.waiting.take()
    }

    /// Time of the next poll; `None` when no value waits.
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
        // 960 was the last published value; 999 waits until 1000 ms.
        assert_eq!(throttle.deadline(), Some(start + MS * 1000));
        assert_eq!(throttle.poll(start + MS * 999), None);
        assert_eq!(throttle.poll(start + MS * 1000), Some(999));
        assert_eq!(throttle.deadline(), None);
    }

    #[test]
    fn does_not_catch_up_after_a_pause() {
        let start = Instant::now();
        let mut throttle = Throttle::new(50.0);
        assert_eq!(throttle.offer(1, start), Some(1));
        assert_eq!(throttle.offer(2, start + MS * 500), Some(2));
        assert_eq!(throttle.offer(3, start + MS * 501), None);
        assert_eq!(throttle.flush(), Some(3));
    }
}
