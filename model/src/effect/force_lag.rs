//! Lag of the force: it follows the model's force with a first-order lag.
//!
//! ```text
//! tau dF'/dt = F - F'
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | tau | `tau_s` | s | the fluid's own response, or a soft mount in front of a viscous damper |
//!
//! Exact for a force that is linear between samples. The state starts at rest at the first force. The lag of a spring in series grows
//! with the damping and thus with the current: see the other form, [`super::Effect::SeriesSpring`].

use super::{Definition, EffectState, Inside, Inversion, Lag, Layer, Parameter, Properties, Unit, Values};
use crate::force::{Inputs, Number};

pub(super) struct ForceLag;

impl Definition for ForceLag {
    const PROPERTIES: Properties = Properties {
        id: "force_lag",
        form: Some("first_order"),
        what: "the force follows with one time constant",
        parameters: &[Parameter::absolute("tau_s", Unit::SECOND, [0.0, 15e-3], 5e-4)],
        example: &[0.007],
        separated_by: "motion over a wide band with the current held, at several currents",
        confounders: &["sensor_delay", "inertia", "anti_alias_mismatch", "coil_lag"],
        needs: &[],
        follows_time: false,
        layer: Layer::Rod(3),
        inversion: Inversion::Search,
        static_stiffness_n_m: |_| 0.0,
        refinement: None,
    };

    #[inline]
    fn step<R: Number>(
        [tau_s, ..]: Values<R>,
        state: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        let (force_n, since_s) = state.force_inside(inputs, inside)?;
        let lag = &mut state.lags[0];
        match since_s {
            None => {
                *lag = Lag::at_rest(force_n);
                Some(force_n)
            }
            Some(step_s) => Some(lag.step(state.coefficients[0].of(tau_s, step_s), force_n)),
        }
    }
}
