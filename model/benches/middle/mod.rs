//! Force laws and effects in the middle of their parameter ranges, for a damper of 1 kN, 15 mm, 0.2 m/s and 2
//! m/s².

#![allow(dead_code, reason = "each bench and test is a separate crate and uses only a part")]

use mr_damper_model::effect::{Effect, EffectModel};
use mr_damper_model::force::ForceLaw;

/// Parameters in the middle of the range of starting values of a fit.
pub(crate) fn parameters(law: ForceLaw) -> Vec<f64> {
    let value = |p: &mr_damper_model::force::law::Parameter| {
        let scale = 1e3_f64.powi(p.scale.force)
            * 0.015_f64.powi(p.scale.displacement)
            * 0.2_f64.powi(p.scale.velocity)
            * 2_f64.powi(p.scale.acceleration);
        let [low, high] = p.start;
        scale * if low > 0.0 { (low * high).sqrt() } else { 0.3 * low + 0.7 * high }
    };
    law.parameters().iter().map(value).collect()
}

/// The effect in the middle of its physical range.
pub(crate) fn present(effect: Effect) -> EffectModel {
    let value = |p: &mr_damper_model::effect::Parameter| {
        let size = 1e3_f64.powi(p.scale.force)
            * 0.015_f64.powi(p.scale.displacement)
            * 0.2_f64.powi(p.scale.velocity);
        let [low, high] = p.range_at(size);
        if high > 0.0 { 0.5 * high } else { 0.5 * low }
    };
    let values: Vec<f64> = effect.parameters().iter().map(value).collect();
    EffectModel::new(effect, &values).expect("within range")
}
