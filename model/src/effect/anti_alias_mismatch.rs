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

use super::{Definition, EffectState, Inside, Inversion, Lag, Layer, Parameter, Properties, Unit, Values};
use crate::force::{Inputs, Number};

pub(super) struct AntiAliasMismatch;

impl Definition for AntiAliasMismatch {
    const PROPERTIES: Properties = Properties {
        id: "anti_alias_mismatch",
        form: None,
        what: "the force channel is low-passed, displacement is not",
        parameters: &[Parameter::absolute("delay_s", Unit::SECOND, [0.0, 20e-3], 5e-4)],
        example: &[0.009],
        separated_by: "high-frequency motion: a filter reduces the amplitude too, a delay does not",
        confounders: &["sensor_delay", "force_lag", "inertia", "coil_lag"],
        needs: &[],
        follows_time: false,
        layer: Layer::Measurement(1),
        inversion: Inversion::Search,
        static_stiffness_n_m: |_| 0.0,
        refinement: None,
    };

    #[inline]
    fn step<R: Number>(
        [delay_s, ..]: Values<R>,
        state: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        let (force_n, since_s) = state.force_inside(inputs, inside)?;
        match since_s {
            None => {
                state.lags = [Lag::at_rest(force_n); 2];
                Some(force_n)
            }
            Some(step_s) => {
                let by = state.coefficients[0].of(delay_s * 0.5, step_s);
                let first_n = state.lags[0].step(by, force_n);
                Some(state.lags[1].step(by, first_n))
            }
        }
    }
}
