//! The lagged signals of models that feed on force: what they remember from sample to sample.
//!
//! The same memory serves both ways of running. Pushing measured forces makes the next prediction one step
//! ahead; pushing the model's own predictions makes it a free run. Which of the two it is, is the caller's
//! business, and the two are never mixed in a figure.

use super::Inputs;

/// Samples that the history reaches back.
pub const DEPTH: usize = 5;

/// The newest signals, newest first; a slot that is not known holds NaN.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct History {
    /// F_{k-1}, F_{k-2}, ... in newtons, with the session's offset still in.
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
    /// The history with these lags, newest first: forces from the sample before on, all others from this sample on.
    #[must_use]
    pub(crate) const fn of(
        force_n: [f64; DEPTH],
        displacement_m: [f64; DEPTH],
        velocity_m_s: [f64; DEPTH],
        drive: [f64; DEPTH],
    ) -> Self {
        Self { force_n, displacement_m, velocity_m_s, drive }
    }

    /// Takes in the inputs of sample k.
    #[inline]
    pub fn push_inputs(&mut self, inputs: &Inputs) {
        shift_in(&mut self.displacement_m, inputs.displacement_m);
        shift_in(&mut self.velocity_m_s, inputs.velocity_m_s);
        shift_in(&mut self.drive, inputs.drive);
    }

    /// Takes in that nothing is known of the inputs of sample k: its place in the lags is taken all the same.
    #[inline]
    pub fn push_unknown_inputs(&mut self) {
        for slots in [&mut self.displacement_m, &mut self.velocity_m_s, &mut self.drive] {
            shift_in(slots, f64::NAN);
        }
    }

    /// Takes in the force of sample k, measured or predicted; call after the prediction of sample k.
    #[inline]
    pub fn push_force(&mut self, force_n: f64) {
        shift_in(&mut self.force_n, force_n);
    }

    /// Replaces the force of `age` samples before the newest one by the measured value. Ages beyond the
    /// history are ignored: no coming prediction uses them.
    #[inline]
    pub fn seed(&mut self, age: usize, force_n: f64) {
        if let Some(slot) = self.force_n.get_mut(age) {
            *slot = force_n;
        }
    }

    /// Force in newtons of a model that is linear in the newest lags of force (less `offset_n`), displacement and
    /// velocity, as many as there are coefficients of each; `None` while one of them is not known.
    #[inline]
    pub(super) fn regress(&self, offset_n: f64, [force, x, v]: [&[f64]; 3]) -> Option<f64> {
        let lags = force.len();
        let ready = known(&self.force_n, lags)
            && known(&self.displacement_m, lags)
            && known(&self.velocity_m_s, lags);
        if !ready {
            return None;
        }
        let mut force_n = offset_n;
        for lag in 0..lags {
            force_n += force[lag] * (self.force_n[lag] - offset_n)
                + x[lag] * self.displacement_m[lag]
                + v[lag] * self.velocity_m_s[lag];
        }
        Some(force_n)
    }

    /// Forgets the forces, so that only measured ones can make a model ready again.
    pub fn forget_forces(&mut self) {
        self.force_n = [f64::NAN; DEPTH];
    }
}

/// True when the first `lags` slots are known.
#[inline]
pub(super) fn known(slots: &[f64; DEPTH], lags: usize) -> bool {
    slots[..lags].iter().all(|v| v.is_finite())
}

#[inline]
fn shift_in(slots: &mut [f64; DEPTH], value: f64) {
    slots.copy_within(..DEPTH - 1, 1);
    slots[0] = value;
}
