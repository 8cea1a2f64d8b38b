//! Semi-phenomenological hyperbolic tangent (Guo et al.; thesis 2.3, 4.5).
//!
//! ```text
//! f = A1 tanh(A3 u) + A2 u,      u = v + kappa x,      kappa = V0/X0
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | A1 | `yield_force_n` | N | height of the tanh step |
//! | A2 | `post_yield_damping_n_s_m` | N·s/m | slope beyond the yield |
//! | A3 | `pre_yield_slope_s_m` | s/m | steepness of the step |
//! | V0 | `coupling_velocity_m_s` | m/s | velocity that is equivalent to the displacement X0: the width of the loop |
//! | X0 | `coupling_stroke_m` | m | see V0 |
//! | x, v | inputs | m, m/s | displacement and velocity, positive in extension |
//!
//! Only the ratio V0/X0 matters, so one of the five parameters is redundant at one current. With polynomials over
//! the current the ratio is a rational function, so both are kept. The thesis' column heads are swapped; the
//! printed numbers need the definition above (see `preset`).
//!
//! Source: `[guo2006]` in the bibliography (node/docs/guide/bibliography.md), equations 2.3 and 4.5 of the thesis.

use super::{Inputs, MemorylessLaw, Parameter, Real, Scale};

pub(super) struct Sp;

impl MemorylessLaw for Sp {
    const NAME: &'static str = "sp";
    const PARAMETERS: &'static [Parameter] = &[
        Parameter::linear("yield_force_n", Scale::new(1, 0, 0, 0), [0.3, 1.0]).within(0.0, 5.0),
        Parameter::linear("post_yield_damping_n_s_m", Scale::new(1, 0, -1, 0), [0.0, 1.0]),
        Parameter::nonlinear("pre_yield_slope_s_m", Scale::new(0, 0, -1, 0), [1.0, 100.0]).within(0.3, 1e3),
        Parameter::nonlinear("coupling_velocity_m_s", Scale::new(0, 0, 1, 0), [-0.5, 0.5]).within(-2.0, 2.0),
        Parameter::gauge("coupling_stroke_m", Scale::new(0, 1, 0, 0), [1.0, 1.0]).within(0.2, 5.0),
    ];

    #[inline]
    fn force_n<D: Real>(p: &[D], inputs: &Inputs<D>) -> D {
        let u = p[3] / p[4] * inputs.displacement_m + inputs.velocity_m_s;
        p[0] * (p[2] * u).tanh() + p[1] * u
    }

    #[inline]
    fn gradient(p: &[f64], inputs: &Inputs, gradient: &mut [f64]) -> f64 {
        let (x, v) = (inputs.displacement_m, inputs.velocity_m_s);
        let kappa = p[3] / p[4];
        let u = v + kappa * x;
        let t = super::tanh(p[2] * u);
        let step = p[0] * (1.0 - t * t);
        let by_u = step * p[2] + p[1];
        gradient[0] = t;
        gradient[1] = u;
        gradient[2] = step * u;
        gradient[3] = by_u * x / p[4];
        gradient[4] = -by_u * x * kappa / p[4];
        p[0] * t + p[1] * u
    }
}
