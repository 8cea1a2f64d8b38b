//! Fuzzy sets over the drive (thesis 4.8): Gaussian memberships with one width.
//!
//! ```text
//! w_j(i) = exp(-(i - c_j)^2 / (2 sigma^2)) / sum_k exp(-(i - c_k)^2 / (2 sigma^2))
//! ```
//!
//! Every model whose functions stand side by side over the current is blended by these.

use crate::error::Error;
use crate::sample::DriveKind;

/// The most fuzzy sets that one model can hold.
pub const MAX_FUNCTIONS: usize = 16;

/// Gaussian membership functions over the drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Membership {
    /// What is fuzzified: current in A, or command voltage in V.
    pub drive: DriveKind,
    /// Standard deviation of every set, in the unit of `drive`.
    pub sigma: f64,
}

/// Memberships with their centres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FuzzySets {
    membership: Membership,
    len: usize,
    centres: [f64; MAX_FUNCTIONS],
}

impl FuzzySets {
    /// One set around each of `centres`.
    ///
    /// # Errors
    /// When there are no centres or more than [`MAX_FUNCTIONS`], when they do not increase, when sigma is not
    /// positive, or a number is not finite.
    pub fn new(membership: Membership, centres: &[f64]) -> Result<Self, Error> {
        let unit = membership.drive.unit_suffix();
        Error::check(&format!("membership_sigma_{unit}"), membership.sigma, "positive and finite", |s| {
            s > 0.0
        })?;
        if centres.is_empty() || centres.len() > MAX_FUNCTIONS {
            return Err(Error::Length {
                name: format!("membership_centres_{unit}"),
                found: centres.len(),
                expected: format!("1 to {MAX_FUNCTIONS}"),
            });
        }
        Error::check(&format!("membership_centres_{unit}[0]"), centres[0], "finite", |_| true)?;
        for (j, pair) in centres.windows(2).enumerate() {
            let name = format!("membership_centres_{unit}[{}]", j + 1);
            Error::check(&name, pair[1], "greater than the centre before it", |c| c > pair[0])?;
        }
        let mut sets = Self { membership, len: centres.len(), centres: [0.0; MAX_FUNCTIONS] };
        sets.centres[..centres.len()].copy_from_slice(centres);
        Ok(sets)
    }

    /// Which drive the sets are over.
    #[must_use]
    pub const fn drive(&self) -> DriveKind {
        self.membership.drive
    }

    /// Width of the sets, in the unit of the drive.
    #[must_use]
    pub const fn sigma(&self) -> f64 {
        self.membership.sigma
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

    /// Normalised firing strengths of the sets at drive `i`: they are positive and sum to one.
    ///
    /// Strengths are taken relative to the nearest set. Far outside the centres all exponentials underflow,
    /// and a plain quotient would be 0/0; relative to the nearest set the model goes over to that set's
    /// function instead.
    #[inline]
    #[must_use]
    pub fn weights(&self, i: f64) -> [f64; MAX_FUNCTIONS] {
        let mut weights = [0.0; MAX_FUNCTIONS];
        let scale = -0.5 / (self.membership.sigma * self.membership.sigma);
        let mut nearest = f64::INFINITY;
        for (weight, centre) in weights.iter_mut().zip(self.centres()) {
            let distance = i - centre;
            *weight = distance * distance;
            nearest = nearest.min(*weight);
        }
        let mut sum = 0.0;
        for weight in &mut weights[..self.len] {
            *weight = (scale * (*weight - nearest)).exp();
            sum += *weight;
        }
        for weight in &mut weights[..self.len] {
            *weight /= sum;
        }
        weights
    }
}
