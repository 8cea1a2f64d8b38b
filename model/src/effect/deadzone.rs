//! Dead zone: free play between rod and piston.
//!
//! ```text
//! y = max(x - g/2, min(x + g/2, y before)),   d = (x - y before) sign(x - x before) - g/2
//! e = 1/2 + d / |x - x before|, within 0..1
//! F' = F0 + e (F - F0),   F: the model's at y, e v, e a
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | g | `gap_m` | m | free play from one side to the other |
//! | x, v, a | inputs | m, m/s, m/s² | displacement of the rod and its derivatives |
//! | y | state | m | displacement of the piston |
//! | d | | m | distance of the rod beyond the edge ahead of it; negative before it |
//! | e | state | - | share of the step around this sample in which the piston moves with the rod: 1 engaged, 0 within the gap |
//! | F0 | of the model | N | the session's force offset, which does not come from the damper |
//!
//! After each reversal the force is zero until the gap is crossed. The share makes the force fade over the step around the sample in
//! which the rod leaves one side or meets the other, so the force is continuous in g and has no delay. A share of the step that ends at
//! the sample would be half a step late, and the gap found would be too small by as much. The share is kept while the rod rests.
//! The piston starts engaged, in the direction of motion.
//!
//! The force is continuous in g, but not linear in g near zero: the rod moves slowly around a reversal, so even a very small gap takes a
//! while to cross. The probe is therefore as large as a gap of practical size.

use super::parts::{play, scaled};
use super::{Definition, EffectState, Inside, Inversion, Layer, Parameter, Properties, Unit, Values};
use crate::force::{Inputs, Number};

pub(super) struct Deadzone;

impl Definition for Deadzone {
    const PROPERTIES: Properties = Properties {
        id: "deadzone",
        form: None,
        what: "free play: no force for a short way after each reversal",
        parameters: &[Parameter::absolute("gap_m", Unit::METRE, [0.0, 3e-3], 3e-4)],
        example: &[8e-4],
        separated_by: "small and large strokes at equal speed: the distance without force does not grow with the stroke",
        confounders: &["friction", "force_lag"],
        needs: &[],
        follows_time: false,
        layer: Layer::Rod(0),
        inversion: Inversion::Search,
        static_stiffness_n_m: |_| 0.0,
        refinement: None,
    };

    #[inline]
    fn step<R: Number>(
        [gap_m, ..]: Values<R>,
        state: &mut EffectState<R>,
        inputs: &Inputs<R>,
        inside: &mut Inside<R>,
    ) -> Option<R> {
        let (x, v) = (inputs.displacement_m, inputs.velocity_m_s);
        if !(x.re().is_finite() && v.re().is_finite()) {
            state.elapsed.miss(inputs.dt_s);
            inside.run(inputs);
            return None;
        }
        let half_m = gap_m * 0.5;
        let (y, share) = match state.elapsed.hit(inputs.dt_s) {
            None => (if v.re() == 0.0 { x } else { x - half_m * v.re().signum() }, R::from(1.0)),
            Some(_) => {
                let [x_before, y_before, share] = state.held;
                let (y, step_m) = (play(y_before, x, half_m), x - x_before);
                let beyond_m = (x - y_before) * step_m.re().signum() - half_m;
                let share =
                    if step_m.re() == 0.0 { share } else { (beyond_m / step_m.abs() + 0.5).clamp(0.0, 1.0) };
                (y, share)
            }
        };
        state.held = [x, y, share];
        let force_n = inside.run(&Inputs {
            displacement_m: y,
            velocity_m_s: share * v,
            acceleration_m_s2: share * inputs.acceleration_m_s2,
            ..*inputs
        })?;
        Some(scaled(force_n, inside.offset_n(), share))
    }
}
