//! Gas spring: the rod compresses the gas of the accumulator as it moves in.
//!
//! ```text
//! F' = F + k x
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | k | `stiffness_n_m` | N/m | gas pressure times rod area squared over gas volume, times the polytropic exponent |
//! | x | input | m | displacement, positive in extension |
//!
//! The force of the gas at rest is part of the session's force offset.

use super::{About, EffectState, Inside, Parameter};
use crate::force::Inputs;

pub(super) const ABOUT: About = About {
    id: "gas_spring",
    form: None,
    what: "the gas pushes back in proportion to displacement",
    parameters: &[Parameter::absolute("stiffness_n_m", [0.0, 20e3], 200.0)],
    separated_by: "slow, long strokes without current: force at equal speed, at positions further in and further out",
    confounders: &["inertia", "end_stop", "position_dependence"],
    needs: &[],
};

#[inline]
pub(super) fn step(
    stiffness_n_m: f64,
    _: &mut EffectState,
    inputs: &Inputs,
    inside: &mut Inside,
) -> Option<f64> {
    Some(inside.run(inputs)? + stiffness_n_m * inputs.displacement_m)
}
