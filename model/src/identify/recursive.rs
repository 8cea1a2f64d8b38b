//! Recursive least squares in Potter's square-root form.
//!
//! ```text
//! k = P phi / (lambda + phi' P phi),   a <- a + k (y - phi' a),   P <- (P - k phi' P) / lambda
//! P = S S',   f = S' phi,   g = lambda + f' f,   S <- (S - S f f' / (g + sqrt(lambda g))) / sqrt(lambda)
//! ```
//!
//! a are the coefficients, P their covariance in units of the noise variance, phi and y the regressors and the output of a
//! sample, lambda the forgetting factor. The square root S keeps P symmetric and positive definite when regressors are
//! nearly collinear, as the lags of displacement and velocity are; the plain update loses both to rounding. a starts at zero
//! and P at a variance times the identity. With lambda = 1, a is then exactly the ridge solution
//! (sum phi phi' + I / variance)^-1 sum phi y of the samples so far.
//!
//! The first paper of the thesis names the method for its ARX models, but prints neither lambda nor the first P. Here lambda
//! is 1, since a damper on a rig does not change within a run, and the variance is 1e6 for signals that are divided by their
//! standard deviation, so that the start is soon forgotten. The regression of [`super::regression`], the default, solves the
//! same problem in one step with minimum norm. The two agree where the samples determine the coefficients; in the directions
//! that they do not determine, the recursion stays close to zero.
//!
//! Source: `[thesis-paper1]` and `[ljung1999]` in the bibliography (node/docs/guide/bibliography.md).

use nalgebra::{DMatrix, DVector};

/// Forgetting factor.
pub(super) const FORGETTING: f64 = 1.0;
/// Variance of each coefficient before the first sample, for normalised signals.
pub(super) const INITIAL_VARIANCE: f64 = 1e6;

/// State of a recursion.
pub(super) struct Recursion {
    coefficients: DVector<f64>,
    /// S, a square root of the covariance.
    root: DMatrix<f64>,
    forgetting: f64,
}

impl Recursion {
    /// Without samples: `n` coefficients of the given variance.
    pub(super) fn new(n: usize, forgetting: f64, variance: f64) -> Self {
        let root = DMatrix::from_diagonal_element(n, n, variance.sqrt());
        Self { coefficients: DVector::zeros(n), root, forgetting }
    }

    /// The coefficients so far.
    pub(super) const fn coefficients(&self) -> &DVector<f64> {
        &self.coefficients
    }

    /// Forgets coefficient `which`: it is zero with the given variance and independent of all others, which keep their joint
    /// distribution. This changes the meaning of a regressor, from the constant of one run to that of the next.
    pub(super) fn restart(&mut self, which: usize, variance: f64) {
        // Without the row of this coefficient, S is a square root of the others' covariance with one column too many.
        // Householder reflections from the right make room for the new coefficient's own column.
        let n = self.root.nrows();
        let others = self.root.clone().remove_row(which);
        let triangle = others.transpose().qr().r().transpose();
        let mut root = DMatrix::zeros(n, n);
        for (i, row) in triangle.row_iter().enumerate() {
            let to = i + usize::from(i >= which);
            root.view_mut((to, 0), (1, n - 1)).copy_from(&row);
        }
        root[(which, n - 1)] = variance.sqrt();
        self.root = root;
        self.coefficients[which] = 0.0;
    }

    /// Takes one sample.
    pub(super) fn update(&mut self, regressors: &[f64], output: f64) {
        let phi = DVector::from_column_slice(regressors);
        let projected = self.root.tr_mul(&phi);
        let total = self.forgetting + projected.norm_squared();
        let gain = &self.root * &projected;
        let residual = output - phi.dot(&self.coefficients);
        self.coefficients.axpy(residual / total, &gain, 1.0);
        let root = self.forgetting.sqrt();
        self.root.ger(-1.0 / (total + root * total.sqrt()), &gain, &projected, 1.0);
        if root != 1.0 {
            self.root /= root;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numbers::agrees;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    /// Samples of y = 2 u1 - 3 u2 + 0.5 u3 + noise, where u3 is nearly u1.
    fn samples() -> Vec<([f64; 3], f64)> {
        let mut random = Pcg64Mcg::seed_from_u64(4);
        let mut draw = || 2.0 * random.random::<f64>() - 1.0;
        let sample = |_| {
            let (u1, u2, small, noise) = (draw(), draw(), draw(), draw());
            let phi = [u1, u2, u1 + 1e-4 * small];
            (phi, 2.0 * phi[0] - 3.0 * phi[1] + 0.5 * phi[2] + 0.01 * noise)
        };
        (0..500).map(sample).collect()
    }

    /// The regularised normal equations with weights that fall by `forgetting` per sample.
    fn solved(samples: &[([f64; 3], f64)], forgetting: f64, variance: f64) -> DVector<f64> {
        let last = samples.len() as i32;
        let mut square = DMatrix::from_diagonal_element(3, 3, forgetting.powi(last) / variance);
        let mut right = DVector::zeros(3);
        for (k, (phi, y)) in (1..).zip(samples) {
            let weight = forgetting.powi(last - k);
            for i in 0..3 {
                right[i] += weight * phi[i] * y;
                for j in 0..3 {
                    square[(i, j)] += weight * phi[i] * phi[j];
                }
            }
        }
        square.lu().solve(&right).expect("regular")
    }

    #[test]
    fn the_recursion_solves_the_regularised_normal_equations() {
        let samples = samples();
        for (forgetting, variance) in [(1.0, 1e6), (1.0, 1.0), (0.98, 1e6)] {
            let mut recursion = Recursion::new(3, forgetting, variance);
            for (phi, y) in &samples {
                recursion.update(phi, *y);
            }
            let truth = solved(&samples, forgetting, variance);
            let error = (recursion.coefficients() - &truth).amax();
            // The difference of u1 and u3 is worth 1e-8 of the square: this much of the rounding is amplified.
            assert!(error < 1e-6, "{forgetting} {variance}: {error}, {truth}");
        }
    }

    #[test]
    fn a_restarted_coefficient_is_fitted_for_each_run() {
        // Two runs with constants of their own: as if each had a regressor that is zero in the other.
        let samples = samples();
        let (constants, mut recursion) = ([7.0, -40.0], Recursion::new(3, 1.0, 1e6));
        let (mut square, mut right) = (DMatrix::from_diagonal_element(4, 4, 1e-6), DVector::zeros(4));
        for (run, samples) in samples.chunks(250).enumerate() {
            recursion.restart(2, 1e6);
            for (phi, y) in samples {
                let y = y - 0.5 * phi[2] + constants[run];
                recursion.update(&[phi[0], phi[1], 1.0], y);
                let row = DVector::from_fn(4, |j, _| match j {
                    0 | 1 => phi[j],
                    _ => f64::from(j == 2 + run),
                });
                square.ger(1.0, &row, &row, 1.0);
                right.axpy(y, &row, 1.0);
            }
        }
        let truth = square.lu().solve(&right).expect("regular");
        let found = recursion.coefficients();
        for (j, of) in [(0, 0), (1, 1), (2, 3)] {
            assert!((found[j] - truth[of]).abs() < 1e-9, "{j}: {found} {truth}");
        }
        assert!((found[0] - 2.0).abs() < 0.01 && (found[2] + 40.0).abs() < 0.01, "{found}");
    }

    #[test]
    fn the_square_root_form_gives_the_coefficients_of_the_covariance_recursion_in_numpy() {
        for forgetting in [1.0, 0.98] {
            let mut recursion = Recursion::new(4, forgetting, 1e6);
            for k in (1..=300).map(f64::from) {
                if k == 151.0 {
                    recursion.restart(3, 1e6);
                }
                let phi = [(0.3 * k).sin(), (0.71 * k).cos(), (1.7 * k + 1.0).sin(), 1.0];
                let step = if k > 150.0 { 30.0 } else { 0.0 };
                let y = 2.0 * phi[0] - 3.0 * phi[1] + 0.5 * phi[2] + 7.0 + 0.2 * (11.0 * k).sin() - step;
                recursion.update(&phi, y);
            }
            agrees(&format!("recursion.{forgetting}"), recursion.coefficients().as_slice(), 1e-9);
        }
    }
}
