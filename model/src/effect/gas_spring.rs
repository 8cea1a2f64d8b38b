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

use super::{Definition, EffectState, Inside, Inversion, Layer, Parameter, Properties, Unit, Values};
use crate::force::{Inputs, Number};

pub(super) struct GasSpring;

impl Definition for GasSpring {
    const PROPERTIES: Properties = Properties {
        id: "gas_spring",
        form: None,
        what: "the gas pushes back in proportion to displacement",
        parameters: &[Parameter::absolute("stiffness_n_m", Unit::NEWTON_PER_METRE, [0.0, 20e3], 200.0)],
        example: &[6e3],
        separated_by: "slow, long strokes without current: force at equal speed, at positions further in and further out",
        confounders: &["inertia", "end_stop", "position_dependence"],
        needs: &[],
        follows_time: false,
        layer: Layer::Parallel(2),
        inversion: Inversion::Subtract,
        static_stiffness_n_m: |[stiffness_n_m, ..]| stiffness_n_m,
        refinement: None,
    };

    #[inline]
    fn step<R: Number>(
        [stiffness_n_m, ..]: Values<R>,
        _: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        Some(inside.run(inputs)? + stiffness_n_m * inputs.displacement_m)
    }
}
