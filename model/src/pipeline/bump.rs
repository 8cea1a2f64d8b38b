//! Bumpless transfer: an offset that is added after a change of mode or model, so that neither the estimate nor its slope steps.
//!
//! ```text
//! F_out = F_mode + d,    d'' + 2 d' / tau + d / tau^2 = 0
//! d (t0)  = F_before(t0) - F_mode(t0),    d'(t0) = F_out'(t0) - F_mode'(t0)
//! d (t + h) = (d + (d' + d / tau) h) e^(-h / tau)
//! d'(t + h) = (d' - (d' + d / tau) h / tau) e^(-h / tau)
//! ```
//!
//! | symbol | what | unit |
//! |---|---|---|
//! | F_mode | force of the current mode | N |
//! | F_before | force of the previous mode at the same sample, if available; else the last output, extrapolated along its slope | N |
//! | tau | half of `bumpless_tau_s`; the decay of a step then has the same area as an exponential with that time constant | s |
//!
//! The decay is critically damped: the slowest that does not overshoot. Slopes are averaged over the last [`SLOPE_S`], because a
//! force that follows a load cell has mostly noise from one sample to the next.

use crate::elementary::exp;

/// Time constant of the slopes, s.
const SLOPE_S: f64 = 5e-3;
/// Offset below which it is set to zero, N; no load cell resolves it. From then on the output is bit-identical to the mode's own
/// force.
const NOTHING_N: f64 = 1e-3;

/// A force and its slope.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Sloped {
    last_n: Option<f64>,
    n_s: f64,
}

impl Sloped {
    #[inline]
    fn see(&mut self, force_n: Option<f64>, dt_s: f64) {
        self.n_s = match (self.last_n, force_n) {
            (Some(last_n), Some(force_n)) if dt_s > 0.0 => {
                let share = dt_s / (dt_s + SLOPE_S);
                self.n_s + share * ((force_n - last_n) / dt_s - self.n_s)
            }
            _ => 0.0,
        };
        self.last_n = force_n;
    }
}

/// The forces of both channels at a sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Forces {
    /// Time since the sample before, s; 0 if history restarted.
    pub(super) dt_s: f64,
    pub(super) free_n: Option<f64>,
    pub(super) seeded_n: Option<f64>,
}

/// The channel that the output comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum OutputChannel {
    Free,
    Seeded,
}

impl Forces {
    pub(super) const fn of(&self, channel: OutputChannel) -> Option<f64> {
        match channel {
            OutputChannel::Free => self.free_n,
            OutputChannel::Seeded => self.seeded_n,
        }
    }
}

/// The offset, and the slopes from which it is computed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Bump {
    offset_n: f64,
    offset_n_s: f64,
    free: Sloped,
    seeded: Sloped,
    output: Sloped,
    /// The models have been swapped: the next output continues from the last one.
    swapped: bool,
}

impl Bump {
    /// The output for `forces`: the force of `now` plus the offset. `before` is the previous channel if the mode has changed.
    #[inline]
    pub(super) fn smooth(
        &mut self,
        forces: &Forces,
        now: OutputChannel,
        before: Option<Option<OutputChannel>>,
        bumpless_tau_s: f64,
    ) -> Option<f64> {
        let (dt_s, tau_s) = (forces.dt_s, 0.5 * bumpless_tau_s);
        self.free.see(forces.free_n, dt_s);
        self.seeded.see(forces.seeded_n, dt_s);
        let force_n = forces.of(now)?;
        if dt_s > 0.0 {
            self.decay(dt_s, tau_s);
        }
        let swapped = std::mem::take(&mut self.swapped);
        if let (true, Some(last_n)) = (swapped || before.is_some(), self.output.last_n) {
            let led_n = last_n + self.output.n_s * dt_s;
            let before_n = match before {
                Some(Some(before)) if !swapped => forces.of(before).map_or(led_n, |n| n + self.offset_n),
                _ => led_n,
            };
            let slope = if now == OutputChannel::Free { &self.free } else { &self.seeded };
            // The slope of a new model is not known yet.
            let kink_n_s = if swapped { 0.0 } else { self.output.n_s - slope.n_s };
            (self.offset_n, self.offset_n_s) = (before_n - force_n, kink_n_s);
        }
        if tau_s <= 0.0 || (self.offset_n.abs() < NOTHING_N && self.offset_n_s.abs() * tau_s < NOTHING_N) {
            (self.offset_n, self.offset_n_s) = (0.0, 0.0);
        }
        let output_n = force_n + self.offset_n;
        self.output.see(Some(output_n), dt_s);
        Some(output_n)
    }

    fn decay(&mut self, dt_s: f64, tau_s: f64) {
        if self.offset_n == 0.0 && self.offset_n_s == 0.0 || tau_s <= 0.0 {
            return;
        }
        let (pull, keep) = (self.offset_n_s + self.offset_n / tau_s, exp(-dt_s / tau_s));
        self.offset_n = (self.offset_n + pull * dt_s) * keep;
        self.offset_n_s = (self.offset_n_s - pull * dt_s / tau_s) * keep;
    }

    /// Holds the output for the step of `forces`.
    pub(super) fn hold(&mut self, forces: &Forces) -> Option<f64> {
        self.free.see(forces.free_n, forces.dt_s);
        self.seeded.see(forces.seeded_n, forces.dt_s);
        (self.offset_n, self.offset_n_s) = (0.0, 0.0);
        self.output.n_s = 0.0;
        self.output.last_n
    }

    /// The next output comes from another model: it starts from the last output, because the slope of the new model is not known yet.
    pub(super) fn expect_step(&mut self) {
        self.swapped = true;
        (self.free, self.seeded) = (Sloped::default(), Sloped::default());
    }

    pub(super) const fn last_output_n(&self) -> Option<f64> {
        self.output.last_n
    }

    /// The present offset, N: the output minus the mode's own force.
    pub(super) const fn offset_n(&self) -> f64 {
        self.offset_n
    }

    pub(super) fn forget(&mut self) {
        *self = Self::default();
    }
}
