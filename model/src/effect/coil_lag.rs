//! Lag of the coil: the current follows the drive with a lag.
//!
//! ```text
//! tau di_e/dt = i - i_e        the model is driven by i_e
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | tau | `tau_s` | s | inductance over resistance of coil and driver; includes eddy currents and the fluid's own lag |
//! | | `tau_rise_s`, `tau_fall_s` | s | the same while the current rises and while it falls |
//! | i | input | A or V | drive |
//!
//! Exact for a drive that is linear between samples. Rise or fall is decided once a sample: the current rises if the drive is further
//! from zero than i_e. The state starts at rest at the first drive.
//!
//! Source: first-order model of the coil, e.g. Dyke et al. (1996), Smart Mater. Struct. 5, 565 (their eta).
//! See `[dyke1996]` in the bibliography (node/docs/guide/bibliography.md).

use super::{About, EffectState, Inside, Need, Parameter};
use crate::force::Inputs;

const TAU_S: [f64; 2] = [1e-3, 40e-3];
const PROBE_S: f64 = 1e-3;
const SEPARATED_BY: &str = "steps of the current while the damper moves at constant speed";
const CONFOUNDERS: &[&str] = &["remanence", "force_lag", "anti_alias_mismatch"];

pub(super) const ONE_TAU: About = About {
    id: "coil_lag",
    form: Some("one_tau"),
    what: "the coil's current follows the drive with one time constant",
    parameters: &[Parameter::absolute("tau_s", TAU_S, PROBE_S)],
    separated_by: SEPARATED_BY,
    confounders: CONFOUNDERS,
    needs: &[Need::Drive],
};

pub(super) const RISE_FALL: About = About {
    form: Some("rise_fall"),
    what: "the coil's current rises with one time constant and falls with another",
    parameters: &[
        Parameter::absolute("tau_rise_s", TAU_S, PROBE_S),
        Parameter::absolute("tau_fall_s", TAU_S, PROBE_S),
    ],
    ..ONE_TAU
};

/// One sample with the time constants of rise and fall.
#[inline]
pub(super) fn step(
    [rise_s, fall_s]: [f64; 2],
    state: &mut EffectState,
    inputs: &Inputs,
    inside: &mut Inside,
) -> Option<f64> {
    let Some(since_s) = state.drive(inputs) else { return inside.run(inputs) };
    let lag = &mut state.lags[0];
    let drive = match since_s {
        None => {
            *lag = super::Lag::at_rest(inputs.drive);
            inputs.drive
        }
        Some(step_s) => {
            let grows = inputs.drive.abs() >= lag.output.abs();
            let (which, tau_s) = if grows { (0, rise_s) } else { (1, fall_s) };
            lag.step(state.coefficients[which].of(tau_s, step_s), inputs.drive)
        }
    };
    inside.run(&Inputs { drive, ..*inputs })
}
