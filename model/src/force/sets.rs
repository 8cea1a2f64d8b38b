//! Fuzzy sets over the drive (thesis 4.8): Gaussian memberships.
//!
//! ```text
//! w_j(i) = g_j / sum_k g_k,      g_j = exp(-(i - c_j)^2 / (2 sigma_j^2))
//! ```
//!
//! These sets blend every model that has one function per level of the drive. In the thesis all sets have the same width sigma; sets
//! with identified centres and widths each have their own.
//!
//! Source: `[thesis]` in the bibliography (node/docs/guide/bibliography.md), equation 4.8 of the thesis.

use super::jet::Real;
use crate::error::Error;
use crate::sample::DriveKind;

/// A set is ignored if its exponent exceeds the strongest set's by more than this: -ln of 1e-7.
const OUT: f64 = 16.118_095_650_958_32;
/// Largest number of fuzzy sets in a model.
pub const MAX_FUNCTIONS: usize = 16;

/// Common properties of Gaussian membership functions of one width.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Membership {
    /// The fuzzified drive: current in A, or command voltage in V.
    pub drive: DriveKind,
    /// Standard deviation of every set, in the unit of `drive`.
    pub sigma: f64,
}

/// Memberships with their centres and widths.
///
/// ```
/// use mr_damper_model::force::{FuzzySets, Membership};
/// use mr_damper_model::sample::DriveKind;
///
/// let membership = Membership { drive: DriveKind::CoilCurrent, sigma: 0.5 };
/// let sets = FuzzySets::new(membership, &[0.0, 1.0, 2.0])?;
/// let weights = sets.weights(0.5);
/// assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
/// // 1.5 A from the third centre and 0.5 A from the second: exp(-(1.5^2 - 0.5^2) / (2 * 0.5^2)) = exp(-4)
/// assert!((weights[2] / weights[1] - (-4.0_f64).exp()).abs() < 1e-12);
/// assert!(FuzzySets::new(membership, &[1.0, 0.0]).is_err(), "centres must increase");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FuzzySets {
    drive: DriveKind,
    len: usize,
    centres: [f64; MAX_FUNCTIONS],
    sigmas: [f64; MAX_FUNCTIONS],
    /// See [`sharpness`]. They are stored because division by the sigmas would take a fifth of a step's time.
    sharpnesses: [f64; MAX_FUNCTIONS],
}

impl FuzzySets {
    /// One set around each of `centres`, all with the same width.
    ///
    /// # Errors
    /// The same as for [`FuzzySets::with_widths`].
    pub fn new(membership: Membership, centres: &[f64]) -> Result<Self, Error> {
        let unit = membership.drive.unit_suffix();
        Error::check(&format!("membership_sigma_{unit}"), membership.sigma, "positive and finite", |s| {
            s > 0.0
        })?;
        Self::with_widths(membership.drive, centres, &vec![membership.sigma; centres.len()])
    }

    /// One set around each of `centres`, with the standard deviations `sigmas`; both in the unit of `drive`.
    ///
    /// # Errors
    /// When the number of centres is 0 or above [`MAX_FUNCTIONS`], the centres do not increase, the numbers of sigmas and centres
    /// differ, a sigma is not positive, or a number is not finite.
    pub fn with_widths(drive: DriveKind, centres: &[f64], sigmas: &[f64]) -> Result<Self, Error> {
        let unit = drive.unit_suffix();
        if centres.is_empty() || centres.len() > MAX_FUNCTIONS {
            return Err(Error::Length {
                name: format!("membership_centres_{unit}"),
                found: centres.len(),
                expected: format!("1 to {MAX_FUNCTIONS}"),
            });
        }
        if sigmas.len() != centres.len() {
            return Err(Error::Length {
                name: format!("membership_sigma_{unit}"),
                found: sigmas.len(),
                expected: format!("one for all, or {} (one for each centre)", centres.len()),
            });
        }
        Error::check(&format!("membership_centres_{unit}[0]"), centres[0], "finite", |_| true)?;
        for (j, pair) in centres.windows(2).enumerate() {
            let name = format!("membership_centres_{unit}[{}]", j + 1);
            Error::check(&name, pair[1], "greater than the centre before it", |c| c > pair[0])?;
        }
        for (j, sigma) in sigmas.iter().enumerate() {
            let name = format!("membership_sigma_{unit}[{j}]");
            Error::check(&name, *sigma, "positive and finite", |s| s > 0.0)?;
        }
        let (mut all_centres, mut all_sigmas) = ([0.0; MAX_FUNCTIONS], [1.0; MAX_FUNCTIONS]);
        all_centres[..centres.len()].copy_from_slice(centres);
        all_sigmas[..sigmas.len()].copy_from_slice(sigmas);
        let sharpnesses = all_sigmas.map(sharpness);
        Ok(Self { drive, len: centres.len(), centres: all_centres, sigmas: all_sigmas, sharpnesses })
    }

    /// The drive of the sets.
    #[must_use]
    pub const fn drive(&self) -> DriveKind {
        self.drive
    }

    /// Standard deviations of the sets, in the unit of the drive.
    #[must_use]
    pub fn sigmas(&self) -> &[f64] {
        &self.sigmas[..self.len]
    }

    /// Number of sets.
    #[must_use]
    #[expect(clippy::len_without_is_empty, reason = "there is always one set")]
    pub const fn len(&self) -> usize {
        self.len
    }

    /// Centres of the sets, in the unit of the drive, increasing.
    #[must_use]
    pub fn centres(&self) -> &[f64] {
        &self.centres[..self.len]
    }

    /// Normalised firing strengths of the sets at drive `i`. They are not negative and sum to one; entries beyond [`FuzzySets::len`]
    /// are zero. NaN for a drive that is not finite.
    #[inline]
    #[must_use]
    pub fn weights(&self, i: f64) -> [f64; MAX_FUNCTIONS] {
        self.strengths(i).shares()
    }

    /// Strengths of the sets at drive `i`. NaN for a drive that is not finite.
    #[inline(always)]
    pub(crate) fn strengths<R: Real>(&self, i: R) -> Strengths<R> {
        Strengths::at(i, self.centres(), &self.sharpnesses[..self.len])
    }
}

/// Strengths of fuzzy sets at one drive, relative to the strongest.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Strengths<R = f64> {
    of: [R; MAX_FUNCTIONS],
    sum: R,
    len: usize,
}

impl<R: Real> Strengths<R> {
    /// Strengths of Gaussian sets at drive `i`, one per centre, at most [`MAX_FUNCTIONS`].
    #[inline(always)]
    fn at(i: R, centres: &[f64], sharpnesses: &[f64]) -> Self {
        let len = centres.len().min(MAX_FUNCTIONS);
        let (mut of, nearest) = exponents(i, centres, sharpnesses);
        let mut sum = R::from(0.0);
        for value in &mut of[..len] {
            *value = strength(*value - nearest);
            sum = sum + *value;
        }
        Self { of, sum, len }
    }

    /// Each strength divided by the sum.
    #[inline]
    pub(super) fn shares(&self) -> [R; MAX_FUNCTIONS] {
        let Self { of: mut weights, sum, len } = *self;
        for weight in &mut weights[..len] {
            *weight = *weight / sum;
        }
        weights
    }

    /// Weighted mean of the sets' outputs `says`, with the strengths as weights. Ignored sets are not evaluated. NaN if the strengths
    /// are NaN.
    #[inline(always)]
    pub(crate) fn mean(&self, says: impl Fn(usize) -> R) -> R {
        let mut sum = R::from(0.0);
        for (set, strength) in self.of[..self.len].iter().enumerate() {
            // NaN is not equal to zero, so it propagates.
            if !strength.is_zero() {
                sum = sum + *strength * says(set);
            }
        }
        sum / self.sum
    }
}

impl Strengths {
    /// [`Self::mean`] of a value and its slope.
    #[inline]
    pub(crate) fn mean_and_slope(&self, says: impl Fn(usize) -> [f64; 2]) -> [f64; 2] {
        let [mut value, mut slope] = [0.0; 2];
        for (set, strength) in self.of[..self.len].iter().enumerate() {
            if *strength != 0.0 {
                let [own, own_slope] = says(set);
                value += strength * own;
                slope += strength * own_slope;
            }
        }
        // The reciprocal is independent of `says`, so the division does not delay the result.
        let share = self.sum.recip();
        [value * share, slope * share]
    }
}

/// Weights of Gaussian sets at drive `i`, one per centre, at most [`MAX_FUNCTIONS`].
///
/// Strengths are computed relative to the strongest set. Far outside the centres all exponentials underflow, and a plain quotient
/// would be 0/0. Relative to the strongest set, the model approaches that set's function instead. A set with less than 1e-7 of the
/// strongest is ignored: it would add less than any load cell resolves, but the function of a set that no data reach may have any
/// value.
#[inline]
pub(crate) fn blend(i: f64, centres: &[f64], sigmas: &[f64]) -> [f64; MAX_FUNCTIONS] {
    let mut sharpnesses = [0.0; MAX_FUNCTIONS];
    for (own, sigma) in sharpnesses.iter_mut().zip(sigmas) {
        *own = sharpness(*sigma);
    }
    Strengths::at(i, centres, &sharpnesses).shares()
}

/// Factor of the squared distance from a centre: 1/(2 sigma²). It is clamped to the range from 1e-200 to 1e200 (sigma near 1e100 and
/// 1e-100), so that no product with a squared distance overflows and no difference of two exponents is NaN.
#[inline]
fn sharpness(sigma: f64) -> f64 {
    (0.5 / (sigma * sigma)).clamp(1e-200, 1e200)
}

/// Exponent of each set at drive `i`, (i - c)²/(2 sigma²), and the smallest of them; unused entries are zero.
#[inline(always)]
fn exponents<R: Real>(i: R, centres: &[f64], sharpnesses: &[f64]) -> ([R; MAX_FUNCTIONS], R) {
    let mut all = [R::from(0.0); MAX_FUNCTIONS];
    let mut least = R::from(f64::INFINITY);
    for (exponent, (centre, sharpness)) in all.iter_mut().zip(centres.iter().zip(sharpnesses)) {
        let distance = i - *centre;
        *exponent = distance * distance * *sharpness;
        least = least.min(*exponent);
    }
    (all, least)
}

/// Strength of a set whose exponent is `beyond` above the strongest set's: 0 if the set is ignored, NaN if `beyond` is NaN.
#[inline(always)]
fn strength<R: Real>(beyond: R) -> R {
    // NaN from an unknown drive must propagate.
    if beyond.re() > OUT { R::from(0.0) } else { (-beyond).exp() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sets(centres: &[f64], sigmas: &[f64]) -> FuzzySets {
        FuzzySets::with_widths(DriveKind::CoilCurrent, centres, sigmas).expect("sets")
    }

    proptest! {
        #[test]
        fn weights_are_the_quotient_of_exponentials(
            steps in prop::collection::vec(0.05..1.0f64, 1..=MAX_FUNCTIONS),
            sigma in 0.1..0.6f64, wider in 0.8..1.25f64, share in -0.1..1.1f64,
        ) {
            let centres: Vec<f64> = steps.iter().scan(0.0, |at, step| { *at += step; Some(*at) }).collect();
            let widths: Vec<f64> =
                (0..centres.len()).map(|j| if j % 2 == 0 { sigma } else { sigma * wider }).collect();
            let sets = sets(&centres, &widths);
            let i = share * centres[centres.len() - 1];
            let strength = |(c, s): (&f64, &f64)| (-(i - c).powi(2) / (2.0 * s * s)).exp();
            let strengths: Vec<f64> = centres.iter().zip(&widths).map(strength).collect();
            let sum: f64 = strengths.iter().sum();
            let weights = sets.weights(i);
            for (weight, strength) in weights.iter().zip(&strengths) {
                // A set with less than 1e-7 of the strongest is ignored; there are up to sixteen sets.
                prop_assert!((weight - strength / sum).abs() < 2e-6, "{weight} {}", strength / sum);
            }
            prop_assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-15 * 16.0);
            prop_assert!(weights[centres.len()..].iter().all(|w| *w == 0.0));
            let expected: f64 = weights.iter().zip(&centres).map(|(w, c)| w * c).sum();
            let mean = sets.strengths(i).mean(|set| centres[set]);
            prop_assert!((mean - expected).abs() < 1e-12);
            let [value, slope] = sets.strengths(i).mean_and_slope(|set| [centres[set], -centres[set]]);
            prop_assert!((value - expected).abs() < 1e-12 && (slope + expected).abs() < 1e-12);
        }
    }

    #[test]
    fn weights_of_neighbouring_sets_are_exact_to_rounding() {
        let weights = sets(&[0.0, 0.4, 1.0], &[0.2, 0.3, 0.2]).weights(0.3);
        let strength = [-1.125, -0.5 / 9.0, -6.125].map(f64::exp);
        let sum: f64 = strength.iter().sum();
        for (weight, strength) in weights.iter().zip(strength) {
            assert!((weight * sum / strength - 1.0).abs() < 1e-14, "{weights:?}");
        }
    }

    #[test]
    fn widths_of_any_size_give_weights_and_an_unknown_drive_gives_nan() {
        for sigma in [1e-300, 1e-160, 1e160, 1e300] {
            let sets = sets(&[0.0, 1.0], &[sigma; 2]);
            for i in [0.0, 1e-200, 0.4, 1.0, 50.0] {
                let weights = sets.weights(i);
                let sum: f64 = weights.iter().sum();
                assert!((sum - 1.0).abs() < 1e-15, "sigma {sigma}, drive {i}: {weights:?}");
            }
        }
        let narrow = sets(&[0.0, 1.0], &[0.2; 2]);
        assert_eq!(narrow.weights(40.0)[..2], [0.0, 1.0]);
        assert_eq!(narrow.weights(-40.0)[..2], [1.0, 0.0]);
        assert!([f64::NAN, f64::INFINITY].iter().all(|i| narrow.weights(*i)[0].is_nan()));
    }
}
