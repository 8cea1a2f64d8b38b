//! Identification of the fuzzy-tanh model: seeded restarts of a bounded least-squares fit.
//!
//! Given the slopes A3 and couplings kappa, the heights A1 and dampings A2 follow from a linear solve. A
//! restart draws slopes and couplings, solves for the rest, and lets all parameters go. Restarts work on a
//! sample of the rows, side by side; the best distinct ones are then finished on all rows. Each restart has
//! random numbers of its own and sums are added in a fixed order, so that results do not depend on the number
//! of threads.

use super::dataset::Dataset;
use super::least_squares::{Minimum, Problem, Stop, minimise};
use super::levels::Memberships;
use super::tanh_problem::{PER_FUNCTION, TanhProblem};
use super::{ActiveBound, Progress, Watch};
use crate::error::Error;
use crate::force::{FuzzyTanh, TanhFunction};
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Rows that restarts work on.
const RESTART_ROWS: usize = 8192;
/// Restarts that are finished on all rows.
const POLISHED: usize = 3;
/// Restarts when conditionings are compared.
const SCOUTS: u32 = 4;
/// Rows that a parameter wants at least.
const ROWS_PER_PARAMETER: usize = 10;
/// Costs closer than this share are the same minimum.
const SAME: f64 = 1e-4;

/// What came out.
pub(super) struct Fitted {
    /// The model, its offset the mean of the runs' offsets.
    pub(super) model: FuzzyTanh,
    /// Offset of each run, N.
    pub(super) offsets_n: Vec<f64>,
    /// RSSE of each restart on the rows it worked on, N, best first.
    pub(super) restart_rsse_n: Vec<f64>,
    /// Parameters that ended on a bound.
    pub(super) active_bounds: Vec<ActiveBound>,
    /// False when the last fit ran out of evaluations.
    pub(super) converged: bool,
}

/// Scales of the data, from which bounds and starts follow.
struct Scales {
    /// Half the range of the measured force, N.
    force_n: f64,
    /// Peak speed, m/s.
    velocity_m_s: f64,
    /// Largest ratio of speed to stroke in any run: a kind of highest circular frequency, 1/s.
    frequency_1_s: f64,
}

impl Scales {
    fn of(datasets: &[Dataset]) -> Result<Self, Error> {
        let mut scales = Self { force_n: 0.0, velocity_m_s: 0.0, frequency_1_s: 0.0 };
        for dataset in datasets {
            let e = &dataset.envelope;
            let (Some(x), Some(v), Some(f)) = (e.displacement_m, e.velocity_m_s, e.force_n) else { continue };
            let (speed, stroke) = (v[1].abs().max(v[0].abs()), 0.5 * (x[1] - x[0]));
            scales.force_n = scales.force_n.max(0.5 * (f[1] - f[0]));
            scales.velocity_m_s = scales.velocity_m_s.max(speed);
            if stroke > 0.0 {
                scales.frequency_1_s = scales.frequency_1_s.max(speed / stroke);
            }
        }
        if scales.force_n > 0.0 && scales.velocity_m_s > 0.0 && scales.frequency_1_s > 0.0 {
            return Ok(scales);
        }
        Err(Error::Data {
            message: "force or displacement never varies in these runs: nothing can be identified from them"
                .to_owned(),
        })
    }

    fn all_bounds(&self, functions: usize) -> Vec<[f64; 2]> {
        (0..functions).flat_map(|_| self.bounds()).collect()
    }

    /// Bounds of one function. The step is no higher than a few times the force seen. Its slope lies between
    /// a step as wide as all speeds and one that is over within a thousandth of them. The coupling shifts the
    /// loop by no more than twice the highest frequency, at which it would be all stiffness. Damping is free.
    fn bounds(&self) -> [[f64; 2]; PER_FUNCTION] {
        [
            [0.0, 5.0 * self.force_n],
            [f64::NEG_INFINITY, f64::INFINITY],
            [(0.3 / self.velocity_m_s).ln(), (1e3 / self.velocity_m_s).ln()],
            [-2.0 * self.frequency_1_s, 2.0 * self.frequency_1_s],
        ]
    }
}

/// Fits the model to `datasets`, which have drives of the memberships' kind.
pub(super) fn fit(
    datasets: &[Dataset],
    memberships: &Memberships,
    restarts: u32,
    seed: u64,
    watch: &Watch,
) -> Result<Fitted, Error> {
    let (sample, mut outcomes) = explore(datasets, memberships, restarts, seed, watch)?;
    let sampled = sample.counted().max(1) as f64;
    let restart_rsse_n = outcomes.iter().map(|m| (m.cost / sampled).sqrt()).collect();
    outcomes.dedup_by(|b, a| (b.cost - a.cost).abs() <= SAME * a.cost);

    let problem = TanhProblem::new(datasets, memberships, watch.flag())?;
    let bounds = Scales::of(datasets)?.all_bounds(memberships.centres.len());
    let mut best: Option<Minimum> = None;
    let candidates = outcomes.len().min(POLISHED);
    for (index, outcome) in outcomes.iter().take(POLISHED).enumerate() {
        watch.report(Progress::Polish { done: index as u32, of: candidates as u32 });
        let minimum =
            minimise(&problem, &outcome.parameters, &bounds, &Stop::default()).ok_or(Error::Cancelled)?;
        if minimum.cost.is_finite() && best.as_ref().is_none_or(|best| minimum.cost < best.cost) {
            best = Some(minimum);
        }
    }
    watch.report(Progress::Polish { done: candidates as u32, of: candidates as u32 });
    let best = best.ok_or_else(|| Error::Data {
        message: "no restart gave a finite error; look for values that are out of all proportion in the runs"
            .to_owned(),
    })?;

    let offsets_n = problem.offsets_n(&best.parameters);
    let functions: Vec<TanhFunction> = best.parameters.chunks_exact(PER_FUNCTION).map(function).collect();
    let force_offset_n = super::mean_offset(datasets, &offsets_n);
    let model = FuzzyTanh::new(memberships.membership, &memberships.centres, &functions, force_offset_n)?;
    let active_bounds = active_bounds(&best.parameters, &bounds, &functions);
    Ok(Fitted { model, offsets_n, restart_rsse_n, active_bounds, converged: best.converged })
}

/// A sample of the rows, and the restarts on it, best first.
fn explore<'a>(
    datasets: &[Dataset],
    memberships: &Memberships,
    restarts: u32,
    seed: u64,
    watch: &'a Watch,
) -> Result<(TanhProblem<'a>, Vec<Minimum>), Error> {
    let scales = Scales::of(datasets)?;
    let functions = memberships.centres.len();
    let bounds = scales.all_bounds(functions);
    let sample = TanhProblem::sample(datasets, memberships, RESTART_ROWS, seed, watch.flag())?;
    check_support(&sample, memberships)?;
    let done = AtomicUsize::new(0);
    let restarts = restarts.max(1);
    let one = |restart| {
        let start = start(&sample, functions, &scales, restart, seed)?;
        let minimum = minimise(&sample, &start, &bounds, &Stop { evaluations: 120, cost: 1e-7, step: 1e-7 })?;
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        watch.report(Progress::Restart { done: done as u32, of: restarts });
        Some(minimum)
    };
    let outcomes: Option<Vec<Minimum>> = (0..restarts).into_par_iter().map(one).collect();
    let mut outcomes = outcomes.ok_or(Error::Cancelled)?;
    // A stable sort: of equal costs the earlier restart stays ahead, whatever thread it ran on.
    outcomes.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    Ok((sample, outcomes))
}

/// Mean of the runs' ESR after a few restarts on a sample of the rows: enough to compare conditionings by.
pub(super) fn sample_esr(
    datasets: &[Dataset],
    memberships: &Memberships,
    seed: u64,
    watch: &Watch,
) -> Result<f64, Error> {
    let quiet = Watch { progress: None, ..*watch };
    let (sample, outcomes) = explore(datasets, memberships, SCOUTS, seed, &quiet)?;
    Ok(sample.mean_esr(&outcomes[0].parameters))
}

fn function(p: &[f64]) -> TanhFunction {
    TanhFunction {
        yield_force_n: p[0],
        post_yield_damping_n_s_m: p[1],
        pre_yield_slope_s_m: p[2].exp(),
        coupling_per_s: p[3],
    }
}

/// Refuses data that some set never sees.
fn check_support(problem: &TanhProblem, memberships: &Memberships) -> Result<(), Error> {
    let least = (PER_FUNCTION * ROWS_PER_PARAMETER) as f64;
    let support = problem.support();
    let poor = support.iter().zip(&memberships.centres).find(|(support, _)| **support < least);
    let Some((support, centre)) = poor else { return Ok(()) };
    Err(Error::Data {
        message: format!(
            "too few samples near {} = {centre}: they weigh {support:.1}, but a function needs {least}; add \
             runs, or choose membership centres that the runs reach",
            memberships.membership.drive
        ),
    })
}

/// Start of one restart: slopes and couplings drawn, heights and dampings solved for. `None`: cancelled.
fn start(
    sample: &TanhProblem,
    functions: usize,
    scales: &Scales,
    restart: u32,
    seed: u64,
) -> Option<Vec<f64>> {
    let mut random =
        Pcg64Mcg::seed_from_u64(seed ^ (u64::from(restart) + 1).wrapping_mul(0xd134_2543_de82_ef95));
    let mut uniform = |low: f64, high: f64| low + (high - low) * random.random::<f64>();
    let mut start = vec![0.0; PER_FUNCTION * functions];
    // Functions of one damper resemble each other: all are drawn around one slope and one coupling. The first
    // restart is the plain guess, a step over a tenth of all speeds without a loop.
    let (slope, coupling) =
        if restart == 0 { (10.0, 0.0) } else { (uniform(0.0, 5.3).exp(), uniform(-0.5, 0.5)) };
    for p in start.chunks_exact_mut(PER_FUNCTION) {
        let (stretch, shift) =
            if restart == 0 { (1.0, 0.0) } else { (uniform(-0.7, 0.7).exp(), uniform(-0.2, 0.2)) };
        p[2] = (slope * stretch / scales.velocity_m_s).ln();
        p[3] = (coupling + shift) * scales.frequency_1_s;
    }
    // With heights and dampings zero their columns are those of the linear problem, and the residual is the
    // force.
    let normal = sample.normal(&start)?;
    let linear: Vec<usize> = (0..start.len()).filter(|j| j % PER_FUNCTION < 2).collect();
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
    for p in start.chunks_exact_mut(PER_FUNCTION) {
        // A step of no height has no slope to improve.
        p[0] = p[0].max(0.02 * scales.force_n);
    }
    Some(start)
}

fn active_bounds(parameters: &[f64], bounds: &[[f64; 2]], functions: &[TanhFunction]) -> Vec<ActiveBound> {
    let names = ["yield_force_n", "post_yield_damping_n_s_m", "pre_yield_slope_s_m", "coupling_per_s"];
    let on = |(j, (p, b)): (usize, (&f64, &[f64; 2]))| {
        let function = functions.get(j / PER_FUNCTION)?;
        let value = [
            function.yield_force_n,
            function.post_yield_damping_n_s_m,
            function.pre_yield_slope_s_m,
            function.coupling_per_s,
        ][j % PER_FUNCTION];
        (*p <= b[0] || *p >= b[1]).then(|| ActiveBound {
            parameter: format!("{}[{}]", names[j % PER_FUNCTION], j / PER_FUNCTION),
            value,
        })
    };
    parameters.iter().zip(bounds).enumerate().filter_map(on).collect()
}
