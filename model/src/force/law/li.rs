//! Sigmoid with one branch for rising and one for falling velocity (Li et al.; thesis 2.5).
//!
//! ```text
//! f = L1 (1 - e^(-L2 (v - L3))) / (1 + e^(-L2 (v - L3))) + L4 v + kr x
//!   = L1 tanh(L2 (v - L3) / 2) + L4 v + kr x         with one set of five for a >= 0, another for a < 0
//! ```
//!
//! | symbol | parameter, after `rising_` (a >= 0) or `falling_` (a < 0) | unit | meaning |
//! |---|---|---|---|
//! | L1 | `yield_force_n` | N | height of the step |
//! | L2 | `steepness_s_m` | s/m | steepness of the step |
//! | L3 | `hysteretic_velocity_m_s` | m/s | velocity at which the branch passes zero |
//! | L4 | `post_yield_damping_n_s_m` | N·s/m | slope beyond the yield |
//! | kr | `stiffness_n_m` | N/m | spring of the gas chamber |
//! | x, v, a | inputs | m, m/s, m/s² | displacement, velocity, acceleration, positive in extension |
//!
//! The law has ten parameters, as in the source, with a stiffness on each branch. a = 0 belongs to the rising
//! branch. If the acceleration is not known (NaN), the force is NaN.
//!
//! Source: `[li2009]` in the bibliography (node/docs/guide/bibliography.md), equation 2.5 of the thesis.

use super::{Branch, Inputs, MemorylessLaw, Parameter, Real, Scale};
use std::ops::Range;

const FORCE: Scale = Scale::new(1, 0, 0, 0);
const DAMPING: Scale = Scale::new(1, 0, -1, 0);
const SLOWNESS: Scale = Scale::new(0, 0, -1, 0);
const VELOCITY: Scale = Scale::new(0, 0, 1, 0);
const STIFFNESS: Scale = Scale::new(1, -1, 0, 0);

/// Index range of the branch's parameters; `None` if the acceleration is not known.
#[inline]
fn branch<D: Real>(inputs: &Inputs<D>) -> Option<Range<usize>> {
    Branch::of(inputs).map(|branch| match branch {
        Branch::Rising => 0..5,
        Branch::Falling => 5..10,
    })
}

pub(super) struct Li;

impl MemorylessLaw for Li {
    const NAME: &'static str = "li";
    const PARAMETERS: &'static [Parameter] = &[
        Parameter::linear("rising_yield_force_n", FORCE, [0.3, 1.0]).within(0.0, 5.0),
        Parameter::nonlinear("rising_steepness_s_m", SLOWNESS, [2.0, 200.0]).within(0.6, 2e3),
        Parameter::nonlinear("rising_hysteretic_velocity_m_s", VELOCITY, [-0.3, 0.3]).within(-2.0, 2.0),
        Parameter::linear("rising_post_yield_damping_n_s_m", DAMPING, [0.0, 1.0]),
        Parameter::linear("rising_stiffness_n_m", STIFFNESS, [-0.2, 0.2]),
        Parameter::linear("falling_yield_force_n", FORCE, [0.3, 1.0]).within(0.0, 5.0),
        Parameter::nonlinear("falling_steepness_s_m", SLOWNESS, [2.0, 200.0]).within(0.6, 2e3),
        Parameter::nonlinear("falling_hysteretic_velocity_m_s", VELOCITY, [-0.3, 0.3]).within(-2.0, 2.0),
        Parameter::linear("falling_post_yield_damping_n_s_m", DAMPING, [0.0, 1.0]),
        Parameter::linear("falling_stiffness_n_m", STIFFNESS, [-0.2, 0.2]),
    ];

    #[inline]
    fn force_n<D: Real>(p: &[D], inputs: &Inputs<D>) -> D {
        let Some(branch) = branch(inputs) else { return D::from(f64::NAN) };
        let p = &p[branch];
        let (x, v) = (inputs.displacement_m, inputs.velocity_m_s);
        p[0] * (p[1] * 0.5 * (-p[2] + v)).tanh() + p[3] * v + p[4] * x
    }

    #[inline]
    fn gradient(p: &[f64], inputs: &Inputs, gradient: &mut [f64]) -> f64 {
        gradient[..10].fill(0.0);
        let Some(branch) = branch(inputs) else { return f64::NAN };
        let (p, gradient) = (&p[branch.clone()], &mut gradient[branch]);
        let (x, v) = (inputs.displacement_m, inputs.velocity_m_s);
        let t = super::tanh(0.5 * p[1] * (v - p[2]));
        let step = 0.5 * p[0] * (1.0 - t * t);
        gradient[0] = t;
        gradient[1] = step * (v - p[2]);
        gradient[2] = -step * p[1];
        gradient[3] = v;
        gradient[4] = x;
        p[0] * t + p[3] * v + p[4] * x
    }
}
