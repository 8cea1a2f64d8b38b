//! Delay between the force channel and the displacement channel.
//!
//! ```text
//! d >= 0    F'(t) = F(t - d)
//! d <  0    F'(t) = F at x + |d| v and v + |d| a:  x and v extrapolated to first order
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | d | `delay_s` | s | time by which the force is late; negative if the displacement is late |
//! | x, v, a | inputs | m, m/s, m/s² | displacement and its derivatives |
//!
//! A late force is the model's force at that earlier time, by linear interpolation between samples. The memory covers 10 ms at any
//! rate: above 6.2 kHz it keeps samples 0.16 ms apart. Until it goes back far enough, the first force is used. An early force would
//! need future displacements; a causal model can only extrapolate them. Drive and acceleration are not changed.
//!
//! A positive delay is an effect of the load cell: the damper's force is F(t). At a negative delay the displacement is late, and the load
//! cell shows the force of now, so the damper's force is the extrapolated one.

use super::{
    Definition, EffectState, Inside, Inversion, Layer, MAX_DELAY_S, Parameter, Properties, Unit, Values,
};
use crate::force::{Inputs, Number};

/// True if the displacement is late and not the force.
pub(super) fn displacement_is_late<R: Number>([delay_s, ..]: Values<R>) -> bool {
    delay_s.re() < 0.0
}

pub(super) struct SensorDelay;

impl Definition for SensorDelay {
    const PROPERTIES: Properties = Properties {
        id: "sensor_delay",
        form: None,
        what: "the force channel is late, or early, by a fixed time",
        parameters: &[Parameter::absolute("delay_s", Unit::SECOND, [-MAX_DELAY_S, MAX_DELAY_S], 5e-4)],
        example: &[0.005],
        separated_by: "motion over a wide band: phase that grows in proportion to frequency while amplitude stays",
        confounders: &["force_lag", "inertia", "anti_alias_mismatch"],
        needs: &[],
        follows_time: false,
        layer: Layer::Measurement(0),
        inversion: Inversion::Search,
        static_stiffness_n_m: |_| 0.0,
        refinement: None,
    };

    #[inline]
    fn step<R: Number>(
        values @ [delay_s, ..]: Values<R>,
        state: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        if displacement_is_late(values) {
            return inside.run(&Inputs {
                displacement_m: inputs.displacement_m - delay_s * inputs.velocity_m_s,
                velocity_m_s: inputs.velocity_m_s - delay_s * inputs.acceleration_m_s2,
                ..*inputs
            });
        }
        let (force_n, since_s) = state.force_inside(inputs, inside)?;
        match since_s {
            None => state.ring.restart(force_n),
            Some(since_s) => state.ring.push(since_s, force_n),
        }
        Some(state.ring.at(delay_s))
    }
}
