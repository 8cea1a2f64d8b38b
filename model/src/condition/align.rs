//! Aligns channels of different rates and clocks to the displacement stamps.
//!
//! The drive (and measured velocity and temperature) is held: its value at stamp t is the newest reading not
//! newer than t. Measured force is interpolated: its value at t is known once a force reading at or after t
//! has arrived, so a prediction waits in a bounded queue until then. Neither depends on the order in which
//! channels arrive, as long as a reading arrives before it is needed.

use crate::sample::Stamp;

/// Number of predictions that can wait for their measured force: a quarter of a second at 1 kHz.
const PENDING: usize = 256;

/// Number of readings that a [`Hold`] keeps. Older ones are needed when newer readings arrive before the
/// displacement that they follow.
const HELD: usize = 64;

/// A reading and its stamp.
type Stamped = (Stamp, f64);

/// The last readings of a channel whose value is held between stamps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Hold {
    len: usize,
    next: usize,
    stamps: [Stamp; HELD],
    values: [f64; HELD],
}

impl Default for Hold {
    fn default() -> Self {
        Self { len: 0, next: 0, stamps: [Stamp::from_nanos(0); HELD], values: [0.0; HELD] }
    }
}

impl Hold {
    /// Adds a reading. Stamps must increase; the caller refuses other readings.
    #[inline]
    pub(crate) fn push(&mut self, stamp: Stamp, value: f64) {
        self.stamps[self.next] = stamp;
        self.values[self.next] = value;
        self.next = (self.next + 1) % HELD;
        self.len = (self.len + 1).min(HELD);
    }

    /// The newest reading not newer than `at`, and its stamp.
    #[inline]
    #[must_use]
    pub(crate) fn at(&self, at: Stamp) -> Option<(Stamp, f64)> {
        self.around(at).map(|(before, _)| before)
    }

    /// The newest reading not newer than `at`, and the next one after it.
    #[inline]
    fn around(&self, at: Stamp) -> Option<(Stamped, Option<Stamped>)> {
        let mut after = None;
        for age in 0..self.len {
            let slot = (self.next + HELD - 1 - age) % HELD;
            let reading = (self.stamps[slot], self.values[slot]);
            if reading.0 <= at {
                return Some((reading, after));
            }
            after = Some(reading);
        }
        None
    }

    /// Removes all readings.
    pub(crate) fn clear(&mut self) {
        self.len = 0;
    }
}

/// Measured force, and the predictions that wait for it. `T` is the data that is returned with the force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ForceAligner<T> {
    readings: Hold,
    last: Option<Stamp>,
    first: usize,
    len: usize,
    stamps: [Stamp; PENDING],
    waiting: [Option<T>; PENDING],
}

impl<T: Copy> Default for ForceAligner<T> {
    fn default() -> Self {
        Self {
            readings: Hold::default(),
            last: None,
            first: 0,
            len: 0,
            stamps: [Stamp::from_nanos(0); PENDING],
            waiting: [None; PENDING],
        }
    }
}

impl<T: Copy> ForceAligner<T> {
    /// Adds a force reading. Stamps must increase; the caller refuses other readings.
    #[inline]
    pub(crate) fn push_force(&mut self, stamp: Stamp, force_n: f64) {
        self.readings.push(stamp, force_n);
        self.last = Some(stamp);
    }

    /// The newest force not newer than `at`, and its stamp.
    #[inline]
    #[must_use]
    pub(crate) fn newest(&self, at: Stamp) -> Option<(Stamp, f64)> {
        self.readings.at(at)
    }

    /// Queues `what` until the force at `stamp` is known. If the queue is full, the oldest entry is dropped.
    #[inline]
    pub(crate) fn wait(&mut self, stamp: Stamp, what: T) {
        if self.len == PENDING {
            self.first = (self.first + 1) % PENDING;
            self.len -= 1;
        }
        let slot = (self.first + self.len) % PENDING;
        self.stamps[slot] = stamp;
        self.waiting[slot] = Some(what);
        self.len += 1;
    }

    /// The next entry whose force is known, and that force, in the order of the queue. Entries between
    /// readings that are more than `max_span_s` apart are dropped.
    #[inline]
    pub(crate) fn next_known(&mut self, max_span_s: f64) -> Option<(Stamp, f64, T)> {
        let last = self.last?;
        while self.len > 0 {
            let slot = self.first;
            let stamp = self.stamps[slot];
            if stamp > last {
                return None;
            }
            self.first = (self.first + 1) % PENDING;
            self.len -= 1;
            if let (Some(force), Some(what)) = (self.measured(stamp, max_span_s), self.waiting[slot]) {
                return Some((stamp, force, what));
            }
        }
        None
    }

    /// Force at `stamp`, interpolated linearly between its neighbouring readings; `None` if they are more
    /// than `max_span_s` apart.
    #[must_use]
    pub(crate) fn measured(&self, stamp: Stamp, max_span_s: f64) -> Option<f64> {
        let ((t0, f0), after) = self.readings.around(stamp)?;
        if t0 == stamp {
            return Some(f0);
        }
        let (t1, f1) = after?;
        let span = t1.since(t0).get();
        (span <= max_span_s).then(|| f0 + (f1 - f0) * (stamp.since(t0).get() / span))
    }

    /// As [`measured`](Self::measured), but on the parabola through the two readings and the one before them.
    /// The third reading must be at least half as far from the second as the first two are from each other.
    #[must_use]
    pub(crate) fn measured_on_curve(&self, stamp: Stamp, max_span_s: f64) -> Option<f64> {
        let line_n = self.measured(stamp, max_span_s)?;
        let ((t0, f0), after) = self.readings.around(stamp)?;
        let Some((t1, f1)) = after.filter(|_| t0 != stamp) else { return Some(line_n) };
        let span = t1.since(t0).get();
        let Some((older, f2)) = self.readings.at(t0.shifted((-0.5e9 * span) as i64)) else {
            return Some(line_n);
        };
        let back = t0.since(older).get();
        if back > max_span_s {
            return Some(line_n);
        }
        let curvature = ((f1 - f0) / span - (f0 - f2) / back) / (span + back);
        Some(line_n + curvature * stamp.since(t0).get() * stamp.since(t1).get())
    }

    /// Removes all readings and all entries of the queue.
    pub(crate) fn clear(&mut self) {
        self.readings.clear();
        self.last = None;
        self.len = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: i64) -> Stamp {
        Stamp::from_nanos(ms * 1_000_000)
    }

    #[test]
    fn hold_skips_readings_newer_than_the_requested_stamp() {
        let mut hold = Hold::default();
        assert_eq!(hold.at(at(5)), None);
        for (ms, value) in [(0, 1.0), (10, 2.0), (20, 3.0)] {
            hold.push(at(ms), value);
        }
        assert_eq!(hold.at(at(15)), Some((at(10), 2.0)));
        assert_eq!(hold.at(at(20)), Some((at(20), 3.0)));
        assert_eq!(hold.at(at(-1)), None);
    }

    #[test]
    fn a_prediction_waits_for_its_interpolated_force() {
        let mut aligner = ForceAligner::default();
        aligner.push_force(at(0), 10.0);
        for (ms, what) in [(0, 'a'), (1, 'b'), (3, 'c'), (4, 'd'), (5, 'e')] {
            aligner.wait(at(ms), what);
        }
        assert_eq!(aligner.next_known(0.1), Some((at(0), 10.0, 'a')));
        assert_eq!(aligner.next_known(0.1), None, "the force at 1 ms is not known yet");
        aligner.push_force(at(4), 50.0);
        assert_eq!(aligner.next_known(0.1), Some((at(1), 20.0, 'b')));
        assert_eq!(aligner.next_known(0.1), Some((at(3), 40.0, 'c')));
        assert_eq!(aligner.next_known(0.1), Some((at(4), 50.0, 'd')));
        assert_eq!(aligner.next_known(0.1), None);
        aligner.push_force(at(900), 0.0);
        assert_eq!(aligner.next_known(0.1), None, "no interpolation across a gap");
    }

    #[test]
    fn three_readings_give_a_parabola_and_two_give_a_line() {
        let mut aligner = ForceAligner::<()>::default();
        for ms in [0_i64, 4, 10] {
            aligner.push_force(at(ms), (ms * ms) as f64);
        }
        let close = |a: Option<f64>, b: f64| (a.expect("known") - b).abs() < 1e-9;
        assert!(close(aligner.measured_on_curve(at(7), 0.1), 49.0));
        assert!(close(aligner.measured_on_curve(at(10), 0.1), 100.0));
        assert!(close(aligner.measured_on_curve(at(2), 0.1), 8.0), "no older reading: linear");
        assert_eq!(aligner.measured_on_curve(at(7), 0.005), None, "the readings are too far apart");
        assert_eq!(aligner.measured_on_curve(at(11), 0.1), None);
    }

    #[test]
    fn force_readings_are_kept_until_a_late_displacement_needs_them() {
        let mut aligner = ForceAligner::default();
        for ms in 0..20 {
            aligner.push_force(at(ms), ms as f64);
        }
        aligner.wait(at(3), 'a');
        aligner.wait(at(7), 'b');
        assert_eq!(aligner.next_known(0.1), Some((at(3), 3.0, 'a')));
        assert_eq!(aligner.next_known(0.1), Some((at(7), 7.0, 'b')));
    }

    #[test]
    fn a_full_queue_drops_the_oldest_entry() {
        let mut aligner = ForceAligner::default();
        for k in 0..=PENDING {
            aligner.wait(at(k as i64), k);
        }
        aligner.push_force(at(0), 1.0);
        aligner.push_force(at(1), 1.0);
        assert_eq!(aligner.next_known(0.1), Some((at(1), 1.0, 1)));
    }
}
