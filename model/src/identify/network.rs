//! Identification of the networks: seeded restarts, trained for simulation (free run).
//!
//! ```text
//! minimise  sum over windows of h rows, sum over their rows k of (y_k - F_k)^2,     h = 8, 32, 128 in turn
//! y_k = f(u_k, y_{k-1} .. y_{k-r}; w)  from measured forces before the window
//! ```
//!
//! A network that is trained only one step ahead learns that the force hardly changes within a sample, and
//! diverges when its own output is fed back: the NMSE of its simulation is .6 to 3 on the virtual rig.
//! Training therefore minimises the errors of short simulations, which get longer as the network improves.
//! This is the recurrent network of Wang and Liao. Its one-step-ahead prediction is worse than it could be;
//! compare it with persistence.
//!
//! `wang-liao` and `narx` are trained by the Levenberg-Marquardt method, with derivatives propagated along the window.
//! `chen` is trained by back-propagation through the window in mini-batches, with Adam steps. Initial weights
//! follow Nguyen and Widrow. A neuron of the input layer starts with a gain of one half, so that two deviations of its signal lie in
//! its steep part.
//!
//! Every fifth stretch of two seconds is held back. Of all weights in the course of a training, those with
//! the best simulation over the held-back rows are kept; the best restart is chosen in the same way. This
//! simulation starts at rest and covers whole runs, as in live use: a network can have a second, distant
//! equilibrium at rest, which it reaches from rest but not from measured force. Training does not continue on
//! the held-back rows. Each restart has its own random numbers, and sums are added in a fixed order, so
//! results do not depend on the number of threads.
//!
//! Each run has a force offset, first estimated by a rough model ([`session_offsets_n`]) and finally
//! corrected by the mean error of the simulation.
//!
//! Source: `[wangliao2001]`, `[chen2009]`, `[nguyen-widrow]` and `[adam]` in the bibliography (node/docs/guide/bibliography.md).

use super::dataset::{Dataset, Row};
use super::least_squares::{Normal, Problem, Stop, minimise};
use super::offsets::session_offsets_n;
use super::unrolled::{Stretch, Table, Tape, Unrolled};
use super::{Progress, Watch, regression};
use crate::error::{Error, IdentifyError};
use crate::force::{Network, NetworkScaling, NetworkStructure, Normalisation};
use crate::metrics::ErrorSum;
use crate::parallel;
use crate::sample::DriveKind;
use crate::units::Second;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::cell::RefCell;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Length of the stretches, s; every fifth one is held back.
const STRETCH_S: f64 = 2.0;
/// Smallest number of stretches; short runs have shorter stretches.
const STRETCHES: usize = 10;
/// Smallest and largest number of rows in a stretch.
const STRETCH_ROWS: [usize; 2] = [64, 2048];
/// Smallest number of rows per weight.
const ROWS_PER_WEIGHT: usize = 4;
/// Number of requested restarts per network restart, because a network takes this many times as long as a
/// tanh model.
pub(super) const RESTARTS_PER_RESTART: u32 = 8;
/// Number of restarts that are refined.
const POLISHED: usize = 2;
/// Accepted steps without a better simulation of the held-back rows after which a stage ends.
const PATIENCE: u32 = 8;
/// Gain of the neurons in the input layer before training; their bias is zero.
const INPUT_GAIN: f64 = 0.5;
/// A channel is constant if its deviation is below this share of its mean.
const ROUNDING: f64 = 1e-9;

/// One stage of a training: window length, number of rows in the error sum, and number of evaluations
/// (Levenberg-Marquardt) or epochs (back-propagation).
#[derive(Debug, Clone, Copy)]
struct Stage {
    horizon: usize,
    rows: usize,
    rounds: usize,
}

const fn stage(horizon: usize, rows: usize, rounds: usize) -> Stage {
    Stage { horizon, rows, rounds }
}

/// Stages of Levenberg-Marquardt; only the refined restarts run the last one.
const MARQUARDT: [Stage; 3] = [stage(8, 1024, 8), stage(32, 1024, 15), stage(128, 2048, 25)];
/// Stages of back-propagation, on all rows.
const ADAM: [Stage; 3] = [stage(8, usize::MAX, 20), stage(32, usize::MAX, 40), stage(128, usize::MAX, 80)];

/// Result of the fit.
#[derive(Debug, Clone)]
pub(super) struct Fitted {
    /// The model; its offset is the mean of the runs' offsets.
    pub(super) model: Network,
    /// Offset of each run, N.
    pub(super) offsets_n: Vec<f64>,
    /// RMSE of each restart's simulation of the held-back rows, before refinement, N, lowest first.
    pub(super) restart_rsse_n: Vec<f64>,
    /// Warnings for the user: a simulation that is not usable.
    pub(super) warnings: Vec<String>,
}

/// Fits a passive (`drive` is `None`) or semi-active network to `datasets`.
pub(super) fn fit(
    datasets: &[Dataset],
    structure: NetworkStructure,
    drive: Option<DriveKind>,
    restarts: u32,
    seed: u64,
    watch: &Watch,
) -> Result<Fitted, Error> {
    fit_about(datasets, structure, drive, None, restarts, seed, watch)
}

/// The same, with a first estimate of the runs' offsets, N, or `None` for that of [`session_offsets_n`].
pub(super) fn fit_about(
    datasets: &[Dataset],
    structure: NetworkStructure,
    drive: Option<DriveKind>,
    offsets_n: Option<Vec<f64>>,
    restarts: u32,
    seed: u64,
    watch: &Watch,
) -> Result<Fitted, Error> {
    let rate_hz = regression::common_rate(datasets, structure.name())?;
    // Checked first: with only a few samples the checks of the channels are meaningless.
    let counted: usize = datasets.iter().map(Dataset::counted).sum();
    check_rows([counted, counted], structure, structure.weights(drive.is_some()))?;
    let offsets_n = offsets_n.unwrap_or_else(|| session_offsets_n(datasets, drive.is_some()));
    let scaling = scaling(datasets, drive, &offsets_n)?;
    let zeros = vec![0.0; structure.weights(drive.is_some())];
    let offset_n = super::mean_offset(datasets, &offsets_n);
    let empty = Network::new(structure, scaling, &zeros, Second(1.0 / rate_hz), offset_n)?;
    let [least, most] = STRETCH_ROWS;
    let stretch = ((STRETCH_S * rate_hz) as usize).min(counted / STRETCHES).clamp(least, most);
    let table = Table::new(datasets, &empty, &offsets_n, stretch);
    check_rows(table.counted(), structure, zeros.len())?;

    let (restart_rsse_n, best) = train(&table, restarts.max(1), seed, watch)?;
    let network = empty.with_weights(&best.weights);
    let offsets_n = table.corrected_offsets_n(&network, &offsets_n);
    let model = network.with_force_offset_n(super::mean_offset(datasets, &offsets_n));
    let warnings = warnings(&table, &network);
    let restart_rsse_n = restart_rsse_n.iter().map(|e| e.sqrt() * scaling.force_deviation_n).collect();
    Ok(Fitted { model, offsets_n, restart_rsse_n, warnings })
}

/// Means and deviations of the counted rows.
fn scaling(
    datasets: &[Dataset],
    drive: Option<DriveKind>,
    offsets_n: &[f64],
) -> Result<NetworkScaling, Error> {
    let force = normalisation(datasets, |run, row| row.force_n - offsets_n[run]);
    let displacement_m = normalisation(datasets, |_, row| row.displacement_m);
    let velocity_m_s = normalisation(datasets, |_, row| row.velocity_m_s);
    for (channel, n) in [("force", &force), ("displacement", &displacement_m), ("velocity", &velocity_m_s)] {
        if is_constant(n) {
            return Err(IdentifyError::Constant { channel }.into());
        }
    }
    let drive = drive.map(|kind| (kind, normalisation(datasets, |_, row| row.drive)));
    if let Some((kind, n)) = drive
        && is_constant(&n)
    {
        return Err(IdentifyError::ConstantDrive { drive: kind, value: n.mean }.into());
    }
    Ok(NetworkScaling { displacement_m, velocity_m_s, drive, force_deviation_n: force.deviation })
}

/// Mean and deviation of a signal over the counted rows; non-finite values are ignored, and both are 0
/// without values.
pub(super) fn normalisation(datasets: &[Dataset], signal: impl Fn(usize, &Row) -> f64) -> Normalisation {
    let counted = || {
        let rows = datasets.iter().enumerate().flat_map(|(run, d)| d.rows.iter().map(move |row| (run, row)));
        rows.filter(|(_, row)| row.counts).map(|(run, row)| signal(run, row)).filter(|s| s.is_finite())
    };
    let count = counted().count().max(1) as f64;
    let mean = counted().sum::<f64>() / count;
    Normalisation { mean, deviation: (counted().map(|s| (s - mean).powi(2)).sum::<f64>() / count).sqrt() }
}

/// True when the signal is constant up to rounding errors, or unknown.
pub(super) fn is_constant(n: &Normalisation) -> bool {
    n.deviation <= ROUNDING * n.mean.abs() || n.deviation <= f64::MIN_POSITIVE
}

/// Refuses data with too few rows for the number of weights.
fn check_rows(
    [training, held_back]: [usize; 2],
    structure: NetworkStructure,
    weights: usize,
) -> Result<(), Error> {
    let needed = ROWS_PER_WEIGHT * weights;
    if training < needed {
        return Err(IdentifyError::TooFewSamples {
            model: structure.name(),
            which: Some("for training, each with five before it,".to_owned()),
            samples: training,
            needed,
            count: weights,
            parts: "weights",
        }
        .into());
    }
    if held_back == 0 {
        return Err(IdentifyError::NothingHeldBack { model: structure.name() }.into());
    }
    Ok(())
}

/// Weights during training, with the mean squared error of their simulation of the held-back rows.
#[derive(Debug, Clone)]
struct Candidate {
    weights: Vec<f64>,
    error: f64,
    random: Pcg64Mcg,
}

/// The errors of the restarts, lowest first, and the best refined restart.
fn train(table: &Table, restarts: u32, seed: u64, watch: &Watch) -> Result<(Vec<f64>, Candidate), Error> {
    let done = AtomicUsize::new(0);
    let (stages, last) = match table.network.structure() {
        NetworkStructure::WangLiao | NetworkStructure::Narx => (&MARQUARDT[..2], MARQUARDT[2]),
        NetworkStructure::Chen => (&ADAM[..2], ADAM[2]),
    };
    let explore = |restart| {
        let mut random =
            Pcg64Mcg::seed_from_u64(seed ^ (restart as u64 + 1).wrapping_mul(0xd134_2543_de82_ef95));
        let weights = nguyen_widrow(&table.network, &mut random);
        let mut candidate = Candidate { weights, error: f64::INFINITY, random };
        for stage in stages {
            candidate = one_stage(table, candidate, *stage, watch)?;
        }
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        watch.report(Progress::Restart { done: done as u32, of: restarts });
        Some(candidate)
    };
    let candidates: Option<Vec<Candidate>> =
        parallel::map_indices(restarts as usize, explore).into_iter().collect();
    let mut candidates = candidates.ok_or(Error::Cancelled)?;
    // The sort is stable: of equal errors the earlier restart comes first, whatever thread it ran on.
    candidates.sort_by(|a, b| a.error.total_cmp(&b.error));
    let errors = candidates.iter().map(|candidate| candidate.error).collect();

    candidates.truncate(POLISHED);
    let of = candidates.len() as u32;
    watch.report(Progress::Polish { done: 0, of });
    let finished: Option<Vec<Candidate>> =
        parallel::map(&candidates, |candidate| one_stage(table, candidate.clone(), last, watch))
            .into_iter()
            .collect();
    watch.report(Progress::Polish { done: of, of });
    let best = finished.ok_or(Error::Cancelled)?.into_iter().min_by(|a, b| a.error.total_cmp(&b.error));
    let best = best.filter(|best| best.error.is_finite()).ok_or(IdentifyError::NoFiniteError)?;
    Ok((errors, best))
}

/// Initial weights after Nguyen and Widrow: each hidden neuron is nonlinear in its own part of the input
/// range.
fn nguyen_widrow(network: &Network, random: &mut Pcg64Mcg) -> Vec<f64> {
    let (hidden, inputs) = (network.structure().hidden(), network.inputs());
    let mut uniform = |half: f64| half * (2.0 * random.random::<f64>() - 1.0);
    let length = 0.7 * (hidden as f64).powf(1.0 / inputs as f64);
    let mut weights = vec![0.0; network.parameter_count()];
    for j in 0..hidden {
        let direction: Vec<f64> = (0..inputs).map(|_| uniform(1.0)).collect();
        let norm = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
        for (i, d) in direction.iter().enumerate() {
            weights[i * hidden + j] = length * d / norm;
        }
        weights[inputs * hidden + j] = uniform(length);
    }
    for c in &mut weights[(inputs + 1) * hidden..][..hidden] {
        *c = uniform(0.3);
    }
    if network.structure().has_input_neurons() {
        weights[(inputs + 2) * hidden + 1..][..inputs].fill(INPUT_GAIN);
    }
    weights
}

/// Runs one stage of training and returns its best weights; `None` if cancelled.
fn one_stage(table: &Table, start: Candidate, stage: Stage, watch: &Watch) -> Option<Candidate> {
    match table.network.structure() {
        NetworkStructure::WangLiao | NetworkStructure::Narx => marquardt(table, start, stage, watch),
        NetworkStructure::Chen => adam(table, start, stage, watch),
    }
}

/// The best weights of a stage so far, and the number of steps since they were found.
#[derive(Debug)]
struct Best {
    weights: Vec<f64>,
    error: f64,
    cost: f64,
    since: u32,
}

impl Best {
    fn of(start: &Candidate) -> Self {
        Self { weights: start.weights.clone(), error: start.error, cost: f64::INFINITY, since: 0 }
    }

    /// Evaluates the weights of one training step; false when the stage should stop.
    fn look(&mut self, table: &Table, weights: &[f64]) -> bool {
        let error = table.held_back_error(&table.network.with_weights(weights));
        self.since += 1;
        if error < self.error {
            (self.error, self.since) = (error, 0);
            self.weights.copy_from_slice(weights);
        }
        self.since < PATIENCE
    }
}

/// The errors of a stage; each accepted point is also evaluated on the held-back rows.
struct Watched<'a> {
    errors: Unrolled<'a>,
    best: RefCell<Best>,
}

impl Problem for Watched<'_> {
    fn normal(&self, weights: &[f64]) -> Option<Normal> {
        let normal = self.errors.normal(weights)?;
        let mut best = self.best.borrow_mut();
        // The solver accepts a point exactly when its cost is lower than the last accepted one.
        if normal.cost < best.cost {
            best.cost = normal.cost;
            if !best.look(self.errors.table, weights) {
                return None;
            }
        }
        Some(normal)
    }
}

fn marquardt(table: &Table, start: Candidate, stage: Stage, watch: &Watch) -> Option<Candidate> {
    let [rows, _] = table.counted();
    let errors = Unrolled {
        table,
        windows: table.windows(stage.horizon),
        stride: rows.div_ceil(stage.rows).max(1),
        cancel: watch.flag(),
    };
    let problem = Watched { errors, best: RefCell::new(Best::of(&start)) };
    let bounds = vec![[f64::NEG_INFINITY, f64::INFINITY]; start.weights.len()];
    let stop = Stop { evaluations: stage.rounds, cost: 1e-6, step: 1e-6 };
    // `minimise` returns `None` if `Best::look` stops it; the stage is complete in either case.
    let _ = minimise(&problem, &start.weights, &bounds, &stop);
    let Best { weights, error, .. } = problem.best.into_inner();
    (!watch.is_cancelled()).then_some(Candidate { weights, error, random: start.random })
}

/// Rows of a mini-batch.
const BATCH: usize = 256;
/// Adam's step size at the start of a stage; it falls along half a cosine to one hundredth.
const RATE: f64 = 0.03;
/// Adam's decay factors of the gradient and of the squared gradient.
const MOMENTS: [f64; 2] = [0.9, 0.999];

fn adam(table: &Table, start: Candidate, stage: Stage, watch: &Watch) -> Option<Candidate> {
    let mut best = Best::of(&start);
    let Candidate { mut weights, mut random, .. } = start;
    let mut windows: Vec<Stretch> = table.windows(stage.horizon);
    let batch = (BATCH / stage.horizon).max(1);
    let steps = stage.rounds * windows.len().div_ceil(batch);
    let mut moments = vec![[0.0; 2]; weights.len()];
    let (mut gradient, mut tape) = (vec![0.0; weights.len()], Tape::default());
    let mut step = 0;
    for _ in 0..stage.rounds {
        windows.shuffle(&mut random);
        for windows in windows.chunks(batch) {
            if watch.is_cancelled() {
                return None;
            }
            gradient.fill(0.0);
            let network = table.network.with_weights(&weights);
            let mut rows = 0;
            for window in windows {
                table.back_propagate(&network, window, &mut tape, &mut gradient);
                rows += window.len();
            }
            let rate = RATE * (0.505 + 0.495 * (std::f64::consts::PI * step as f64 / steps as f64).cos());
            step += 1;
            let unbias = MOMENTS.map(|m| 1.0 / (1.0 - m.powi(step)));
            for ((weight, moments), gradient) in weights.iter_mut().zip(&mut moments).zip(&gradient) {
                let g = gradient / rows as f64;
                for ((moment, keep), new) in moments.iter_mut().zip(MOMENTS).zip([g, g * g]) {
                    *moment = keep * *moment + (1.0 - keep) * new;
                }
                *weight -= rate * unbias[0] * moments[0] / ((unbias[1] * moments[1]).sqrt() + 1e-8);
            }
        }
        // Steps are noisy, so a stage always runs to its end.
        best.look(table, &weights);
    }
    Some(Candidate { weights: best.weights, error: best.error, random })
}

/// Warnings about the simulation of whole runs.
fn warnings(table: &Table, network: &Network) -> Vec<String> {
    let (mut largest, mut reach) = (0.0_f64, 0.0_f64);
    let mut sums = [ErrorSum::default(); 2];
    table.free_run(network, |row| {
        (largest, reach) = (largest.max(row.predicted.abs()), reach.max(row.measured.abs()));
        sums[0].add(row.measured, row.predicted);
        if row.held_back {
            sums[1].add(row.measured, row.predicted);
        }
    });
    let [whole, held_back] = sums.map(|sum| sum.fit().map_or(f64::INFINITY, |fit| fit.esr));
    let name = network.structure().name();
    let advice =
        "use its one-step-ahead prediction only, or identify again with more runs, restarts or another seed";
    let mut warnings = Vec::new();
    if largest > 3.0 * reach {
        let times = largest / reach;
        warnings.push(format!(
            "the simulation of this {name} model diverges: its force reaches {times:.1} times the measured one; {advice}"
        ));
    } else if whole >= 1.0 || held_back >= 1.0 {
        warnings.push(format!(
            "the simulation of this {name} model is not better than the mean force: NMSE {whole:.2} on the \
             training runs, {held_back:.2} on the held-back rows; {advice}"
        ));
    }
    warnings
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::condition::Conditioning;
    use crate::identify::DatasetOptions;
    use crate::rig::{Channels, Experiment, Plant, record};
    use num_dual::{Dual64, DualNum};

    fn dataset() -> Dataset {
        let experiment = Experiment::thesis("RP-APRBS").expect("known").with_duration_s(8.0);
        let run = record(&experiment, &Plant::default(), &Channels::default(), 1);
        Dataset::from_run(&run, &Conditioning::THESIS, &DatasetOptions::default()).expect("a dataset")
    }

    /// A table of the rig's run, and a network with random weights.
    fn table(structure: NetworkStructure) -> (Table, Network) {
        let datasets = [dataset()];
        let offsets_n = session_offsets_n(&datasets, true);
        let drive = Some(DriveKind::CoilCurrent);
        let scaling = scaling(&datasets, drive, &offsets_n).expect("varies");
        let zeros = vec![0.0; structure.weights(true)];
        let empty = Network::new(structure, scaling, &zeros, Second(1.0 / 512.0), offsets_n[0]);
        let empty = empty.expect("a network");
        let weights = nguyen_widrow(&empty, &mut Pcg64Mcg::seed_from_u64(1));
        (Table::new(&datasets, &empty, &offsets_n, 512), empty.with_weights(&weights))
    }

    /// The window's squared errors, from the equation at the top of this file, for any number type.
    fn cost<D: DualNum + Copy + From<f64>>(table: &Table, window: &Stretch, weights: &[D]) -> D {
        let network = &table.network;
        let (hidden, n, lags) =
            (network.structure().hidden(), network.inputs(), network.structure().force_lags());
        let mut forces: Vec<D> = Vec::new();
        let mut cost = D::zero();
        table.rows(window, |given, before, measured, counts| {
            if forces.is_empty() {
                forces = before[..lags].iter().rev().map(|f| D::from(*f)).collect();
            }
            let newest_first = forces.iter().rev().take(lags).copied();
            let mut inputs: Vec<D> = given.iter().map(|u| D::from(*u)).chain(newest_first).collect();
            if network.structure() == NetworkStructure::WangLiao {
                let first = hidden * (n + 2) + 1;
                for (i, u) in inputs.iter_mut().enumerate() {
                    *u = (weights[first + i] * *u + weights[first + n + i]).tanh();
                }
            }
            let predicted = (0..hidden).fold(weights[hidden * (n + 2)], |sum, j| {
                let bias = weights[hidden * n + j];
                let z = inputs.iter().enumerate().fold(bias, |z, (i, u)| z + weights[hidden * i + j] * *u);
                sum + weights[hidden * (n + 1) + j] * z.tanh()
            });
            forces.push(predicted);
            if counts {
                cost += (predicted - D::from(measured)) * (predicted - D::from(measured));
            }
        });
        cost
    }

    #[test]
    fn gradients_through_time_match_the_equation() {
        for structure in NetworkStructure::ALL {
            let (table, network) = table(structure);
            let weights = network.weights();
            let windows = table.windows(12);
            let window = &windows[40];
            assert_eq!(window.len(), 12);
            let mut back = vec![0.0; weights.len()];
            let found = table.back_propagate(&network, window, &mut Tape::default(), &mut back);
            let flag = std::sync::atomic::AtomicBool::new(false);
            let problem = Unrolled { table: &table, windows: vec![window.clone()], stride: 1, cancel: &flag };
            let normal = problem.normal(&weights).expect("not cancelled");
            let truth = cost(&table, window, &weights);
            assert!((truth - found).abs() < 1e-9 * truth && (truth - normal.cost).abs() < 1e-9 * truth);
            for which in (0..weights.len()).step_by(7) {
                let dual = |(k, value): (usize, &f64)| Dual64::new(*value, f64::from(k == which));
                let weights: Vec<Dual64> = weights.iter().enumerate().map(dual).collect();
                let half = 0.5 * cost(&table, window, &weights).eps;
                for found in [back[which], normal.gradient[which]] {
                    assert!((found - half).abs() < 1e-9 * truth, "{structure:?} {which}: {found} {half}");
                }
            }
        }
    }

    #[test]
    fn starts_follow_nguyen_and_widrow() {
        for structure in NetworkStructure::ALL {
            let (_, network) = table(structure);
            let (hidden, inputs, weights) = (structure.hidden(), network.inputs(), network.weights());
            let length = 0.7 * (hidden as f64).powf(1.0 / inputs as f64);
            for j in 0..hidden {
                let own = (0..inputs).map(|i| weights[i * hidden + j].powi(2)).sum::<f64>().sqrt();
                assert!(
                    (own / length - 1.0).abs() < 1e-12,
                    "{structure:?}: neuron {j} has {own}, not {length}"
                );
            }
            let spread = |values: &[f64]| values.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
            let [bends, outputs] = [inputs, inputs + 1].map(|k| spread(&weights[k * hidden..][..hidden]));
            assert!(bends > 0.5 * length && bends <= length, "{structure:?}: {bends} of {length}");
            assert!(outputs > 0.15 && outputs <= 0.3, "{structure:?}: {outputs}");
        }
    }

    #[test]
    fn a_diverging_or_useless_simulation_gives_a_warning() {
        for structure in NetworkStructure::ALL {
            let (table, network) = table(structure);
            let (hidden, inputs) = (structure.hidden(), network.inputs());
            let messages = |output: f64, feedback: f64, bias: f64| {
                let mut weights = vec![0.0; network.parameter_count()];
                weights[(inputs - structure.force_lags()) * hidden] = feedback;
                weights[(inputs + 1) * hidden] = output;
                weights[(inputs + 2) * hidden] = bias;
                if structure.has_input_neurons() {
                    weights[(inputs + 2) * hidden + 1..][..inputs].fill(1.0);
                }
                warnings(&table, &network.with_weights(&weights))
            };
            // A force of twenty deviations, which the feedback sustains.
            let said = messages(20.0, 5.0, 0.1);
            assert!(said.len() == 1 && said[0].contains("diverges"), "{said:?}");
            let said = messages(0.0, 0.0, 1.0);
            assert!(said.len() == 1 && said[0].contains("not better than the mean force"), "{said:?}");
        }
    }
}
