//! Remanence: the core stays magnetised, so the field depends on where the current came from.
//!
//! ```text
//! i_e = max(i - w, min(i + w, i_e before))        the model is driven by i_e
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | w | `half_width_drive` | that of the drive | half the width of the loop: coercive field over turns and gap |
//! | i | input | A or V | drive |
//!
//! The play operator, the simplest of the hystereses of which Prandtl and Ishlinskii build theirs. It starts without
//! remanence, at the first drive. Time does not enter.

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
