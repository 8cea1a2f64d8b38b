//! Dependence on position: the damper's gap changes along the stroke.
//!
//! ```text
//! F' = F0 + (F - F0) max(0, 1 + gamma x)
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | gamma | `growth_per_m` | 1/m | relative growth of the force per metre of displacement |
//! | x | input | m | displacement, positive in extension |
//! | F0 | of the model | N | the session's force offset, which does not come from the damper |

use super::parts::scaled;
use super::{Definition, EffectState, Inside, Inversion, Layer, Parameter, Properties, Unit, Values};
use crate::force::{Inputs, Number};

pub(super) struct PositionDependence;

impl Definition for PositionDependence {
    const PROPERTIES: Properties = Properties {
        id: "position_dependence",
        form: None,
        what: "the force grows or falls along the stroke, in proportion to itself",
        parameters: &[Parameter::absolute("growth_per_m", Unit::new("_per_m", "1/m"), [-10.0, 10.0], 0.1)],
        example: &[4.0],
        separated_by: "the same speeds and currents around several mean positions",
        confounders: &["gas_spring", "asymmetry", "end_stop"],
        needs: &[],
        follows_time: false,
        layer: Layer::Gap(1),
        inversion: Inversion::Search,
        static_stiffness_n_m: |_| 0.0,
        refinement: None,
    };

    #[inline]
    fn step<R: Number>(
        [growth_per_m, ..]: Values<R>,
        _: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        let force_n = inside.run(inputs)?;
        Some(scaled(force_n, inside.offset_n(), growth_per_m * inputs.displacement_m + 1.0))
    }
}
