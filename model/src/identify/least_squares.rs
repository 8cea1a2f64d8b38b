//! Bounded nonlinear least squares: Levenberg and Marquardt's method on the normal equations.
//!
//! ```text
//! minimise   S(p) = sum r(p)^2   within   lower <= p <= upper
//! step       (J'J + lambda D) d = -J'r   over the parameters that are free,   D = diag(J'J), or 1e-3 of the largest so far
//! ```
//!
//! A parameter at a bound that the gradient pushes against is held there; one that a step would carry over
//! its bound is put on it, and the step of the others is solved anew. Lambda follows Nielsen's rule. The
//! problem hands over J'J and J'r, not J: they are summed row by row, so that memory does not grow with the
//! rows.
//!
//! J'J squares the condition number. With steps scaled by D that is harmless down to relative changes near
//! 1e-8 of a parameter, which is far below what measured data determine.

use nalgebra::{DMatrix, DVector};

/// S, J'J and J'r at one point.
#[derive(Debug, Clone, PartialEq)]
pub struct Normal {
    /// Sum of squared residuals.
    pub cost: f64,
    /// J'J, symmetric, of the order of the parameters.
    pub square: DMatrix<f64>,
    /// J'r, half the gradient of the cost.
    pub gradient: DVector<f64>,
}

/// What is minimised. `residual = model - measured`.
pub trait Problem {
    /// Sums at `parameters`; `None` when the work was cancelled.
    fn normal(&self, parameters: &[f64]) -> Option<Normal>;
}

/// How fast the scale of a parameter follows it to where the residuals feel it less, a step. The largest scale so far, as MINPACK has
/// it, holds a parameter that was felt strongly once, and searches creep along valleys: fits of a closing ended short of the minimum.
const FORGETS: f64 = 1e-3;

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stop {
    /// Most evaluations of the problem.
    pub evaluations: usize,
    /// Relative reduction of the cost, found and predicted, below which it has converged.
    pub cost: f64,
    /// Scaled step relative to the scaled parameters below which it has converged.
    pub step: f64,
}

impl Default for Stop {
    fn default() -> Self {
        Self { evaluations: 200, cost: 1e-10, step: 1e-10 }
    }
}

/// A minimum, or as near as the evaluations went.
#[derive(Debug, Clone, PartialEq)]
pub struct Minimum {
    /// Parameters within their bounds.
    pub parameters: Vec<f64>,
    /// Sum of squared residuals there.
    pub cost: f64,
    /// Evaluations of the problem.
    pub evaluations: usize,
    /// False when the evaluations ran out before it converged.
    pub converged: bool,
}

/// Minimises `problem` from `start` within `bounds` (a pair of lower and upper one a parameter; infinite ones
/// are allowed). `start` is moved into the bounds first. `None` when the work was cancelled.
///
/// # Panics
/// When `bounds` is not as long as `start`.
pub fn minimise(problem: &impl Problem, start: &[f64], bounds: &[[f64; 2]], stop: &Stop) -> Option<Minimum> {
    assert_eq!(start.len(), bounds.len(), "one pair of bounds for each parameter");
    let mut p =
        DVector::from_iterator(start.len(), start.iter().zip(bounds).map(|(s, b)| s.clamp(b[0], b[1])));
    let mut here = problem.normal(p.as_slice())?;
    let mut scale = DVector::<f64>::zeros(p.len());
    let (mut lambda, mut growth, mut evaluations) = (1e-3, 2.0, 1);
    let mut converged = false;
    while !converged && evaluations < stop.evaluations {
        for (s, d) in scale.iter_mut().zip(here.square.diagonal().iter()) {
            *s = d.max(FORGETS * *s);
        }
        let (step, trial) = bounded_step(&here, &p, bounds, &scale, lambda);
        let length = |v: &DVector<f64>| v.iter().zip(&scale).map(|(v, s)| v * v * s).sum::<f64>().sqrt();
        let predicted = -2.0 * here.gradient.dot(&step) - step.dot(&(&here.square * &step));
        if length(&step) <= stop.step * length(&p) {
            converged = true;
            continue;
        }
        if predicted.partial_cmp(&(1e-16 * here.cost)) != Some(std::cmp::Ordering::Greater) {
            // Cut at its bounds a step can lose its descent; a shorter one, nearer the gradient, has it.
            converged = lambda > 1e6;
            lambda *= 10.0;
            continue;
        }
        let there = problem.normal(trial.as_slice())?;
        evaluations += 1;
        let gained = here.cost - there.cost;
        if gained > 0.0 {
            let ratio = gained / predicted;
            lambda = (lambda * (1.0 - (2.0 * ratio - 1.0).powi(3)).max(1.0 / 3.0)).max(1e-15);
            growth = 2.0;
            converged = gained <= stop.cost * here.cost && predicted <= stop.cost * here.cost;
            (p, here) = (trial, there);
        } else {
            // Equal to the last digit counts as converged: there is nothing left to gain.
            converged = gained == 0.0 || predicted <= stop.cost * here.cost || lambda > 1e12;
            lambda *= growth;
            growth *= 2.0;
        }
    }
    Some(Minimum { parameters: p.as_slice().to_vec(), cost: here.cost, evaluations, converged })
}

/// The damped step from `p`, and the point that it leads to, which is within the bounds to the last bit.
fn bounded_step(
    here: &Normal,
    p: &DVector<f64>,
    bounds: &[[f64; 2]],
    scale: &DVector<f64>,
    lambda: f64,
) -> (DVector<f64>, DVector<f64>) {
    let n = p.len();
    let (mut step, mut trial) = (DVector::zeros(n), p.clone());
    let held = |j: usize| {
        let g = here.gradient[j];
        (p[j] <= bounds[j][0] && g >= 0.0) || (p[j] >= bounds[j][1] && g <= 0.0)
    };
    // A parameter that no residual has felt so far stays where it is.
    let mut free: Vec<usize> = (0..n).filter(|&j| !held(j) && scale[j] > 0.0).collect();
    while !free.is_empty() {
        // Scaled to a unit diagonal, so that units of the parameters do not spoil the factorisation.
        let root: Vec<f64> = free.iter().map(|&j| scale[j].sqrt()).collect();
        let system = DMatrix::from_fn(free.len(), free.len(), |a, b| {
            here.square[(free[a], free[b])] / (root[a] * root[b]) + if a == b { lambda } else { 0.0 }
        });
        // Parameters that were put on a bound act on the others through their known step.
        let moved = &here.square * &step;
        let rhs = DVector::from_fn(free.len(), |a, _| -(here.gradient[free[a]] + moved[free[a]]) / root[a]);
        let Some(solution) = solve(system, &rhs) else { return (DVector::zeros(n), p.clone()) };
        let mut inside = Vec::with_capacity(free.len());
        let mut cut = false;
        for (a, &j) in free.iter().enumerate() {
            let wanted = p[j] + solution[a] / root[a];
            trial[j] = wanted.clamp(bounds[j][0], bounds[j][1]);
            if trial[j] == wanted || wanted.is_nan() {
                inside.push(j);
            } else {
                step[j] = trial[j] - p[j];
                cut = true;
            }
        }
        if !cut {
            for (a, &j) in free.iter().enumerate() {
                step[j] = solution[a] / root[a];
            }
            break;
        }
        // At least one was put on its bound, so this ends.
        free = inside;
    }
    (step, trial)
}

/// Cholesky's solution, with as much more damping as it takes to make the matrix positive definite.
fn solve(mut system: DMatrix<f64>, rhs: &DVector<f64>) -> Option<DVector<f64>> {
    let mut extra = 1e-14;
    while extra < 1.0 {
        if let Some(factors) = system.clone().cholesky() {
            return Some(factors.solve(rhs));
        }
        for j in 0..system.nrows() {
            system[(j, j)] += extra;
        }
        extra *= 100.0;
    }
    None
}
