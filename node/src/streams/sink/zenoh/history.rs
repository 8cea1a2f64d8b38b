//! The last seconds of estimates and residuals, in bounded memory.

use super::payload::{Item, Payload};
use super::time_range::TimeRange;
use crate::estimation::wire::ModelNames;
use mr_damper_model::pipeline::Event;
use serde::Serialize;
use std::collections::VecDeque;

/// Maximum number of entries per topic at any rate: 10 s at 6 kHz, less than 10 MB.
pub(super) const CAPACITY: usize = 65_536;

/// An event of the history.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    /// Time at which the mirror took the event, from [`super::shared::Clock`], in nanoseconds since 1970.
    taken_ns: i64,
    /// `seq` of the event under `state/`.
    seq: u64,
    item: Item,
}

impl Entry {
    pub(super) fn payload<'a>(&self, names: &'a ModelNames) -> Payload<'a> {
        self.item.payload(self.seq, names)
    }
}

/// The entries that a query selects.
#[derive(Debug, Clone, Copy)]
pub(super) struct Selection {
    pub(super) range: TimeRange,
    /// Maximum number of entries per topic; the newest are returned.
    pub(super) max: usize,
}

/// Estimates and residuals, oldest first.
#[derive(Debug, Default)]
pub(super) struct History {
    length_ns: i64,
    estimates: VecDeque<Entry>,
    residuals: VecDeque<Entry>,
}

/// The entries in the answer to a query, oldest first.
#[derive(Debug, Default)]
pub(super) struct Excerpt {
    pub(super) estimates: Vec<Entry>,
    pub(super) residuals: Vec<Entry>,
    /// Extent of the whole history.
    pub(super) held: Extent,
}

/// Extent of the history: numbers of entries, and the time of the oldest.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub(super) struct Extent {
    pub(super) estimates: usize,
    pub(super) residuals: usize,
    pub(super) oldest_taken_ns: Option<i64>,
}

impl History {
    /// A history of `length_s` seconds; with zero it keeps nothing.
    pub(super) fn new(length_s: f64) -> Self {
        // The cast saturates.
        Self { length_ns: (length_s * 1e9) as i64, ..Self::default() }
    }

    /// Adds an estimate or residual; `taken_ns` never goes back.
    pub(super) fn push(&mut self, item: Item, seq: u64, taken_ns: i64) {
        let list = match item.event {
            Event::Estimate(_) => &mut self.estimates,
            Event::Residual(_) => &mut self.residuals,
            Event::Input(_)
            | Event::Refusal(_)
            | Event::Transition(_)
            | Event::Alarm(_)
            | Event::Command(_) => return,
        };
        if self.length_ns == 0 {
            return;
        }
        list.push_back(Entry { taken_ns, seq, item });
        if list.len() > CAPACITY {
            list.pop_front();
        }
        // Both lists, so that entries of a topic without new samples expire too.
        let oldest_ns = taken_ns.saturating_sub(self.length_ns);
        for list in [&mut self.estimates, &mut self.residuals] {
            while list.front().is_some_and(|entry| entry.taken_ns < oldest_ns) {
                list.pop_front();
            }
        }
    }

    /// Copies the selected entries, so that they can be encoded without locking the history.
    pub(super) fn excerpt(&self, selection: &Selection, now_ns: i64) -> Excerpt {
        let oldest_ns = now_ns.saturating_sub(self.length_ns);
        let pick = |list: &VecDeque<Entry>| {
            let fits =
                |entry: &&Entry| entry.taken_ns >= oldest_ns && selection.range.contains(entry.taken_ns);
            let mut picked: Vec<Entry> =
                list.iter().rev().filter(fits).take(selection.max).copied().collect();
            picked.reverse();
            picked
        };
        let fronts = [self.estimates.front(), self.residuals.front()];
        Excerpt {
            estimates: pick(&self.estimates),
            residuals: pick(&self.residuals),
            held: Extent {
                estimates: self.estimates.len(),
                residuals: self.residuals.len(),
                oldest_taken_ns: fronts.into_iter().flatten().map(|entry| entry.taken_ns).min(),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::samples;
    use super::*;

    const SECOND: i64 = 1_000_000_000;
    const EVERYTHING: Selection = Selection { range: TimeRange::ALL, max: usize::MAX };

    fn filled(length_s: f64, count: i64, step_ns: i64) -> History {
        let mut history = History::new(length_s);
        for k in 0..count {
            history.push(Item::new(samples::estimate(k, 1.0), |_| None), k as u64 + 1, k * step_ns);
        }
        history
    }

    #[test]
    fn keeps_exactly_its_length() {
        let history = filled(2.0, 1000, SECOND / 100);
        let held = history.excerpt(&EVERYTHING, 999 * SECOND / 100).held;
        assert_eq!((held.estimates, held.residuals), (201, 0));
        assert_eq!(held.oldest_taken_ns, Some(799 * SECOND / 100));
        assert_eq!(filled(0.0, 10, 1).excerpt(&EVERYTHING, 9).held.estimates, 0);
    }

    #[test]
    fn is_bounded_at_any_rate() {
        let history = filled(10.0, CAPACITY as i64 + 50, 1);
        assert_eq!(history.excerpt(&EVERYTHING, CAPACITY as i64).held.estimates, CAPACITY);
    }

    #[test]
    fn answers_ranges_with_the_newest_last() {
        let history = filled(10.0, 100, SECOND / 10);
        let now = 99 * SECOND / 10;
        let range = TimeRange::parse("[now(-1s)..]", now).expect("this is a range");
        let excerpt = history.excerpt(&Selection { range, max: usize::MAX }, now);
        let seqs: Vec<u64> = excerpt.estimates.iter().map(|entry| entry.seq).collect();
        assert_eq!(seqs, (90..=100).collect::<Vec<u64>>());
        let excerpt = history.excerpt(&Selection { range, max: 3 }, now);
        assert_eq!(excerpt.estimates.iter().map(|entry| entry.seq).collect::<Vec<u64>>(), [98, 99, 100]);
        // Without new samples, entries older than the length are not returned although they are still in memory.
        assert!(history.excerpt(&EVERYTHING, now + 20 * SECOND).estimates.is_empty());
    }
}
