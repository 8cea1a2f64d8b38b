//! Inertia: mass between the damper and the load cell, or of the fluid.
//!
//! ```text
//! F' = F + m a
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | m | `mass_kg` | kg | mass that moves with the rod on the damper's side of the load cell |
//! | a | input | m/s² | acceleration |
//!
//! The first sample has no acceleration yet, so it has a force only if the mass is zero.

use super::{About, EffectState, Inside, Parameter};
use crate::force::Inputs;

pub(super) const ABOUT: About = About {
    id: "inertia",
    form: None,
    what: "a mass that moves with the rod adds its inertial force",
    parameters: &[Parameter::absolute("mass_kg", [0.0, 5.0], 0.05)],
    separated_by: "high-frequency motion without current: the force of a mass leads, a lag is late",
    confounders: &["sensor_delay", "force_lag", "gas_spring", "anti_alias_mismatch"],
    needs: &[],
};

#[inline]
pub(super) fn step(mass_kg: f64, _: &mut EffectState, inputs: &Inputs, inside: &mut Inside) -> Option<f64> {
    let force_n = inside.run(inputs)?;
    // Without a mass no acceleration is needed.
    if mass_kg == 0.0 { Some(force_n) } else { Some(force_n + mass_kg * inputs.acceleration_m_s2) }
}
