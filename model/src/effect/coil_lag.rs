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

use super::{
    Definition, Effect, EffectState, Inside, Inversion, Layer, Need, Parameter, Properties, Refinement, Unit,
    Values,
};
use crate::force::{Inputs, Number};

const TAU_S: [f64; 2] = [1e-3, 40e-3];
const PROBE_S: f64 = 1e-3;

/// One time constant.
pub(super) struct CoilLag;

impl Definition for CoilLag {
    const PROPERTIES: Properties = Properties {
        id: "coil_lag",
        form: Some("one_tau"),
        what: "the coil's current follows the drive with one time constant",
        parameters: &[Parameter::absolute("tau_s", Unit::SECOND, TAU_S, PROBE_S)],
        example: &[0.012],
        separated_by: "steps of the current while the damper moves at constant speed",
        confounders: &["remanence", "force_lag", "anti_alias_mismatch"],
        needs: &[Need::Drive],
        follows_time: false,
        layer: Layer::Coil(0),
        inversion: Inversion::Lead(|[tau_s, ..]| [tau_s; 2]),
        static_stiffness_n_m: |_| 0.0,
        refinement: Some(Refinement { effect: Effect::CoilLagRiseFall, values: |[tau_s, ..]| [tau_s; 2] }),
    };

    #[inline]
    fn step<R: Number>(
        [tau_s, ..]: Values<R>,
        state: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        step([tau_s; 2], state, inputs, inside)
    }
}

/// One time constant for rise and one for fall.
pub(super) struct CoilLagRiseFall;

impl Definition for CoilLagRiseFall {
    const PROPERTIES: Properties = Properties {
        form: Some("rise_fall"),
        what: "the coil's current rises with one time constant and falls with another",
        parameters: &[
            Parameter::absolute("tau_rise_s", Unit::SECOND, TAU_S, PROBE_S),
            Parameter::absolute("tau_fall_s", Unit::SECOND, TAU_S, PROBE_S),
        ],
        example: &[0.006, 0.019],
        inversion: Inversion::Lead(|taus_s| taus_s),
        refinement: None,
        ..CoilLag::PROPERTIES
    };

    #[inline]
    fn step<R: Number>(
        values: Values<R>,
        state: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        step(values, state, inputs, inside)
    }
}

/// One sample with the time constants of rise and fall.
#[inline]
fn step<R: Number>(
    [rise_s, fall_s]: Values<R>,
    state: &mut EffectState<R>,
    inputs: &Inputs<R>,
    inside: &mut Inside<R>,
) -> Option<R> {
    let Some(since_s) = state.drive(inputs) else { return inside.run(inputs) };
    let lag = &mut state.lags[0];
    let drive = match since_s {
        None => {
            *lag = super::Lag::at_rest(inputs.drive);
            inputs.drive
        }
        Some(step_s) => {
            let grows = inputs.drive.abs().re() >= lag.output.abs().re();
            let (which, tau_s) = if grows { (0, rise_s) } else { (1, fall_s) };
            lag.step(state.coefficients[which].of(tau_s, step_s), inputs.drive)
        }
    };
    inside.run(&Inputs { drive, ..*inputs })
}
