//! Statistics of time series: how strongly neighbouring values depend on each other, and what that means for an error figure.
//!
//! | module | computes | used by |
//! |---|---|---|
//! | [`autocorrelation`] | integrated autocorrelation time, effective number of values | diagnosis, calibration |
//! | [`bootstrap`] | draws of runs with replacement | `mr-damper identify` |
//! | `block_sums` | p of a mean from block sums, corrected for several tests | diagnosis |
//! | [`correlation`] | Pearson's coefficient, correlation functions with their bands | diagnosis, reports |
//! | [`spectrum`] | power densities and coherence by Welch's method | reports |
//! | `error_ratio` | ratio of two squared errors with its interval, from a t test on blocks | diagnosis |
//! | [`parabola`] | value and derivatives from a least-squares parabola in a sliding window | reports |
//!
//! All of them allocate and none of them runs in the live path. Random draws follow from a seed.

pub mod autocorrelation;
pub(crate) mod block_sums;
pub mod bootstrap;
pub mod correlation;
pub(crate) mod error_ratio;
pub(crate) mod fourier;
pub mod parabola;
pub mod spectrum;

use crate::lanes::widest;

/// The smallest and the largest of `values`; without values, an infinite range in reverse.
pub(crate) fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
}

/// Sum of products of two series of one length; zero if one of them is empty.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    const LANES: usize = 8;
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let sums = widest(
        #[inline(always)]
        || {
            let mut sums = [0.0; LANES];
            for (a, b) in a.iter().zip(b) {
                for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
                    *sum += a * b;
                }
            }
            sums
        },
    );
    sums.iter().sum::<f64>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f64>()
}

#[cfg(test)]
mod tests;
