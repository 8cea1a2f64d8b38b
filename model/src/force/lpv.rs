//! Linear parameter-varying (LPV) ARX: the coefficients depend on the drive (future work in the thesis).
//!
//! ```text
//! F_k = F0 + sum_{l=1..3} a_l(i_k) (F_{k-l} - F0) + b_l(i_k) x_{k-l+1} + c_l(i_k) v_{k-l+1}
//! a_l(i) = sum_d a_ld i^d                 polynomials, or
//! a_l(i) = sum_s w_s(i) a_ls              fuzzy sets over the drive
//! ```
//!
//! F is force, N; x displacement, m; v velocity, m/s; i the drive, A or V, at the same sample; F0 the session's
//! offset, N; k counts samples of period Ts, so the coefficients hold at one rate only.
//!
//! The semi-active ARX adds terms in the current, which shift the force by the same amount in both directions of
//! motion. In this model the current changes the dynamics: gain and poles. The model is still linear in displacement
//! and velocity, so the knee of the force-velocity curve enters only through measured force: it predicts well one
//! step ahead, but its simulation has no knee. At a constant current it is a plain ARX ([`Lpv::frozen`]). Stability
//! of all frozen models does not make the LPV model stable, but an unstable one is a warning.
//!
//! Source: `[thesis]` in the bibliography (node/docs/guide/bibliography.md), future work of the thesis.

use super::arx::{Arx, LAGS};
use super::dependence::Dependence;
use super::history::{History, known};
use super::sets::MAX_FUNCTIONS;
use crate::error::{Error, ForceError};
use crate::units::Second;

/// Number of regressors: lags of force, displacement and velocity.
pub const LPV_REGRESSORS: usize = 3 * LAGS;
/// Largest number of coefficients.
const MAX_COEFFICIENTS: usize = LPV_REGRESSORS * MAX_FUNCTIONS;

/// The LPV model.
///
/// ```
/// use mr_damper_model::force::{Dependence, LPV_REGRESSORS, Lpv};
/// use mr_damper_model::sample::DriveKind;
/// use mr_damper_model::units::Second;
///
/// // F_k = 0.5 F_{k-1} + (100 + 400 i) v_k
/// let mut coefficients = [0.0; 2 * LPV_REGRESSORS];
/// (coefficients[0], coefficients[6], coefficients[LPV_REGRESSORS + 6]) = (0.5, 100.0, 400.0);
/// let linear = Dependence::Polynomial { drive: DriveKind::CoilCurrent, degree: 1 };
/// let lpv = Lpv::new(linear, &coefficients, Second(1.0 / 512.0), 0.0)?;
///
/// let at_2_a = lpv.frozen(2.0)?;
/// assert_eq!((at_2_a.force_lags()[0], at_2_a.velocity_lags_n_s_m()[0]), (0.5, 900.0));
/// assert!(Lpv::new(Dependence::None, &coefficients[..9], Second(1.0 / 512.0), 0.0).is_err(), "that is an ARX model");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lpv {
    dependence: Dependence,
    /// Copy by copy: three force lags, three displacement lags (N/m), three velocity lags (N s/m).
    coefficients: [f64; MAX_COEFFICIENTS],
    sample_period_s: f64,
    force_offset_n: f64,
}

impl Lpv {
    /// A model from its coefficients in SI units, copy by copy (one copy per power of the drive or fuzzy set). Each
    /// copy holds three force lags, three displacement lags (N/m) and three velocity lags (N·s/m), each per power of
    /// the drive.
    ///
    /// # Errors
    /// When the number of coefficients is not [`LPV_REGRESSORS`] times the copies, the dependence is none (use the
    /// passive ARX), a number is not finite or the sample period is not positive.
    pub fn new(
        dependence: Dependence,
        coefficients: &[f64],
        sample_period: Second,
        force_offset_n: f64,
    ) -> Result<Self, Error> {
        dependence.check()?;
        if dependence.drive().is_none() {
            return Err(ForceError::LpvWithoutDrive.into());
        }
        let needed = LPV_REGRESSORS * dependence.copies();
        if coefficients.len() != needed {
            return Err(Error::Length {
                name: "coefficients of lpv".to_owned(),
                found: coefficients.len(),
                expected: format!("{needed} ({LPV_REGRESSORS} regressors times {})", dependence.copies()),
            });
        }
        for (index, value) in coefficients.iter().enumerate() {
            let (copy, regressor) = (index / LPV_REGRESSORS, index % LPV_REGRESSORS);
            let list = ["force_lags", "displacement_lags_n_m", "velocity_lags_n_s_m"][regressor / LAGS];
            let name = format!("{list}[{}][{copy}]", regressor % LAGS);
            Error::check(&name, *value, "finite", |_| true)?;
        }
        Error::check("force_offset_n", force_offset_n, "finite", |_| true)?;
        let sample_period_s =
            Error::check("sample_period_s", sample_period.get(), "positive and finite", |t| t > 0.0)?;
        let mut model =
            Self { dependence, coefficients: [0.0; MAX_COEFFICIENTS], sample_period_s, force_offset_n };
        model.coefficients[..needed].copy_from_slice(coefficients);
        Ok(model)
    }

    /// How the coefficients depend on the drive.
    #[must_use]
    pub const fn dependence(&self) -> &Dependence {
        &self.dependence
    }

    /// All coefficients, copy by copy; see [`Lpv::new`].
    #[must_use]
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients[..self.parameter_count()]
    }

    /// Nine per copy.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        LPV_REGRESSORS * self.dependence.copies()
    }

    /// The sample period at which the coefficients hold.
    #[must_use]
    pub const fn sample_period(&self) -> Second {
        Second(self.sample_period_s)
    }

    /// Force offset of the session, N.
    #[must_use]
    pub const fn force_offset_n(&self) -> f64 {
        self.force_offset_n
    }

    /// The same model with another session's force offset, N.
    #[must_use]
    pub const fn with_force_offset_n(mut self, force_offset_n: f64) -> Self {
        self.force_offset_n = force_offset_n;
        self
    }

    /// The coefficients at drive `i`.
    #[inline]
    fn coefficients_at(&self, i: f64) -> [f64; LPV_REGRESSORS] {
        let mut at = [0.0; LPV_REGRESSORS];
        for (copy, weight) in self.coefficients().chunks_exact(LPV_REGRESSORS).zip(self.dependence.weights(i))
        {
            at.iter_mut().zip(copy).for_each(|(sum, coefficient)| *sum += weight * coefficient);
        }
        at
    }

    /// The passive ARX that the model equals at the constant drive `i`, in the unit of its drive.
    ///
    /// # Errors
    /// When `i` is not finite, or so large that a coefficient is not finite.
    pub fn frozen(&self, i: f64) -> Result<Arx, Error> {
        let at = self.coefficients_at(i);
        let of = |signal: usize| std::array::from_fn(|lag| at[signal * LAGS + lag]);
        Arx::new(of(0), of(1), of(2), None, self.sample_period(), self.force_offset_n)
    }

    /// The predicted force, N; `None` if a needed lag is not known.
    #[inline]
    #[must_use]
    pub fn predict_n(&self, history: &History) -> Option<f64> {
        if !known(&history.drive, 1) {
            return None;
        }
        let at = self.coefficients_at(history.drive[0]);
        let of = |signal: usize| &at[signal * LAGS..(signal + 1) * LAGS];
        history.regress(self.force_offset_n, 0, [of(0), of(1), of(2)])
    }
}
