//! Modified Bouc-Wen law (Spencer et al. 1997; thesis 2.2): the force law with memory.
//!
//! ```text
//! f  = c1 y' + k1 x
//! y' = (alpha z + c0 v + k0 (x - y)) / (c0 + c1)
//! z' = (v - y') (A - (beta + gamma sgn((v - y') z)) |z|^n)
//! ```
//!
//! | symbol | parameter | unit | meaning |
//! |---|---|---|---|
//! | c0 | `high_velocity_damping_n_s_m` | N·s/m | viscous damping at high velocity |
//! | c1 | `low_velocity_damping_n_s_m` | N·s/m | dashpot that rounds off the force at low velocity |
//! | k0 | `high_velocity_stiffness_n_m` | N/m | stiffness at high velocity |
//! | k1 | `accumulator_stiffness_n_m` | N/m | spring of the gas chamber |
//! | alpha | `hysteresis_force_n` | N | force of the hysteresis at z = 1 |
//! | gamma | `hysteresis_gamma_per_m` | 1/m | shape of the loop |
//! | n | `hysteresis_exponent` | 1 | sharpness of the yield |
//! | beta | `hysteresis_beta_per_m` | 1/m | shape of the loop |
//! | A | `hysteresis_slope_per_m` | 1/m | slope of z over displacement at z = 0 |
//! | x, v | inputs | m, m/s | displacement and velocity, positive in extension |
//!
//! The law has nine parameters. The source's tenth, x0, only adds the constant -k1 x0, which is the session's force
//! offset that every model here has. z is dimensionless, so that no parameter has a unit with a fractional power.
//! The source's z is a length; its alpha times that unit of length is our alpha. The scale of z is free: s z in
//! place of z, with alpha/s, s A, and gamma and beta times s^(1-n), describes the same damper, so A is a gauge. z
//! is bounded, by (A/(beta + gamma))^(1/n), only if beta + gamma > 0. As in the source, only alpha, c0 and c1
//! depend on the drive in a polynomial dependence. The others determine the shape of the loop, and if beta + gamma
//! crossed zero between two currents, z could grow without bound.
//!
//! # Integration
//! The hidden variables are r = x - y, z, and the velocity of the sample before; r' = v - y' does not depend on
//! displacement. Between samples the velocity is interpolated linearly. At speed, z reaches its bound within a
//! fraction of a sample (the published damper yields within 0.02 mm: time constants down to 0.02 ms), so an
//! explicit scheme would need hundreds of steps. The scheme used is ROS2 (Verwer et al. 1999): second order,
//! L-stable, linearly implicit, with one 2 by 2 system per step and no iteration. A sample takes one step per
//! [`LONGEST_S`], at most [`STEPS`] steps.
//!
//! Source: `[spencer1996]` in the bibliography (node/docs/guide/bibliography.md), equation 2.2 of the thesis; integration `[verwer1999]`.

use super::{Hidden, Inputs, Law, MAX_HIDDEN, Parameter, Scale, Sensitivity, by_jets, first_gradient};
use crate::force::jet::Real;
use crate::lanes::widest;

/// Longest step, s, unless a sample would need more than [`STEPS`] of them.
const LONGEST_S: f64 = 0.5e-3;
/// Largest number of steps per sample.
const STEPS: u32 = 8;
/// Diagonal of ROS2, 1 - 1/sqrt(2).
const DIAGONAL: f64 = 1.0 - std::f64::consts::FRAC_1_SQRT_2;

/// Number of parameters.
const COUNT: usize = 9;

pub(super) struct BoucWen;

impl Law for BoucWen {
    const NAME: &'static str = "bouc-wen";
    const PARAMETERS: &'static [Parameter] = &[
        Parameter::nonlinear("high_velocity_damping_n_s_m", Scale::new(1, 0, -1, 0), [0.05, 1.0])
            .within(0.0, 1e2),
        Parameter::nonlinear("low_velocity_damping_n_s_m", Scale::new(1, 0, -1, 0), [1.0, 50.0])
            .within(1e-2, 1e4),
        Parameter::nonlinear("high_velocity_stiffness_n_m", Scale::new(1, -1, 0, 0), [0.01, 1.0])
            .within(0.0, 1e2)
            .at_any_drive(),
        Parameter::linear("accumulator_stiffness_n_m", Scale::new(1, -1, 0, 0), [-0.2, 0.2]).at_any_drive(),
        Parameter::nonlinear("hysteresis_force_n", Scale::new(1, 0, 0, 0), [0.1, 1.0]).within(0.0, 10.0),
        // Start values of gamma and beta near half of the slope keep z near one, and the hysteretic force near
        // `hysteresis_force_n`.
        Parameter::nonlinear("hysteresis_gamma_per_m", Scale::new(0, -1, 0, 0), [20.0, 200.0])
            .within(1e-2, 1e4)
            .at_any_drive(),
        Parameter::nonlinear("hysteresis_exponent", Scale::ONE, [1.0, 2.5]).within(1.0, 5.0).at_any_drive(),
        Parameter::nonlinear("hysteresis_beta_per_m", Scale::new(0, -1, 0, 0), [20.0, 200.0])
            .within(0.0, 1e4)
            .at_any_drive(),
        Parameter::gauge("hysteresis_slope_per_m", Scale::new(0, -1, 0, 0), [100.0, 100.0])
            .within(1.0, 1e6)
            .at_any_drive(),
    ];
    const HAS_MEMORY: bool = true;

    #[inline]
    fn force_n<D: Real>(p: &[D], inputs: &Inputs<D>, hidden: &mut Hidden<D>) -> D {
        step(p, inputs, hidden)
    }

    #[inline]
    fn gradient(p: &[f64], inputs: &Inputs, gradient: &mut [f64]) -> f64 {
        first_gradient::<Self>(p, inputs, gradient)
    }

    #[inline]
    fn sensitivity(p: &[f64], inputs: &Inputs, hidden: &mut Hidden) -> Sensitivity {
        by_jets::<COUNT, { COUNT + MAX_HIDDEN }>(p, hidden, |p, hidden| step(p, &inputs.lifted(), hidden))
    }
}

/// Computes one sample: the force, N, and `hidden` advanced. If an input is not finite, the force is NaN and
/// `hidden` is unchanged; the next sample continues from it.
#[inline]
fn step<D: Real>(p: &[D], inputs: &Inputs<D>, hidden: &mut Hidden<D>) -> D {
    widest(
        #[inline(always)]
        || sample(p, inputs, hidden),
    )
}

/// [`step`], compiled into its caller, so that the derivatives of a [`crate::force::jet::Jet`] use the caller's vectors.
#[inline(always)]
fn sample<D: Real>(p: &[D], inputs: &Inputs<D>, hidden: &mut Hidden<D>) -> D {
    let (x, v) = (inputs.displacement_m, inputs.velocity_m_s);
    if !(x.re().is_finite() && v.re().is_finite()) {
        return D::from(f64::NAN);
    }
    let damper = Damper::new(p);
    let (mut r, mut z) = (D::from(0.0), D::from(0.0));
    if let Some(dt_s) = inputs.dt_s {
        [r, z, _] = *hidden;
        let steps = ((dt_s / LONGEST_S).ceil() as u32).clamp(1, STEPS);
        let h = dt_s / f64::from(steps);
        let slope = (v - hidden[2]) * f64::from(steps).recip();
        for k in 0..steps {
            let start = hidden[2] + slope * f64::from(k);
            [r, z] = damper.advance([r, z], [start, start + slope], h);
        }
    }
    *hidden = [r, z, v];
    damper.c1 * (v - damper.slip(r, z, v)) + damper.k1 * x
}

/// The parameters, prepared for a step.
#[derive(Clone, Copy)]
struct Damper<D> {
    c1: D,
    k0: D,
    k1: D,
    alpha: D,
    gamma: D,
    n: D,
    beta: D,
    a: D,
    /// 1/(c0 + c1).
    mobility: D,
    /// Bound of |z|, (A/(beta + gamma))^(1/n); infinite if z is not bounded.
    bound: D,
}

impl<D: Real> Damper<D> {
    #[inline(always)]
    fn new(p: &[D]) -> Self {
        let mobility = D::from(1.0) / (p[0] + p[1]);
        let bound = p[8] / (p[5] + p[7]);
        Self {
            c1: p[1],
            k0: p[2],
            k1: p[3],
            alpha: p[4],
            gamma: p[5],
            n: p[6],
            beta: p[7],
            a: p[8],
            mobility,
            bound: if bound.re() > 0.0 { (bound.ln() / p[6]).exp() } else { D::from(f64::INFINITY) },
        }
    }

    /// r' = v - y'.
    #[inline(always)]
    fn slip(&self, r: D, z: D, v: D) -> D {
        (self.c1 * v - self.alpha * z - self.k0 * r) * self.mobility
    }

    /// |z|^(n-1), and beta + gamma or beta - gamma, depending on the sign of slip and z.
    #[inline(always)]
    fn shape(&self, slip: D, z: D) -> (D, D) {
        let (magnitude, loading) = match z.re() {
            re if re > 0.0 => (z, slip.re() >= 0.0),
            re if re < 0.0 => (-z, slip.re() < 0.0),
            // z = 0: z' multiplies the power by |z|, so its value does not matter there. It enters the matrix W of the step, where any
            // value keeps the order of the scheme; for n = 1 the power is 1, and 0 omits one term of W.
            _ => return (D::from(0.0), self.beta),
        };
        let power = ((self.n - D::from(1.0)) * magnitude.ln()).exp();
        (power, if loading { self.beta + self.gamma } else { self.beta - self.gamma })
    }

    /// One ROS2 step of `h` seconds from [r, z], with a velocity that changes linearly from `v[0]` to `v[1]`:
    ///
    /// ```text
    /// W k1 = f(s)      W k2 = f(s + h k1) - 2 k1      s + h (3 k1 + k2) / 2,      W = 1 - d h df/ds
    /// ```
    #[inline(always)]
    fn advance(&self, [r, z]: [D; 2], v: [D; 2], h: f64) -> [D; 2] {
        let slip = self.slip(r, z, v[0]);
        let (power, shape) = self.shape(slip, z);
        let magnitude = absolute(z);
        let growth = self.a - shape * power * magnitude;
        let slip_by_r = -(self.k0 * self.mobility);
        let slip_by_z = -(self.alpha * self.mobility);
        let bend = shape * self.n * power * slip;
        let rate_by_r = growth * slip_by_r;
        let dh = DIAGONAL * h;
        // If beta > gamma, the unloading of z accelerates for a while. With the whole Jacobian in W, W could become
        // singular and r diverge. The scheme keeps its order with any matrix in place of df/ds, so this term is
        // limited.
        let decay = if z.re() < 0.0 { -bend } else { bend };
        let least = -0.5 / dh;
        let decay = if decay.re() > least { decay } else { D::from(least) };
        let rate_by_z = growth * slip_by_z - decay;
        let one = D::from(1.0);
        let (w11, w12) = (one - slip_by_r * dh, -(slip_by_z * dh));
        let (w21, w22) = (-(rate_by_r * dh), one - rate_by_z * dh);
        let inverse = one / (w11 * w22 - w12 * w21);
        let solve = |a: D, b: D| [(w22 * a - w12 * b) * inverse, (w11 * b - w21 * a) * inverse];

        let k1 = solve(slip, slip * growth);
        let (r2, z2) = (r + k1[0] * h, self.bounded(z + k1[1] * h, magnitude));
        let slip = self.slip(r2, z2, v[1]);
        let (power, shape) = self.shape(slip, z2);
        let rate = slip * (self.a - shape * power * absolute(z2));
        let k2 = solve(slip - k1[0] * 2.0, rate - k1[1] * 2.0);
        let z_next = z + (k1[1] * 3.0 + k2[1]) * (0.5 * h);
        [r + (k1[0] * 3.0 + k2[0]) * (0.5 * h), self.bounded(z_next, magnitude)]
    }

    /// Limits z to its bound, which the exact solution never crosses outwards. If the slope of z is steep, a step
    /// from z = 0 (whose curvature is not in df/ds there) would overshoot far.
    #[inline(always)]
    fn bounded(&self, z: D, before: D) -> D {
        let limit = if before.re() > self.bound.re() { before } else { self.bound };
        if z.re() > limit.re() {
            limit
        } else if z.re() < -limit.re() {
            -limit
        } else {
            z
        }
    }
}

#[inline(always)]
fn absolute<D: Real>(z: D) -> D {
    if z.re() < 0.0 { -z } else { z }
}

#[cfg(test)]
mod tests;
