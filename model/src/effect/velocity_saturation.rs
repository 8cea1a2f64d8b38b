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

use super::{Definition, EffectState, Inside, Inversion, Layer, Parameter, Properties, Unit, Values};
use crate::force::law::Scale;
use crate::force::{Inputs, Number};

pub(super) struct VelocitySaturation;

impl Definition for VelocitySaturation {
    const PROPERTIES: Properties = Properties {
        id: "velocity_saturation",
        form: None,
        what: "at high speed the force grows faster, or slower, than in proportion to velocity",
        parameters: &[Parameter::relative(
            "quadratic_n_s2_m2",
            Unit::new("_n_s2_m2", "N s²/m²"),
            Scale::new(1, 0, -2, 0),
            [-1.0, 1.0],
            0.01,
        )],
        example: &[900.0],
        separated_by: "fast strokes without current",
        confounders: &["friction", "asymmetry"],
        needs: &[],
        follows_time: false,
        layer: Layer::Parallel(0),
        inversion: Inversion::Subtract,
        static_stiffness_n_m: |_| 0.0,
        refinement: None,
    };

    #[inline]
    fn step<R: Number>(
        [quadratic_n_s2_m2, ..]: Values<R>,
        _: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        let v = inputs.velocity_m_s;
        Some(inside.run(inputs)? + quadratic_n_s2_m2 * v * v.abs())
    }
}
