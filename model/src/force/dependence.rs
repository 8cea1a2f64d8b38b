//! How the parameters of a model follow the drive: one mechanism for every model that knows nothing of current.
//!
//! ```text
//! none         p
//! polynomial   p_j(i) = c_j0 + c_j1 i + ... + c_jd i^d
//! fuzzy        sum_s w_s(i) f(p_s),     w_s: Gaussian sets, see [`FuzzySets`]
//! ```
//!
//! Either way there are *copies* of the parameters, one for each power or set, and each copy counts for something
//! at a drive: powers of it blend parameters, sets blend outputs. (Of a model that is linear in its parameters the
//! two are the same.)

use super::sets::{FuzzySets, MAX_FUNCTIONS};
use crate::error::Error;
use crate::sample::DriveKind;

/// The highest power of the drive.
pub const MAX_DEGREE: usize = 4;

/// How the parameters of a model follow the drive.
#[allow(clippy::large_enum_variant, reason = "boxing the sets would put them on the heap, out of `Copy`")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Dependence {
    /// Not at all: a passive model.
    None,
    /// As polynomials.
    Polynomial {
        /// What the polynomials are in.
        drive: DriveKind,
        /// Their degree, 1 to [`MAX_DEGREE`].
        degree: usize,
    },
    /// One full set of parameters under each fuzzy set; forces are blended.
    Fuzzy(FuzzySets),
}

impl Dependence {
    /// Which drive it is on; `None` for a passive model.
    #[must_use]
    pub const fn drive(&self) -> Option<DriveKind> {
        match self {
            Self::None => None,
            Self::Polynomial { drive, .. } => Some(*drive),
            Self::Fuzzy(sets) => Some(sets.drive()),
        }
    }

    /// Coefficients behind each parameter: one, one for each power, or one for each set.
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

    /// Refuses a polynomial of a degree that is not 1 to [`MAX_DEGREE`].
    pub(super) fn check(&self) -> Result<(), Error> {
        let Self::Polynomial { degree, .. } = self else { return Ok(()) };
        Error::check("degree", *degree as f64, "1 to 4", |d| (1.0..=MAX_DEGREE as f64).contains(&d))?;
        Ok(())
    }

    /// What each copy of the parameters counts for at drive `i`: one, powers of `i`, or the weights of the sets.
    /// Entries beyond [`Dependence::copies`] are zero.
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
