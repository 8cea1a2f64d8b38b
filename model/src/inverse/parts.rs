//! The numbers of an inverse controller, for code that is written from it: see the crate `mr-damper-export`.

use super::limits::Limits;
use crate::force::Tsk;
use crate::inverse_model::InverseModel;

/// The numbers of an inverse controller.
///
/// ```
/// use mr_damper_model::inverse::{InverseController, InverseMap, Limits, Method};
/// use mr_damper_model::preset;
///
/// let model = preset::load(preset::BEST_FUZZY_TANH)?;
/// let controller = InverseController::with_method(&model, Limits::default(), Method::Polynomial)?;
/// let parts = controller.parts().expect("it has an inverse");
/// assert!(matches!(parts.map, InverseMap::Polynomial { fastest_m_s, .. } if fastest_m_s > 0.0));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InverseParts {
    /// The limits.
    pub limits: Limits,
    /// The model's largest force on the grid of [`super::Shape`], N.
    pub most_n: f64,
    /// True if the force turns back over the current, so that the range is searched in parts.
    pub folded: bool,
    /// True if the force at each motion is linear in the current.
    pub linear: bool,
    /// How the current is found.
    pub map: InverseMap,
}

/// How the current for a force is found; see [`super::Method`].
#[allow(clippy::large_enum_variant, reason = "built once, when code is written")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InverseMap {
    /// A search on the model.
    Search,
    /// `i = (Fd - sum_k b_k u^k) / sum_k c_k u^k` with `u` the velocity over `fastest_m_s`, clamped to 1.
    Polynomial {
        /// Velocity that the powers are scaled with, m/s.
        fastest_m_s: f64,
        /// b in N and c in N/A for a >= 0.
        rising: [[f64; 7]; 2],
        /// b in N and c in N/A for a < 0.
        falling: [[f64; 7]; 2],
    },
    /// Fuzzy rules over displacement, velocity and force, whose output is a current in A.
    Fuzzy {
        /// The rules.
        rules: Tsk,
        /// Range to which the displacement is clamped, m.
        displacement_m: [f64; 2],
        /// Largest speed, to which the velocity is clamped, m/s.
        fastest_m_s: f64,
    },
    /// A learned inverse of the model file. Where it gives no current, the search does.
    Learned(InverseModel),
}
