//! Fuzzy sets over the drive (thesis 4.8): Gaussian memberships.
//!
//! ```text
//! w_j(i) = g_j / sum_k g_k,      g_j = exp(-(i - c_j)^2 / (2 sigma_j^2))
//! ```
//!
//! Every model whose functions stand side by side over the current is blended by these. In the thesis all widths
//! sigma are one; sets whose centres and widths were identified have each their own.

use crate::error::Error;
use crate::sample::DriveKind;

/// Squared distance, in widths, beyond the strongest set's from which a set is out: -2 ln of 1e-7.
const OUT: f64 = 32.236_191_301_916_64;
/// The most fuzzy sets that one model can hold.
pub const MAX_FUNCTIONS: usize = 16;

/// What Gaussian membership functions of one width have in common.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Membership {
    /// What is fuzzified: current in A, or command voltage in V.
    pub drive: DriveKind,
    /// Standard deviation of every set, in the unit of `drive`.
    pub sigma: f64,
}

/// Memberships with their centres and widths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FuzzySets {
    drive: DriveKind,
    len: usize,
    centres: [f64; MAX_FUNCTIONS],
    sigmas: [f64; MAX_FUNCTIONS],
}

impl FuzzySets {
    /// One set around each of `centres`, all of one width.
    ///
    /// # Errors
    /// As [`FuzzySets::with_widths`].
    pub fn new(membership: Membership, centres: &[f64]) -> Result<Self, Error> {
        let unit = membership.drive.unit_suffix();
        Error::check(&format!("membership_sigma_{unit}"), membership.sigma, "positive and finite", |s| {
            s > 0.0
        })?;
        Self::with_widths(membership.drive, centres, &vec![membership.sigma; centres.len()])
    }

    /// One set around each of `centres`, each with its standard deviation from `sigmas`; both in the unit of `drive`.
    ///
    /// # Errors
    /// When there are no centres or more than [`MAX_FUNCTIONS`], when they do not increase, when there are more or
    /// fewer sigmas, one is not positive, or a number is not finite.
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
        let mut sets =
            Self { drive, len: centres.len(), centres: [0.0; MAX_FUNCTIONS], sigmas: [1.0; MAX_FUNCTIONS] };
        sets.centres[..centres.len()].copy_from_slice(centres);
        sets.sigmas[..sigmas.len()].copy_from_slice(sigmas);
        Ok(sets)
    }

    /// Which drive the sets are over.
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

    /// Normalised firing strengths of the sets at drive `i`: they are not negative and sum to one; entries beyond
    /// [`FuzzySets::len`] are zero. NaN for a drive that is not finite.
    #[inline]
    #[must_use]
    pub fn weights(&self, i: f64) -> [f64; MAX_FUNCTIONS] {
        blend(i, self.centres(), self.sigmas())
    }

    /// Strengths of the sets at drive `i`. NaN for a drive that is not finite.
    #[inline]
    pub(crate) fn strengths(&self, i: f64) -> Strengths {
        Strengths::at(i, self.centres(), self.sigmas())
    }
}

/// Strengths of fuzzy sets at one drive, relative to the strongest.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Strengths {
    of: [f64; MAX_FUNCTIONS],
    sum: f64,
    len: usize,
}

impl Strengths {
    /// Those of Gaussian sets at drive `i`, as many as there are `centres`, at most [`MAX_FUNCTIONS`].
    #[inline]
    fn at(i: f64, centres: &[f64], sigmas: &[f64]) -> Self {
        let len = centres.len().min(MAX_FUNCTIONS);
        let (mut of, nearest) = distances(i, centres, sigmas);
        let mut sum = 0.0;
        for value in &mut of[..len] {
            *value = strength(*value - nearest);
            sum += *value;
        }
        Self { of, sum, len }
    }

    /// Mean of what each set says, by the sets' strengths; a set that is out is not asked. NaN where the strengths are.
    #[inline]
    pub(crate) fn mean(&self, says: impl Fn(usize) -> f64) -> f64 {
        let mut sum = 0.0;
        for (set, strength) in self.of[..self.len].iter().enumerate() {
            // NaN is no zero: it comes through.
            if *strength != 0.0 {
                sum += strength * says(set);
            }
        }
        sum / self.sum
    }

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
        // At hand before `says` is: whoever waits for the mean waits for no division.
        let share = self.sum.recip();
        [value * share, slope * share]
    }
}

/// Weights of Gaussian sets at drive `i`, as many as there are `centres`, at most [`MAX_FUNCTIONS`].
///
/// Strengths are taken relative to the strongest set. Far outside the centres all exponentials underflow, and a plain
/// quotient would be 0/0; relative to the strongest set the model goes over to that set's function instead. A set with
/// less than 1e-7 of the strongest has no say at all: it would add less than any load cell resolves, but
/// what stands under a set that no data reach may be anything.
#[inline]
pub(crate) fn blend(i: f64, centres: &[f64], sigmas: &[f64]) -> [f64; MAX_FUNCTIONS] {
    let Strengths { of: mut weights, sum, len } = Strengths::at(i, centres, sigmas);
    for weight in &mut weights[..len] {
        *weight /= sum;
    }
    weights
}

/// Squared distance of drive `i` from each centre, in widths, and the least of them; zeros beyond.
#[inline]
fn distances(i: f64, centres: &[f64], sigmas: &[f64]) -> ([f64; MAX_FUNCTIONS], f64) {
    let mut squares = [0.0; MAX_FUNCTIONS];
    let mut least = f64::INFINITY;
    for (square, (centre, sigma)) in squares.iter_mut().zip(centres.iter().zip(sigmas)) {
        let distance = (i - centre) / sigma;
        *square = distance * distance;
        least = least.min(*square);
    }
    (squares, least)
}

/// Strength of a set whose squared distance is `beyond` the nearest one's: 0 where it is out, NaN where that is NaN.
#[inline]
fn strength(beyond: f64) -> f64 {
    // NaN, of a drive that is not known, must come through.
    if beyond > OUT { 0.0 } else { (-0.5 * beyond).exp() }
}
