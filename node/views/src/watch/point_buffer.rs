//! The points of one line of a chart, limited to the last seconds, thinned, in bounded memory.

use serde::ser::{Serialize, SerializeSeq, Serializer};
use std::collections::VecDeque;

/// Points are kept for this time, s.
pub const KEPT_S: f64 = 10.0;
/// Points per second, more than a chart has columns. Time is divided into cells of this rate, and the first point of each is kept:
/// lines whose samples have the same stamps so keep points at the same stamps.
const CELLS_PER_S: f64 = 256.0;
/// Maximum number of points at any stamps: a few more than fit into [`KEPT_S`].
const MOST: usize = 2600;

/// A point: seconds since the first sample, and `N` values at that time. In JSON it is a list of these numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChartPoint<const N: usize> {
    /// Seconds since the first sample.
    pub at_s: f64,
    /// The values; NaN when unknown.
    pub values: [f32; N],
}

impl<const N: usize> Serialize for ChartPoint<N> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut list = serializer.serialize_seq(Some(N + 1))?;
        // A resolution of 0.1 ms is finer than a chart shows, and keeps the text short.
        list.serialize_element(&((self.at_s * 1e4).round() / 1e4))?;
        self.values.iter().try_for_each(|value| list.serialize_element(value))?;
        list.end()
    }
}

/// The last points of a line, in order of time.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PointBuffer<const N: usize> {
    points: VecDeque<ChartPoint<N>>,
    /// Number of points added since the start.
    added: u64,
}

impl<const N: usize> PointBuffer<N> {
    /// Adds a point, unless there is one in its cell already, or a later one.
    pub fn push(&mut self, at_s: f64, values: [f64; N]) {
        let cell = |at_s: f64| (at_s * CELLS_PER_S).floor();
        if self.points.back().is_some_and(|last| cell(at_s) <= cell(last.at_s)) {
            return;
        }
        self.points.push_back(ChartPoint { at_s, values: values.map(|value| value as f32) });
        self.added += 1;
        while self.points.len() > MOST || self.points.front().is_some_and(|first| at_s - first.at_s > KEPT_S)
        {
            self.points.pop_front();
        }
    }

    /// Removes all points.
    pub fn clear(&mut self) {
        self.points.clear();
    }

    /// The points that were added since `cursor` and are still kept. The cursor is advanced.
    pub fn since(&self, cursor: &mut u64) -> Vec<ChartPoint<N>> {
        let fresh = usize::try_from(self.added.saturating_sub(*cursor)).unwrap_or(usize::MAX);
        *cursor = self.added;
        self.points.iter().skip(self.points.len().saturating_sub(fresh)).copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_thinned_ordered_and_bounded() {
        let mut buffer = PointBuffer::<1>::default();
        for k in 0..60_000 {
            buffer.push(f64::from(k) * 1e-3, [f64::from(k)]);
        }
        let mut cursor = 0;
        let kept = buffer.since(&mut cursor);
        assert!((2400..=MOST).contains(&kept.len()), "{} points of ten seconds", kept.len());
        assert!(kept.windows(2).all(|pair| pair[1].at_s > pair[0].at_s));
        // A line that begins later keeps the same stamps.
        let mut other = PointBuffer::<1>::default();
        (50_001..60_000).for_each(|k| other.push(f64::from(k) * 1e-3, [0.0]));
        let times = |points: &[ChartPoint<1>]| {
            points.iter().rev().take(2000).map(|point| point.at_s).collect::<Vec<_>>()
        };
        assert_eq!(times(&other.since(&mut 0)), times(&kept));
        assert!(kept[0].at_s >= 59.9 - KEPT_S);
        buffer.push(1.0, [f64::NAN]);
        assert_eq!(buffer.since(&mut cursor), [], "a point in the past");
        buffer.push(60.5, [1.0]);
        buffer.push(60.6, [2.0]);
        assert_eq!(buffer.since(&mut cursor).len(), 2);
        buffer.clear();
        buffer.push(0.5, [3.0]);
        assert_eq!(buffer.since(&mut cursor), [ChartPoint { at_s: 0.5, values: [3.0] }]);
    }

    #[test]
    fn a_point_is_a_short_list_and_unknown_values_are_null() {
        let point = ChartPoint { at_s: 1.234_567_89, values: [-0.1, f32::NAN] };
        assert_eq!(serde_json::to_string(&point).expect("JSON"), "[1.2346,-0.1,null]");
    }
}
