//! Linear damper and spring: the plainest base of a diagnosis, for machines that are not MR dampers.
//!
//! ```text
//! f = c v + k x
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | c | `damping_n_s_m` | N·s/m | force by velocity |
//! | k | `stiffness_n_m` | N/m | force by displacement |
//! | x, v | inputs | m, m/s | displacement and velocity, positive in extension |

use super::{Inputs, MemorylessLaw, Parameter, Real, Scale};

pub(super) struct Linear;

impl MemorylessLaw for Linear {
    const NAME: &'static str = "linear";
    const PARAMETERS: &'static [Parameter] = &[
        Parameter::linear("damping_n_s_m", Scale::new(1, 0, -1, 0), [0.0, 1.0]),
        Parameter::linear("stiffness_n_m", Scale::new(1, -1, 0, 0), [-1.0, 1.0]),
    ];

    #[inline]
    fn force_n<D: Real>(p: &[D], inputs: &Inputs<D>) -> D {
        p[0] * inputs.velocity_m_s + p[1] * inputs.displacement_m
    }

    #[inline]
    fn gradient(p: &[f64], inputs: &Inputs, gradient: &mut [f64]) -> f64 {
        gradient[0] = inputs.velocity_m_s;
        gradient[1] = inputs.displacement_m;
        p[0] * inputs.velocity_m_s + p[1] * inputs.displacement_m
    }
}
