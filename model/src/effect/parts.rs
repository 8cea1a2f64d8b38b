//! What several effects are made of: time between good samples, a first-order lag, a play operator.

use super::MAX_DELAY_S;

/// Velocity over which a smooth sign turns from -1 to 1, m/s.
const SIGN_VELOCITY_M_S: f64 = 5e-3;

/// The sign of a velocity, smooth where it turns: tanh(v / 5 mm/s). A solver around it needs that.
#[inline]
pub(super) fn smooth_sign(velocity_m_s: f64) -> f64 {
    crate::force::tanh(velocity_m_s / SIGN_VELOCITY_M_S)
}

/// `force_n` with the damper's share of it times `factor`, zero where that is negative: the session's offset is no
/// force of the damper. NaN stays NaN, which f64::max would make a zero of.
#[inline]
pub(super) fn scaled(force_n: f64, offset_n: f64, factor: f64) -> f64 {
    offset_n + (force_n - offset_n) * if factor < 0.0 { 0.0 } else { factor }
}

/// Time from one sample that an effect could use to the next: what lies between counts, whatever it was.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Elapsed {
    begun: bool,
    waited_s: f64,
}

impl Elapsed {
    /// Time since the last sample of use; `None` at the first one and after a gap. A step that is not positive is a
    /// gap.
    #[inline]
    pub(super) fn since_s(&self, dt_s: Option<f64>) -> Option<f64> {
        dt_s.filter(|dt| self.begun && *dt > 0.0).map(|dt| self.waited_s + dt)
    }

    /// This sample is of use: time since the last one, as [`Elapsed::since_s`].
    #[inline]
    pub(super) fn hit(&mut self, dt_s: Option<f64>) -> Option<f64> {
        let since_s = self.since_s(dt_s);
        *self = Self { begun: true, waited_s: 0.0 };
        since_s
    }

    /// This sample is of no use.
    #[inline]
    pub(super) fn miss(&mut self, dt_s: Option<f64>) {
        *self = match self.since_s(dt_s) {
            Some(waited_s) => Self { begun: true, waited_s },
            None => Self::default(),
        };
    }
}

/// Coefficients of a first-order lag for one step, kept because a stream keeps its rate as a rule.
///
/// ```text
/// p = exp(-h/tau),   q = (1 - p) tau / h
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Coefficients {
    tau_s: f64,
    step_s: f64,
    pole: f64,
    ramp: f64,
}

impl Coefficients {
    /// Those for this time constant and step.
    #[inline]
    pub(super) fn of(&mut self, tau_s: f64, step_s: f64) -> Self {
        if tau_s != self.tau_s || step_s != self.step_s {
            // A time constant of zero makes the ratio infinite, the pole and the ramp zero: nothing lags.
            let ratio = step_s / tau_s;
            *self = Self { tau_s, step_s, pole: (-ratio).exp(), ramp: -(-ratio).exp_m1() / ratio };
        }
        *self
    }
}

/// Input and output of a first-order lag: tau dy/dt = u - y, exact for an input that runs straight from sample to
/// sample, whatever the steps.
///
/// ```text
/// y_k = p y_{k-1} + (1 - q) u_k + (q - p) u_{k-1}
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Lag {
    input: f64,
    pub(super) output: f64,
}

impl Lag {
    /// At rest at `value`.
    pub(super) const fn at_rest(value: f64) -> Self {
        Self { input: value, output: value }
    }

    /// One step.
    #[inline]
    pub(super) fn step(&mut self, by: Coefficients, input: f64) -> f64 {
        let Coefficients { pole: p, ramp: q, .. } = by;
        self.output = p * self.output + (1.0 - q) * input + (q - p) * self.input;
        self.input = input;
        self.output
    }
}

/// Play operator: the output stays while the input is within `half_width` of it, and is dragged along beyond.
#[inline]
pub(super) fn play(before: f64, input: f64, half_width: f64) -> f64 {
    before.max(input - half_width).min(input + half_width)
}

/// Samples that a [`Ring`] holds.
const CAPACITY: usize = 64;
/// Spacing of the samples that are kept, s: so many of them reach back over the longest delay at any rate.
const SPACING_S: f64 = MAX_DELAY_S / (CAPACITY - 2) as f64;

/// The last values of a signal, reaching back at least [`MAX_DELAY_S`] at any rate: where samples come closer than
/// 0.16 ms (beyond 6.2 kHz) only so many are kept that they are that far apart, and the newest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ring {
    /// Time since the value kept before, s, and the value.
    slots: [(f64, f64); CAPACITY],
    newest: usize,
    len: usize,
}

impl Default for Ring {
    fn default() -> Self {
        Self { slots: [(0.0, 0.0); CAPACITY], newest: 0, len: 0 }
    }
}

impl Ring {
    /// Starts anew with `value`.
    pub(super) const fn restart(&mut self, value: f64) {
        self.newest = 0;
        self.len = 1;
        self.slots[0] = (0.0, value);
    }

    /// Takes in `value`, `since_s` after the one before.
    #[inline]
    pub(super) fn push(&mut self, since_s: f64, value: f64) {
        let spacing_s = self.slots[self.newest].0;
        // The first value is kept however soon the second comes.
        if self.len > 1 && spacing_s < SPACING_S {
            self.slots[self.newest] = (spacing_s + since_s, value);
            return;
        }
        self.newest = (self.newest + 1) % CAPACITY;
        self.len = (self.len + 1).min(CAPACITY);
        self.slots[self.newest] = (since_s, value);
    }

    /// The value `age_s` before the newest, between two kept ones on the straight line; before the first one, that.
    #[inline]
    pub(super) fn at(&self, age_s: f64) -> f64 {
        let (mut slot, mut left_s) = (self.newest, age_s);
        for _ in 1..self.len {
            let before = (slot + CAPACITY - 1) % CAPACITY;
            let ((spacing_s, newer), (_, older)) = (self.slots[slot], self.slots[before]);
            if left_s <= spacing_s {
                return newer + (older - newer) * (left_s / spacing_s);
            }
            left_s -= spacing_s;
            slot = before;
        }
        self.slots[slot].1
    }
}
