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
//! for F. A damper's force falls as F grows on the right, so the model's answer to a guess lies on the other side of
//! the root: the two bracket it, and a secant that keeps the bracket (Illinois) with a bisection in every third step
//! closes in. Around a model whose force falls steeply as speed grows (a spring cannot hold that) there may be no such
//! force; then there is none. The model is tried on copies of its state, and steps once when F is found. The first sample takes the
//! spring at rest (e' = e'' = 0). Where the model jumps (laws that branch by the sign of acceleration) F ends within
//! the jump, as a spring would hold it.
//!
//! Source: Maxwell's element with the damper for its dashpot. Telling of it: a residual that goes with acceleration,
//! the more so the larger the current.

use super::{About, EffectState, Inside, Parameter};
use crate::force::Inputs;

/// Most trials of the model a sample.
const TRIALS: u32 = 48;
/// Steps by which a bracket is sought, where the model's answer is none.
const WIDENINGS: u32 = 12;
/// Error of the force that is small enough: of the force, and of a newton.
const TOLERANCE: f64 = 1e-11;

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
    let [force_before_n, rate_m_s, _] = state.held;
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
    let guess_n = if before.is_some() { force_before_n } else { offset_n };
    let found = solve(guess_n, offset_n, |force_n| inside.trial(&behind(force_n)));
    let force_n = found.unwrap_or(guess_n);
    // The model steps whether there is a force or not: it may be filling its history.
    let answer_n = inside.finite(&behind(force_n));
    if found.is_none() || answer_n.is_none() {
        state.elapsed.miss(inputs.dt_s);
        return None;
    }
    state.elapsed.hit(inputs.dt_s);
    state.held = [force_n, rates(force_n).0, 0.0];
    found
}

/// Where `model(F) = F`, from `guess_n`; `None` when the model gives no force there, or there is no bracket.
fn solve(guess_n: f64, offset_n: f64, model: impl Fn(f64) -> Option<f64>) -> Option<f64> {
    let excess = |force_n: f64| model(force_n).map(|answer_n| force_n - answer_n);
    let close =
        |force_n: f64, excess_n: f64| excess_n.abs() <= TOLERANCE * ((force_n - offset_n).abs() + 1.0);
    let (mut a, mut above_a) = (guess_n, excess(guess_n)?);
    if close(a, above_a) {
        return Some(a);
    }
    // The answer to the guess, and as far again where that is not across yet.
    let (mut b, mut reach) = (a - above_a, -above_a);
    let mut above_b = excess(b)?;
    for _ in 0..WIDENINGS {
        if close(b, above_b) {
            return Some(b);
        }
        if above_a * above_b < 0.0 {
            break;
        }
        reach *= 2.0;
        (a, above_a) = (b, above_b);
        b += reach;
        above_b = excess(b)?;
    }
    if above_a * above_b > 0.0 {
        return None;
    }
    // Always a and b on either side; b is the newest.
    for trial in 0..TRIALS {
        let secant = b - above_b * (b - a) / (above_b - above_a);
        let inside = secant > a.min(b) && secant < a.max(b);
        let c = if inside && trial % 3 != 2 { secant } else { 0.5 * (a + b) };
        let above_c = excess(c)?;
        if close(c, above_c) || (b - a).abs() <= TOLERANCE * (1.0 + c.abs()) {
            return Some(c);
        }
        if above_c * above_b < 0.0 {
            (a, above_a) = (b, above_b);
        } else {
            above_a *= 0.5;
        }
        (b, above_b) = (c, above_c);
    }
    Some(0.5 * (a + b))
}
