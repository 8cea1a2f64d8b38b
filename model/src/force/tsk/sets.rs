//! Memberships of one input of a TSK model, and their firing strengths.
//!
//! ```text
//! u      = (raw - mean) / std_dev
//! w_j(u) = g_j(u) / sum_k g_k(u)
//! ```
//!
//! [`TskSet`] has the functions g. The weights are defined everywhere:
//!
//! - Strengths of Gaussians are computed relative to the strongest one. Far outside all of them the exponentials
//!   underflow and a plain quotient would be 0/0. Relative to the strongest, only one set counts: the nearest,
//!   or very far out the widest. Two-sided Gaussians follow the same rule.
//! - Bells fall as powers of the distance. Far outside, only the bells with the smallest exponent b count, and they
//!   share the weight as a^(2 b). Where all of them underflow, their logarithms are compared instead.
//! - Triangles become shoulders at the ends: the first is one below its peak, and the last is one above its peak. In a
//!   gap that no triangle covers, only the set with the nearest peak counts.
//! - Trapezoids have no shoulders at the ends. Where none of them is above zero, only the one with the nearest plateau
//!   counts.

use super::Signal;
use super::set::{
    NUMBERS, Shape, TskSet, bell_energy, bell_power, trapezoid, trapezoid_slopes, two_sided_energy,
};
use crate::elementary::{exp, ln};
use crate::error::{Error, ForceError};

/// Largest number of memberships of one input.
pub const MAX_SETS: usize = 5;
/// Beyond this many standard deviations the weights are held constant: their differences would be lost to
/// rounding.
const FARTHEST: f64 = 1e6;
/// Below this sum of strengths, bells are compared by their logarithms.
const LEAST_SUM: f64 = 1e-100;

/// One input of a TSK model: the signal, its normalisation, its memberships.
///
/// ```
/// use mr_damper_model::force::{Signal, TskInput, TskSet};
///
/// // Triangles about -0.1, 0 and 0.1 m/s; the outer two are shoulders.
/// let triangle = |peak: f64| TskSet::Triangle { left: peak - 1.0, peak, right: peak + 1.0 };
/// let input = TskInput::new(Signal::Velocity, 0.0, 0.1, &[triangle(-1.0), triangle(0.0), triangle(1.0)])?;
/// let weights = |raw_m_s| input.weights(input.normalise(raw_m_s));
/// assert_eq!(weights(0.025)[..3], [0.0, 0.75, 0.25]);
/// assert_eq!(weights(5.0)[..3], [0.0, 0.0, 1.0]);
/// assert!(TskInput::new(Signal::Velocity, 0.0, 0.1, &[triangle(1.0), triangle(0.0)]).is_err(), "peaks must increase");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TskInput {
    signal: Signal,
    mean: f64,
    std_dev: f64,
    shape: Shape,
    len: usize,
    /// Numbers of each set, in the order of the fields of [`TskSet`].
    pub(super) numbers: [[f64; NUMBERS]; MAX_SETS],
}

/// Weights of one input's sets, and their derivatives with respect to the sets' numbers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Firing {
    /// w_j: not negative, with sum one.
    pub(crate) weights: [f64; MAX_SETS],
    /// Derivative of g_j with respect to its own numbers, divided by sum_k g_k. Let A_j be the output of the
    /// rules of set j alone and F the output; then dF/dp_j = (A_j - F) times this.
    pub(crate) slopes: [[f64; NUMBERS]; MAX_SETS],
}

impl TskInput {
    /// An input with its memberships, all of one shape; triangles have increasing peaks. `mean` and
    /// `std_dev` are in the SI unit of `signal`.
    ///
    /// # Errors
    /// Names the number that is out of range, with the signal.
    pub fn new(signal: Signal, mean: f64, std_dev: f64, sets: &[TskSet]) -> Result<Self, Error> {
        let name = signal.name();
        let unit = signal.unit_suffix();
        Error::check(&format!("{name}_mean_{unit}"), mean, "finite", |_| true)?;
        Error::check(&format!("{name}_std_dev_{unit}"), std_dev, "positive and finite", |s| s > 0.0)?;
        let Some(first) = sets.first().filter(|_| sets.len() <= MAX_SETS) else {
            return Err(Error::Length {
                name: format!("{name}_sets"),
                found: sets.len(),
                expected: format!("1 to {MAX_SETS}"),
            });
        };
        let shape = first.shape();
        let mut numbers = [[0.0; NUMBERS]; MAX_SETS];
        for (j, (set, slot)) in sets.iter().zip(&mut numbers).enumerate() {
            if set.shape() != shape {
                return Err(ForceError::MixedShapes { input: name.to_owned(), index: j }.into());
            }
            *slot = set.numbers();
            set.check(&format!("{name}_sets[{j}]"), j > 0, j + 1 < sets.len())?;
            if let (TskSet::Triangle { peak, .. }, Some(before)) = (set, j.checked_sub(1)) {
                let least = sets[before].numbers()[1];
                Error::check(&format!("{name}_sets[{j}].peak"), *peak, "above the peak before it", |p| {
                    p > least
                })?;
            }
        }
        Ok(Self { signal, mean, std_dev, shape, len: sets.len(), numbers })
    }

    /// The signal.
    #[must_use]
    pub const fn signal(&self) -> Signal {
        self.signal
    }

    /// Mean that is subtracted, in the signal's unit.
    #[must_use]
    pub const fn mean(&self) -> f64 {
        self.mean
    }

    /// Standard deviation that the signal is divided by, in the signal's unit.
    #[must_use]
    pub const fn std_dev(&self) -> f64 {
        self.std_dev
    }

    /// Shape of the memberships.
    #[must_use]
    pub const fn shape(&self) -> Shape {
        self.shape
    }

    /// Number of memberships.
    #[must_use]
    #[expect(clippy::len_without_is_empty, reason = "there is always one set")]
    pub const fn len(&self) -> usize {
        self.len
    }

    /// The memberships.
    pub fn sets(&self) -> impl Iterator<Item = TskSet> + '_ {
        self.numbers[..self.len].iter().map(|numbers| TskSet::of(self.shape, *numbers))
    }

    /// `raw`, in the signal's unit, normalised for the memberships.
    #[inline]
    #[must_use]
    pub fn normalise(&self, raw: f64) -> f64 {
        (raw - self.mean) / self.std_dev
    }

    /// Weights of the sets at the normalised value `u`: not negative, with sum one; NaN if `u` is not finite.
    #[inline]
    #[must_use]
    pub fn weights(&self, u: f64) -> [f64; MAX_SETS] {
        let (mut strengths, sum) = self.strengths(u);
        for strength in &mut strengths[..self.len] {
            *strength /= sum;
        }
        strengths
    }

    /// Strengths up to a common factor, and their sum.
    #[inline]
    fn strengths(&self, u: f64) -> ([f64; MAX_SETS], f64) {
        if !u.is_finite() {
            return ([f64::NAN; MAX_SETS], f64::NAN);
        }
        let mut strengths = [0.0; MAX_SETS];
        if self.len == 1 {
            strengths[0] = 1.0;
            return (strengths, 1.0);
        }
        let u = u.clamp(-FARTHEST, FARTHEST);
        let sets = strengths.iter_mut().zip(&self.numbers[..self.len]);
        match self.shape {
            Shape::Gaussian => {
                let mut nearest = f64::INFINITY;
                for (strength, [centre, sigma, ..]) in sets {
                    let distance = (u - centre) / sigma;
                    *strength = 0.5 * distance * distance;
                    nearest = nearest.min(*strength);
                }
                for strength in &mut strengths[..self.len] {
                    *strength = exp(nearest - *strength);
                }
            }
            Shape::TwoSidedGaussian => self.relative(&mut strengths, u, two_sided_energy),
            Shape::Bell => {
                let mut sum = 0.0;
                for (strength, numbers) in sets {
                    *strength = 1.0 / (1.0 + bell_power(numbers, u));
                    sum += *strength;
                }
                if sum < LEAST_SUM {
                    self.relative(&mut strengths, u, bell_energy);
                }
            }
            Shape::Trapezoid => {
                for (strength, numbers) in sets {
                    *strength = trapezoid(numbers, u);
                }
            }
            Shape::Triangle => {
                for (j, (strength, [left, peak, right, _])) in sets.enumerate() {
                    let (foot, shoulder) =
                        if u <= *peak { (left, j == 0) } else { (right, j + 1 == self.len) };
                    *strength =
                        if shoulder || u == *peak { 1.0 } else { ((u - foot) / (peak - foot)).max(0.0) };
                }
            }
        }
        let sum: f64 = strengths[..self.len].iter().sum();
        if sum == 0.0 {
            strengths[self.nearest(u)] = 1.0;
            return (strengths, 1.0);
        }
        (strengths, sum)
    }

    /// Strengths exp(-energy), relative to the strongest.
    fn relative(
        &self,
        strengths: &mut [f64; MAX_SETS],
        u: f64,
        energy: impl Fn(&[f64; NUMBERS], f64) -> f64,
    ) {
        let mut nearest = f64::INFINITY;
        for (strength, numbers) in strengths.iter_mut().zip(&self.numbers[..self.len]) {
            *strength = energy(numbers, u);
            nearest = nearest.min(*strength);
        }
        for strength in &mut strengths[..self.len] {
            *strength = exp(nearest - *strength);
        }
    }

    /// Index of the triangle whose peak, or of the trapezoid whose plateau, is nearest to `u`.
    fn nearest(&self, u: f64) -> usize {
        // A triangle is a trapezoid with a plateau of no width at its peak.
        let distance = |j: usize| {
            let [_, b, c, _] = self.numbers[j];
            let c = if self.shape == Shape::Trapezoid { c } else { b };
            (b.min(c) - u).max(u - b.max(c))
        };
        (1..self.len).fold(0, |best, j| if distance(j) < distance(best) { j } else { best })
    }

    /// Weights and slopes at the normalised value `u`.
    #[inline]
    pub(crate) fn fire(&self, u: f64) -> Firing {
        let (strengths, sum) = self.strengths(u);
        let mut firing = Firing { weights: strengths, ..Firing::default() };
        for (j, weight) in firing.weights[..self.len].iter_mut().enumerate() {
            *weight /= sum;
            // A single set always has weight one, and a set that does not fire has slope zero.
            if self.len > 1 && *weight > 0.0 {
                let numbers = &self.numbers[j];
                firing.slopes[j] = match self.shape {
                    Shape::Gaussian => {
                        let [centre, sigma, ..] = numbers;
                        let distance = (u - centre) / sigma;
                        let slope = *weight * distance / sigma;
                        [slope, slope * distance, 0.0, 0.0]
                    }
                    Shape::TwoSidedGaussian => {
                        let [s1, c1, s2, c2] = numbers;
                        let (left, right) = (((c1 - u) / s1).max(0.0), ((u - c2) / s2).max(0.0));
                        [left * left / s1, -left / s1, right * right / s2, right / s2]
                            .map(|slope| *weight * slope)
                    }
                    Shape::Bell => bell_slopes(numbers, u, *weight),
                    Shape::Triangle => self.side_slopes(j, u).map(|slope| slope / sum),
                    Shape::Trapezoid => trapezoid_slopes(numbers, u).map(|slope| slope / sum),
                };
            }
        }
        firing
    }

    /// Derivatives of triangle j with respect to its left foot, peak and right foot.
    fn side_slopes(&self, j: usize, u: f64) -> [f64; NUMBERS] {
        let [left, peak, right, _] = self.numbers[j];
        if u <= peak && j > 0 && left < u {
            // (u - a) / (b - a)
            [u - peak, left - u, 0.0, 0.0].map(|slope| slope / (peak - left).powi(2))
        } else if u > peak && j + 1 < self.len && u < right {
            // (d - u) / (d - b)
            [0.0, right - u, u - peak, 0.0].map(|slope| slope / (right - peak).powi(2))
        } else {
            [0.0; NUMBERS]
        }
    }
}

/// Derivatives of a bell with respect to its numbers, times `weight` / g:
///
/// ```text
/// dg/da = (2 b/a) g (1 - g),   dg/db = -2 ln|(u - c)/a| g (1 - g),   dg/dc = 2 b/(u - c) g (1 - g)
/// ```
///
/// At the centre all three are zero; with b of at most 1/2, where dg/dc has no limit, zero is its mean of both sides.
fn bell_slopes(numbers: &[f64; NUMBERS], u: f64, weight: f64) -> [f64; NUMBERS] {
    let [a, b, c, _] = *numbers;
    let distance = u - c;
    if distance == 0.0 {
        return [0.0; NUMBERS];
    }
    // 1 - g, which neither overflows nor cancels.
    let slope = weight / (1.0 + 1.0 / bell_power(numbers, u));
    [2.0 * b / a * slope, -2.0 * ln((distance / a).abs()) * slope, 2.0 * b / distance * slope, 0.0]
}
