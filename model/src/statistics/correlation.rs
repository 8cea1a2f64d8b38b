//! Pearson's coefficient, and correlation functions of stretches of evenly spaced samples.
//!
//! ```text
//! r       = sum x y / sqrt(sum x² sum y²)                          means subtracted
//! r_xy(k) = sum_t x_t y_{t+k} / sqrt(sum x² sum y²)                means subtracted; sums within stretches
//! ```
//!
//! | correlation function | 95 % band about zero |
//! |---|---|
//! | autocorrelation | 1.96 / sqrt(N), the band for white noise |
//! | cross-correlation | 1.96 sqrt(sum_k r_xx(k) r_yy(k) / N), the band for two unrelated signals with these autocorrelations |
//!
//! Source of the second band: `[bartlett1946]` in the bibliography (node/docs/guide/bibliography.md).

use super::dot;
use super::fourier::transform;
use realfft::RealFftPlanner;
use realfft::num_complex::Complex;

/// Pearson's correlation coefficient of pairs of values; zero if one of the two is constant.
///
/// ```
/// use mr_damper_model::statistics::correlation::pearson;
/// let line: Vec<(f64, f64)> = (0..10).map(|k| (f64::from(k), 3.0 - 2.0 * f64::from(k))).collect();
/// assert!((pearson(&line) + 1.0).abs() < 1e-12);
/// ```
#[must_use]
pub fn pearson(pairs: &[(f64, f64)]) -> f64 {
    let count = pairs.len().max(1) as f64;
    let centred = |pick: fn(&(f64, f64)) -> f64| -> Vec<f64> {
        let mean = pairs.iter().map(pick).sum::<f64>() / count;
        pairs.iter().map(|pair| pick(pair) - mean).collect()
    };
    of_centred(&centred(|pair| pair.0), &centred(|pair| pair.1))
}

/// Pearson's coefficient of two series whose means are zero already, for example because each run's own mean was removed; zero if one
/// of them is zero throughout.
#[must_use]
pub(crate) fn of_centred(x: &[f64], y: &[f64]) -> f64 {
    let scale = (dot(x, x) * dot(y, y)).sqrt();
    if scale > 0.0 { dot(x, y) / scale } else { 0.0 }
}

/// A correlation function.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrelationFunction {
    /// Coefficients at lags -L to L, in samples. At a positive lag the second signal follows the first.
    pub coefficients: Vec<f64>,
    /// Half the width of the 95 % band about zero.
    pub band: f64,
}

impl CorrelationFunction {
    /// Pairs of lag, in samples, and coefficient.
    pub fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        let reach = (self.coefficients.len() / 2) as f64;
        self.coefficients.iter().enumerate().map(move |(k, r)| (k as f64 - reach, *r))
    }
}

/// The cross-correlation of the paired signals in `stretches` for lags up to `reach` in both directions. Its band uses the
/// autocorrelations up to lag `colour`. `None` when one of the signals is constant.
///
/// ```
/// use mr_damper_model::statistics::correlation::cross_correlation;
///
/// // The second signal follows the first by 3 samples.
/// let noise: Vec<f64> = (0_u64..500).map(|k| (k * k * 7919 % 1009) as f64 / 1009.0 - 0.5).collect();
/// let pairs: Vec<(f64, f64)> = (3..noise.len()).map(|k| (noise[k], noise[k - 3])).collect();
/// let found = cross_correlation(&[pairs], 10, 5).expect("both signals vary");
/// let (lag, peak) = found.points().max_by(|a, b| a.1.total_cmp(&b.1)).expect("there are lags");
/// assert_eq!(lag, 3.0);
/// assert!(peak > 0.9 && found.band < 0.2, "{peak} {}", found.band);
/// ```
#[must_use]
pub fn cross_correlation(
    stretches: &[Vec<(f64, f64)>],
    reach: usize,
    colour: usize,
) -> Option<CorrelationFunction> {
    let sums = Sums::of(stretches, reach.max(colour))?;
    let normal = (sums.xx[0] * sums.yy[0]).sqrt();
    let coloured: f64 =
        1.0 + (1..=colour).map(|k| 2.0 * sums.xx[k] * sums.yy[k] / (sums.xx[0] * sums.yy[0])).sum::<f64>();
    let middle = sums.xy.len() / 2;
    Some(CorrelationFunction {
        coefficients: sums.xy[middle - reach..=middle + reach].iter().map(|xy| xy / normal).collect(),
        band: 1.96 * (coloured.max(1.0) / sums.count).sqrt(),
    })
}

/// The autocorrelation of a signal for lags up to `reach` in both directions, with the band of white noise. `None` when
/// the signal is constant.
#[must_use]
pub fn autocorrelation(stretches: &[Vec<f64>], reach: usize) -> Option<CorrelationFunction> {
    let pairs: Vec<Vec<(f64, f64)>> =
        stretches.iter().map(|s| s.iter().map(|x| (*x, *x)).collect()).collect();
    let sums = Sums::of(&pairs, reach)?;
    let coefficients = sums.xy.iter().map(|xy| xy / sums.xx[0]).collect();
    Some(CorrelationFunction { coefficients, band: 1.96 / sums.count.sqrt() })
}

/// Sums of products of the signals without their means.
struct Sums {
    count: f64,
    /// Sums at lags 0 to L.
    xx: Vec<f64>,
    yy: Vec<f64>,
    /// Sums at lags -L to L.
    xy: Vec<f64>,
}

impl Sums {
    fn of(stretches: &[Vec<(f64, f64)>], reach: usize) -> Option<Self> {
        let count = stretches.iter().map(Vec::len).sum::<usize>() as f64;
        let all = || stretches.iter().flatten();
        let (x_mean, y_mean) =
            (all().map(|pair| pair.0).sum::<f64>() / count, all().map(|pair| pair.1).sum::<f64>() / count);
        let zero = || vec![0.0; reach + 1];
        let mut sums = Self { count, xx: zero(), yy: zero(), xy: vec![0.0; 2 * reach + 1] };
        let mut planner = RealFftPlanner::<f64>::new();
        for stretch in stretches {
            // Zero padding for the largest lag, so that the circular correlation does not wrap around.
            let length = (stretch.len() + reach + 1).next_power_of_two();
            let plan = planner.plan_fft_forward(length);
            let padded = |value: &dyn Fn(&(f64, f64)) -> f64| {
                let mut values: Vec<f64> = stretch.iter().map(value).collect();
                values.resize(length, 0.0);
                transform(&*plan, &values)
            };
            let (x, y) = (padded(&|pair| pair.0 - x_mean), padded(&|pair| pair.1 - y_mean));
            let back = planner.plan_fft_inverse(length);
            let lags = |a: &[Complex<f64>], b: &[Complex<f64>]| -> Vec<f64> {
                let mut product: Vec<Complex<f64>> = a.iter().zip(b).map(|(a, b)| a.conj() * b).collect();
                let mut lags = back.make_output_vec();
                // This cannot fail: the lengths are the plan's own, and the spectrum of a real signal is real at both ends.
                let _ = back.process(&mut product, &mut lags);
                lags.iter().map(|lag| lag / length as f64).collect()
            };
            let (xx, yy, xy) = (lags(&x, &x), lags(&y, &y), lags(&x, &y));
            for k in 0..=reach {
                sums.xx[k] += xx[k];
                sums.yy[k] += yy[k];
                sums.xy[reach + k] += xy[k];
                if k > 0 {
                    sums.xy[reach - k] += xy[length - k];
                }
            }
        }
        (sums.xx[0] > 0.0 && sums.yy[0] > 0.0).then_some(sums)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::noise;
    use super::*;

    #[test]
    fn pearson_matches_a_value_computed_by_hand() {
        // Deviations -1, 0, 1 and -1, 1, 0: 1 / sqrt(2 * 2).
        assert!((pearson(&[(1.0, 4.0), (2.0, 6.0), (3.0, 5.0)]) - 0.5).abs() < 1e-15);
        assert_eq!(pearson(&[(1.0, 2.0), (1.0, 5.0)]), 0.0);
        assert_eq!(pearson(&[]), 0.0);
    }

    #[test]
    fn white_noise_stays_within_the_band_and_correlates_with_itself() {
        let found =
            autocorrelation(&[noise(1, 6000).collect(), noise(2, 4000).collect()], 200).expect("it varies");
        assert!((found.coefficients[200] - 1.0).abs() < 1e-12 && (found.band - 0.0196).abs() < 1e-6);
        let outside =
            found.points().filter(|(lag, r)| *lag > 0.0 && r.abs() > found.band).count() as f64 / 200.0;
        assert!((0.01..0.11).contains(&outside), "{outside}");
        assert!(autocorrelation(&[vec![3.0; 100]], 10).is_none(), "a constant signal has no correlation");
    }

    #[test]
    fn a_delay_appears_at_its_lag() {
        let x: Vec<f64> = noise(3, 3000).collect();
        let delayed: Vec<(f64, f64)> = (7..x.len()).map(|t| (x[t], x[t - 7])).collect();
        let found = cross_correlation(&[delayed], 20, 200).expect("it varies");
        let peak = found.points().max_by(|a, b| a.1.total_cmp(&b.1)).expect("lags");
        assert_eq!(peak.0, 7.0);
        assert!(peak.1 > 0.99);
    }

    #[test]
    fn the_sums_agree_with_the_definition() {
        let pairs: Vec<(f64, f64)> = noise(4, 50).zip(noise(5, 50)).collect();
        let found =
            cross_correlation(&[pairs[..20].to_vec(), pairs[20..].to_vec()], 3, 3).expect("it varies");
        let mean = |pick: fn(&(f64, f64)) -> f64| pairs.iter().map(pick).sum::<f64>() / 50.0;
        let (mx, my) = (mean(|p| p.0), mean(|p| p.1));
        let within = |k: usize, range: std::ops::Range<usize>| -> f64 {
            range
                .clone()
                .filter(|t| t + k < range.end)
                .map(|t| (pairs[t].0 - mx) * (pairs[t + k].1 - my))
                .sum()
        };
        let square = |pick: fn(&(f64, f64)) -> f64, mean: f64| {
            pairs.iter().map(|p| (pick(p) - mean).powi(2)).sum::<f64>()
        };
        let normal = (square(|p| p.0, mx) * square(|p| p.1, my)).sqrt();
        let direct = (within(2, 0..20) + within(2, 20..50)) / normal;
        assert!((found.coefficients[3 + 2] - direct).abs() < 1e-12);
    }

    #[test]
    fn unrelated_slow_signals_stay_within_the_wider_band() {
        let slow = |seed: u64| {
            let mut lag = 0.0;
            noise(seed, 20_000).map(move |x| {
                lag += 0.02 * (x - lag);
                lag
            })
        };
        let mut outside = 0;
        for seed in 0..40 {
            let pairs: Vec<(f64, f64)> = slow(10 + 2 * seed).zip(slow(11 + 2 * seed)).collect();
            let found = cross_correlation(&[pairs], 0, 600).expect("it varies");
            assert!(found.band > 3.0 * 1.96 / 20_000_f64.sqrt(), "{}", found.band);
            outside += usize::from(found.coefficients[0].abs() > found.band);
        }
        assert!(outside <= 6, "{outside} of 40 are outside the 95 % band");
    }
}
