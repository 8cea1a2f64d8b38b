//! The last minutes of a line of a chart, in bounded memory: the smallest and largest values of every tenth of a second.
//!
//! Every message counts, also those that [`super::point_buffer`] leaves out, so a spike of one sample stays visible.

use serde::ser::{Serialize, SerializeSeq, Serializer};
use std::collections::VecDeque;

/// Buckets are kept for this time, s.
pub const HISTORY_S: f64 = 600.0;
/// Buckets per second: a chart of two minutes has one bucket for each column.
const PER_S: f64 = 10.0;
/// Length of a bucket, s.
pub const BUCKET_S: f64 = 1.0 / PER_S;
/// Maximum number of buckets.
const MOST: usize = (HISTORY_S * PER_S) as usize;

/// Extremes of `N` values over a bucket. In JSON it is a list: the start of the bucket, then the smallest and the largest of each value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bucket<const N: usize> {
    /// Number of the bucket: it begins at this number times [`BUCKET_S`], s since the first sample.
    pub number: i64,
    /// Smallest values; NaN when all are unknown.
    pub low: [f32; N],
    /// Largest values; NaN when all are unknown.
    pub high: [f32; N],
}

impl<const N: usize> Bucket<N> {
    /// Start of the bucket, s since the first sample.
    #[must_use]
    pub fn start_s(&self) -> f64 {
        // A quotient, because it is exact to the last digit, so that JSON has one decimal.
        self.number as f64 / PER_S
    }
}

impl<const N: usize> Serialize for Bucket<N> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut list = serializer.serialize_seq(Some(1 + 2 * N))?;
        list.serialize_element(&self.start_s())?;
        for (low, high) in self.low.iter().zip(&self.high) {
            list.serialize_element(low)?;
            list.serialize_element(high)?;
        }
        list.end()
    }
}

/// The last buckets of a line, in order of time. Buckets without a message do not exist.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct History<const N: usize> {
    buckets: VecDeque<Bucket<N>>,
}

impl<const N: usize> History<N> {
    /// Adds `values` at `at_s`. Values before the newest bucket are dropped.
    pub fn push(&mut self, at_s: f64, values: [f64; N]) {
        // The cast saturates, and converts NaN to zero.
        let number = (at_s * PER_S).floor() as i64;
        let values = values.map(|value| value as f32);
        match self.buckets.back_mut() {
            Some(last) if last.number == number => {
                // `min` and `max` of a number and NaN are the number.
                for (place, value) in values.into_iter().enumerate() {
                    last.low[place] = last.low[place].min(value);
                    last.high[place] = last.high[place].max(value);
                }
            }
            Some(last) if last.number > number => {}
            _ => {
                self.buckets.push_back(Bucket { number, low: values, high: values });
                while self.buckets.len() > MOST
                    || self.buckets.front().is_some_and(|first| number - first.number >= MOST as i64)
                {
                    self.buckets.pop_front();
                }
            }
        }
    }

    /// Removes all buckets.
    pub fn clear(&mut self) {
        self.buckets.clear();
    }

    /// The buckets that end after `from_s`. The newest may still change.
    #[must_use]
    pub fn since(&self, from_s: f64) -> Vec<Bucket<N>> {
        let first = self.buckets.partition_point(|bucket| (bucket.number + 1) as f64 / PER_S <= from_s);
        self.buckets.range(first..).copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bucket_has_the_extremes_of_all_its_values() {
        let mut history = History::<2>::default();
        for (at_s, values) in [
            (0.0, [1.0, f64::NAN]),
            (0.05, [9.0, 4.0]),
            (0.099, [-3.0, f64::NAN]),
            (0.1, [2.0, 2.0]),
            (0.02, [99.0, 99.0]),
            (0.7, [f64::NAN, 1.0]),
        ] {
            history.push(at_s, values);
        }
        let json = serde_json::to_value(history.since(f64::NEG_INFINITY)).expect("JSON");
        let expected = serde_json::json!([
            [0.0, -3.0, 9.0, 4.0, 4.0],
            [0.1, 2.0, 2.0, 2.0, 2.0],
            [0.7, null, null, 1.0, 1.0],
        ]);
        assert_eq!(json, expected, "a value before the newest bucket is dropped, and gaps have no buckets");
        assert_eq!(history.since(0.15).len(), 2, "the bucket around the given time is included");
        assert_eq!(history.since(0.85), []);
        history.clear();
        assert_eq!(history.since(0.0), []);
    }

    #[test]
    fn memory_is_bounded_at_any_stamps() {
        let mut history = History::<1>::default();
        for k in 0..2_000_000_i64 {
            history.push(k as f64 * 1e-3, [(k % 1000) as f64]);
        }
        let kept = history.since(0.0);
        assert_eq!(kept.len(), MOST);
        assert_eq!(kept[0].start_s(), 2000.0 - HISTORY_S);
        assert!(kept.windows(2).all(|pair| pair[1].number == pair[0].number + 1));
        assert!(kept.iter().all(|bucket| bucket.high[0] - bucket.low[0] == 99.0));
        history.push(1e9, [0.0]);
        assert_eq!(history.since(0.0).len(), 1, "what is older than the kept time is removed");
        history.push(f64::NAN, [0.0]);
        assert_eq!(history.since(0.0).len(), 1);
    }
}
