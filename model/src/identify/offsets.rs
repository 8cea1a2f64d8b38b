//! Force offsets of runs, for models that have no offset among their parameters.
//!
//! ```text
//! F = o_run + sum_jk b_jk phi_j(x, v) u^k + e,     phi = x, v, tanh(v/sd v), tanh(4 v/sd v);   k = 0, 1, 2 if driven
//! ```
//!
//! u is the normalised drive. A run's mean force is not its offset, because in a run of a few seconds motion
//! or current may be larger in one direction. A damper's force is nearly odd in x and v, so the part of the
//! mean that this rough odd model does not explain is the offset.

use super::dataset::{Dataset, Row};
use super::network::normalisation;
use nalgebra::{DMatrix, DVector};

/// Number of functions of x and v.
const FUNCTIONS: usize = 4;
/// Singular values below this share of the largest are taken as zero.
const RANK_TOLERANCE: f64 = 1e-9;

/// The offset of each run, N, from its counted rows.
pub(super) fn session_offsets_n(datasets: &[Dataset], driven: bool) -> Vec<f64> {
    let velocity = normalisation(datasets, |_, row| row.velocity_m_s);
    let displacement = normalisation(datasets, |_, row| row.displacement_m);
    let drive = normalisation(datasets, |_, row| row.drive);
    let n = FUNCTIONS * if driven { 3 } else { 1 };
    // A constant channel has no effect here; the fit refuses it later, by name.
    let over = |value: f64, deviation: f64| if deviation > 0.0 { value / deviation } else { 0.0 };
    let columns = |row: &Row| {
        let (x, v) =
            (over(row.displacement_m, displacement.deviation), over(row.velocity_m_s, velocity.deviation));
        let u = over(row.drive - drive.mean, drive.deviation);
        let functions = [x, v, v.tanh(), (4.0 * v).tanh()];
        let powers = [1.0, u, u * u];
        DVector::from_fn(n + 1, |j, _| {
            if j == n { row.force_n } else { functions[j % FUNCTIONS] * powers[j / FUNCTIONS] }
        })
    };
    let complete = |dataset: &Dataset| {
        let rows = dataset.rows.iter().filter(|row| row.counts).map(columns);
        rows.filter(|row| row.iter().all(|value| value.is_finite())).collect::<Vec<_>>()
    };
    let mut square = DMatrix::<f64>::zeros(n, n);
    let mut right = DVector::<f64>::zeros(n);
    let mut means = Vec::with_capacity(datasets.len());
    for dataset in datasets {
        let rows = complete(dataset);
        let mean = rows.iter().fold(DVector::zeros(n + 1), |sum, row| sum + row) / rows.len().max(1) as f64;
        for row in rows {
            let centred = row - &mean;
            let regressors = centred.rows(0, n);
            square.ger(1.0, &regressors, &regressors, 1.0);
            right.axpy(centred[n], &regressors, 1.0);
        }
        means.push(mean);
    }
    let svd = square.svd(true, true);
    let tolerance = RANK_TOLERANCE * svd.singular_values.max();
    let b = svd.solve(&right, tolerance).unwrap_or_else(|_| DVector::zeros(n));
    means.iter().map(|mean| mean[n] - b.dot(&mean.rows(0, n))).collect()
}
