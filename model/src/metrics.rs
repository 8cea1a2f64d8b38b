//! Error metrics (thesis 4.1, 4.2).
//!
//! ```text
//! RMSE = sqrt( (1/T) sum (F - Fhat)^2 )              N; the thesis calls it RSSE
//! NMSE = RMSE^2 / ( (1/T) sum (F - mean F)^2 )       1; error power over force variance; the thesis calls it ESR
//! ```
//!
//! Fields and JSON keys keep the thesis' names: `rsse_n` and `esr`.
//!
//! Source: `[thesis]` in the bibliography (node/docs/guide/bibliography.md), equations 4.1 and 4.2 of the thesis.

use serde::{Deserialize, Serialize};

/// Error of a prediction over some samples.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    /// Root mean squared error (RMSE), N.
    pub rsse_n: f64,
    /// Normalised mean squared error (NMSE): error power over force variance, 1. Infinite when the measured
    /// force is constant.
    pub esr: f64,
    /// Number of samples used.
    pub samples: u64,
}

/// Accumulates squared error and force variance in one pass. Welford's update keeps the variance accurate
/// when the mean force is large.
///
/// ```
/// use mr_damper_model::metrics::ErrorSum;
///
/// let mut sum = ErrorSum::default();
/// for (measured_n, predicted_n) in [(-100.0, -110.0), (100.0, 110.0)] {
///     sum.add(measured_n, predicted_n);
/// }
/// // An error of 10 N, where the force has a standard deviation of 100 N.
/// let fit = sum.fit().expect("there are samples");
/// assert_eq!((fit.rsse_n, fit.samples), (10.0, 2));
/// assert!((fit.esr - 0.01).abs() < 1e-15);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ErrorSum {
    count: u64,
    mean: f64,
    spread: f64,
    squared_error: f64,
    error: f64,
}

impl ErrorSum {
    /// Adds one sample: the measured force and its prediction, in newtons. A sample with a non-finite error
    /// is ignored.
    #[inline]
    pub fn add(&mut self, measured_n: f64, predicted_n: f64) {
        let error = measured_n - predicted_n;
        if !error.is_finite() {
            return;
        }
        self.count += 1;
        let delta = measured_n - self.mean;
        self.mean += delta / self.count as f64;
        self.spread += delta * (measured_n - self.mean);
        self.squared_error += error * error;
        self.error += error;
    }

    /// Adds all samples of `other`.
    pub fn merge(&mut self, other: &Self) {
        if other.count == 0 {
            return;
        }
        let (ours, theirs) = (self.count as f64, other.count as f64);
        let delta = other.mean - self.mean;
        self.mean += delta * theirs / (ours + theirs);
        self.spread += other.spread + delta * delta * ours * theirs / (ours + theirs);
        self.count += other.count;
        self.squared_error += other.squared_error;
        self.error += other.error;
    }

    /// Mean of measured minus predicted force, N; zero without samples.
    #[must_use]
    pub fn mean_error_n(&self) -> f64 {
        if self.count == 0 { 0.0 } else { self.error / self.count as f64 }
    }

    /// RMSE and NMSE, or `None` without samples.
    #[must_use]
    pub fn fit(&self) -> Option<Fit> {
        self.fit_with(self.squared_error)
    }

    /// RMSE and NMSE after the mean error (the force offset of the session) is removed, or `None` without
    /// samples.
    #[must_use]
    pub fn fit_without_offset(&self) -> Option<Fit> {
        let mean = self.mean_error_n();
        self.fit_with((self.squared_error - self.count as f64 * mean * mean).max(0.0))
    }

    fn fit_with(&self, squared_error: f64) -> Option<Fit> {
        let count = self.count as f64;
        (self.count > 0).then(|| Fit {
            rsse_n: (squared_error / count).sqrt(),
            esr: squared_error / self.spread,
            samples: self.count,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metrics_match_a_hand_computed_case() {
        let mut sum = ErrorSum::default();
        for (measured, predicted) in [(1.0, 2.0), (3.0, 3.0), (5.0, 3.0), (f64::NAN, 0.0)] {
            sum.add(measured, predicted);
        }
        let fit = sum.fit().expect("three samples");
        assert!((fit.rsse_n - (5.0_f64 / 3.0).sqrt()).abs() < 1e-15);
        assert!((fit.esr - 5.0 / 8.0).abs() < 1e-15);
        assert_eq!(fit.samples, 3);
        let centred = sum.fit_without_offset().expect("three samples");
        assert!((centred.esr - (5.0 - 1.0 / 3.0) / 8.0).abs() < 1e-15);
    }

    #[test]
    fn merging_parts_equals_adding_all_samples() {
        let samples: Vec<(f64, f64)> =
            (0..100).map(|k| (f64::from(k * 37 % 100), f64::from(k * 53 % 90))).collect();
        let of = |samples: &[(f64, f64)]| {
            let mut sum = ErrorSum::default();
            samples.iter().for_each(|(measured, predicted)| sum.add(*measured, *predicted));
            sum
        };
        let sum = of(&samples);
        let whole = sum.fit().expect("samples");
        let mut merged = ErrorSum::default();
        for part in [&samples[..0], &samples[..30], &samples[30..31], &samples[31..]] {
            merged.merge(&of(part));
        }
        assert!((merged.mean_error_n() - sum.mean_error_n()).abs() < 1e-12 && sum.mean_error_n() != 0.0);
        let merged = merged.fit().expect("samples");
        assert!(
            (merged.esr / whole.esr - 1.0).abs() < 1e-14 && merged.samples == 100,
            "{merged:?} {whole:?}"
        );
        assert!((merged.rsse_n / whole.rsse_n - 1.0).abs() < 1e-14);
    }

    #[test]
    fn a_large_mean_force_does_not_reduce_accuracy() {
        let mut sum = ErrorSum::default();
        for k in 0..1000 {
            sum.add(1e9 + f64::from(k % 2), 1e9);
        }
        let fit = sum.fit().expect("samples");
        assert!((fit.esr - 500.0 / 250.0).abs() < 1e-6, "{}", fit.esr);
    }
}
