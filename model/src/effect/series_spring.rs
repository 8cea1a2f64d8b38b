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
//! for F: by secants from where the last two samples point, held between the nearest forces known to be too low and
//! too high, and by halving between those where a secant does not halve the error. When the error is small, F takes
//! the secant once more, which leaves the square of it, and the model stays as it stepped last: each trial steps it
//! from where it stood before the sample. Around a model whose force falls steeply as speed grows (a spring cannot
//! hold that) there may be no such force; then there is none. The first sample takes the spring at rest
//! (e' = e'' = 0). Where the model jumps (laws that branch by the sign of acceleration) F ends within the jump, as a
//! spring would hold it.
//!
//! Source: Maxwell's element with the damper for its dashpot. Telling of it: a residual that goes with acceleration,
//! the more so the larger the current.

use super::{About, EffectState, Inside, Parameter};
use crate::force::Inputs;

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

/// What the spring did at the sample before.
struct Before {
    since_s: f64,
    stretch_m: f64,
    rate_m_s: f64,
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
    let offset_n = inside.offset_n();
    let [force_before_n, rate_m_s, slope] = state.held;
    let stretch_m = |force_n: f64| compliance_m_n * (force_n - offset_n);
    let before = state.elapsed.since_s(inputs.dt_s).map(|since_s| Before {
        since_s,
        stretch_m: stretch_m(force_before_n),
        rate_m_s,
    });
    let rates = |force_n: f64| match &before {
        None => (0.0, 0.0),
        Some(b) => {
            let rate_m_s = (stretch_m(force_n) - b.stretch_m) / b.since_s;
            (rate_m_s, (rate_m_s - b.rate_m_s) / b.since_s)
        }
    };
    let behind = |force_n: f64| {
        let (rate_m_s, rate_m_s2) = rates(force_n);
        Inputs {
            displacement_m: inputs.displacement_m - stretch_m(force_n),
            velocity_m_s: inputs.velocity_m_s - rate_m_s,
            acceleration_m_s2: inputs.acceleration_m_s2 - rate_m_s2,
            ..*inputs
        }
    };
    let (guess_n, slope) = match &before {
        Some(b) => (force_before_n + b.rate_m_s / compliance_m_n * b.since_s, slope),
        None => (offset_n, 1.0),
    };
    // The model steps whether there is a force or not: it may be filling its history.
    let mut trials = inside.trials();
    let found = solve(guess_n, slope, offset_n, |force_n| trials.step(&behind(force_n)));
    let Some((force_n, slope)) = found else {
        state.elapsed.miss(inputs.dt_s);
        return None;
    };
    state.elapsed.hit(inputs.dt_s);
    state.held = [force_n, rates(force_n).0, slope];
    Some(force_n)
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
