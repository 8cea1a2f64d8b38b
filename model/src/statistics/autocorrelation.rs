//! Integrated autocorrelation time: how many values of a series carry the information of one independent value.
//!
//! ```text
//! rho_k = sum_t d_t d_{t+k} / sum_t d_t^2          d: the series minus its mean
//! tau   = 1 + 2 sum_{k=1..K} rho_k                 in values;  N / tau values are independent
//! K     = the last lag before rho_k <= floor, and less than `longest_share` of N
//! ```
//!
//! The sum must end somewhere: at long lags rho_k is noise about zero, and the variance of the sum grows with every lag. [`Cutoff`]
//! says where. The two users need different ends, see its constants.
//!
//! Source: `[sokal1997]` in the bibliography (node/docs/guide/bibliography.md).

use super::dot;

/// Where the sum over the lags ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cutoff {
    /// The sum ends before the first lag whose autocorrelation is not above this.
    pub floor: f64,
    /// The sum contains only lags below this share of the series' length.
    pub longest_share: f64,
}

impl Cutoff {
    /// Ends at the first autocorrelation that is not positive, and at half of the series. For the blocks of a significance test: a
    /// time that is too long costs power, and a time that is too short names effects by chance. Lags beyond half of the series have
    /// too few products.
    pub const FIRST_ZERO: Self = Self { floor: 0.0, longest_share: 0.5 };
    /// Ends at the first autocorrelation of 0.05 or less. For the number of independent residuals of a calibration: sizes of residuals
    /// are positive, so a slow change of their level keeps the autocorrelation slightly above zero over a whole run. Summed up, it would
    /// refuse a run with thousands of residuals.
    pub const FIRST_NOISE: Self = Self { floor: 0.05, longest_share: 1.0 };
}

/// Integrated autocorrelation time of `values`, in values; 1 for independent values, for a constant series and for an empty one.
///
/// ```
/// use mr_damper_model::statistics::autocorrelation::{Cutoff, integrated_time};
/// // A square wave with a period of 40 values: neighbours are alike.
/// let values: Vec<f64> = (0..4000).map(|k| if k / 20 % 2 == 0 { 1.0 } else { -1.0 }).collect();
/// let time = integrated_time(&values, Cutoff::FIRST_ZERO);
/// assert!((time - 10.0).abs() < 0.1, "{time}");
/// assert_eq!(integrated_time(&[3.0; 100], Cutoff::FIRST_ZERO), 1.0);
/// ```
#[must_use]
pub fn integrated_time(values: &[f64], cutoff: Cutoff) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    let deviation: Vec<f64> = values.iter().map(|value| value - mean).collect();
    let power = dot(&deviation, &deviation);
    let lags = (cutoff.longest_share * deviation.len() as f64) as usize;
    let mut half = 0.5;
    for lag in 1..lags.min(deviation.len()) {
        let correlation = dot(&deviation[lag..], &deviation) / power;
        // The autocorrelation of a constant series is NaN.
        if correlation.is_nan() || correlation <= cutoff.floor {
            break;
        }
        half += correlation;
    }
    2.0 * half
}

#[cfg(test)]
mod tests {
    use super::super::tests::noise;
    use super::*;

    /// A first-order autoregression with coefficient a has rho_k = a^k, so tau = (1 + a) / (1 - a).
    fn autoregression(coefficient: f64, count: usize) -> Vec<f64> {
        let mut state = 0.0;
        let step = |x: f64| {
            state = coefficient * state + x;
            state
        };
        noise(3, count).map(step).collect()
    }

    #[test]
    fn the_time_of_an_autoregression_matches_its_formula() {
        for (coefficient, expected) in [(0.0, 1.0), (0.5, 3.0), (0.9, 19.0)] {
            let values = autoregression(coefficient, 200_000);
            let time = integrated_time(&values, Cutoff::FIRST_ZERO);
            assert!((time / expected - 1.0).abs() < 0.1, "{coefficient}: {time}");
        }
    }

    #[test]
    fn the_floor_ends_the_sum_earlier_and_the_share_bounds_its_lags() {
        let values = autoregression(0.9, 200_000);
        let (zero, floor) =
            (integrated_time(&values, Cutoff::FIRST_ZERO), integrated_time(&values, Cutoff::FIRST_NOISE));
        // The sum of .9^k from the first term below .05 is 2 * .05 * .9 / (1 - .9) or a little less.
        assert!(floor < zero && floor > zero - 2.0, "{floor} {zero}");
        // Two values per lag: of four values only lag 1 is below half, and its autocorrelation is 1/4.
        let ramp = [-1.5, -0.5, 0.5, 1.5];
        assert_eq!(integrated_time(&ramp, Cutoff { floor: 0.0, longest_share: 0.5 }), 1.5);
        assert_eq!(integrated_time(&ramp, Cutoff { floor: 0.0, longest_share: 0.25 }), 1.0);
        assert_eq!(integrated_time(&ramp, Cutoff { floor: 0.0, longest_share: 9.0 }), 1.5);
    }

    #[test]
    fn a_constant_or_empty_series_has_the_time_one() {
        for cutoff in [Cutoff::FIRST_ZERO, Cutoff::FIRST_NOISE] {
            assert_eq!(integrated_time(&[2.0; 50], cutoff), 1.0);
            assert_eq!(integrated_time(&[], cutoff), 1.0);
        }
    }
}
