//! Asymmetry: the force differs between extension and compression.
//!
//! ```text
//! F' = F0 + (F - F0) (1 + beta tanh(v / 5 mm/s))
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | beta | `asymmetry` | - | share by which the force is larger in extension and smaller in compression |
//! | v | input | m/s | velocity, positive in extension |
//! | F0 | of the model | N | the session's force offset, which does not come from the damper |

use super::parts::{scaled, smooth_sign};
use super::{Definition, EffectState, Inside, Inversion, Layer, Parameter, Properties, Unit, Values};
use crate::force::{Inputs, Number};

pub(super) struct Asymmetry;

impl Definition for Asymmetry {
    const PROPERTIES: Properties = Properties {
        id: "asymmetry",
        form: None,
        what: "the damper is stiffer in one direction than in the other",
        parameters: &[Parameter::absolute("asymmetry", Unit::NONE, [-0.4, 0.4], 0.01)],
        example: &[-0.12],
        separated_by: "several currents and speeds in both directions: an offset does not grow with the force",
        confounders: &["friction", "position_dependence", "velocity_saturation"],
        needs: &[],
        follows_time: false,
        layer: Layer::Gap(2),
        inversion: Inversion::Search,
        static_stiffness_n_m: |_| 0.0,
        refinement: None,
    };

    #[inline]
    fn step<R: Number>(
        [asymmetry, ..]: Values<R>,
        _: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        let force_n = inside.run(inputs)?;
        Some(scaled(force_n, inside.offset_n(), asymmetry * smooth_sign(inputs.velocity_m_s) + 1.0))
    }
}
