//! Test motion: sines about the middle of the model's stroke, each at one current.
//!
//! ```text
//! x = x_0 + r X cos w t,   v = -r X w sin w t,   a = -r X w^2 cos w t,   w = V / X,   0 < r <= 1
//! ```
//!
//! | symbol | what | unit |
//! |---|---|---|
//! | x_0, X | middle and half width of the envelope's displacement | m |
//! | V | larger end of its velocity | m/s |
//! | r | reach: amplitude as a share of X and of V | 1 |
//!
//! Displacement, velocity and acceleration are related as in a real motion, unlike on a grid of the three: both branches of a
//! hysteresis loop occur where they belong. A model with memory runs one period before it is evaluated. A model without memory
//! is evaluated at each point alone.

use super::shape::Bounds;
use crate::effect::{Augmented, AugmentedState, REFERENCE_TEMP_C};
use crate::elementary;
use crate::force::Inputs;
use crate::model::Model;
use std::f64::consts::TAU;

/// Points of a sine at which the model is evaluated.
pub(super) const POINTS: usize = 48;
/// Least and most time steps from one point to the next.
const STEPS: [f64; 2] = [2.0, 24.0];

/// Position of the points on a sine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CyclePoints {
    /// At the points to which a surrogate is fitted.
    On,
    /// Halfway between them.
    Between,
}

/// The sines of a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cycle {
    pub(super) middle_m: f64,
    pub(super) half_m: f64,
    pub(super) fastest_m_s: f64,
    /// Time steps from one point to the next.
    steps: usize,
    /// False for a model without memory.
    remembers: bool,
}

/// A point of a sine.
pub(super) struct At<'a> {
    /// The sample, including its current.
    pub(super) inputs: Inputs,
    /// The model's force there, N.
    pub(super) force_n: f64,
    model: &'a Augmented,
    before: AugmentedState,
}

impl At<'_> {
    /// The force, N, if the current were another at this sample only.
    pub(super) fn force_n_at(&self, current_a: f64) -> Option<f64> {
        let mut state = self.before;
        let inputs = Inputs { drive: current_a, ..self.inputs };
        self.model.free_run(&mut state, &inputs).filter(|force_n| force_n.is_finite())
    }
}

impl Cycle {
    /// The sines of `model`. The envelope must be a valid range, which [`super::Shape::has_force`] checks.
    pub(super) fn of(model: &Model) -> Self {
        let Bounds { stroke_m: [low_m, high_m], fastest_m_s, rate_hz } = Bounds::of(model);
        let half_m = (0.5 * (high_m - low_m)).max(1e-6);
        let fastest_m_s = fastest_m_s.max(1e-6);
        let steps = (TAU * half_m / fastest_m_s * rate_hz / POINTS as f64).ceil().clamp(STEPS[0], STEPS[1]);
        Self {
            middle_m: 0.5 * (low_m + high_m),
            half_m,
            fastest_m_s,
            steps: steps as usize,
            remembers: model.force.remembers() || !model.effects.is_empty(),
        }
    }

    /// Calls `see` at each point of the sine of amplitude `reach` at `current_a` where `model` has a finite force.
    pub(super) fn along(
        &self,
        model: &Augmented,
        reach: f64,
        current_a: f64,
        points: CyclePoints,
        mut see: impl FnMut(&At),
    ) {
        let round = POINTS * self.steps;
        let omega = self.fastest_m_s / self.half_m;
        let dt_s = TAU / omega / round as f64;
        let shown = match points {
            CyclePoints::On => 0,
            CyclePoints::Between => self.steps / 2,
        };
        let mut state = AugmentedState::default();
        for step in 0..2 * round {
            let angle = TAU * step as f64 / round as f64;
            let (sin, cos) = (elementary::sin(angle), elementary::cos(angle));
            let inputs = Inputs {
                dt_s: (step > 0).then_some(dt_s),
                displacement_m: self.middle_m + reach * self.half_m * cos,
                velocity_m_s: -reach * self.fastest_m_s * sin,
                acceleration_m_s2: -reach * self.fastest_m_s * omega * cos,
                drive: current_a,
                case_temp_c: REFERENCE_TEMP_C,
            };
            let before = state;
            let is_shown = step >= round && step % self.steps == shown;
            if !is_shown && !self.remembers {
                continue;
            }
            let force_n = model.free_run(&mut state, &inputs).filter(|force_n| force_n.is_finite());
            if let Some(force_n) = force_n.filter(|_| is_shown) {
                see(&At { inputs, force_n, model, before });
            }
        }
    }
}
