//! Quadratic term in velocity: turbulence makes the force grow faster, shear thinning slower.
//!
//! ```text
//! F' = F + c v |v|
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | c | `quadratic_n_s2_m2` | N·s²/m² | positive: flow resistance of orifices; negative: shear thinning of the fluid |
//! | v | input | m/s | velocity |

use super::{About, EffectState, Inside, Parameter};
use crate::force::Inputs;
use crate::force::law::Scale;

pub(super) const ABOUT: About = About {
    id: "velocity_saturation",
    form: None,
    what: "at high speed the force grows faster, or slower, than in proportion to velocity",
    parameters: &[Parameter::relative("quadratic_n_s2_m2", Scale::new(1, 0, -2, 0), [-1.0, 1.0], 0.01)],
    separated_by: "fast strokes without current",
    confounders: &["friction", "asymmetry"],
    needs: &[],
};

#[inline]
pub(super) fn step(
    quadratic_n_s2_m2: f64,
    _: &mut EffectState,
    inputs: &Inputs,
    inside: &mut Inside,
) -> Option<f64> {
    let v = inputs.velocity_m_s;
    Some(inside.run(inputs)? + quadratic_n_s2_m2 * v * v.abs())
}
