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

use super::{Definition, EffectState, Inside, Inversion, Layer, Parameter, Properties, Unit, Values};
use crate::force::{Inputs, Number};

pub(super) struct Inertia;

impl Definition for Inertia {
    const PROPERTIES: Properties = Properties {
        id: "inertia",
        form: None,
        what: "a mass that moves with the rod adds its inertial force",
        parameters: &[Parameter::absolute("mass_kg", Unit::KILOGRAM, [0.0, 5.0], 0.05)],
        example: &[1.5],
        separated_by: "high-frequency motion without current: the force of a mass leads, a lag is late",
        confounders: &["sensor_delay", "force_lag", "gas_spring", "anti_alias_mismatch"],
        needs: &[],
        follows_time: false,
        layer: Layer::Rod(2),
        inversion: Inversion::Subtract,
        static_stiffness_n_m: |_| 0.0,
        refinement: None,
    };

    #[inline]
    fn step<R: Number>(
        [mass_kg, ..]: Values<R>,
        _: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        let force_n = inside.run(inputs)?;
        // Without a mass no acceleration is needed.
        if mass_kg.is_zero() { Some(force_n) } else { Some(force_n + mass_kg * inputs.acceleration_m_s2) }
    }
}
