//! The lagged signals of autoregressive models: their state from sample to sample.
//!
//! The same history serves prediction and simulation. If measured forces are pushed, the next prediction is one
//! step ahead. If the model's own predictions are pushed, it is a simulation (free run). The caller chooses; an
//! error figure never mixes the two.

use super::Inputs;

/// Number of samples in the history.
pub const DEPTH: usize = 5;

/// The last signals, newest first; NaN where not known.
///
/// ```
/// use mr_damper_model::force::{Arx, History, Inputs};
/// # use mr_damper_model::units::Second;
///
/// // F_k = 0.5 F_{k-1} + 500 v_k, at a velocity of 0.1 m/s
/// let arx = Arx::new([0.5, 0.0, 0.0], [0.0; 3], [500.0, 0.0, 0.0], None, Second(1.0 / 512.0), 0.0)?;
/// # let inputs = Inputs {
/// #     dt_s: Some(1.0 / 512.0), displacement_m: 0.0, velocity_m_s: 0.1, acceleration_m_s2: 0.0, drive: f64::NAN, case_temp_c: 25.0,
/// # };
/// let mut history = History::default();
/// for measured_n in [10.0, 20.0, 30.0] {
///     history.push_inputs(&inputs);
///     assert_eq!(arx.predict_n(&history), None, "three measured forces are needed");
///     history.push_force(measured_n);
/// }
/// history.push_inputs(&inputs);
/// assert_eq!(arx.predict_n(&history), Some(65.0)); // one step ahead: 0.5 * 30 N + 500 N s/m * 0.1 m/s
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct History {
    /// F_{k-1}, F_{k-2}, ... in newtons, including the session's offset.
    pub(super) force_n: [f64; DEPTH],
    /// x_k, x_{k-1}, ... in metres.
    pub(super) displacement_m: [f64; DEPTH],
    /// v_k, v_{k-1}, ... in m/s.
    pub(super) velocity_m_s: [f64; DEPTH],
    /// i_k, i_{k-1}, ... in A or V.
    pub(super) drive: [f64; DEPTH],
}

impl Default for History {
    fn default() -> Self {
        let unknown = [f64::NAN; DEPTH];
        Self { force_n: unknown, displacement_m: unknown, velocity_m_s: unknown, drive: unknown }
    }
}

impl History {
    /// The history with the given lags, newest first: forces start at the sample before, all others at this sample.
    #[must_use]
    pub(crate) const fn of(
        force_n: [f64; DEPTH],
        displacement_m: [f64; DEPTH],
        velocity_m_s: [f64; DEPTH],
        drive: [f64; DEPTH],
    ) -> Self {
        Self { force_n, displacement_m, velocity_m_s, drive }
    }

    /// Adds the inputs of sample k.
    #[inline]
    pub fn push_inputs(&mut self, inputs: &Inputs) {
        shift_in(&mut self.displacement_m, inputs.displacement_m);
        shift_in(&mut self.velocity_m_s, inputs.velocity_m_s);
        shift_in(&mut self.drive, inputs.drive);
    }

    /// Adds NaN for the inputs of sample k, which are not known but take a place in the lags.
    #[inline]
    pub(crate) fn push_unknown_inputs(&mut self) {
        for slots in [&mut self.displacement_m, &mut self.velocity_m_s, &mut self.drive] {
            shift_in(slots, f64::NAN);
        }
    }

    /// Adds the force of sample k, measured or predicted. Call it after the prediction of sample k.
    #[inline]
    pub fn push_force(&mut self, force_n: f64) {
        shift_in(&mut self.force_n, force_n);
    }

    /// Replaces the force of the sample `age` samples before the newest by the measured value. Ages beyond the
    /// history are ignored, because no later prediction uses them.
    #[inline]
    pub fn seed(&mut self, age: usize, force_n: f64) {
        if let Some(slot) = self.force_n.get_mut(age) {
            *slot = force_n;
        }
    }

    /// Force, N, of a model that is linear in the newest lags of force (minus `offset_n`), displacement and
    /// velocity. The number of lags of each is the number of its coefficients; those of displacement and velocity
    /// start `delay` samples before the newest. `None` if one of the lags is not known.
    #[inline]
    pub(super) fn regress(&self, offset_n: f64, delay: usize, [force, x, v]: [&[f64]; 3]) -> Option<f64> {
        let lags = force.len();
        let (displacement_m, velocity_m_s) = (&self.displacement_m[delay..], &self.velocity_m_s[delay..]);
        if !(known(&self.force_n, lags) && known(displacement_m, lags) && known(velocity_m_s, lags)) {
            return None;
        }
        let mut force_n = offset_n;
        for lag in 0..lags {
            force_n += force[lag] * (self.force_n[lag] - offset_n)
                + x[lag] * displacement_m[lag]
                + v[lag] * velocity_m_s[lag];
        }
        Some(force_n)
    }

    /// Clears the forces, so that only measured ones can complete the history again.
    pub(crate) fn forget_forces(&mut self) {
        self.force_n = [f64::NAN; DEPTH];
    }
}

/// True if the first `lags` slots are known.
#[inline]
pub(super) fn known(slots: &[f64], lags: usize) -> bool {
    slots[..lags].iter().all(|v| v.is_finite())
}

#[inline]
fn shift_in(slots: &mut [f64; DEPTH], value: f64) {
    slots.copy_within(..DEPTH - 1, 1);
    slots[0] = value;
}
