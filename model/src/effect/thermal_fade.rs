//! Thermal fade: the force falls as the damper warms up.
//!
//! ```text
//! F' = F0 + (F - F0) max(0, 1 + alpha (T - 25 °C))
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | alpha | `fade_per_k` | 1/K | relative change of the force per kelvin, mostly by viscosity |
//! | T | input | °C | case temperature, held between readings |
//! | F0 | of the model | N | the session's force offset, which does not come from the damper |
//!
//! A sample without a temperature has no force. Yield and viscous parts of the force fade by the same factor here.

use super::REFERENCE_TEMP_C;
use super::parts::scaled;
use super::{Definition, EffectState, Inside, Inversion, Layer, Need, Parameter, Properties, Unit, Values};
use crate::force::{Inputs, Number};

pub(super) struct ThermalFade;

impl Definition for ThermalFade {
    const PROPERTIES: Properties = Properties {
        id: "thermal_fade",
        form: None,
        what: "the force falls as the damper warms up",
        parameters: &[Parameter::absolute("fade_per_k", Unit::new("_per_k", "1/K"), [-0.01, 0.0], -5e-4)],
        example: &[-0.003],
        separated_by: "the same motion and current, cold and warm",
        confounders: &["load_cell_drift"],
        needs: &[Need::CaseTemperature],
        follows_time: true,
        layer: Layer::Gap(0),
        inversion: Inversion::Search,
        static_stiffness_n_m: |_| 0.0,
        refinement: None,
    };

    #[inline]
    fn step<R: Number>(
        [fade_per_k, ..]: Values<R>,
        _: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        let force_n = inside.run(inputs)?;
        let factor = fade_per_k * (inputs.case_temp_c - REFERENCE_TEMP_C) + 1.0;
        Some(scaled(force_n, inside.offset_n(), factor))
    }
}
