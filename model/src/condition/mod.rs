//! Causal conditioning: turns stamped readings into the displacement and velocity that a model needs.
//!
//! The thesis low-passes displacement (two equal poles at 20 Hz) and differentiates it. Both are settings
//! here, and so is the position of the filter:
//!
//! - `inputs`: the model gets low-passed displacement; the measured force is not filtered. The thesis'
//!   coefficients are valid for this setting.
//! - `output`: the model gets raw displacement, and its force is low-passed; the measured force passes the
//!   same filter before the comparison. The two settings are not equivalent, because the model is nonlinear:
//!   they differ by an NMSE of about 0.009 on this damper.
//! - `none`: no filter.
//!
//! All computations use differences of stamps, so jitter or a changing rate needs no special treatment.

#![cfg_attr(not(test), deny(clippy::disallowed_methods))]

mod align;
mod derivative;
mod low_pass;
mod timing;

pub(crate) use align::{ForceAligner, Hold};
pub use low_pass::{LowPass, State as LowPassState};
pub(crate) use timing::Timing;

use crate::error::Error;
use crate::units::{Hertz, Second};
use derivative::Derivative;
use serde::{Deserialize, Serialize};

/// Position of the low-pass filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ApplyTo {
    /// On displacement, before the derivative and the model.
    Inputs,
    /// On the model's force, and on the measured force that it is compared with.
    Output,
    /// No filter.
    #[default]
    None,
}

/// Source of the velocity.
///
/// ```
/// use mr_damper_model::condition::{ApplyTo, Conditioning, VelocitySource};
///
/// // A slope needs its whole window after a reset, and the low-pass 6.64 time constants.
/// let slope = Conditioning { velocity: VelocitySource::Slope, slope_window_s: 0.02, ..Conditioning::default() };
/// assert_eq!((slope.apply_to, slope.settling_time().get()), (ApplyTo::None, 0.02));
/// let filtered = Conditioning { apply_to: ApplyTo::Output, ..slope };
/// assert!((filtered.settling_time().get() - 0.02 - 6.64 * filtered.low_pass().tau_s()).abs() < 1e-12);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VelocitySource {
    /// Backward difference of the (conditioned) displacement, as in the thesis.
    #[default]
    Backward,
    /// Slope, at the last point, of the parabola through the last three (conditioned) displacements: no delay
    /// to first order, more noise.
    #[serde(rename = "three_point")]
    ThreePoint,
    /// Slope of the least-squares line through the displacements of a trailing window: less noise, a delay of
    /// half the window.
    Slope,
    /// Measured velocity from the run or topic.
    Measured,
}

/// How a model's inputs are computed from displacement. Part of every model file.
///
/// ```
/// use mr_damper_model::condition::{Conditioning, MotionState};
///
/// let conditioning = Conditioning::THESIS;
/// let (filter, mut state) = (conditioning.low_pass(), MotionState::default());
/// let mut motion = None;
/// for k in 0..512 {
///     let dt_s = (k > 0).then_some(1.0 / 512.0);
///     motion = conditioning.step(&filter, &mut state, dt_s, 0.1 * f64::from(k) / 512.0, None);
/// }
/// // After one second at 0.1 m/s: the velocity is exact, and the filter delays displacement by 2 tau.
/// let motion = motion.expect("a second displacement gives a velocity");
/// let delayed_m = 0.1 * (511.0 / 512.0 - 2.0 * filter.tau_s());
/// assert!((motion.velocity_m_s - 0.1).abs() < 1e-9 && (motion.displacement_m - delayed_m).abs() < 1e-9);
///
/// let error = Conditioning { cutoff_hz: 0.0, ..conditioning }.validate().unwrap_err();
/// assert_eq!(error.to_string(), "conditioning.cutoff_hz is 0, but must be between 0.1 and 10000 Hz");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Conditioning {
    /// Position of the low-pass filter.
    pub apply_to: ApplyTo,
    /// Corner frequency of each of the two poles, Hz.
    pub cutoff_hz: f64,
    /// Source of the velocity.
    pub velocity: VelocitySource,
    /// Length of the window if `velocity` is `slope`, s.
    #[serde(default = "default_window_s")]
    pub slope_window_s: f64,
}

const fn default_window_s() -> f64 {
    0.01
}

impl Default for Conditioning {
    /// No filter, backward difference.
    fn default() -> Self {
        Self {
            apply_to: ApplyTo::None,
            cutoff_hz: Self::THESIS.cutoff_hz,
            velocity: VelocitySource::Backward,
            slope_window_s: default_window_s(),
        }
    }
}

impl Conditioning {
    /// The thesis' conditioning: displacement through two poles at 20 Hz, backward difference.
    pub const THESIS: Self = Self {
        apply_to: ApplyTo::Inputs,
        cutoff_hz: 20.0,
        velocity: VelocitySource::Backward,
        slope_window_s: default_window_s(),
    };

    /// Checks that the numbers are in range.
    ///
    /// # Errors
    /// [`Error::OutOfRange`], which names the field.
    pub fn validate(&self) -> Result<(), Error> {
        Error::check("conditioning.cutoff_hz", self.cutoff_hz, "between 0.1 and 10000 Hz", |f| {
            (0.1..=10_000.0).contains(&f)
        })?;
        Error::check("conditioning.slope_window_s", self.slope_window_s, "between 0.0001 and 1 s", |w| {
            (1e-4..=1.0).contains(&w)
        })?;
        Ok(())
    }

    /// The low-pass filter of this conditioning.
    #[must_use]
    pub fn low_pass(&self) -> LowPass {
        LowPass::new(Hertz(self.cutoff_hz))
    }

    /// Time after a reset until the transients of filter and derivative have decayed to 1 %.
    #[must_use]
    pub fn settling_time(&self) -> Second {
        let filter = if self.apply_to == ApplyTo::None { 0.0 } else { 6.64 * self.low_pass().tau_s() };
        let derivative = if self.velocity == VelocitySource::Slope { self.slope_window_s } else { 0.0 };
        Second(filter + derivative)
    }
}

/// Displacement and its derivatives after conditioning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Displacement, m.
    pub displacement_m: f64,
    /// Velocity, m/s.
    pub velocity_m_s: f64,
    /// Acceleration, m/s²: the backward difference of velocity; NaN until there are two velocities.
    pub acceleration_m_s2: f64,
}

/// State of the displacement path: filter, then derivatives.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MotionState {
    filter: low_pass::State,
    derivative: derivative::State,
    velocity_m_s: Option<f64>,
}

impl Conditioning {
    /// Processes one displacement, `dt_s` seconds after the previous one, and the measured velocity if there
    /// is one. `dt_s` is `None` for the first displacement, or after a gap that makes the history useless.
    /// Returns the motion, or `None` while velocity is unknown.
    #[inline]
    pub fn step(
        &self,
        low_pass: &LowPass,
        state: &mut MotionState,
        dt_s: Option<f64>,
        displacement_m: f64,
        measured_velocity_m_s: Option<f64>,
    ) -> Option<Motion> {
        let filtered = match self.apply_to {
            ApplyTo::Inputs => low_pass.step(&mut state.filter, dt_s, displacement_m),
            ApplyTo::Output | ApplyTo::None => displacement_m,
        };
        let velocity = match self.velocity {
            VelocitySource::Backward => Derivative::Backward.step(&mut state.derivative, dt_s, filtered),
            VelocitySource::ThreePoint => Derivative::ThreePoint.step(&mut state.derivative, dt_s, filtered),
            VelocitySource::Slope => Derivative::Slope { window_s: self.slope_window_s }.step(
                &mut state.derivative,
                dt_s,
                filtered,
            ),
            VelocitySource::Measured => measured_velocity_m_s,
        };
        let before = std::mem::replace(&mut state.velocity_m_s, velocity).filter(|_| dt_s.is_some());
        velocity.map(|velocity_m_s| Motion {
            displacement_m: filtered,
            velocity_m_s,
            acceleration_m_s2: match (before, dt_s) {
                (Some(before), Some(dt_s)) => (velocity_m_s - before) / dt_s,
                _ => f64::NAN,
            },
        })
    }
}
