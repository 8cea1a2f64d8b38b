//! Parts that several effects use: time between valid samples, a first-order lag, a play operator, a delay line.

use super::MAX_DELAY_S;
use crate::force::jet::Real;

/// Velocity scale over which the smooth sign changes from -1 to 1, m/s.
pub(super) const SIGN_VELOCITY_M_S: f64 = 5e-3;

/// Smooth sign of a velocity: tanh(v / 5 mm/s). It is smooth because the solver of a series spring around it needs that.
#[inline]
pub(super) fn smooth_sign<R: Real>(velocity_m_s: R) -> R {
    (velocity_m_s / SIGN_VELOCITY_M_S).tanh()
}

/// `force_n` with the damper's part multiplied by `factor`, or by zero if `factor` is negative. The session's offset is not multiplied:
/// it does not come from the damper. The comparison keeps NaN, which `f64::max` would turn into zero.
#[inline]
pub(super) fn scaled<R: Real>(force_n: R, offset_n: f64, factor: R) -> R {
    (force_n - offset_n) * if factor.re() < 0.0 { R::from(0.0) } else { factor } + offset_n
}

/// Time between samples that an effect can use. Samples in between that it cannot use count towards the time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Elapsed {
    begun: bool,
    waited_s: f64,
}

impl Elapsed {
    /// Time since the last valid sample, s; `None` at the first one and after a gap. A step that is not positive counts as a gap.
    #[inline]
    pub(super) fn since_s(&self, dt_s: Option<f64>) -> Option<f64> {
        dt_s.filter(|dt| self.begun && *dt > 0.0).map(|dt| self.waited_s + dt)
    }

    /// True before the first sample.
    #[inline]
    pub(super) const fn is_first(&self) -> bool {
        !self.begun
    }

    /// Records a valid sample, and returns the time since the last one as [`Elapsed::since_s`].
    #[inline]
    pub(super) fn hit(&mut self, dt_s: Option<f64>) -> Option<f64> {
        let since_s = self.since_s(dt_s);
        *self = Self { begun: true, waited_s: 0.0 };
        since_s
    }

    /// Records a sample that cannot be used.
    #[inline]
    pub(super) fn miss(&mut self, dt_s: Option<f64>) {
        *self = match self.since_s(dt_s) {
            Some(waited_s) => Self { begun: true, waited_s },
            None => Self::default(),
        };
    }
}

/// Coefficients of a first-order lag for one step. They are kept for the next step because most streams have a constant rate.
///
/// ```text
/// p = exp(-h/tau),   q = (1 - p) tau / h
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Coefficients<R = f64> {
    tau_s: R,
    step_s: f64,
    pole: R,
    ramp: R,
}

impl<R: Real> Coefficients<R> {
    /// The coefficients for this time constant and step, recomputed if either changed.
    #[inline]
    pub(super) fn of(&mut self, tau_s: R, step_s: f64) -> Self {
        if tau_s != self.tau_s || step_s != self.step_s {
            let (pole, ramp) = if tau_s.re() == 0.0 {
                // Without a lag both are zero, and only the ramp changes with the time constant.
                (R::from(0.0), tau_s / step_s)
            } else {
                let ratio = R::from(step_s) / tau_s;
                ((-ratio).exp(), -(-ratio).exp_m1() / ratio)
            };
            *self = Self { tau_s, step_s, pole, ramp };
        }
        *self
    }
}

/// Input and output of a first-order lag, tau dy/dt = u - y. Exact for an input that is linear between samples, for any step.
///
/// ```text
/// y_k = p y_{k-1} + (1 - q) u_k + (q - p) u_{k-1}
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Lag<R = f64> {
    input: R,
    pub(super) output: R,
}

impl<R: Real> Lag<R> {
    /// At rest at `value`.
    pub(super) const fn at_rest(value: R) -> Self {
        Self { input: value, output: value }
    }

    /// One step.
    #[inline]
    pub(super) fn step(&mut self, by: Coefficients<R>, input: R) -> R {
        let Coefficients { pole: p, ramp: q, .. } = by;
        self.output = p * self.output + (-q + 1.0) * input + (q - p) * self.input;
        self.input = input;
        self.output
    }
}

/// Play operator: the output stays while the input is within `half_width` of it; beyond that it follows at that distance.
#[inline]
pub(super) fn play<R: Real>(before: R, input: R, half_width: R) -> R {
    before.max(input - half_width).min(input + half_width)
}

/// Number of samples in a [`Ring`].
const CAPACITY: usize = 64;
/// Least spacing of the kept samples, s, so that [`CAPACITY`] of them cover the longest delay at any rate.
const SPACING_S: f64 = MAX_DELAY_S / (CAPACITY - 2) as f64;

/// The last values of a signal, over at least [`MAX_DELAY_S`] at any rate. If samples are closer than 0.16 ms (rates above 6.2 kHz),
/// only samples that far apart are kept, plus the newest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ring<R = f64> {
    /// For each kept value: the time since the kept value before it, s, and the value.
    slots: [(f64, R); CAPACITY],
    newest: usize,
    len: usize,
}

impl<R: Real> Default for Ring<R> {
    fn default() -> Self {
        Self { slots: [(0.0, R::from(0.0)); CAPACITY], newest: 0, len: 0 }
    }
}

impl<R: Real> Ring<R> {
    /// True before the first value.
    #[inline]
    pub(super) const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Removes all values.
    #[inline]
    pub(super) const fn clear(&mut self) {
        (self.newest, self.len) = (0, 0);
    }

    /// Restarts with `value`.
    pub(super) const fn restart(&mut self, value: R) {
        self.newest = 0;
        self.len = 1;
        self.slots[0] = (0.0, value);
    }

    /// Adds `value`, `since_s` after the one before.
    #[inline]
    pub(super) fn push(&mut self, since_s: f64, value: R) {
        let spacing_s = self.slots[self.newest].0;
        // The first value is always kept, even if the second follows sooner than the spacing.
        if self.len > 1 && spacing_s < SPACING_S {
            self.slots[self.newest] = (spacing_s + since_s, value);
            return;
        }
        self.newest = (self.newest + 1) % CAPACITY;
        self.len = (self.len + 1).min(CAPACITY);
        self.slots[self.newest] = (since_s, value);
    }

    /// The value `age_s` before the newest, by linear interpolation between kept values; before the first value, the first value.
    #[inline]
    pub(super) fn at(&self, age_s: R) -> R {
        let (mut slot, mut left_s) = (self.newest, age_s);
        for _ in 1..self.len {
            let before = (slot + CAPACITY - 1) % CAPACITY;
            let ((spacing_s, newer), (_, older)) = (self.slots[slot], self.slots[before]);
            if left_s.re() <= spacing_s {
                return newer + (older - newer) * (left_s / spacing_s);
            }
            left_s = left_s - spacing_s;
            slot = before;
        }
        self.slots[slot].1
    }
}
