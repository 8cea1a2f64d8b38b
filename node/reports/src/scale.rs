//! Mapping of values to places on a plot: ranges, round ticks, thinning.

/// A linear map from a range of values to a range of places.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scale {
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) place_from: f64,
    pub(super) place_to: f64,
}

impl Scale {
    /// The place of `value`.
    pub(super) fn place(&self, value: f64) -> f64 {
        let share = (value - self.from) / (self.to - self.from);
        self.place_from + share * (self.place_to - self.place_from)
    }

    pub(super) fn holds(&self, value: f64) -> bool {
        value >= self.from && value <= self.to
    }
}

/// The range of the finite values, widened by 4 % at both ends; 0 to 1 when there are none.
pub(super) fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values
        .filter(|value| value.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
    if low > high {
        return (0.0, 1.0);
    }
    let pad = if high > low { 0.04 * (high - low) } else { 0.5 * high.abs().max(1.0) };
    (low - pad, high + pad)
}

/// About `target` round values between `from` and `to`, and the number of decimals that they need.
pub(super) fn ticks(from: f64, to: f64, target: usize) -> (Vec<f64>, usize) {
    let rough = (to - from) / target.max(1) as f64;
    if rough <= 0.0 || !rough.is_finite() {
        return (Vec::new(), 0);
    }
    let decade = 10.0_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .iter()
        .map(|m| m * decade)
        .find(|step| *step >= 0.999 * rough)
        .unwrap_or(10.0 * decade);
    let (first, last) = ((from / step - 1e-9).ceil() as i64, (to / step + 1e-9).floor() as i64);
    let decimals = (-step.log10().floor()).max(0.0) as usize;
    ((first..=last).map(|k| k as f64 * step).collect(), decimals)
}

/// Thins a curve to at most two points per column: the extremes of the column, in their order, so that no peak is lost.
/// A point that is not finite is kept, because it breaks the line.
pub(super) fn thin_line(points: &[(f64, f64)], columns: usize) -> Vec<(f64, f64)> {
    if points.len() <= 2 * columns {
        return points.to_vec();
    }
    let (from, to) = (points[0].0, points[points.len() - 1].0);
    let column = |x: f64| ((x - from) / (to - from) * columns as f64) as usize;
    let mut thinned = Vec::with_capacity(2 * columns + 2);
    for group in points.chunk_by(|a, b| column(a.0) == column(b.0) && a.1.is_finite() == b.1.is_finite()) {
        if !group[0].1.is_finite() {
            thinned.push(group[0]);
            continue;
        }
        let by_value = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let (Some(low), Some(high)) = (group.iter().min_by(by_value), group.iter().max_by(by_value)) else {
            continue;
        };
        let (first, second) = if low.0 <= high.0 { (low, high) } else { (high, low) };
        thinned.push(*first);
        if second.0 > first.0 {
            thinned.push(*second);
        }
    }
    thinned
}

/// At most `most` of the points, evenly spaced.
pub(super) fn thin_dots(points: &[(f64, f64)], most: usize) -> Vec<(f64, f64)> {
    points.iter().step_by(points.len().div_ceil(most.max(1)).max(1)).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks(0.0, 30.0, 6), (vec![0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0], 0));
        assert_eq!(ticks(-1320.0, 1320.0, 5), (vec![-1000.0, 0.0, 1000.0], 0));
        let (found, decimals) = ticks(11.5, 13.5, 6);
        assert_eq!((found.len(), decimals), (5, 1));
        assert_eq!(ticks(1.0, 1.0, 5).0, Vec::<f64>::new());
        assert_eq!(ticks(0.0, f64::NAN, 5).0, Vec::<f64>::new());
    }

    #[test]
    fn thinning_keeps_peaks_and_breaks() {
        let mut points: Vec<(f64, f64)> =
            (0..10_000).map(|k| (f64::from(k), (f64::from(k) * 0.01).sin())).collect();
        points[5003].1 = 7.0;
        points[7000].1 = f64::NAN;
        let thinned = thin_line(&points, 100);
        assert!(thinned.len() < 220, "{}", thinned.len());
        assert!(thinned.iter().any(|p| p.1 == 7.0) && thinned.iter().any(|p| p.1.is_nan()));
        assert!(thinned.is_sorted_by(|a, b| a.0 <= b.0));
        assert_eq!(thin_dots(&points, 100).len(), 100);
        assert!(thin_dots(&[], 100).is_empty());
    }

    #[test]
    fn a_range_covers_its_values_and_is_never_empty() {
        assert_eq!(range(std::iter::empty()), (0.0, 1.0));
        let (low, high) = range([3.0, f64::NAN, 3.0].into_iter());
        assert!(low < 3.0 && high > 3.0);
    }
}
