//! End stop: a bumper near the ends of the stroke.
//!
//! ```text
//! F' = F + k max(0, |x| - x0) sign(x)
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | k | `stiffness_n_m` | N/m | stiffness of the bumper |
//! | x0 | `clearance_m` | m | displacement at which the rod meets it, on either side |
//! | x | input | m | displacement, positive in extension |

use super::{Definition, EffectState, Inside, Inversion, Layer, Parameter, Properties, Unit, Values};
use crate::force::law::Scale;
use crate::force::{Inputs, Number};

pub(super) struct EndStop;

impl Definition for EndStop {
    const PROPERTIES: Properties = Properties {
        id: "end_stop",
        form: None,
        what: "a bumper pushes back near the ends of the stroke",
        parameters: &[
            Parameter::relative(
                "stiffness_n_m",
                Unit::NEWTON_PER_METRE,
                Scale::new(1, -1, 0, 0),
                [0.0, 1e3],
                0.01,
            ),
            Parameter::shape("clearance_m", Unit::METRE, Scale::new(0, 1, 0, 0), [0.2, 1.0], 0.8),
        ],
        example: &[2e5, 0.008],
        separated_by: "strokes to the ends, slow and fast: the force does not depend on speed and current",
        confounders: &["gas_spring", "position_dependence"],
        needs: &[],
        follows_time: false,
        layer: Layer::Parallel(3),
        inversion: Inversion::Subtract,
        static_stiffness_n_m: |_| 0.0,
        refinement: None,
    };

    #[inline]
    fn step<R: Number>(
        [stiffness_n_m, clearance_m, ..]: Values<R>,
        _: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        let x = inputs.displacement_m;
        // Not `f64::max`, which would turn NaN into zero.
        let beyond_m = if x.abs().re() <= clearance_m.re() { R::from(0.0) } else { x.abs() - clearance_m };
        let pushed_m = if x.re() < 0.0 { -beyond_m } else { beyond_m };
        Some(inside.run(inputs)? + stiffness_n_m * pushed_m)
    }
}
