//! Low-pass filter of the force channel that the displacement channel does not have.
//!
//! ```text
//! H(s) = 1 / (tau s + 1)^2,   tau = d / 2
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | d | `delay_s` | s | delay of the filter at low frequency |
//!
//! Each pole is exact for an input that is linear between samples. The state starts at rest at the first force.

use super::{About, EffectState, Inside, Lag, Parameter};
use crate::force::Inputs;

pub(super) const ABOUT: About = About {
    id: "anti_alias_mismatch",
    form: None,
    what: "the force channel is low-passed, displacement is not",
    parameters: &[Parameter::absolute("delay_s", [0.0, 20e-3], 5e-4)],
    separated_by: "high-frequency motion: a filter reduces the amplitude too, a delay does not",
    confounders: &["sensor_delay", "force_lag", "inertia", "coil_lag"],
    needs: &[],
};

#[inline]
pub(super) fn step(
    delay_s: f64,
    state: &mut EffectState,
    inputs: &Inputs,
    inside: &mut Inside,
) -> Option<f64> {
    let (force_n, since_s) = state.force_inside(inputs, inside)?;
    match since_s {
        None => {
            state.lags = [Lag::at_rest(force_n); 2];
            Some(force_n)
        }
        Some(step_s) => {
            let by = state.coefficients[0].of(0.5 * delay_s, step_s);
            let first_n = state.lags[0].step(by, force_n);
            Some(state.lags[1].step(by, first_n))
        }
    }
}
