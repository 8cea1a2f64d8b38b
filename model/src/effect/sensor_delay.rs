//! Delay between the force channel and the displacement channel.
//!
//! ```text
//! d >= 0    F'(t) = F(t - d)
//! d <  0    F'(t) = F at x + |d| v and v + |d| a:  what x and v will be, to first order
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | d | `delay_s` | s | time by which force is late; negative where displacement is |
//! | x, v, a | inputs | m, m/s, m/s² | displacement and its derivatives |
//!
//! A late force is the model's own of then, between two samples on the straight line. The memory reaches back 10 ms
//! at any rate: beyond 6.2 kHz it keeps samples 0.16 ms apart. Before there is a force of then, the first one holds.
//! An early force would need displacements to come, so it is the best that a causal model can do: drive and
//! acceleration are left as they are.

use super::{About, EffectState, Inside, MAX_DELAY_S, Parameter};
use crate::force::Inputs;

pub(super) const ABOUT: About = About {
    id: "sensor_delay",
    form: None,
    what: "the force channel is late, or early, by a fixed time",
    parameters: &[Parameter::absolute("delay_s", [-MAX_DELAY_S, MAX_DELAY_S], 5e-4)],
    separated_by: "motion over a wide band: phase that grows in proportion to frequency while amplitude stays",
    confounders: &["force_lag", "inertia", "anti_alias_mismatch"],
    needs: &[],
};

#[inline]
pub(super) fn step(
    delay_s: f64,
    state: &mut EffectState,
    inputs: &Inputs,
    inside: &mut Inside,
) -> Option<f64> {
    if delay_s < 0.0 {
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
