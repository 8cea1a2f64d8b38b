//! Bounded least-squares fit with seeded restarts, refined on all rows.
//!
//! A linear solve determines the parameters in which the force is linear, given the others. A restart draws
//! the nonlinear parameters at random, solves for the linear ones, and then fits all of them. Restarts run in
//! parallel on a sample of the rows; the best distinct ones are then refined on all rows. Most starts fall
//! behind after a few evaluations, so only the promising ones are completed. Each restart has its own random
//! numbers, and sums are added in a fixed order, so results do not depend on the number of threads.

use super::dataset::Dataset;
use super::least_squares::{Minimum, Problem, Stop, minimise};
use super::options::REWEIGHTINGS;
use super::report::BLOCK_S;
use super::row_problem::{Columns, RowProblem, Training};
use super::{Loss, Options, Progress, Watch};
use crate::error::{Error, IdentifyError};
use crate::parallel;
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Sample size for restarts; half as many for a model with memory, whose rows cost more.
const RESTART_ROWS: usize = 4096;
/// Number of restarts that are refined on all rows, for a model without memory.
const POLISHED: usize = 3;
/// Restarts for the comparison of conditionings.
const SCOUTS: u32 = 4;
/// Evaluations after which restarts are compared.
const ROUGH: usize = 15;
/// One in this many restarts is continued.
const PROMISING: usize = 4;
/// Number of results of a model with memory that are evaluated on all rows.
const EVALUATED: usize = 6;
/// Costs with a smaller relative difference are taken as the same minimum.
const SAME: f64 = 1e-4;

/// A model whose parameters are searched.
pub(super) trait SearchedModel: Columns + Clone {
    /// Lower and upper bound of each parameter.
    fn bounds(&self) -> Vec<[f64; 2]>;
    /// True when the force is linear in parameter `j` and in all other such parameters together.
    fn is_linear(&self, j: usize) -> bool;
    /// A starting point with all linear parameters zero. Restart 0 is a fixed guess; the others draw from
    /// `uniform(low, high)`.
    fn draw(&self, restart: u32, uniform: &mut dyn FnMut(f64, f64) -> f64) -> Vec<f64>;
    /// A known starting point, which replaces the restarts.
    fn seeded(&self) -> Option<Vec<f64>> {
        None
    }
    /// Adjusts a start after its linear parameters are solved for.
    fn settle(&self, start: &mut [f64]);
    /// Derivatives of the natural parameters with respect to the searched ones.
    fn natural_slopes(&self, parameters: &[f64]) -> Vec<f64>;
}

/// Result of a search.
pub(super) struct Found {
    /// Parameters in the model's own units.
    pub(super) natural: Vec<f64>,
    /// Standard error of each, in its unit; NaN if the rows do not determine it.
    pub(super) standard_errors: Vec<f64>,
    /// Indices of parameters that ended on a bound.
    pub(super) on_bound: Vec<usize>,
    /// Offset of each run, N.
    pub(super) offsets_n: Vec<f64>,
    /// RMSE of each restart on its rows, N, lowest first.
    pub(super) restart_rsse_n: Vec<f64>,
    /// False when the last fit used up its evaluations.
    pub(super) converged: bool,
}

/// Searches the parameters of `searched` on `training`.
pub(super) fn search<'t, S: SearchedModel>(
    training: impl Into<Training<'t>>,
    searched: &S,
    options: &Options,
    watch: &Watch,
) -> Result<Found, Error> {
    let training = training.into();
    let (restart_rsse_n, mut outcomes) = match searched.seeded() {
        Some(parameters) => {
            let seed = Minimum { parameters, cost: f64::INFINITY, evaluations: 0, converged: false };
            (Vec::new(), vec![seed])
        }
        None => {
            let (sample, outcomes) = explore(training, searched, options.restarts, options.seed, watch)?;
            let sampled = sample.counted().max(1) as f64;
            (outcomes.iter().map(|m| (m.cost / sampled).sqrt()).collect(), outcomes)
        }
    };
    outcomes.dedup_by(|b, a| (b.cost - a.cost).abs() <= SAME * a.cost);

    let counted: usize = training.runs.iter().map(Dataset::counted).sum();
    let fewer = options.most_rows.filter(|most| counted > *most);
    let mut problem = final_problem(training, searched, options, watch);
    let bounds = searched.bounds();
    // The cost of a row decides how many candidates are refined, and how finely.
    let (polished, stop) = if searched.has_memory() {
        (1, Stop { evaluations: 60, cost: 1e-8, step: 1e-8 })
    } else {
        (POLISHED, Stop::default())
    };
    // A model with memory may be stable on short stretches and diverge over a whole run, so all rows decide.
    let on_all_rows = searched.has_memory();
    let whole =
        fewer.filter(|_| on_all_rows).map(|_| RowProblem::new(training, searched.clone(), watch.flag()));
    let evaluated = |minimum: Minimum| -> Result<Minimum, Error> {
        if !on_all_rows {
            return Ok(minimum);
        }
        let all = whole.as_ref().unwrap_or(&problem);
        let cost = all.normal(&minimum.parameters).ok_or(Error::Cancelled)?.cost;
        Ok(Minimum { cost, ..minimum })
    };
    if on_all_rows {
        outcomes.truncate(EVALUATED);
        outcomes = outcomes.into_iter().map(evaluated).collect::<Result<_, _>>()?;
        outcomes.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    }
    let mut best: Option<Minimum> = None;
    let candidates = outcomes.len().min(polished);
    for (index, outcome) in outcomes.into_iter().take(polished).enumerate() {
        watch.report(Progress::Polish { done: index as u32, of: candidates as u32 });
        let minimum = minimise(&problem, &outcome.parameters, &bounds, &stop).ok_or(Error::Cancelled)?;
        let unpolished = on_all_rows.then_some(outcome);
        for minimum in [Some(evaluated(minimum)?), unpolished].into_iter().flatten() {
            if minimum.cost.is_finite() && best.as_ref().is_none_or(|best| minimum.cost < best.cost) {
                best = Some(minimum);
            }
        }
    }
    let mut best = best.ok_or(IdentifyError::NoFiniteError)?;
    if let Loss::Huber { threshold_n } = options.loss {
        for _ in 0..REWEIGHTINGS {
            problem.weigh(&best.parameters, threshold_n);
            best = minimise(&problem, &best.parameters, &bounds, &stop).ok_or(Error::Cancelled)?;
        }
    }
    watch.report(Progress::Polish { done: candidates as u32, of: candidates as u32 });
    let mut found = found(&problem, searched, &best.parameters)?;
    // The prior has an offset of its own.
    found.offsets_n.truncate(training.runs.len());
    Ok(Found { restart_rsse_n, converged: best.converged, ..found })
}

/// The result at `parameters`, which another method found: offsets and standard errors from all rows, or from
/// the most rows that `options` allows.
pub(super) fn finish<S: SearchedModel>(
    datasets: &[Dataset],
    searched: &S,
    parameters: &[f64],
    options: &Options,
    watch: &Watch,
) -> Result<Found, Error> {
    let mut problem = final_problem(datasets.into(), searched, options, watch);
    if let Loss::Huber { threshold_n } = options.loss {
        // Each time the offsets are those of the weights before.
        for _ in 0..REWEIGHTINGS {
            problem.weigh(parameters, threshold_n);
        }
    }
    found(&problem, searched, parameters)
}

/// All rows, or a sample if the options limit their number.
fn final_problem<'a, S: SearchedModel>(
    training: Training,
    searched: &S,
    options: &Options,
    watch: &'a Watch,
) -> RowProblem<'a, S> {
    let counted: usize = training.runs.iter().map(Dataset::counted).sum();
    match options.most_rows.filter(|most| counted > *most) {
        Some(most) => {
            RowProblem::sample(training, searched.clone(), most, options.seed, watch.flag()).in_parallel()
        }
        None => RowProblem::new(training, searched.clone(), watch.flag()),
    }
}

/// The result at `parameters`, without restarts and not converged.
fn found<S: SearchedModel>(
    problem: &RowProblem<S>,
    searched: &S,
    parameters: &[f64],
) -> Result<Found, Error> {
    let bounds = searched.bounds();
    let on_bound =
        |(j, (p, b)): (usize, (&f64, &[f64; 2]))| (b[0] < b[1] && (*p <= b[0] || *p >= b[1])).then_some(j);
    Ok(Found {
        natural: searched.natural(parameters),
        standard_errors: standard_errors(problem, searched, parameters)?,
        on_bound: parameters.iter().zip(&bounds).enumerate().filter_map(on_bound).collect(),
        offsets_n: problem.offsets_n(parameters),
        restart_rsse_n: Vec::new(),
        converged: false,
    })
}

/// A sample of the rows, and the restarts on it, best first.
fn explore<'a, S: SearchedModel>(
    training: Training,
    searched: &S,
    restarts: u32,
    seed: u64,
    watch: &'a Watch,
) -> Result<(RowProblem<'a, S>, Vec<Minimum>), Error> {
    let rows = if searched.has_memory() { RESTART_ROWS / 2 } else { RESTART_ROWS };
    let sample = RowProblem::sample(training, searched.clone(), rows, seed, watch.flag());
    let bounds = searched.bounds();
    let done = AtomicUsize::new(0);
    let restarts = restarts.max(1);
    let full = Stop { evaluations: 120, cost: 1e-7, step: 1e-7 };
    let first = Stop { evaluations: ROUGH, ..full };
    let one = |restart: usize| {
        let start = start(&sample, searched, restart as u32, seed)?;
        let minimum = minimise(&sample, &start, &bounds, &first)?;
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        watch.report(Progress::Restart { done: done as u32, of: restarts });
        Some(minimum)
    };
    let outcomes: Option<Vec<Minimum>> = parallel::map_indices(restarts as usize, one).into_iter().collect();
    let mut outcomes = outcomes.ok_or(Error::Cancelled)?;
    // The sort is stable: of equal costs the earlier restart comes first, whatever thread it ran on.
    // Non-finite costs are last.
    outcomes.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let promising = outcomes.len().div_ceil(PROMISING);
    let on = |rough: &Minimum| minimise(&sample, &rough.parameters, &bounds, &full);
    let finished: Option<Vec<Minimum>> = parallel::map(&outcomes[..promising], on).into_iter().collect();
    outcomes.splice(..promising, finished.ok_or(Error::Cancelled)?);
    outcomes.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    Ok((sample, outcomes))
}

/// Mean of the runs' NMSE after a few restarts on a sample of the rows; enough to compare conditionings.
pub(super) fn sample_esr<S: SearchedModel>(
    datasets: &[Dataset],
    searched: &S,
    seed: u64,
    watch: &Watch,
) -> Result<f64, Error> {
    let quiet = Watch { progress: None, ..*watch };
    let (sample, outcomes) = explore(datasets.into(), searched, SCOUTS, seed, &quiet)?;
    Ok(sample.mean_esr(&outcomes[0].parameters))
}

/// Start of one restart: nonlinear parameters drawn, linear ones solved for. `None` if cancelled.
fn start<S: SearchedModel>(
    sample: &RowProblem<S>,
    searched: &S,
    restart: u32,
    seed: u64,
) -> Option<Vec<f64>> {
    let mut random =
        Pcg64Mcg::seed_from_u64(seed ^ (u64::from(restart) + 1).wrapping_mul(0xd134_2543_de82_ef95));
    let mut start = searched.draw(restart, &mut |low, high| low + (high - low) * random.random::<f64>());
    let linear: Vec<usize> = (0..start.len()).filter(|j| searched.is_linear(*j)).collect();
    if linear.is_empty() {
        return Some(start);
    }
    // With the linear parameters zero, their columns are the columns of the linear problem.
    let normal = sample.normal(&start)?;
    let scale = |j: usize| normal.square[(j, j)].max(f64::MIN_POSITIVE).sqrt();
    let system = DMatrix::from_fn(linear.len(), linear.len(), |a, b| {
        let ridge = if a == b { 1e-6 } else { 0.0 };
        normal.square[(linear[a], linear[b])] / (scale(linear[a]) * scale(linear[b])) + ridge
    });
    let rhs = DVector::from_fn(linear.len(), |a, _| -normal.gradient[linear[a]] / scale(linear[a]));
    if let Some(factors) = system.cholesky() {
        let solution = factors.solve(&rhs);
        for (a, &j) in linear.iter().enumerate() {
            start[j] = solution[a] / scale(j);
        }
    }
    searched.settle(&mut start);
    Some(start)
}

/// Standard errors by the sandwich formula H^-1 B H^-1: H is the normal matrix, B the scatter of the gradient
/// over blocks of one second. Residuals of an incomplete model are correlated from sample to sample; taken as
/// white noise, they would make the errors too small by a factor of ten or more.
fn standard_errors<S: SearchedModel>(
    problem: &RowProblem<S>,
    searched: &S,
    parameters: &[f64],
) -> Result<Vec<f64>, Error> {
    let normal = problem.normal(parameters).ok_or(Error::Cancelled)?;
    let scatter = problem.gradient_scatter(parameters, BLOCK_S);
    let n = parameters.len();
    let root: Vec<f64> = (0..n).map(|j| normal.square[(j, j)].sqrt()).collect();
    let known: Vec<usize> = (0..n).filter(|&j| root[j] > 0.0 && root[j].is_finite()).collect();
    let scaled = |matrix: &DMatrix<f64>| {
        DMatrix::from_fn(known.len(), known.len(), |a, b| {
            let (i, j) = (known[a], known[b]);
            matrix[(i, j)] / (root[i] * root[j])
        })
    };
    let mut errors = vec![f64::NAN; n];
    let Ok(inverse) = scaled(&normal.square).pseudo_inverse(1e-12) else { return Ok(errors) };
    let covariance = &inverse * scaled(&scatter) * &inverse;
    let slopes = searched.natural_slopes(parameters);
    for (a, &j) in known.iter().enumerate() {
        errors[j] = covariance[(a, a)].max(0.0).sqrt() / root[j] * slopes[j].abs();
    }
    Ok(errors)
}
