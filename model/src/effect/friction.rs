//! Coulomb friction of seals and guides.
//!
//! ```text
//! F' = F + Fc tanh(v / 5 mm/s)
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | Fc | `friction_n` | N | friction at any speed |
//! | v | input | m/s | velocity |
//!
//! The change of sign at rest is smooth, over 5 mm/s.

use super::parts::smooth_sign;
use super::{About, EffectState, Inside, Parameter};
use crate::force::Inputs;

pub(super) const ABOUT: About = About {
    id: "friction",
    form: None,
    what: "seals and guides add Coulomb friction, the same at any speed and current",
    parameters: &[Parameter::absolute("friction_n", [0.0, 200.0], 2.0)],
    separated_by: "slow motion without current",
    confounders: &["asymmetry", "deadzone", "velocity_saturation"],
    needs: &[],
};

#[inline]
pub(super) fn step(
    friction_n: f64,
    _: &mut EffectState,
    inputs: &Inputs,
    inside: &mut Inside,
) -> Option<f64> {
    Some(inside.run(inputs)? + friction_n * smooth_sign(inputs.velocity_m_s))
}
