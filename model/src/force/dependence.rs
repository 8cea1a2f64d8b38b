//! Dependence of a model's parameters on the drive: one mechanism for every model without a current input of its
//! own.
//!
//! ```text
//! none         p
//! polynomial   p_j(i) = c_j0 + c_j1 i + ... + c_jd i^d
//! fuzzy        sum_s w_s(i) f(p_s),     w_s: Gaussian sets, see [`FuzzySets`]
//! ```
//!
//! In both forms there are *copies* of the parameters, one per power or set. Each copy has a weight that depends
//! on the drive: powers of the drive blend parameters, sets blend outputs. The two are equivalent for a model that
//! is linear in its parameters.

use super::sets::{FuzzySets, MAX_FUNCTIONS};
use crate::error::Error;
use crate::sample::DriveKind;

/// Largest degree of a polynomial in the drive.
pub const MAX_DEGREE: usize = 5;

/// How the parameters of a model depend on the drive.
///
/// ```
/// use mr_damper_model::force::{Dependence, FuzzySets, Membership};
/// use mr_damper_model::sample::DriveKind::CoilCurrent;
///
/// // Polynomials: the coefficient of i^d has the weight i^d.
/// let quadratic = Dependence::Polynomial { drive: CoilCurrent, degree: 2 };
/// assert_eq!((quadratic.copies(), &quadratic.weights(2.0)[..3]), (3, &[1.0, 2.0, 4.0][..]));
/// // Fuzzy sets: midway between two centres, both outputs have the weight 1/2.
/// let sets = FuzzySets::new(Membership { drive: CoilCurrent, sigma: 0.5 }, &[0.0, 2.0])?;
/// assert_eq!(Dependence::Fuzzy(sets).weights(1.0)[..2], [0.5, 0.5]);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[allow(clippy::large_enum_variant, reason = "boxing the sets would put them on the heap, out of `Copy`")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Dependence {
    /// No dependence: a passive model.
    None,
    /// Polynomials in the drive.
    Polynomial {
        /// The variable of the polynomials.
        drive: DriveKind,
        /// Degree, 1 to [`MAX_DEGREE`].
        degree: usize,
    },
    /// One full set of parameters per fuzzy set; forces are blended.
    Fuzzy(FuzzySets),
}

impl Dependence {
    /// The drive; `None` for a passive model.
    #[must_use]
    pub const fn drive(&self) -> Option<DriveKind> {
        match self {
            Self::None => None,
            Self::Polynomial { drive, .. } => Some(*drive),
            Self::Fuzzy(sets) => Some(sets.drive()),
        }
    }

    /// Number of coefficients per parameter: one, one per power, or one per set.
    #[must_use]
    pub const fn copies(&self) -> usize {
        match self {
            Self::None => 1,
            Self::Polynomial { degree, .. } => *degree + 1,
            Self::Fuzzy(sets) => sets.len(),
        }
    }

    /// The name in model files: `none`, `polynomial`, `fuzzy`.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Polynomial { .. } => "polynomial",
            Self::Fuzzy(_) => "fuzzy",
        }
    }

    /// Refuses a polynomial whose degree is not 1 to [`MAX_DEGREE`].
    pub(super) fn check(&self) -> Result<(), Error> {
        let Self::Polynomial { degree, .. } = self else { return Ok(()) };
        Error::check("degree", *degree as f64, "1 to 5", |d| (1.0..=MAX_DEGREE as f64).contains(&d))?;
        Ok(())
    }

    /// Weight of each copy of the parameters at drive `i`: one, powers of `i`, or the weights of the sets. Entries
    /// beyond [`Dependence::copies`] are zero.
    #[inline]
    #[must_use]
    pub fn weights(&self, i: f64) -> [f64; MAX_FUNCTIONS] {
        let mut weights = [0.0; MAX_FUNCTIONS];
        match self {
            Self::None => weights[0] = 1.0,
            Self::Polynomial { degree, .. } => {
                let mut power = 1.0;
                for weight in &mut weights[..=*degree] {
                    *weight = power;
                    power *= i;
                }
            }
            Self::Fuzzy(sets) => return sets.weights(i),
        }
        weights
    }
}
