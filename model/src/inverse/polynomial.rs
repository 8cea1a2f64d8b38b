//! Inverse by the polynomial of Choi, Lee and Park.
//!
//! ```text
//! F(v, i) = sum_k (b_k + c_k i) v^k,   k = 0 .. 6     one set for a >= 0, another for a < 0
//! i       = (Fd - sum_k b_k v^k) / sum_k c_k v^k
//! ```
//!
//! | symbol | what | unit |
//! |---|---|---|
//! | Fd | demanded force of the model without effects, including its offset | N |
//! | v, a | velocity, acceleration of the damper | m/s, m/s² |
//! | b, c | least squares on the model's force along sines, see `cycle.rs`; v is divided by its largest value in the envelope | N, N/A |
//!
//! Outside the fitted velocities the polynomial would diverge, so v is clamped to their range. If the acceleration is not known, the
//! mean of the two branches is used. The polynomial gives no current where its denominator and the model's F(i_max) - F(0) differ in
//! sign, as can happen near v = 0: the current would drive the force away from the demand.
//!
//! Source: Choi, S.-B., Lee, S.-K., Park, Y.-P. (2001), J. Sound Vib. 245, 375.
//! See `[choi2001]` in the bibliography (node/docs/guide/bibliography.md).

use super::parts::InverseMap;
use super::surrogate::Sample;
use nalgebra::{DMatrix, DVector};

/// Number of coefficients of each of b and c: degree six.
const TERMS: usize = 7;
/// Singular values below this share of the largest count as zero.
const RANK_TOLERANCE: f64 = 1e-10;

/// The polynomial: both branches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Polynomial {
    fastest_m_s: f64,
    rising: Branch,
    falling: Branch,
}

/// One set of coefficients, in powers of v over the fastest.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Branch {
    force_n: [f64; TERMS],
    slope_n_a: [f64; TERMS],
}

impl Polynomial {
    /// The least-squares fit to `samples`; `None` if they do not determine it.
    pub(super) fn fit(samples: &[Sample], fastest_m_s: f64, current_max_a: f64) -> Option<Self> {
        let branch = |falls: bool| {
            let own: Vec<&Sample> =
                samples.iter().filter(|s| (s.inputs.acceleration_m_s2 < 0.0) == falls).collect();
            Branch::fit(&own, fastest_m_s, current_max_a)
        };
        Some(Self { fastest_m_s, rising: branch(false)?, falling: branch(true)? })
    }

    pub(super) const fn parts(&self) -> InverseMap {
        let Self { fastest_m_s, rising, falling } = self;
        InverseMap::Polynomial {
            fastest_m_s: *fastest_m_s,
            rising: [rising.force_n, rising.slope_n_a],
            falling: [falling.force_n, falling.slope_n_a],
        }
    }

    /// The current for `force_n` at velocity `v_m_s` and acceleration `a_m_s2`; `None` where the polynomial gives no current. `way_n` is
    /// the change of the damper's force from zero current to the largest.
    #[inline]
    pub(super) fn current_a(&self, v_m_s: f64, a_m_s2: f64, force_n: f64, way_n: f64) -> Option<f64> {
        let u = (v_m_s / self.fastest_m_s).clamp(-1.0, 1.0);
        let (base_n, slope_n_a) = if a_m_s2.is_nan() {
            let ((b1, c1), (b2, c2)) = (self.rising.at(u), self.falling.at(u));
            (0.5 * (b1 + b2), 0.5 * (c1 + c2))
        } else {
            let branch = if a_m_s2 < 0.0 { &self.falling } else { &self.rising };
            branch.at(u)
        };
        (slope_n_a * way_n > 0.0).then(|| (force_n - base_n) / slope_n_a)
    }
}

impl Branch {
    fn fit(samples: &[&Sample], fastest_m_s: f64, current_max_a: f64) -> Option<Self> {
        if samples.len() < 2 * TERMS {
            return None;
        }
        let powers = |sample: &Sample, column: usize| {
            let u = sample.inputs.velocity_m_s / fastest_m_s;
            let scale = if column < TERMS { 1.0 } else { sample.inputs.drive / current_max_a };
            scale * u.powi((column % TERMS) as i32)
        };
        let rows = DMatrix::from_fn(samples.len(), 2 * TERMS, |row, column| powers(samples[row], column));
        let force_n = DVector::from_iterator(samples.len(), samples.iter().map(|sample| sample.force_n));
        let svd = rows.svd(true, true);
        let found = svd.solve(&force_n, RANK_TOLERANCE * svd.singular_values.max()).ok()?;
        let found = Some(found).filter(|found| found.iter().all(|number| number.is_finite()))?;
        Some(Self {
            force_n: std::array::from_fn(|k| found[k]),
            slope_n_a: std::array::from_fn(|k| found[TERMS + k] / current_max_a),
        })
    }

    /// Force without current, N, and its slope over the current, N/A.
    #[inline]
    fn at(&self, u: f64) -> (f64, f64) {
        let horner = |terms: &[f64; TERMS]| terms.iter().rev().fold(0.0, |sum, term| sum * u + term);
        (horner(&self.force_n), horner(&self.slope_n_a))
    }
}
