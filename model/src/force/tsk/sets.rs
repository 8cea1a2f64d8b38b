//! Memberships of one input of a TSK model, and their firing strengths.
//!
//! ```text
//! u      = (raw - mean) / std_dev
//! g_j(u) = exp(-(u - c_j)^2 / (2 s_j^2))                          Gaussian
//! g_j(u) = max(0, min((u - a_j)/(b_j - a_j), (d_j - u)/(d_j - b_j)))   triangle: feet a, d, peak b
//! w_j(u) = g_j / sum_k g_k
//! ```
//!
//! Strengths of Gaussians are computed relative to the strongest one. Far outside all of them the exponentials
//! underflow and a plain quotient would be 0/0. Relative to the strongest, only one set counts: the nearest,
//! or very far out the widest. Triangles become shoulders at the ends: the first is one below its peak, and
//! the last is one above its peak. In a gap that no triangle covers, only the set with the nearest peak
//! counts.

use super::Signal;
use crate::error::{Error, ForceError};

/// Largest number of memberships of one input.
pub const MAX_SETS: usize = 5;
/// Smallest sigma of a Gaussian, in standard deviations of its input. A narrower set is a spike between
/// samples.
const LEAST_SIGMA: f64 = 1e-6;
/// Beyond this many standard deviations the weights are held constant: their differences would be lost to
/// rounding.
const FARTHEST: f64 = 1e6;

/// One membership function, over the normalised input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TskSet {
    /// exp(-(u - centre)^2 / (2 sigma^2)).
    Gaussian {
        /// Position of the maximum.
        centre: f64,
        /// Standard deviation.
        sigma: f64,
    },
    /// One at the peak, zero at the feet, linear between.
    Triangle {
        /// Left foot; unused for the first set, which is a shoulder.
        left: f64,
        /// Position of the maximum.
        peak: f64,
        /// Right foot; unused for the last set.
        right: f64,
    },
}

/// Shape of an input's memberships.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Gaussian bells.
    Gaussian,
    /// Triangles, with shoulders at the ends.
    Triangle,
}

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
    /// Centre, sigma and zero; or left foot, peak, right foot.
    pub(super) numbers: [[f64; 3]; MAX_SETS],
}

/// Weights of one input's sets, and their derivatives with respect to the sets' numbers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Firing {
    /// w_j: not negative, with sum one.
    pub(crate) weights: [f64; MAX_SETS],
    /// Derivative of g_j with respect to its own numbers, divided by sum_k g_k. Let A_j be the output of the
    /// rules of set j alone and F the output; then dF/dp_j = (A_j - F) times this.
    pub(crate) slopes: [[f64; 3]; MAX_SETS],
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
        let mut numbers = [[0.0; 3]; MAX_SETS];
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
        self.numbers[..self.len].iter().map(|n| match self.shape {
            Shape::Gaussian => TskSet::Gaussian { centre: n[0], sigma: n[1] },
            Shape::Triangle => TskSet::Triangle { left: n[0], peak: n[1], right: n[2] },
        })
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
                for (strength, [centre, sigma, _]) in sets {
                    let distance = (u - centre) / sigma;
                    *strength = 0.5 * distance * distance;
                    nearest = nearest.min(*strength);
                }
                for strength in &mut strengths[..self.len] {
                    *strength = (nearest - *strength).exp();
                }
            }
            Shape::Triangle => {
                for (j, (strength, [left, peak, right])) in sets.enumerate() {
                    let (foot, shoulder) =
                        if u <= *peak { (left, j == 0) } else { (right, j + 1 == self.len) };
                    *strength =
                        if shoulder || u == *peak { 1.0 } else { ((u - foot) / (peak - foot)).max(0.0) };
                }
            }
        }
        let sum: f64 = strengths[..self.len].iter().sum();
        if sum == 0.0 {
            strengths[self.nearest_peak(u)] = 1.0;
            return (strengths, 1.0);
        }
        (strengths, sum)
    }

    /// Index of the triangle whose peak is nearest to `u`.
    fn nearest_peak(&self, u: f64) -> usize {
        let distance = |j: usize| (u - self.numbers[j][1]).abs();
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
                firing.slopes[j] = match self.shape {
                    Shape::Gaussian => {
                        let [centre, sigma, _] = self.numbers[j];
                        let distance = (u - centre) / sigma;
                        let slope = *weight * distance / sigma;
                        [slope, slope * distance, 0.0]
                    }
                    Shape::Triangle => self.side_slopes(j, u).map(|slope| slope / sum),
                };
            }
        }
        firing
    }

    /// Derivatives of triangle j with respect to its left foot, peak and right foot.
    fn side_slopes(&self, j: usize, u: f64) -> [f64; 3] {
        let [left, peak, right] = self.numbers[j];
        if u <= peak && j > 0 && left < u {
            // (u - a) / (b - a)
            [u - peak, left - u, 0.0].map(|slope| slope / (peak - left).powi(2))
        } else if u > peak && j + 1 < self.len && u < right {
            // (d - u) / (d - b)
            [0.0, right - u, u - peak].map(|slope| slope / (right - peak).powi(2))
        } else {
            [0.0; 3]
        }
    }
}

impl TskSet {
    /// The shape.
    #[must_use]
    pub const fn shape(&self) -> Shape {
        match self {
            Self::Gaussian { .. } => Shape::Gaussian,
            Self::Triangle { .. } => Shape::Triangle,
        }
    }

    /// Position of the maximum: the centre or the peak.
    #[must_use]
    pub const fn top(&self) -> f64 {
        match *self {
            Self::Gaussian { centre, .. } => centre,
            Self::Triangle { peak, .. } => peak,
        }
    }

    const fn numbers(&self) -> [f64; 3] {
        match *self {
            Self::Gaussian { centre, sigma } => [centre, sigma, 0.0],
            Self::Triangle { left, peak, right } => [left, peak, right],
        }
    }

    /// Checks the numbers. The outer foot of a shoulder may equal its peak.
    fn check(&self, name: &str, left_counts: bool, right_counts: bool) -> Result<(), Error> {
        match *self {
            Self::Gaussian { centre, sigma } => {
                Error::check(&format!("{name}.centre"), centre, "finite", |_| true)?;
                Error::check(&format!("{name}.sigma"), sigma, "finite and at least 1e-6", |s| {
                    s >= LEAST_SIGMA
                })?;
            }
            Self::Triangle { left, peak, right } => {
                Error::check(&format!("{name}.peak"), peak, "finite", |_| true)?;
                Error::check(&format!("{name}.left"), left, "below the peak", |l| {
                    l < peak || (l == peak && !left_counts)
                })?;
                Error::check(&format!("{name}.right"), right, "above the peak", |r| {
                    r > peak || (r == peak && !right_counts)
                })?;
            }
        }
        Ok(())
    }
}
