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
use super::{Definition, EffectState, Inside, Inversion, Layer, Parameter, Properties, Unit, Values};
use crate::force::Inputs;

pub(super) struct Friction;

impl Definition for Friction {
    const PROPERTIES: Properties = Properties {
        id: "friction",
        form: None,
        what: "seals and guides add Coulomb friction, the same at any speed and current",
        parameters: &[Parameter::absolute("friction_n", Unit::NEWTON, [0.0, 200.0], 2.0)],
        example: &[60.0],
        separated_by: "slow motion without current",
        confounders: &["asymmetry", "deadzone", "velocity_saturation"],
        needs: &[],
        layer: Layer::Parallel(1),
        inversion: Inversion::Subtract,
        static_stiffness_n_m: |_| 0.0,
        refinement: None,
    };

    #[inline]
    fn step(
        [friction_n, ..]: Values,
        _: &mut EffectState,
        inputs: &Inputs,
        inside: &mut Inside,
    ) -> Option<f64> {
        Some(inside.run(inputs)? + friction_n * smooth_sign(inputs.velocity_m_s))
    }
}
