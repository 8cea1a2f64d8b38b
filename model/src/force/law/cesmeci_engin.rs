//! Arctangent, shifted by the sign of acceleration, with inertia (Cesmeci and Engin; thesis 2.6).
//!
//! ```text
//! f = cb v + (2/pi) fy atan(kp (v - v0 sgn(a))) + m a
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | cb | `post_yield_damping_n_s_m` | N·s/m | slope beyond the yield |
//! | fy | `yield_force_n` | N | height of the step |
//! | kp | `steepness_s_m` | s/m | steepness of the step |
//! | v0 | `hysteretic_velocity_m_s` | m/s | half the width of the loop |
//! | m | `effective_mass_kg` | kg | moving mass |
//! | v, a | inputs | m/s, m/s² | velocity and acceleration, positive in extension |
//!
//! The source's sixth parameter f0 is the session's force offset, which every model here has. a = 0 counts as
//! rising. If the acceleration is not known (NaN), the force is NaN.
//!
//! Source: `[cesmeci2010]` in the bibliography (node/docs/guide/bibliography.md), equation 2.6 of the thesis.

use super::{Branch, Inputs, MemorylessLaw, Parameter, Real, Scale};
use std::f64::consts::FRAC_2_PI;

/// sgn(a), with sgn(0) = 1; NaN if the acceleration is not known.
#[inline]
fn direction<D: Real>(inputs: &Inputs<D>) -> f64 {
    match Branch::of(inputs) {
        Some(Branch::Rising) => 1.0,
        Some(Branch::Falling) => -1.0,
        None => f64::NAN,
    }
}

pub(super) struct CesmeciEngin;

impl MemorylessLaw for CesmeciEngin {
    const NAME: &'static str = "cesmeci-engin";
    const PARAMETERS: &'static [Parameter] = &[
        Parameter::linear("post_yield_damping_n_s_m", Scale::new(1, 0, -1, 0), [0.0, 1.0]),
        Parameter::linear("yield_force_n", Scale::new(1, 0, 0, 0), [0.3, 1.0]).within(0.0, 5.0),
        Parameter::nonlinear("steepness_s_m", Scale::new(0, 0, -1, 0), [1.0, 200.0]).within(0.3, 3e3),
        Parameter::nonlinear("hysteretic_velocity_m_s", Scale::new(0, 0, 1, 0), [-0.3, 0.3])
            .within(-2.0, 2.0),
        Parameter::linear("effective_mass_kg", Scale::new(1, 0, 0, -1), [-0.1, 0.1]),
    ];

    #[inline]
    fn force_n<D: Real>(p: &[D], inputs: &Inputs<D>) -> D {
        let (v, a) = (inputs.velocity_m_s, inputs.acceleration_m_s2);
        let shifted = -p[3] * direction(inputs) + v;
        p[0] * v + p[1] * FRAC_2_PI * (p[2] * shifted).atan() + p[4] * a
    }

    #[inline]
    fn gradient(p: &[f64], inputs: &Inputs, gradient: &mut [f64]) -> f64 {
        let (v, a, s) = (inputs.velocity_m_s, inputs.acceleration_m_s2, direction(inputs));
        let shifted = v - p[3] * s;
        let z = p[2] * shifted;
        let t = FRAC_2_PI * super::atan(z);
        let step = p[1] * FRAC_2_PI / (1.0 + z * z);
        gradient[0] = v;
        gradient[1] = t;
        gradient[2] = step * shifted;
        gradient[3] = -step * p[2] * s;
        gradient[4] = a;
        p[0] * v + p[1] * t + p[4] * a
    }
}
