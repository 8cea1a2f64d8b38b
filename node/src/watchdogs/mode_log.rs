//! Log lines about changes of mode, at most one per second.

use mr_damper_model::pipeline::Transition;
use std::time::{Duration, Instant};

/// Minimum time between two lines.
const EVERY: Duration = Duration::from_secs(1);

/// The content of one line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ModeLine {
    /// The latest change.
    pub(crate) transition: Transition,
    /// Changes since the last line, including this one.
    pub(crate) count: u64,
}

impl ModeLine {
    /// Writes the line to the log.
    pub(crate) fn log(&self) {
        tracing::info!(
            from = self.transition.from.name(),
            to = self.transition.to.name(),
            reason = self.transition.cause.text(),
            count = self.count,
            "mode"
        );
    }
}

/// Changes of mode that are not logged yet.
#[derive(Debug, Default)]
pub(crate) struct ModeLog {
    last_line: Option<Instant>,
    waiting: Option<ModeLine>,
}

impl ModeLog {
    /// Takes a change. Returns the line to log, if one is due: the first at once, then at most one per second.
    pub(crate) fn note(&mut self, transition: &Transition, now: Instant) -> Option<ModeLine> {
        let count = self.waiting.map_or(0, |waiting| waiting.count) + 1;
        self.waiting = Some(ModeLine { transition: *transition, count });
        self.flush(now)
    }

    /// Returns the line about the waiting changes, once it is due. Call it a few times per second.
    pub(crate) fn flush(&mut self, now: Instant) -> Option<ModeLine> {
        if self.last_line.is_some_and(|last| now.saturating_duration_since(last) < EVERY) {
            return None;
        }
        let line = self.waiting.take()?;
        self.last_line = Some(now);
        Some(line)
    }

    /// Returns the line about the waiting changes at the end, due or not.
    pub(crate) fn finish(&mut self) -> Option<ModeLine> {
        self.waiting.take()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_model::pipeline::{Cause, Mode};
    use mr_damper_model::sample::Stamp;

    fn change(number: i64) -> Transition {
        let modes = [Mode::Arx, Mode::Model];
        let at = |number: i64| modes[number.rem_euclid(2) as usize];
        Transition {
            stamp: Stamp::from_nanos(number),
            from: at(number),
            to: at(number + 1),
            cause: Cause::ArxUnready,
        }
    }

    #[test]
    fn frequent_changes_give_one_line_per_second_with_the_count_of_all() {
        let (mut log, start) = (ModeLog::default(), Instant::now());
        let mut lines = Vec::new();
        for number in 0..2500 {
            let now = start + Duration::from_millis(number);
            lines.extend(log.note(&change(number as i64), now).map(|line| (number, line.count)));
        }
        assert_eq!(lines, [(0, 1), (1000, 1000), (2000, 1000)]);
        let last = log.finish().expect("the rest");
        assert_eq!((last.count, last.transition), (499, change(2499)));
        assert_eq!(log.finish(), None);
    }

    #[test]
    fn a_change_without_a_successor_is_logged_when_due() {
        let (mut log, start) = (ModeLog::default(), Instant::now());
        let after = |ms| start + Duration::from_millis(ms);
        assert_eq!(log.flush(start), None);
        assert_eq!(log.note(&change(1), start).map(|line| line.count), Some(1));
        assert_eq!(log.note(&change(2), after(10)), None);
        assert_eq!(log.flush(after(900)), None);
        let line = log.flush(after(1000)).expect("it is due");
        assert_eq!((line.transition, line.count), (change(2), 1));
        assert_eq!(log.flush(after(3000)), None);
        assert!(log.note(&change(3), after(3001)).is_some(), "rare changes are logged at once");
    }
}
