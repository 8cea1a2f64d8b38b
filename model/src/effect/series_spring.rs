//! Compliance in series: mount, rod and clevis deform before the piston moves.
//!
//! ```text
//! w = x - c (F - F0),   F = f(w, w')        with f the model
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | c | `compliance_m_n` | m/N | one over the stiffness of the spring: 0 for a rigid one, 1e-5 for 100 kN/m |
//! | x | input | m | displacement of the rod |
//! | w | state | m | displacement of the piston |
//! | F0 | of the model | N | the session's force offset, which does not act on the spring |
//!
//! Each sample solves, with backward differences over the time dt since the sample before,
//!
//! ```text
//! e = c (F - F0),   e' = (e - e before)/dt,   e'' = (e' - e' before)/dt
//! F = f(x - e, v - e', a - e'')
//! ```
//!
//! for F, starting from the linear extrapolation of the last two samples.
//!
//! - For a model without memory that can give its slope, Newton steps are taken. A step shorter than 1 % of the force is the last,
//!   because Newton converges quadratically. A sample thus costs one evaluation of the model, and two or three at a reversal. Compared
//!   with F solved to full precision, on noisy motion, the difference is one thousandth of the force (root mean square) for a spring of
//!   1 kN/mm, and less for stiffer ones.
//! - For all other models, and if three Newton steps are not enough, F is found by the secant method. F is kept between the nearest forces
//!   known to be too low and too high, and the interval is bisected if a secant step does not halve the error. When the error is
//!   small, one last secant step gives F, and the model keeps the state of the last trial. Each trial starts from the state before the
//!   sample.
//! - With derivatives, the secant method starts at force and slope of a simulation of the same model without them
//!   ([`super::Solved`]), and takes one trial.
//! - If a Newton step is from 1 to 2 % long, the next correction is added with a weight that grows smoothly from 0 to 1. Scores and
//!   derivatives are differences of this force, and a threshold would show in them.
//!
//! Around a model whose force falls steeply with speed such a force may not exist, because the spring cannot balance it; the sample then
//! has no force. At the first sample the spring is at rest (e' = e'' = 0). If the model jumps (force laws that switch with the sign of the
//! acceleration), F ends within the jump, as with a real spring.
//!
//! Source: Maxwell element with the damper as its dashpot. Indicator in data: a residual that correlates with acceleration, more strongly
//! at larger current.
//! See `[maxwell]` in the bibliography (node/docs/guide/bibliography.md).

use super::{Definition, EffectState, Inside, Inversion, Layer, Parameter, Properties, Unit, Values};
use crate::force::{Inputs, Number, Way};

/// Length of a Newton step relative to |force| + 1 N. Up to the first value the step is the last; from the second value on it is not.
const SHORT: [f64; 2] = [1e-2, 2e-2];
/// Largest number of Newton steps per sample.
const NEWTONS: u32 = 3;
/// Largest number of trials of the model per sample.
const TRIALS: u32 = 48;
/// The same without a secant: at the first trial, or within a jump.
const EXACT: f64 = 1e-10;

pub(super) struct SeriesSpring;

impl Definition for SeriesSpring {
    const PROPERTIES: Properties = Properties {
        id: "force_lag",
        form: Some("series_spring"),
        what: "a spring in series: the piston moves less than the rod",
        parameters: &[Parameter::absolute("compliance_m_n", Unit::new("_m_n", "m/N"), [0.0, 1e-5], 1e-8)],
        example: &[3e-7],
        separated_by: "motion over a wide band at several currents: the lag grows with the damping",
        confounders: &["sensor_delay", "inertia", "anti_alias_mismatch", "coil_lag"],
        needs: &[],
        follows_time: false,
        layer: Layer::Rod(1),
        inversion: Inversion::Search,
        static_stiffness_n_m: |_| 0.0,
        refinement: None,
    };

    #[inline]
    fn step<R: Number>(
        [compliance_m_n, ..]: Values<R>,
        state: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        if compliance_m_n.is_zero() {
            return inside.run(inputs);
        }
        let [force_before_n, force_rate_n_s, slope] = state.held;
        let before = state.elapsed.since_s(inputs.dt_s).map(|since_s| Before {
            per_s: since_s.recip(),
            force_n: force_before_n,
            guess_n: force_before_n + force_rate_n_s * since_s,
            force_rate_n_s,
        });
        let spring = Spring { compliance_m_n, offset_n: inside.offset_n(), before };
        let newton = Newton::search(&spring, slope.re(), state.solved.take(), inputs, inside);
        let found = if newton.unsure > 0.0 {
            // The model is stepped even if it gives no force: it may be filling its history.
            let mut trials = inside.trials();
            let model = |force_n: R| trials.step(&spring.behind(inputs, force_n));
            let found = solve((newton.at_n, newton.slope), newton.is_known, spring.offset_n, model);
            found.map(|found| newton.then(found))
        } else {
            Some((newton.force_n, newton.slope))
        };
        let Some((force_n, slope)) = found else {
            state.elapsed.miss(inputs.dt_s);
            return None;
        };
        state.elapsed.hit(inputs.dt_s);
        state.held = [force_n, spring.rates(force_n).0, R::from(slope)];
        Some(force_n)
    }
}

/// The spring at one sample.
struct Spring<R> {
    compliance_m_n: R,
    /// Force at which it has its free length, N.
    offset_n: f64,
    before: Option<Before<R>>,
}

/// The spring at the sample before.
struct Before<R> {
    /// One over the time since that sample, 1/s.
    per_s: f64,
    /// Its force, N.
    force_n: R,
    /// Rate of its force, N/s.
    force_rate_n_s: R,
    /// Force extrapolated with that rate to the present sample, N.
    guess_n: R,
}

impl<R: Number> Spring<R> {
    /// First and second derivative of the spring force if it is `force_n` at the present sample, N/s and N/s².
    #[inline]
    fn rates(&self, force_n: R) -> (R, R) {
        let Some(before) = &self.before else { return (R::from(0.0), R::from(0.0)) };
        let force_rate_n_s = (force_n - before.force_n) * before.per_s;
        (force_rate_n_s, (force_rate_n_s - before.force_rate_n_s) * before.per_s)
    }

    /// The inputs of the piston if the spring force is `force_n`.
    #[inline]
    fn behind(&self, inputs: &Inputs<R>, force_n: R) -> Inputs<R> {
        let (rate_n_s, rate_n_s2) = self.rates(force_n);
        Inputs {
            displacement_m: inputs.displacement_m - self.compliance_m_n * (force_n - self.offset_n),
            velocity_m_s: inputs.velocity_m_s - self.compliance_m_n * rate_n_s,
            acceleration_m_s2: inputs.acceleration_m_s2 - self.compliance_m_n * rate_n_s2,
            ..*inputs
        }
    }
}

/// Newton iteration for `model(F) = F`.
struct Newton<R> {
    /// The force so far, N: the sum of the steps, each with its weight.
    force_n: R,
    /// The iterate, N: the sum of the steps without weights.
    at_n: R,
    /// Slope of F - model(F) at the start of the last step, or at the guess before the first one.
    slope: f64,
    /// Weight of the steps to come: 0 after a short step, 1 if no step was short, with a smooth transition.
    unsure: f64,
    /// Force and slope were solved in a simulation without derivatives.
    is_known: bool,
}

impl<R: Number> Newton<R> {
    /// Starts at the extrapolated force and takes steps until one is short, if the model can give its slope. Stops at [`NEWTONS`] steps,
    /// or at a step that is not possible. If the model cannot give its slope, stops where force and slope are `solved` already.
    #[inline]
    fn search(
        spring: &Spring<R>,
        slope: f64,
        solved: Option<[f64; 2]>,
        inputs: &Inputs<R>,
        inside: &Inside<R>,
    ) -> Self {
        let start = |force_n, slope, is_known| Self { force_n, at_n: force_n, slope, unsure: 1.0, is_known };
        let Some(before) = &spring.before else { return start(R::from(spring.offset_n), 1.0, false) };
        // Without derivatives, so that values are enough here.
        let Some(model) = inside.along(inputs.drive.re()) else {
            return match solved {
                Some([force_n, slope]) => {
                    start(before.guess_n + (force_n - before.guess_n.re()), slope, true)
                }
                None => start(before.guess_n, slope, false),
            };
        };
        let mut newton = start(before.guess_n, slope, false);
        let compliance_m_n = spring.compliance_m_n.re();
        let way = Way { displacement_m: -compliance_m_n, velocity_m_s: -compliance_m_n * before.per_s };
        for _ in 0..NEWTONS {
            let piston = spring.behind(inputs, newton.at_n);
            let force_and_slope =
                model.force_and_slope(piston.displacement_m.re(), piston.velocity_m_s.re(), &way);
            if !newton.step(spring.offset_n, force_and_slope) || newton.unsure == 0.0 {
                break;
            }
        }
        newton
    }

    /// One step, with the model's force `model_n` and its derivative `growth` by the spring force. Returns false without a step if the
    /// slope is not positive.
    #[inline]
    fn step(&mut self, offset_n: f64, [model_n, growth]: [f64; 2]) -> bool {
        let slope = 1.0 - growth;
        let step_n = (R::from(model_n) - self.at_n) / slope;
        if !(slope > 0.0 && step_n.re().is_finite()) {
            return false;
        }
        self.slope = slope;
        self.force_n = self.force_n + step_n * self.unsure;
        self.at_n = self.at_n + step_n;
        let (length_n, size_n) = (step_n.re().abs(), (self.at_n - offset_n).re().abs() + 1.0);
        if length_n <= SHORT[0] * size_n {
            self.unsure = 0.0;
        } else {
            let way = ((length_n / size_n - SHORT[0]) / (SHORT[1] - SHORT[0])).clamp(0.0, 1.0);
            self.unsure *= way * way * (3.0 - 2.0 * way);
        }
        true
    }

    /// The force after `found` (force and slope) was solved from the iterate.
    fn then(&self, (found_n, slope): (R, f64)) -> (R, f64) {
        // Take `found` at full precision if no step was short.
        let force_n =
            if self.unsure < 1.0 { self.force_n + (found_n - self.at_n) * self.unsure } else { found_n };
        (force_n, slope)
    }
}

/// Solves `model(F) = F` and returns F and the slope of F - model(F). Starts from the force and slope of `guess`, which change little from
/// sample to sample. If they are `known`, and the first trial confirms them, it is the last. `None` if the model gives no force at a trial, or
/// if the trials do not enclose a solution.
fn solve<R: Number>(
    guess: (R, f64),
    known: bool,
    offset_n: f64,
    mut model: impl FnMut(R) -> Option<R>,
) -> Option<(R, f64)> {
    let (mut force_n, mut slope) = guess;
    // Bounds of the root known so far.
    let [mut low_n, mut high_n] = [f64::NEG_INFINITY, f64::INFINITY];
    let (mut last, mut reach) = (None, 1.0);
    for _ in 0..TRIALS {
        let excess = force_n - model(force_n)?;
        let (at_n, excess_n) = (force_n.re(), excess.re());
        let size_n = (at_n - offset_n).abs() + 1.0;
        if excess_n.abs() <= EXACT * size_n || high_n - low_n <= EXACT * size_n {
            // The value is exact, and this step makes its derivatives so.
            return Some((force_n - (excess - excess_n) / slope, slope));
        }
        if excess_n < 0.0 {
            low_n = at_n;
        } else {
            high_n = at_n;
        }
        let mut slow = false;
        if let Some((before_n, excess_before_n)) = last {
            let secant: f64 = (excess_n - excess_before_n) / (at_n - before_n);
            slope = if secant > 0.0 { secant } else { 1.0 };
            if secant > 0.0 && excess_n.abs() <= R::SOLVED * size_n {
                return Some((force_n - excess / slope, slope));
            }
            slow = excess_n.abs() > 0.5 * f64::abs(excess_before_n);
        } else if known && excess_n.abs() <= R::SOLVED * size_n {
            return Some((force_n - excess / slope, slope));
        }
        last = Some((at_n, excess_n));
        let step_n = -excess / slope;
        force_n = if high_n - low_n < f64::INFINITY {
            let next_n = force_n + step_n;
            let is_outside = next_n.re() <= low_n || next_n.re() >= high_n;
            if slow || is_outside { R::from(0.5 * (low_n + high_n)) } else { next_n }
        } else {
            // The root is not enclosed yet: double the step each time that the error does not shrink.
            reach = if slow { 2.0 * reach } else { 1.0 };
            force_n + step_n * reach
        };
    }
    (high_n - low_n < f64::INFINITY).then_some((force_n, slope))
}
