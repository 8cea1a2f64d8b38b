//! Force and derivatives of the fuzzy-tanh model at each row, for the least-squares solver.
//!
//! ```text
//! f = sum_j w_j (A1_j t_j + A2_j u_j),      t = tanh(A3 u),  u = v + kappa x
//! df/dA1 = w t      df/d ln A3 = w A1 A3 u (1 - t^2)
//! df/dA2 = w u      df/d kappa = w (A1 A3 (1 - t^2) + A2) x
//! ```
//!
//! Weights w do not depend on the fitted parameters and are computed once. The solver uses the logarithm of
//! A3, which is positive, so that steps are ratios.

use super::free_sets::Blended;
use super::row_problem::Columns;
use super::scales::Scales;
use crate::force::{FuzzySets, Inputs, MAX_FUNCTIONS};

/// Parameters of one function: A1, A2, ln A3, kappa.
pub(super) const PER_FUNCTION: usize = 4;

/// The model's sets, and the scales of its parameters.
#[derive(Debug, Clone, Copy)]
pub(super) struct TanhColumns {
    pub(super) sets: FuzzySets,
    pub(super) scales: Scales,
}

/// Appends the weights of `sets` at `drive`.
pub(super) fn push_weights(sets: &FuzzySets, drive: f64, basis: &mut Vec<f64>) {
    basis.extend(&sets.weights(drive)[..sets.len()]);
}

impl Columns for TanhColumns {
    type Memory = ();

    fn parameters(&self) -> usize {
        PER_FUNCTION * self.sets.len()
    }

    fn has_memory(&self) -> bool {
        false
    }

    fn basis_len(&self) -> usize {
        self.sets.len()
    }

    fn push_basis(&self, drive: f64, basis: &mut Vec<f64>) {
        push_weights(&self.sets, drive, basis);
    }

    fn takes(&self, drive: f64) -> bool {
        drive.is_finite()
    }

    fn natural(&self, parameters: &[f64]) -> Vec<f64> {
        let value = |(j, p): (usize, &f64)| if j % PER_FUNCTION == 2 { p.exp() } else { *p };
        parameters.iter().enumerate().map(value).collect()
    }

    fn at_rest(&self) {}

    #[inline]
    fn row(
        &self,
        (): &mut (),
        inputs: &Inputs,
        weights: &[f64],
        natural: &[f64],
        columns: &mut [f64],
    ) -> f64 {
        self.row_by_set(&mut (), inputs, weights, natural, columns, &mut [0.0; MAX_FUNCTIONS])
    }
}

impl Blended for TanhColumns {
    #[inline]
    fn row_by_set(
        &self,
        (): &mut (),
        inputs: &Inputs,
        weights: &[f64],
        natural: &[f64],
        columns: &mut [f64],
        forces: &mut [f64],
    ) -> f64 {
        let (x, v) = (inputs.displacement_m, inputs.velocity_m_s);
        let mut force = 0.0;
        let functions = columns.chunks_exact_mut(PER_FUNCTION).zip(natural.chunks_exact(PER_FUNCTION));
        for (((column, p), &w), own) in functions.zip(weights).zip(forces) {
            if w == 0.0 {
                continue;
            }
            let (a1, a2, a3, kappa) = (p[0], p[1], p[2], p[3]);
            let u = v + kappa * x;
            let t = crate::elementary::tanh(a3 * u);
            let slope = a1 * a3 * (1.0 - t * t);
            *own = a1 * t + a2 * u;
            force += w * *own;
            column[0] = w * t;
            column[1] = w * u;
            column[2] = w * slope * u;
            column[3] = w * (slope + a2) * x;
        }
        force
    }
}
