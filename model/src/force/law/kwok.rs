//! Hyperbolic tangent with hysteresis from the sign of displacement (Kwok et al.; thesis 2.4).
//!
//! ```text
//! f = c v + k x + alpha z,      z = tanh(beta v + delta sign(x))
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | c | `viscous_damping_n_s_m` | N·s/m | slope beyond the yield |
//! | k | `stiffness_n_m` | N/m | spring of the gas chamber |
//! | alpha | `hysteresis_force_n` | N | height of the tanh step |
//! | beta | `steepness_s_m` | s/m | steepness of the step |
//! | delta | `loop_width` | 1 | half the width of the loop, in units of beta v |
//! | x, v | inputs | m, m/s | displacement and velocity, positive in extension |
//!
//! The source's sixth parameter f0 is the session's force offset, which every model here has. sign(0) is
//! 0. The force jumps where x passes zero; displacement is measured from the middle of the stroke.
//!
//! Source: `[kwok2006]` in the bibliography (node/docs/guide/bibliography.md), equation 2.4 of the thesis.

use super::{Inputs, MemorylessLaw, Parameter, Real, Scale, sign};

pub(super) struct Kwok;

impl MemorylessLaw for Kwok {
    const NAME: &'static str = "kwok";
    const PARAMETERS: &'static [Parameter] = &[
        Parameter::linear("viscous_damping_n_s_m", Scale::new(1, 0, -1, 0), [0.0, 1.0]),
        Parameter::linear("stiffness_n_m", Scale::new(1, -1, 0, 0), [-0.2, 0.2]),
        Parameter::linear("hysteresis_force_n", Scale::new(1, 0, 0, 0), [0.3, 1.0]).within(0.0, 5.0),
        Parameter::nonlinear("steepness_s_m", Scale::new(0, 0, -1, 0), [1.0, 100.0]).within(0.3, 1e3),
        Parameter::nonlinear("loop_width", Scale::ONE, [-2.0, 2.0]).within(-20.0, 20.0),
    ];

    #[inline]
    fn force_n<D: Real>(p: &[D], inputs: &Inputs<D>) -> D {
        let (x, v) = (inputs.displacement_m, inputs.velocity_m_s);
        p[0] * v + p[1] * x + p[2] * (p[3] * v + p[4] * sign(x.re())).tanh()
    }

    #[inline]
    fn gradient(p: &[f64], inputs: &Inputs, gradient: &mut [f64]) -> f64 {
        let (x, v) = (inputs.displacement_m, inputs.velocity_m_s);
        let t = super::tanh(p[3] * v + p[4] * sign(x));
        let step = p[2] * (1.0 - t * t);
        gradient[0] = v;
        gradient[1] = x;
        gradient[2] = t;
        gradient[3] = step * v;
        gradient[4] = step * sign(x);
        p[0] * v + p[1] * x + p[2] * t
    }
}
