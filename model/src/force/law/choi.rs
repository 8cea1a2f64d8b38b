//! Polynomial of the velocity, with one branch for rising and one for falling velocity (Choi et al.; thesis
//! 2.7).
//!
//! ```text
//! f = b0 + b1 v + b2 v^2 + ... + b6 v^6        with one set of seven for a >= 0, another for a < 0
//! ```
//!
//! | symbol | parameter, after `rising_` (a >= 0) or `falling_` (a < 0) | unit | meaning |
//! |---|---|---|---|
//! | b0 | `b0_n` | N | force of the branch at v = 0 |
//! | bj | `bj_n_sj_mj` | N·(s/m)^j | coefficient of v^j, j = 1 to 6 |
//! | v, a | inputs | m/s, m/s² | velocity and acceleration, positive in extension |
//!
//! In the source each b is linear in the current, which is this law with a polynomial dependence of degree 1:
//! 28 coefficients (the thesis counts one branch, 14). The force is linear in all of them. A constant added
//! to both b0 is the session's force offset. Outside the velocities of the identification, v^6 diverges. The
//! rising branch includes a = 0. If the acceleration is not known (NaN), the force is NaN.
//!
//! Source: `[choi2001]` in the bibliography (node/docs/guide/bibliography.md), equation 2.7 of the thesis.

use super::{Branch, Inputs, MemorylessLaw, Parameter, Real, Scale};

/// Number of coefficients of a branch.
const TERMS: usize = 7;
const START: [f64; 2] = [-1.0, 1.0];

const fn term(name: &'static str, power: i32) -> Parameter {
    Parameter::linear(name, Scale::new(1, 0, -power, 0), START)
}

pub(super) struct Choi;

impl MemorylessLaw for Choi {
    const NAME: &'static str = "choi";
    const PARAMETERS: &'static [Parameter] = &[
        term("rising_b0_n", 0),
        term("rising_b1_n_s_m", 1),
        term("rising_b2_n_s2_m2", 2),
        term("rising_b3_n_s3_m3", 3),
        term("rising_b4_n_s4_m4", 4),
        term("rising_b5_n_s5_m5", 5),
        term("rising_b6_n_s6_m6", 6),
        term("falling_b0_n", 0),
        term("falling_b1_n_s_m", 1),
        term("falling_b2_n_s2_m2", 2),
        term("falling_b3_n_s3_m3", 3),
        term("falling_b4_n_s4_m4", 4),
        term("falling_b5_n_s5_m5", 5),
        term("falling_b6_n_s6_m6", 6),
    ];

    #[inline]
    fn force_n<D: Real>(p: &[D], inputs: &Inputs<D>) -> D {
        let branch = match Branch::of(inputs) {
            Some(Branch::Rising) => &p[..TERMS],
            Some(Branch::Falling) => &p[TERMS..],
            None => return D::from(f64::NAN),
        };
        // Horner's rule, from the highest power down.
        branch.iter().rev().fold(D::from(0.0), |sum, b| sum * inputs.velocity_m_s + *b)
    }

    #[inline]
    fn gradient(p: &[f64], inputs: &Inputs, gradient: &mut [f64]) -> f64 {
        gradient[..2 * TERMS].fill(0.0);
        let gradient = match Branch::of(inputs) {
            Some(Branch::Rising) => &mut gradient[..TERMS],
            Some(Branch::Falling) => &mut gradient[TERMS..],
            None => return f64::NAN,
        };
        let mut power = 1.0;
        for slot in gradient {
            *slot = power;
            power *= inputs.velocity_m_s;
        }
        Self::force_n(p, inputs)
    }
}
