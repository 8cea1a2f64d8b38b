//! Semi-phenomenological law with an arctangent in place of the hyperbolic tangent (the thesis' outlook; the
//! step is taken from Cesmeci and Engin, thesis 2.6).
//!
//! ```text
//! f = (2/pi) A1 atan(A3 u) + A2 u,      u = v + kappa x,      kappa = V0/X0
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | A1 | `yield_force_n` | N | height of the step |
//! | A2 | `post_yield_damping_n_s_m` | N·s/m | slope beyond the yield |
//! | A3 | `pre_yield_slope_s_m` | s/m | steepness of the step |
//! | V0, X0 | `coupling_velocity_m_s`, `coupling_stroke_m` | m/s, m | width of the loop, as their ratio |
//! | x, v | inputs | m, m/s | displacement and velocity, positive in extension |
//!
//! The parameters are the same as in [`sp`](super::sp). An arctangent approaches its limit more slowly (as
//! 1/u) than a tanh, which gives a rounder knee.
//!
//! Source: `[cesmeci2010]` in the bibliography (node/docs/guide/bibliography.md), equation 2.6 of the thesis.

use super::{Inputs, MemorylessLaw, Parameter, Real};
use std::f64::consts::FRAC_2_PI;

pub(super) struct Arctan;

impl MemorylessLaw for Arctan {
    const NAME: &'static str = "arctan";
    const PARAMETERS: &'static [Parameter] = super::sp::Sp::PARAMETERS;

    #[inline]
    fn force_n<D: Real>(p: &[D], inputs: &Inputs<D>) -> D {
        let u = p[3] / p[4] * inputs.displacement_m + inputs.velocity_m_s;
        p[0] * FRAC_2_PI * (p[2] * u).atan() + p[1] * u
    }

    #[inline]
    fn gradient(p: &[f64], inputs: &Inputs, gradient: &mut [f64]) -> f64 {
        let (x, v) = (inputs.displacement_m, inputs.velocity_m_s);
        let kappa = p[3] / p[4];
        let u = v + kappa * x;
        let z = p[2] * u;
        let t = FRAC_2_PI * super::atan(z);
        let step = p[0] * FRAC_2_PI / (1.0 + z * z);
        let by_u = step * p[2] + p[1];
        gradient[0] = t;
        gradient[1] = u;
        gradient[2] = step * u;
        gradient[3] = by_u * x / p[4];
        gradient[4] = -by_u * x * kappa / p[4];
        p[0] * t + p[1] * u
    }
}
