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
use super::{About, EffectState, Inside, Need, Parameter};
use crate::force::Inputs;

pub(super) const ABOUT: About = About {
    id: "remanence",
    form: None,
    what: "the field lags behind the current by a fixed width, up and down",
    parameters: &[Parameter::absolute("half_width_drive", [0.0, 0.4], 0.02)],
    separated_by: "slow ramps of the current, up and down, at constant speed: the loop does not shrink with the rate",
    confounders: &["coil_lag"],
    needs: &[Need::Drive],
};

#[inline]
pub(super) fn step(
    half_width: f64,
    state: &mut EffectState,
    inputs: &Inputs,
    inside: &mut Inside,
) -> Option<f64> {
    let Some(since_s) = state.drive(inputs) else { return inside.run(inputs) };
    let drive = match since_s {
        None => inputs.drive,
        Some(_) => play(state.held[0], inputs.drive, half_width),
    };
    state.held[0] = drive;
    inside.run(&Inputs { drive, ..*inputs })
}
