//! Remanence: the core stays magnetised, so the field depends on the history of the current.
//!
//! ```text
//! i_e = max(i - w, min(i + w, i_e before))        the model is driven by i_e
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | w | `half_width_drive` | as the drive | half the width of the loop: coercive field over turns and gap |
//! | i | input | A or V | drive |
//!
//! This is the play operator, the elementary hysteresis of the Prandtl-Ishlinskii model. It starts without remanence at the first
//! drive, and does not depend on time.
//!
//! Source: `[prandtl-ishlinskii]` in the bibliography (node/docs/guide/bibliography.md).

use super::parts::play;
use super::{Definition, EffectState, Inside, Inversion, Layer, Need, Parameter, Properties, Unit, Values};
use crate::force::{Inputs, Number};

pub(super) struct Remanence;

impl Definition for Remanence {
    const PROPERTIES: Properties = Properties {
        id: "remanence",
        form: None,
        what: "the field lags behind the current by a fixed width, up and down",
        parameters: &[Parameter::absolute("half_width_drive", Unit::DRIVE, [0.0, 0.4], 0.02)],
        example: &[0.15],
        separated_by: "slow ramps of the current, up and down, at constant speed: the loop does not shrink with the rate",
        confounders: &["coil_lag"],
        needs: &[Need::Drive],
        follows_time: false,
        layer: Layer::Core(0),
        inversion: Inversion::Search,
        static_stiffness_n_m: |_| 0.0,
        refinement: None,
    };

    #[inline]
    fn step<R: Number>(
        [half_width, ..]: Values<R>,
        state: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        let Some(since_s) = state.drive(inputs) else { return inside.run(inputs) };
        let drive = match since_s {
            None => inputs.drive,
            Some(_) => play(state.held[0], inputs.drive, half_width),
        };
        state.held[0] = drive;
        inside.run(&Inputs { drive, ..*inputs })
    }
}
