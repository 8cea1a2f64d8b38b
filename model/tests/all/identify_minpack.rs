//! The bounded solver of this crate against the port of MINPACK's `lmder` (crate levenberg-marquardt).

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use mr_damper_model::identify::least_squares::{Minimum, Normal, Problem, Stop, minimise};
use nalgebra_034::storage::Owned;
use nalgebra_034::{DMatrix, DVector, Dyn};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// A problem for both solvers: residuals and Jacobian (row by row) at given parameters.
type Model = fn(&[f64]) -> (Vec<f64>, Vec<Vec<f64>>);

struct Ours(Model);

impl Problem for Ours {
    fn normal(&self, parameters: &[f64]) -> Option<Normal> {
        let (r, j) = (self.0)(parameters);
        let j = nalgebra::DMatrix::from_fn(r.len(), parameters.len(), |row, column| j[row][column]);
        let r = nalgebra::DVector::from_vec(r);
        Some(Normal { cost: r.norm_squared(), square: j.tr_mul(&j), gradient: j.tr_mul(&r) })
    }
}

struct Theirs(Model, DVector<f64>);

impl LeastSquaresProblem<f64, Dyn, Dyn> for Theirs {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, x: &DVector<f64>) {
        self.1.copy_from(x);
    }

    fn params(&self) -> DVector<f64> {
        self.1.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        Some(DVector::from_vec((self.0)(self.1.as_slice()).0))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let j = (self.0)(self.1.as_slice()).1;
        Some(DMatrix::from_fn(j.len(), self.1.len(), |row, column| j[row][column]))
    }
}

fn ours(model: Model, start: &[f64], bounds: &[[f64; 2]]) -> Minimum {
    minimise(&Ours(model), start, bounds, &Stop { evaluations: 2000, cost: 1e-14, step: 1e-12 })
        .expect("never cancelled")
}

/// MINPACK's minimum from the same start: parameters and sum of squares.
fn theirs(model: Model, start: &[f64]) -> (Vec<f64>, f64) {
    let (problem, report) =
        LevenbergMarquardt::new().minimize(Theirs(model, DVector::from_column_slice(start)));
    (problem.1.as_slice().to_vec(), 2.0 * report.objective_function)
}

const FREE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

fn rosenbrock(p: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
    (vec![10.0 * (p[1] - p[0] * p[0]), 1.0 - p[0]], vec![vec![-20.0 * p[0], 10.0], vec![-1.0, 0.0]])
}

fn powell_singular(p: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
    let (a, b) = (p[1] - 2.0 * p[2], p[0] - p[3]);
    let (r5, r10) = (5.0_f64.sqrt(), 10.0_f64.sqrt());
    (
        vec![p[0] + 10.0 * p[1], r5 * (p[2] - p[3]), a * a, r10 * b * b],
        vec![
            vec![1.0, 10.0, 0.0, 0.0],
            vec![0.0, 0.0, r5, -r5],
            vec![0.0, 2.0 * a, -4.0 * a, 0.0],
            vec![2.0 * r10 * b, 0.0, 0.0, -2.0 * r10 * b],
        ],
    )
}

/// Bard's problem: a minimum with non-zero residuals, 8.21487e-3 at (0.08241, 1.133, 2.3437).
fn bard(p: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
    const Y: [f64; 15] =
        [0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39];
    let row = |(i, y): (usize, &f64)| {
        let u = (i + 1) as f64;
        let v = 16.0 - u;
        let w = u.min(v);
        let d = v * p[1] + w * p[2];
        (p[0] + u / d - y, vec![1.0, -u * v / (d * d), -u * w / (d * d)])
    };
    Y.iter().enumerate().map(row).unzip()
}

/// Two tanh functions weighted by a drive, on 1500 noisy samples: the problem of identification, with A3 not transformed.
fn tanh(p: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
    const TRUTH: [f64; 8] = [120.0, 500.0, 50.0, -0.8, 700.0, 1200.0, 35.0, 1.5];
    let force = |p: &[f64], x: f64, v: f64, w: [f64; 2]| {
        let mut row = Vec::with_capacity(8);
        let mut force = 0.0;
        for (p, w) in p.chunks(4).zip(w) {
            let u = v + p[3] * x;
            let t = (p[2] * u).tanh();
            let slope = 1.0 - t * t;
            force += w * (p[0] * t + p[1] * u);
            row.extend([w * t, w * u, w * p[0] * u * slope, w * (p[0] * p[2] * slope + p[1]) * x]);
        }
        (force, row)
    };
    let mut noise = Pcg64Mcg::seed_from_u64(4);
    (0..1500)
        .map(|k| {
            let t = f64::from(k) * 0.004;
            let (x, v) = (0.01 * (9.0 * t).sin(), 0.09 * (9.0 * t).cos() + 0.02 * (40.0 * t).cos());
            let second = 0.5 + 0.5 * (2.2 * t).sin();
            let w = [1.0 - second, second];
            let measured = force(&TRUTH, x, v, w).0 + 20.0 * (noise.random::<f64>() - 0.5);
            let (model, row) = force(p, x, v, w);
            (model - measured, row)
        })
        .unzip()
}

#[test]
fn without_active_bounds_the_minima_agree_with_minpack() {
    let cases: [(&str, Model, &[f64]); 4] = [
        ("rosenbrock", rosenbrock, &[-1.2, 1.0]),
        ("powell", powell_singular, &[3.0, -1.0, 0.0, 1.0]),
        ("bard", bard, &[1.0, 1.0, 1.0]),
        ("tanh", tanh, &[300.0, 600.0, 20.0, 0.0, 300.0, 600.0, 20.0, 0.0]),
    ];
    for (name, model, start) in cases {
        let (found, (parameters, cost)) =
            (ours(model, start, &vec![FREE; start.len()]), theirs(model, start));
        // Powell's minimum is a singular zero, which the iteration approaches but never reaches.
        assert!(found.converged || found.cost < 1e-25, "{name}: {found:?}");
        assert!((found.cost - cost).abs() <= 1e-9 * cost + 1e-12, "{name}: {} {cost}", found.cost);
        for (p, q) in found.parameters.iter().zip(&parameters) {
            assert!((p - q).abs() <= 1e-4 * q.abs() + 2e-3, "{name}: {:?} {parameters:?}", found.parameters);
        }
    }
}

#[test]
fn a_bound_is_kept_and_the_other_parameters_are_optimal_given_it() {
    // With p0 held at 0.5 the minimum of Rosenbrock is at p1 = 0.25, with a cost of 0.25.
    let found = ours(rosenbrock, &[-1.2, 1.0], &[[-2.0, 0.5], FREE]);
    assert_eq!(found.parameters[0], 0.5);
    assert!((found.parameters[1] - 0.25).abs() < 1e-9 && (found.cost - 0.25).abs() < 1e-9, "{found:?}");
    // A start outside the bounds is moved inside; bounds away from the minimum have no influence.
    let found = ours(bard, &[9.0, 9.0, 9.0], &[[0.0, 5.0]; 3]);
    assert!((found.cost - 8.214_877e-3).abs() < 1e-8, "{found:?}");
    // With all parameters held, none changes.
    let found = ours(bard, &[1.0, 1.0, 1.0], &[[1.0, 1.0]; 3]);
    assert_eq!(found.parameters, [1.0, 1.0, 1.0]);
}

#[test]
fn within_bounds_no_neighbour_is_better() {
    let bounds =
        [[0.0, 100.0], FREE, [10.0, 60.0], FREE, [0.0, 5000.0], [900.0, 1100.0], [10.0, 60.0], [-1.0, 1.0]];
    let found = ours(tanh, &[50.0, 0.0, 30.0, 0.0, 500.0, 1000.0, 30.0, 0.0], &bounds);
    let active = found.parameters.iter().zip(&bounds).filter(|(p, b)| **p <= b[0] || **p >= b[1]).count();
    assert!(found.converged && active >= 2, "{found:?}");
    let mut random = Pcg64Mcg::seed_from_u64(5);
    for size in [1e-2, 1e-4] {
        for _ in 0..300 {
            let near: Vec<f64> = found
                .parameters
                .iter()
                .zip(&bounds)
                .map(|(p, b)| (p * (1.0 + size * (2.0 * random.random::<f64>() - 1.0))).clamp(b[0], b[1]))
                .collect();
            let cost: f64 = tanh(&near).0.iter().map(|r| r * r).sum();
            assert!(cost >= found.cost * (1.0 - 1e-12), "{cost} {}", found.cost);
        }
    }
}
