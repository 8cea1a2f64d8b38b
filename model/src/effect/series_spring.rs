//! Compliance in series: mount, rod and clevis give way before the piston moves.
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
//! | F0 | of the model | N | the session's offset, which no spring feels |
//!
//! Each sample solves, with backward differences over the time dt since the sample before,
//!
//! ```text
//! e = c (F - F0),   e' = (e - e before)/dt,   e'' = (e' - e' before)/dt
//! F = f(x - e, v - e', a - e'')
//! ```
//!
//! for F, beginning at where the last two samples point.
//!
//! - A model without memory that tells its slope takes steps of Newton. One shorter than 1 % of the force is the last: what it leaves is
//!   the square of it. So a sample costs one evaluation of the model, and two or three at a reversal; beside F found to the last digit,
//!   on noisy motion, that is a thousandth of the force, root mean square, for a spring of 1 kN/mm, and less for stiffer ones.
//! - Everywhere else, and where three steps do not do, F is found by secants, held between the nearest forces known to be too low and
//!   too high, and by halving between those where a secant does not halve the error. When the error is small, F takes the secant once
//!   more, which leaves the square of it, and the model stays as it stepped last: each trial steps it from where it stood before.
//! - A step of Newton from 1 to 2 % long takes of what comes after it a share that grows from nothing to all: scores and derivatives are
//!   differences of this force, and must not see a threshold.
//!
//! Around a model whose force falls steeply as speed grows (a spring cannot hold that) there may be no such force; then there is none.
//! The first sample takes the spring at rest (e' = e'' = 0). Where the model jumps (laws that branch by the sign of acceleration) F
//! ends within the jump, as a spring would hold it.
//!
//! Source: Maxwell's element with the damper for its dashpot. Telling of it: a residual that goes with acceleration,
//! the more so the larger the current.

use super::{About, EffectState, Inside, Parameter};
use crate::force::{Inputs, Way};

/// Length of a step of Newton, as a share of the force and of a newton, up to which it is the last, and from which it is not.
const SHORT: [f64; 2] = [1e-2, 2e-2];
/// Most steps of Newton a sample.
const NEWTONS: u32 = 3;
/// Most trials of the model a sample.
const TRIALS: u32 = 48;
/// Error of the force, as a share of it and of a newton, from which one secant more makes it exact: scores and derivatives are
/// differences of this force, and one part in 1e10 of it is what they need.
const TOLERANCE: f64 = 1e-7;
/// The same where there is no secant: at once, or within a jump.
const EXACT: f64 = 1e-10;

pub(super) const ABOUT: About = About {
    id: "force_lag",
    form: Some("series_spring"),
    what: "a spring in series: the piston moves less than the rod",
    parameters: &[Parameter::absolute("compliance_m_n", [0.0, 1e-5], 1e-8)],
    separated_by: "motion over a wide band at several currents: the lag grows with the damping",
    confounders: &["sensor_delay", "inertia", "anti_alias_mismatch", "coil_lag"],
    needs: &[],
};

/// The spring at one sample.
struct Spring {
    compliance_m_n: f64,
    /// Force at which it is neither long nor short, N.
    offset_n: f64,
    before: Option<Before>,
}

/// What it did at the sample before.
struct Before {
    /// One over the time since.
    per_s: f64,
    /// What it bore, N.
    force_n: f64,
    /// How fast that grew.
    force_rate_n_s: f64,
    /// Where that rate would have brought it by now, N.
    guess_n: f64,
}

impl Spring {
    /// How fast what it bears grows when it is `force_n` now, N/s, and how fast that does, N/s².
    #[inline]
    fn rates(&self, force_n: f64) -> (f64, f64) {
        let Some(before) = &self.before else { return (0.0, 0.0) };
        let force_rate_n_s = (force_n - before.force_n) * before.per_s;
        (force_rate_n_s, (force_rate_n_s - before.force_rate_n_s) * before.per_s)
    }

    /// What is left for the piston when it bears `force_n`.
    #[inline]
    fn behind(&self, inputs: &Inputs, force_n: f64) -> Inputs {
        let (rate_n_s, rate_n_s2) = self.rates(force_n);
        Inputs {
            displacement_m: inputs.displacement_m - self.compliance_m_n * (force_n - self.offset_n),
            velocity_m_s: inputs.velocity_m_s - self.compliance_m_n * rate_n_s,
            acceleration_m_s2: inputs.acceleration_m_s2 - self.compliance_m_n * rate_n_s2,
            ..*inputs
        }
    }
}

#[inline]
pub(super) fn step(
    compliance_m_n: f64,
    state: &mut EffectState,
    inputs: &Inputs,
    inside: &mut Inside,
) -> Option<f64> {
    if compliance_m_n == 0.0 {
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
    let newton = Newton::search(&spring, slope, inputs, inside);
    let found = if newton.unsure > 0.0 {
        // The model steps whether there is a force or not: it may be filling its history.
        let mut trials = inside.trials();
        let model = |force_n: f64| trials.step(&spring.behind(inputs, force_n));
        solve(newton.at_n, newton.slope, spring.offset_n, model).map(|found| newton.then(found))
    } else {
        Some((newton.force_n, newton.slope))
    };
    let Some((force_n, slope)) = found else {
        state.elapsed.miss(inputs.dt_s);
        return None;
    };
    state.elapsed.hit(inputs.dt_s);
    state.held = [force_n, spring.rates(force_n).0, slope];
    Some(force_n)
}

/// Steps of Newton towards where `model(F) = F`.
struct Newton {
    /// What they make the force, N: each step by its share.
    force_n: f64,
    /// Where they have come to, N: each step whole.
    at_n: f64,
    /// Slope of F - model(F) where the last one began, or would begin.
    slope: f64,
    /// Share of what comes after them: 0 where the last one was short, 1 where none was, and between smoothly.
    unsure: f64,
}

impl Newton {
    /// From where the spring's rate points: as many steps as are long, as long as the model tells its slope and they lead anywhere.
    #[inline]
    fn search(spring: &Spring, slope: f64, inputs: &Inputs, inside: &Inside) -> Self {
        let Some(before) = &spring.before else {
            return Self { force_n: spring.offset_n, at_n: spring.offset_n, slope: 1.0, unsure: 1.0 };
        };
        let mut newton = Self { force_n: before.guess_n, at_n: before.guess_n, slope, unsure: 1.0 };
        let Some(model) = inside.along(inputs.drive) else { return newton };
        let way = Way {
            displacement_m: -spring.compliance_m_n,
            velocity_m_s: -spring.compliance_m_n * before.per_s,
        };
        for _ in 0..NEWTONS {
            let piston = spring.behind(inputs, newton.at_n);
            let told = model.force_and_slope(piston.displacement_m, piston.velocity_m_s, &way);
            if !newton.step(spring.offset_n, told) || newton.unsure == 0.0 {
                break;
            }
        }
        newton
    }

    /// One step, where the model gives `model_n` and grows by so much a newton; false, and none, where it points away.
    #[inline]
    fn step(&mut self, offset_n: f64, [model_n, growth]: [f64; 2]) -> bool {
        let slope = 1.0 - growth;
        let step_n = (model_n - self.at_n) / slope;
        if !(slope > 0.0 && step_n.is_finite()) {
            return false;
        }
        self.slope = slope;
        self.force_n += self.unsure * step_n;
        self.at_n += step_n;
        let (length_n, size_n) = (step_n.abs(), (self.at_n - offset_n).abs() + 1.0);
        if length_n <= SHORT[0] * size_n {
            self.unsure = 0.0;
        } else {
            let way = ((length_n / size_n - SHORT[0]) / (SHORT[1] - SHORT[0])).clamp(0.0, 1.0);
            self.unsure *= way * way * (3.0 - 2.0 * way);
        }
        true
    }

    /// The force when `found`, with its slope, was found from where they have come to.
    fn then(&self, (found_n, slope): (f64, f64)) -> (f64, f64) {
        // To the last digit where there was no step, or none that was short.
        let force_n =
            if self.unsure < 1.0 { self.force_n + self.unsure * (found_n - self.at_n) } else { found_n };
        (force_n, slope)
    }
}

/// Where `model(F) = F`, from `guess_n` and a `slope` of F - model(F) to begin with, both close from sample to sample;
/// and the slope found. `None` when the model gives no force on the way, or the trials do not meet.
fn solve(
    guess_n: f64,
    slope: f64,
    offset_n: f64,
    mut model: impl FnMut(f64) -> Option<f64>,
) -> Option<(f64, f64)> {
    let (mut force_n, mut slope) = (guess_n, slope);
    // The root lies between, as far as is known.
    let [mut low_n, mut high_n] = [f64::NEG_INFINITY, f64::INFINITY];
    let (mut last, mut reach) = (None, 1.0);
    for _ in 0..TRIALS {
        let excess_n = force_n - model(force_n)?;
        let size_n = (force_n - offset_n).abs() + 1.0;
        if excess_n.abs() <= EXACT * size_n || high_n - low_n <= EXACT * size_n {
            return Some((force_n, slope));
        }
        if excess_n < 0.0 {
            low_n = force_n;
        } else {
            high_n = force_n;
        }
        let mut slow = false;
        if let Some((before_n, excess_before_n)) = last {
            let secant: f64 = (excess_n - excess_before_n) / (force_n - before_n);
            slope = if secant > 0.0 { secant } else { 1.0 };
            if secant > 0.0 && excess_n.abs() <= TOLERANCE * size_n {
                return Some((force_n - excess_n / slope, slope));
            }
            slow = excess_n.abs() > 0.5 * f64::abs(excess_before_n);
        }
        last = Some((force_n, excess_n));
        let step_n = -excess_n / slope;
        force_n = if high_n - low_n < f64::INFINITY {
            let next_n = force_n + step_n;
            if slow || next_n <= low_n || next_n >= high_n { 0.5 * (low_n + high_n) } else { next_n }
        } else {
            // Not across yet: further each time that this does not help.
            reach = if slow { 2.0 * reach } else { 1.0 };
            force_n + reach * step_n
        };
    }
    (high_n - low_n < f64::INFINITY).then_some((force_n, slope))
}
