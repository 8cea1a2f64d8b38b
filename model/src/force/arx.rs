//! ARX: autoregression with exogenous inputs (thesis 4.3 passive, 4.4 semi-active).
//!
//! ```text
//! F_k = a1 F_{k-1} + a2 F_{k-2} + a3 F_{k-3}
//!     + a4 x_k + a5 x_{k-1} + a6 x_{k-2}
//!     + a7 v_k + a8 v_{k-1} + a9 v_{k-2}
//!   [ + a10 i_k + a11 i_{k-1} + a12 i_{k-2} ]           semi-active only
//! ```
//!
//! F is the force minus the session's offset, N; x displacement, m; v velocity, m/s; i the drive, A or V; k counts samples
//! of period Ts, so the coefficients hold at one rate only. The semi-active current terms are inferred from the passive
//! form, because the thesis' equation is missing in the source.
//!
//! `savaresi` has two lags of each signal instead (thesis 2.8, after Savaresi et al.):
//!
//! ```text
//! F_k = a1 F_{k-1} + a2 F_{k-2} + a3 x_k + a4 x_{k-1} + a5 v_k + a6 v_{k-1} [ + a7 i_k + a8 i_{k-1} ]
//! ```
//!
//! `arx-delayed` has the three lags of paper 1 of the thesis (equation 5), whose inputs start at the sample before:
//!
//! ```text
//! F_k = a1 F_{k-1} + a2 F_{k-2} + a3 F_{k-3}
//!     + a4 x_{k-1} + a5 x_{k-2} + a6 x_{k-3}
//!     + a7 v_{k-1} + a8 v_{k-2} + a9 v_{k-3} [ + a10 i_{k-1} + a11 i_{k-2} + a12 i_{k-3} ]
//! ```
//!
//! Its force at a sample does not depend on the motion and the drive of that sample.
//!
//! With measured force as input, the model is a one-step-ahead predictor. It is accurate but does not show missing effects,
//! because each effect is contained in the measured force. With its own output as input, it is a simulation (free run). An
//! error figure never mixes the two. If v is the backward difference of x, the nine regressors have rank seven: single
//! coefficients are then not determined, but the sum of their products is.
//!
//! Source: `[thesis]`, `[thesis-paper1]` and `[savaresi2005]` in the bibliography (node/docs/guide/bibliography.md), equations 4.3, 4.4 and 2.8 of the
//! thesis, 4 and 5 of its first paper.

use super::history::{History, known};
use crate::error::Error;
use crate::sample::DriveKind;
use crate::units::Second;
use nalgebra::Matrix3;

/// Number of lags of each signal in the regression.
pub const LAGS: usize = 3;
/// Number of lags of each signal for `savaresi`.
pub const SAVARESI_LAGS: usize = 2;

/// Number of lags of each signal, and the delay of the inputs: they tell the ARX structures apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ArxShape {
    /// Number of lags of each signal.
    pub(crate) lags: usize,
    /// Number of samples by which displacement, velocity and drive enter later.
    pub(crate) delay: usize,
}

impl ArxShape {
    /// `arx`.
    pub(crate) const PLAIN: Self = Self { lags: LAGS, delay: 0 };
    /// `arx-delayed`.
    pub(crate) const DELAYED: Self = Self { lags: LAGS, delay: 1 };
    /// `savaresi`.
    pub(crate) const SAVARESI: Self = Self { lags: SAVARESI_LAGS, delay: 0 };

    /// The model's name, as in the contract.
    pub(crate) const fn name(self) -> &'static str {
        match (self.lags, self.delay) {
            (SAVARESI_LAGS, _) => "savaresi",
            (_, 0) => "arx",
            _ => "arx-delayed",
        }
    }

    /// The model of this shape with the given coefficients, `lags` of each signal, in the units of [`Arx::new`].
    ///
    /// # Errors
    /// [`Error::Length`] for another number of coefficients; otherwise the same as for [`Arx::new`].
    pub(crate) fn model(
        self,
        [force, displacement_n_m, velocity_n_s_m]: [&[f64]; 3],
        drive: Option<(DriveKind, &[f64])>,
        sample_period: Second,
        force_offset_n: f64,
    ) -> Result<Arx, Error> {
        let padded = |name: &str, list: &[f64]| {
            if list.len() != self.lags {
                let (found, expected) = (list.len(), self.lags.to_string());
                return Err(Error::Length { name: format!("parameters.{name}"), found, expected });
            }
            Ok(std::array::from_fn(|j| list.get(j).copied().unwrap_or(0.0)))
        };
        let force = padded("force_lags", force)?;
        let displacement_n_m = padded("displacement_lags_n_m", displacement_n_m)?;
        let velocity_n_s_m = padded("velocity_lags_n_s_m", velocity_n_s_m)?;
        let drive = match drive {
            Some((kind, list)) => Some((kind, padded("drive lags", list)?)),
            None => None,
        };
        let arx = Arx::new(force, displacement_n_m, velocity_n_s_m, drive, sample_period, force_offset_n)?;
        Ok(Arx { lags: self.lags, delay: self.delay, ..arx })
    }
}

/// The ARX model.
///
/// ```
/// use mr_damper_model::force::Arx;
/// use mr_damper_model::sample::DriveKind;
/// use mr_damper_model::units::Second;
///
/// // F_k = 0.5 F_{k-1} + 500 v_k + 100 i_k has one pole at 0.5, so its simulation is stable.
/// let drive = Some((DriveKind::CoilCurrent, [100.0, 0.0, 0.0]));
/// let arx = Arx::new([0.5, 0.0, 0.0], [0.0; 3], [500.0, 0.0, 0.0], drive, Second(1.0 / 512.0), 0.0)?;
/// assert!((arx.pole_moduli()[0] - 0.5).abs() < 1e-6);
/// assert_eq!((arx.parameter_count(), arx.drive()), (12, Some(DriveKind::CoilCurrent)));
///
/// let error = Arx::new([f64::NAN; 3], [0.0; 3], [0.0; 3], None, Second(1.0 / 512.0), 0.0).unwrap_err();
/// assert_eq!(error.to_string(), "force_lags[0] is NaN, but must be finite");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arx {
    /// Number of lags of each signal; coefficients beyond are zero.
    lags: usize,
    /// Number of samples by which displacement, velocity and drive enter later: 0, or 1 for `arx-delayed`.
    delay: usize,
    force: [f64; LAGS],
    displacement_n_m: [f64; LAGS],
    velocity_n_s_m: [f64; LAGS],
    drive: Option<(DriveKind, [f64; LAGS])>,
    sample_period_s: f64,
    force_offset_n: f64,
    resolution: f64,
}

impl Arx {
    /// An ARX model from its coefficients in SI units: `force` = a1..a3 (1), `displacement_n_m` = a4..a6,
    /// `velocity_n_s_m` = a7..a9, `drive` = a10..a12 (N/A or N/V) or `None` for the passive form.
    ///
    /// # Errors
    /// When a number is not finite or the sample period is not positive.
    pub fn new(
        force: [f64; LAGS],
        displacement_n_m: [f64; LAGS],
        velocity_n_s_m: [f64; LAGS],
        drive: Option<(DriveKind, [f64; LAGS])>,
        sample_period: Second,
        force_offset_n: f64,
    ) -> Result<Self, Error> {
        let drive_coefficients = drive.map_or([0.0; LAGS], |(_, c)| c);
        for (name, values) in [
            ("force_lags", force),
            ("displacement_lags_n_m", displacement_n_m),
            ("velocity_lags_n_s_m", velocity_n_s_m),
            ("drive_lags", drive_coefficients),
        ] {
            for (j, value) in values.into_iter().enumerate() {
                Error::check(&format!("{name}[{j}]"), value, "finite", |_| true)?;
            }
        }
        Error::check("force_offset_n", force_offset_n, "finite", |_| true)?;
        let sample_period_s =
            Error::check("sample_period_s", sample_period.get(), "positive and finite", |t| t > 0.0)?;
        Ok(Self {
            lags: LAGS,
            delay: 0,
            force,
            displacement_n_m,
            velocity_n_s_m,
            drive,
            sample_period_s,
            force_offset_n,
            resolution: 0.0,
        })
    }

    /// A `savaresi` model: like [`Arx::new`], with two lags of each signal.
    ///
    /// # Errors
    /// The same as for [`Arx::new`].
    pub fn savaresi(
        force: [f64; SAVARESI_LAGS],
        displacement_n_m: [f64; SAVARESI_LAGS],
        velocity_n_s_m: [f64; SAVARESI_LAGS],
        drive: Option<(DriveKind, [f64; SAVARESI_LAGS])>,
        sample_period: Second,
        force_offset_n: f64,
    ) -> Result<Self, Error> {
        let lists = [force.as_slice(), &displacement_n_m, &velocity_n_s_m];
        let drive = drive.as_ref().map(|(kind, list)| (*kind, list.as_slice()));
        ArxShape::SAVARESI.model(lists, drive, sample_period, force_offset_n)
    }

    /// An `arx-delayed` model: like [`Arx::new`], with coefficients for the inputs of samples k-1 to k-3.
    ///
    /// # Errors
    /// The same as for [`Arx::new`].
    pub fn delayed(
        force: [f64; LAGS],
        displacement_n_m: [f64; LAGS],
        velocity_n_s_m: [f64; LAGS],
        drive: Option<(DriveKind, [f64; LAGS])>,
        sample_period: Second,
        force_offset_n: f64,
    ) -> Result<Self, Error> {
        let lists = [force.as_slice(), &displacement_n_m, &velocity_n_s_m];
        let drive = drive.as_ref().map(|(kind, list)| (*kind, list.as_slice()));
        ArxShape::DELAYED.model(lists, drive, sample_period, force_offset_n)
    }

    /// The model's name, as in the contract: `arx` with three lags, `savaresi` with two, and `arx-delayed` with three
    /// lags of inputs that start at the sample before.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        ArxShape { lags: self.lags, delay: self.delay }.name()
    }

    /// Number of samples by which displacement, velocity and drive enter later: 0, or 1 for `arx-delayed`.
    #[must_use]
    pub const fn delay(&self) -> usize {
        self.delay
    }

    /// Number of lags of each signal: 3, or 2 for `savaresi`, whose third coefficients are zero.
    #[must_use]
    pub const fn lags(&self) -> usize {
        self.lags
    }

    /// The same model with coefficients known only to `resolution` (half a unit of the last printed digit).
    #[must_use]
    pub const fn with_resolution(mut self, resolution: f64) -> Self {
        self.resolution = resolution;
        self
    }

    /// Half a unit of the last known digit of the coefficients; zero if they are exact.
    #[must_use]
    pub const fn resolution(&self) -> f64 {
        self.resolution
    }

    /// a1..a3, the coefficients of the force lags.
    #[must_use]
    pub const fn force_lags(&self) -> [f64; LAGS] {
        self.force
    }

    /// a4..a6, N/m; the first belongs to sample k, or k-1 with a [`Arx::delay`].
    #[must_use]
    pub const fn displacement_lags_n_m(&self) -> [f64; LAGS] {
        self.displacement_n_m
    }

    /// a7..a9, N·s/m, from the same sample on.
    #[must_use]
    pub const fn velocity_lags_n_s_m(&self) -> [f64; LAGS] {
        self.velocity_n_s_m
    }

    /// a10..a12 with the kind of drive, N/A or N/V; `None` for the passive form.
    #[must_use]
    pub const fn drive_lags(&self) -> Option<(DriveKind, [f64; LAGS])> {
        self.drive
    }

    /// The drive that the model needs; `None` for the passive form.
    #[must_use]
    pub const fn drive(&self) -> Option<DriveKind> {
        match self.drive {
            Some((kind, _)) => Some(kind),
            None => None,
        }
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

    /// 9 for the passive form, 12 for the semi-active one; 6 and 8 for `savaresi`.
    #[must_use]
    pub const fn parameter_count(&self) -> usize {
        if self.drive.is_some() { 4 * self.lags } else { 3 * self.lags }
    }

    /// Moduli of the three poles (one is zero for `savaresi`), largest first. The simulation is stable if all are below
    /// one.
    #[must_use]
    pub fn pole_moduli(&self) -> [f64; LAGS] {
        let [a1, a2, a3] = self.force;
        let companion = Matrix3::new(a1, a2, a3, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
        let poles = companion.complex_eigenvalues();
        let mut moduli = [poles[0].norm(), poles[1].norm(), poles[2].norm()];
        moduli.sort_by(|a, b| b.total_cmp(a));
        moduli
    }

    /// False if 1 - a1 - a2 - a3, on which every static force depends, is uncertain by more than a third because the
    /// coefficients are rounded. The model can then predict one step ahead, but its simulation is not valid at low
    /// frequency.
    #[must_use]
    pub fn dc_is_meaningful(&self) -> bool {
        let gap = 1.0 - self.force.iter().sum::<f64>();
        gap > 3.0 * (self.lags as f64 * self.resolution)
    }

    /// The predicted force, N; `None` if a needed lag is not known.
    #[inline]
    #[must_use]
    pub fn predict_n(&self, history: &History) -> Option<f64> {
        let drive = &history.drive[self.delay..];
        if self.drive.is_some() && !known(drive, self.lags) {
            return None;
        }
        let lags = ..self.lags;
        let coefficients = [&self.force[lags], &self.displacement_n_m[lags], &self.velocity_n_s_m[lags]];
        let mut force = history.regress(self.force_offset_n, self.delay, coefficients)?;
        if let Some((_, coefficients)) = &self.drive {
            for (coefficient, drive) in coefficients[..self.lags].iter().zip(drive) {
                force += coefficient * drive;
            }
        }
        Some(force)
    }

    /// The same model with another session's force offset, N.
    #[must_use]
    pub const fn with_force_offset_n(mut self, force_offset_n: f64) -> Self {
        self.force_offset_n = force_offset_n;
        self
    }
}
