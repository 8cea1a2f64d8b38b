//! Bounded nonlinear least squares: the Levenberg-Marquardt method on the normal equations.
//!
//! ```text
//! minimise   S(p) = sum r(p)^2   within   lower <= p <= upper
//! step       (J'J + lambda D) d = -J'r   over the parameters that are free,   D = diag(J'J), or 1e-3 of the largest so far
//! ```
//!
//! A parameter at a bound is held there if the gradient pushes it outwards. A parameter that a step would
//! carry over its bound is put on the bound, and the step of the others is solved again. Lambda follows
//! Nielsen's rule. The problem supplies J'J and J'r instead of J: they are summed row by row, so memory use
//! does not grow with the number of rows.
//!
//! J'J squares the condition number. With steps scaled by D this is harmless down to relative changes of
//! about 1e-8 of a parameter, far below what measured data can determine.
//!
//! Source: `[levenberg-marquardt]` in the bibliography (node/docs/guide/bibliography.md).

use nalgebra::{DMatrix, DVector};

/// S, J'J and J'r at one point.
#[derive(Debug, Clone, PartialEq)]
pub struct Normal {
    /// Sum of squared residuals.
    pub cost: f64,
    /// J'J, symmetric, in the order of the parameters.
    pub square: DMatrix<f64>,
    /// J'r, half the gradient of the cost.
    pub gradient: DVector<f64>,
}

impl Normal {
    /// The sums where the model with `n` parameters cannot be simulated: any other point is better.
    pub(crate) fn impossible(n: usize) -> Self {
        Self { cost: f64::INFINITY, square: DMatrix::zeros(n, n), gradient: DVector::zeros(n) }
    }
}

/// The function to minimise. `residual = model - measured`.
pub trait Problem {
    /// The sums at `parameters`; `None` if the work was cancelled.
    fn normal(&self, parameters: &[f64]) -> Option<Normal>;
}

/// Decay factor per step of a parameter's scale while the residuals depend on the parameter less than before.
/// MINPACK keeps the largest scale so far, which holds back a parameter that was once sensitive, and searches
/// creep along valleys: fits during a diagnosis ended short of the minimum.
const FORGETS: f64 = 1e-3;

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stop {
    /// Most evaluations of the problem.
    pub evaluations: usize,
    /// Converged below this relative reduction of the cost, both actual and predicted.
    pub cost: f64,
    /// Converged below this ratio of the scaled step to the scaled parameters.
    pub step: f64,
}

impl Default for Stop {
    fn default() -> Self {
        Self { evaluations: 200, cost: 1e-10, step: 1e-10 }
    }
}

/// A minimum, or the best point if the evaluations ran out.
#[derive(Debug, Clone, PartialEq)]
pub struct Minimum {
    /// Parameters within their bounds.
    pub parameters: Vec<f64>,
    /// Sum of squared residuals there.
    pub cost: f64,
    /// Number of evaluations of the problem.
    pub evaluations: usize,
    /// False when the evaluations ran out before convergence.
    pub converged: bool,
}

/// Minimises `problem` from `start` within `bounds`, one pair of lower and upper bound per parameter; bounds
/// may be infinite. `start` is first clamped to the bounds. `None` if the work was cancelled.
///
/// ```
/// use mr_damper_model::identify::least_squares::{Normal, Problem, Stop, minimise};
/// use nalgebra::{DMatrix, DVector};
///
/// // The time constant of a decay e^(-t / T), from its values at 1 s and 2 s
/// struct Decay([(f64, f64); 2]);
///
/// impl Problem for Decay {
///     fn normal(&self, parameters: &[f64]) -> Option<Normal> {
///         let (mut cost, mut square, mut gradient) = (0.0, 0.0, 0.0);
///         for (t_s, measured) in self.0 {
///             let model = (-t_s / parameters[0]).exp();
///             let (residual, slope) = (model - measured, model * t_s / parameters[0].powi(2));
///             cost += residual * residual;
///             square += slope * slope;
///             gradient += slope * residual;
///         }
///         let (square, gradient) = (DMatrix::from_element(1, 1, square), DVector::from_element(1, gradient));
///         Some(Normal { cost, square, gradient })
///     }
/// }
///
/// let decay = Decay([1.0_f64, 2.0].map(|t_s| (t_s, (-t_s / 0.7).exp())));
/// let found = minimise(&decay, &[2.0], &[[0.1, 10.0]], &Stop::default()).expect("it is not cancelled");
/// assert!(found.converged && (found.parameters[0] - 0.7).abs() < 1e-6, "{found:?}");
/// // A bound that excludes the minimum is where the search ends.
/// let bounded = minimise(&decay, &[2.0], &[[1.0, 10.0]], &Stop::default()).expect("it is not cancelled");
/// assert_eq!(bounded.parameters, [1.0]);
/// ```
///
/// # Panics
/// If `bounds` and `start` differ in length.
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
            // A step that is cut at its bounds may not descend; a shorter step, nearer the gradient, does.
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
            // Costs that are equal to the last digit count as convergence.
            converged = gained == 0.0 || predicted <= stop.cost * here.cost || lambda > 1e12;
            lambda *= growth;
            growth *= 2.0;
        }
    }
    Some(Minimum { parameters: p.as_slice().to_vec(), cost: here.cost, evaluations, converged })
}

/// The damped step from `p`, and the point that it leads to, which is exactly within the bounds.
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
    // A parameter that has not affected any residual so far stays where it is.
    let mut free: Vec<usize> = (0..n).filter(|&j| !held(j) && scale[j] > 0.0).collect();
    while !free.is_empty() {
        // Scaled to a unit diagonal, so that the parameters' units do not harm the factorisation.
        let root: Vec<f64> = free.iter().map(|&j| scale[j].sqrt()).collect();
        let system = DMatrix::from_fn(free.len(), free.len(), |a, b| {
            here.square[(free[a], free[b])] / (root[a] * root[b]) + if a == b { lambda } else { 0.0 }
        });
        // Parameters on a bound act on the others through their known step.
        let moved = &here.square * &step;
        let rhs = DVector::from_fn(free.len(), |a, _| -(here.gradient[free[a]] + moved[free[a]]) / root[a]);
        let Some(solution) = solve(system, &rhs) else { return (DVector::zeros(n), p.clone()) };
        let mut inside = Vec::with_capacity(free.len());
        let mut cut = false;
        for (a, &j) in free.iter().enumerate() {
            let target = p[j] + solution[a] / root[a];
            trial[j] = target.clamp(bounds[j][0], bounds[j][1]);
            if trial[j] == target || target.is_nan() {
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
        // At least one parameter was put on its bound, so the loop ends.
        free = inside;
    }
    (step, trial)
}

/// Solution by Cholesky factorisation, with as much extra damping as makes the matrix positive definite.
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
