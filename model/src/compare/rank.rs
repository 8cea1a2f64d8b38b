//! Statistics of errors over many tests: the five numbers of a box plot, and the rank correlation of two
//! orders.
//!
//! ```text
//! quantile q of n sorted values   x[h] + (h - floor h) (x[floor h + 1] - x[floor h]),   h = q (n - 1)
//! whisker                         the last value within 1.5 (Q3 - Q1) of the box
//! tau-b                           (P - Q) / sqrt((P + Q + Ta)(P + Q + Tb))
//! ```
//! P and Q are the numbers of pairs that the two rankings order the same and the opposite way; Ta and Tb are
//! the numbers of pairs that are tied in only one of them.
//!
//! Source: `[kendall]` in the bibliography (node/docs/guide/bibliography.md).

use std::cmp::Ordering;

/// The numbers of a box plot.
///
/// ```
/// use mr_damper_model::compare::BoxPlot;
///
/// let nmse = BoxPlot::of([0.01, 0.02, 0.03, 0.04, 0.9]).expect("there are values");
/// assert_eq!((nmse.median, nmse.upper_whisker, nmse.outliers), (0.03, 0.04, vec![0.9]));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct BoxPlot {
    /// The smallest value within 1.5 box lengths below the box.
    pub lower_whisker: f64,
    /// First quartile: a quarter of the values are smaller.
    pub lower_quartile: f64,
    /// Median: half of the values are smaller.
    pub median: f64,
    /// Third quartile: three quarters of the values are smaller.
    pub upper_quartile: f64,
    /// The largest value within 1.5 box lengths above the box.
    pub upper_whisker: f64,
    /// Values outside the whiskers, in increasing order.
    pub outliers: Vec<f64>,
}

impl BoxPlot {
    /// The box plot of the finite `values`; `None` if there are none.
    #[must_use]
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = values.into_iter().filter(|value| value.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let [lower_quartile, median, upper_quartile] = [0.25, 0.5, 0.75].map(|q| quantile(&sorted, q));
        let reach = 1.5 * (upper_quartile? - lower_quartile?);
        let (low, high) = (lower_quartile? - reach, upper_quartile? + reach);
        let inside = |value: &&f64| (low..=high).contains(*value);
        Some(Self {
            lower_whisker: *sorted.iter().find(inside)?,
            lower_quartile: lower_quartile?,
            median: median?,
            upper_quartile: upper_quartile?,
            upper_whisker: *sorted.iter().rfind(inside)?,
            outliers: sorted.iter().filter(|value| !inside(value)).copied().collect(),
        })
    }
}

/// Quantile `q` of sorted values, with linear interpolation; `None` without values.
fn quantile(sorted: &[f64], q: f64) -> Option<f64> {
    let place = q * sorted.len().checked_sub(1)? as f64;
    let (below, share) = (place.floor() as usize, place.fract());
    let (low, high) = (sorted[below], sorted[(below + 1).min(sorted.len() - 1)]);
    Some(low + share * (high - low))
}

/// Rank correlation (Kendall's tau-b) of paired values: 1 for the same order, -1 for the reverse order.
/// `None` if all values of one side are equal.
///
/// ```
/// use mr_damper_model::compare::kendall_tau;
///
/// // The ranks of three models in two sources: two of the three pairs have the same order.
/// assert_eq!(kendall_tau(&[(0.01, 0.02), (0.02, 0.05), (0.03, 0.04)]), Some(1.0 / 3.0));
/// assert_eq!(kendall_tau(&[(0.01, 0.02), (0.01, 0.05)]), None);
/// ```
#[must_use]
pub fn kendall_tau(pairs: &[(f64, f64)]) -> Option<f64> {
    let (mut alike, mut against, mut tied_first, mut tied_second) = (0.0, 0.0, 0.0, 0.0);
    for (index, a) in pairs.iter().enumerate() {
        for b in &pairs[index + 1..] {
            match (a.0.total_cmp(&b.0), a.1.total_cmp(&b.1)) {
                (Ordering::Equal, Ordering::Equal) => {}
                (Ordering::Equal, _) => tied_first += 1.0,
                (_, Ordering::Equal) => tied_second += 1.0,
                (first, second) if first == second => alike += 1.0,
                _ => against += 1.0,
            }
        }
    }
    let norm = (alike + against + tied_first) * (alike + against + tied_second);
    (norm > 0.0).then(|| (alike - against) / f64::sqrt(norm))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn box_plot_of_known_values() {
        // numpy.quantile([1..9, 40], [.25, .5, .75]) = 3.25, 5.5, 7.75; fences at -3.5 and 14.5.
        let found = BoxPlot::of([5.0, 40.0, 1.0, f64::NAN, 9.0, 2.0, 8.0, 3.0, 7.0, 4.0, 6.0]);
        let expected = BoxPlot {
            lower_whisker: 1.0,
            lower_quartile: 3.25,
            median: 5.5,
            upper_quartile: 7.75,
            upper_whisker: 9.0,
            outliers: vec![40.0],
        };
        assert_eq!(found, Some(expected));
        assert_eq!(BoxPlot::of([f64::NAN]), None);
        let one = BoxPlot::of([2.0]).expect("one value has a box plot");
        assert_eq!((one.lower_whisker, one.median, one.upper_whisker), (2.0, 2.0, 2.0));
    }

    #[test]
    fn kendall_tau_of_known_orders() {
        let tau = |second: [f64; 4]| {
            kendall_tau(&[0, 1, 2, 3].map(|k| (k as f64, second[k]))).expect("an order on both sides")
        };
        assert_eq!(tau([1.0, 2.0, 3.0, 4.0]), 1.0);
        assert_eq!(tau([4.0, 3.0, 2.0, 1.0]), -1.0);
        // One of six pairs is reversed.
        assert!((tau([1.0, 3.0, 2.0, 4.0]) - 4.0 / 6.0).abs() < 1e-15);
        // scipy.stats.kendalltau([0, 1, 2, 3], [1, 1, 2, 3]) = 5 / sqrt(30).
        assert!((tau([1.0, 1.0, 2.0, 3.0]) - 5.0 / 30.0_f64.sqrt()).abs() < 1e-15);
        assert_eq!(kendall_tau(&[(1.0, 1.0)]), None);
        assert_eq!(kendall_tau(&[(1.0, 1.0), (1.0, 2.0)]), None);
    }
}
