//! Identification of TSK fuzzy models by hybrid learning after Jang (1993).
//!
//! ```text
//! S(m, c) = sum (F / std - o_run - sum_r w_r(m) f_r(c))^2 + lambda |c - c0|^2
//! ```
//!
//! Each epoch solves for the conclusions c at fixed memberships m by linear least squares, and then moves the
//! memberships. Jang moves them along the negative gradient, by a length that grows while the error falls and
//! shrinks otherwise. This hardly moves them: the centres that the thesis prints are still the centres of the
//! initial uniform grid. Here the step is a Levenberg-Marquardt step with the conclusions eliminated
//! (variable projection: Golub and Pereyra 1973, in Kaufman's form of 1975), so that it accounts for the
//! response of the conclusions:
//!
//! ```text
//! J'J = D'D - (phi'D)' (phi'phi + lambda)^-1 (phi'D),    J'r = D'r,    D = d(sum_r w_r f_r)/dm
//! ```
//!
//! Its damping replaces Jang's step length, and an epoch that would raise the cost is reverted. Ten such
//! epochs fit better than fifty of Jang's, and about as well as four hundred. [`Learning::Gradient`] is
//! Jang's own rule, for comparison.
//!
//! A rule in a corner that few rows reach has poorly determined conclusions: without regularisation they grow
//! to a hundred times the force and fit noise. The term lambda pulls them towards c0, the linear function
//! that fits all rows best. Its weight is fifteen times the error power of the fit, as a prior on a
//! conclusion. On a virtual damper this lowers the NMSE of new runs by a third, and the model is linear far
//! from the data. As the error vanishes, so does the regularisation.
//!
//! Centres stay within half a spacing of the uniform grid, and widths and the exponents of bells within a factor of
//! two, so that sets keep their order and meaning; wider bounds fit the training rows hardly better, and other rows worse. The
//! offset of each run is eliminated by removing its means. A low-pass on the output is omitted for model and
//! measurement alike, which hardly moves the minimum.
//!
//! Source: `[jang1993]`, `[golub1973]` and `[kaufman1975]` in the bibliography (node/docs/guide/bibliography.md).

mod back_propagation;
mod evolve;
mod genetic;
mod premises;
mod sums;

pub use back_propagation::BackPropagation;
pub use evolve::{Algorithm, Evolution};

use super::dataset::{Dataset, Row};
use super::least_squares::{Normal, Problem, Stop, minimise};
use super::spec::Variant;
use super::{Options, Progress, Watch};
use crate::condition::ApplyTo;
use crate::error::{Error, IdentifyError};
use crate::force::{MAX_INPUTS, Order, OutputScale, Shape, Signal, Tsk, TskInput, TskKind};
use crate::metrics::ErrorSum;
use crate::sample::DriveKind;
use crate::statistics::range;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use premises::{Axis, Premises, Trained};
use std::cell::{Cell, RefCell};
use sums::{Linear, Rows, Sums};

/// Number of rows, with the fit's own error, whose weight equals the prior on a conclusion one standard
/// deviation of the force away from the linear function. It is more than one because rows of a smooth motion
/// are similar.
const PRIOR_ROWS: f64 = 15.0;
/// Smallest weight of the regularisation, as a share of the rows, which keeps the equations solvable.
const LEAST_RIDGE: f64 = 1e-10;
/// Learning continues with a lighter regularisation if the error power has fallen below this share.
const LIGHTER: f64 = 0.5;
/// Smallest number of rows per parameter.
const ROWS_PER_PARAMETER: usize = 3;
/// A channel is constant if its standard deviation is below this share of its largest value.
const CONSTANT: f64 = 1e-9;
/// Learning has stalled below this relative gain.
const STALLED: f64 = 1e-6;

/// How memberships are learned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Learning {
    /// Levenberg-Marquardt steps with the conclusions eliminated.
    #[default]
    GaussNewton,
    /// Jang's rule: steps along the negative gradient, with an adaptive step length.
    Gradient,
    /// Gradient descent on memberships and conclusions together, without least squares.
    BackPropagation,
}

/// Settings of [`fit_tsk`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TskOptions {
    /// Largest number of epochs of hybrid learning; at least one is run.
    pub epochs: usize,
    /// Shape of the memberships; `None` for [`TskKind::shape`].
    pub shape: Option<Shape>,
    /// How memberships are learned, except for [`TskKind::Evolved`].
    pub learning: Learning,
    /// Evolution of the memberships of [`TskKind::Evolved`].
    pub evolution: Evolution,
    /// Schedule of [`Learning::BackPropagation`].
    pub back_propagation: BackPropagation,
}

impl Default for TskOptions {
    fn default() -> Self {
        Self {
            epochs: 50,
            shape: None,
            learning: Learning::default(),
            evolution: Evolution::default(),
            back_propagation: BackPropagation::default(),
        }
    }
}

impl TskOptions {
    /// The settings from the `options` of an identification, for a variant of the model.
    pub(super) fn of(options: &Options, variant: Option<Variant>) -> Self {
        let algorithm = match variant {
            Some(Variant::Genetic) => Algorithm::Genetic,
            _ => Algorithm::Differential,
        };
        let learning = match variant {
            Some(Variant::BackPropagation) => Learning::BackPropagation,
            _ => Learning::default(),
        };
        Self {
            learning,
            evolution: Evolution { algorithm, seed: options.seed, ..Evolution::default() },
            back_propagation: BackPropagation { seed: options.seed, ..BackPropagation::default() },
            ..Self::default()
        }
    }

    /// The shape of the memberships of a model of `kind`.
    fn trained(&self, kind: TskKind) -> Result<Trained, Error> {
        let shape = self.shape.unwrap_or(kind.shape());
        if !kind.allows(shape) {
            return Err(IdentifyError::ForeignShape { model: kind.name(), shape: shape.name() }.into());
        }
        Trained::of(shape, kind.name())
    }
}

/// Result of the fit.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedTsk {
    /// The model; its offset is the mean of the runs' offsets.
    pub model: Tsk,
    /// Offset of each run, N.
    pub offsets_n: Vec<f64>,
    /// RMSE after each epoch, N. The first is the error of the uniform grid; a reverted epoch repeats the
    /// previous value. For an evolution: after each generation, on its sample of the rows, with the regularisation term.
    /// For back-propagation: the lowest so far, on its sample of the rows.
    pub epoch_rsse_n: Vec<f64>,
    /// False if the epochs of hybrid learning ran out before the error stalled.
    pub converged: bool,
}

/// Fits a model of `kind` to the counted rows of `datasets`. With a `drive`, every dataset must have it;
/// without one, the form is passive.
///
/// ```
/// use mr_damper_model::condition::Conditioning;
/// use mr_damper_model::force::TskKind;
/// use mr_damper_model::identify::{
///     Algorithm, BackPropagation, Dataset, DatasetOptions, Evolution, Learning, TskOptions, Watch, fit_tsk,
/// };
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let experiment = Experiment::thesis("RP-ICPS").expect("an experiment of the thesis").with_duration_s(8.0);
/// let run = record(&experiment, &Plant::default(), &Channels::default(), 1);
/// let data = [Dataset::from_run(&run, &Conditioning::default(), &DatasetOptions::default())?];
/// let options = TskOptions { epochs: 5, learning: Learning::Gradient, ..TskOptions::default() };
/// let found = fit_tsk(&data, TskKind::Anfis, data[0].drive, &options, &Watch::none())?;
/// // Learning moves the memberships, and the error never rises.
/// let errors_n = &found.epoch_rsse_n;
/// assert!(errors_n.windows(2).all(|pair| pair[1] <= pair[0]) && errors_n[errors_n.len() - 1] < errors_n[0], "{errors_n:?}");
///
/// // The published fits: back-propagation of the model of Ahn et al., and a genetic algorithm.
/// let evolution = Evolution { algorithm: Algorithm::Genetic, generations: 3, ..Evolution::default() };
/// let back_propagation = BackPropagation { epochs: 3, ..BackPropagation::default() };
/// let options = TskOptions { learning: Learning::BackPropagation, evolution, back_propagation, ..TskOptions::default() };
/// for kind in [TskKind::Ahn, TskKind::Evolved] {
///     let errors_n = fit_tsk(&data, kind, data[0].drive, &options, &Watch::none())?.epoch_rsse_n;
///     assert!(errors_n.len() >= 3 && errors_n.windows(2).all(|pair| pair[1] <= pair[0]), "{errors_n:?}");
/// }
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// [`Error::Identify`] for too few rows, a constant channel, or a shape that the model does not have or that is not
/// trained; [`Error::Cancelled`].
pub fn fit_tsk(
    datasets: &[Dataset],
    kind: TskKind,
    drive: Option<DriveKind>,
    options: &TskOptions,
    watch: &Watch,
) -> Result<FittedTsk, Error> {
    let mut data = Data::new(datasets, kind, options.trained(kind)?, drive, watch)?;
    if kind != TskKind::Evolved && options.learning == Learning::BackPropagation {
        return back_propagation::fit(&data, kind, &options.back_propagation, watch);
    }
    data.take_out_linear();
    let ridge = data.ridge(data.power(&data.premises.start(), LEAST_RIDGE)?);
    let mut learner = Learner {
        data: &data,
        ridge,
        epochs: options.epochs.max(1),
        watch,
        lowest: Cell::new(f64::INFINITY),
        errors: RefCell::default(),
    };
    let (parameters, converged) = match (kind, options.learning) {
        (TskKind::Evolved, _) => {
            let errors = &mut learner.errors.borrow_mut();
            (evolve::evolve(&data, ridge, &options.evolution, watch, errors)?, true)
        }
        (_, Learning::Gradient) => learner.descend().ok_or(Error::Cancelled)?,
        (_, Learning::GaussNewton | Learning::BackPropagation) => learner.learn()?,
    };
    let errors = learner.errors.into_inner();
    let epoch_rsse_n = data.rsse_n(&errors);
    let (model, offsets_n) = data.model(kind, &parameters, learner.ridge)?;
    Ok(FittedTsk { model, offsets_n, epoch_rsse_n, converged })
}

/// Mean of the runs' NMSE (error power over force variance) with the uniform grid, each run with its best
/// offset; enough to compare conditionings.
pub(super) fn grid_esr(
    datasets: &[Dataset],
    kind: TskKind,
    drive: Option<DriveKind>,
    watch: &Watch,
) -> Result<f64, Error> {
    let mut data = Data::new(datasets, kind, Trained::of(kind.shape(), kind.name())?, drive, watch)?;
    data.take_out_linear();
    let start = data.premises.start();
    let (model, _) = data.model(kind, &start, data.ridge(data.power(&start, LEAST_RIDGE)?))?;
    let structure = kind.structure(drive);
    let esr = |dataset: &Dataset| {
        let mut errors = ErrorSum::default();
        for row in Columns::rows_of(dataset, &structure) {
            errors.add(force_of(dataset, row), model.force_n(&row.inputs()));
        }
        errors.fit_without_offset().map_or(f64::INFINITY, |fit| fit.esr)
    };
    Ok(datasets.iter().map(esr).sum::<f64>() / datasets.len().max(1) as f64)
}

/// Rows, and all other data that is fixed during learning.
struct Data<'a> {
    premises: Premises,
    sums: Sums<'a>,
    order: Order,
    /// Standard deviation of the force about its runs' means, N.
    scale_n: f64,
    /// Slopes of the linear function c0 over the normalised inputs. It is subtracted from the targets.
    slopes: [f64; MAX_INPUTS],
    /// Mean of each run's force divided by `scale_n`, and mean of the linear function.
    force_means: Vec<f64>,
    linear_means: Vec<f64>,
    /// Number of rows of each run in `datasets`, for the mean offset.
    counted: Vec<f64>,
}

/// The conclusions for given memberships.
struct Solved {
    linear: Linear,
    factors: Cholesky<f64, Dyn>,
    conclusions: DVector<f64>,
}

impl<'a> Data<'a> {
    fn new(
        datasets: &[Dataset],
        kind: TskKind,
        shape: Trained,
        drive: Option<DriveKind>,
        watch: &'a Watch,
    ) -> Result<Self, Error> {
        let structure = kind.structure(drive);
        let columns: Vec<Columns> = datasets.iter().map(|d| Columns::of(d, &structure)).collect();
        let found = columns.iter().map(|c| c.force_n.len()).sum();
        check_size(kind, shape, &structure, found)?;
        let mut axes = Vec::with_capacity(structure.len());
        for (j, (signal, sets)) in structure.iter().enumerate() {
            let (mean, std_dev, range) =
                moments(columns.iter().map(|c| c.inputs[j].as_slice()), signal.name())?;
            let range = range.map(|end| (end - mean) / std_dev);
            axes.push(Axis { signal: *signal, mean, std_dev, range, sets: *sets });
        }
        let force_means_n: Vec<f64> = columns.iter().map(|c| mean(&c.force_n)).collect();
        let about: Vec<Vec<f64>> = columns
            .iter()
            .zip(&force_means_n)
            .map(|(c, mean)| c.force_n.iter().map(|f| f - mean).collect())
            .collect();
        let (_, scale_n, _) = moments(about.iter().map(Vec::as_slice), "force_n")?;
        let premises = Premises { axes, shape };

        let mut counts = [1; MAX_INPUTS];
        counts.iter_mut().zip(&structure).for_each(|(count, (_, sets))| *count = *sets);
        let runs: Vec<Rows> =
            columns.iter().zip(&about).map(|(c, f)| c.rows(&premises, f, scale_n)).collect();
        Ok(Self {
            sums: Sums {
                runs,
                counts,
                width: kind.order().width(structure.len()),
                sparse: shape.is_sparse(),
                parallel: true,
                cancel: watch.flag(),
            },
            order: kind.order(),
            scale_n,
            slopes: [0.0; MAX_INPUTS],
            force_means: force_means_n.iter().map(|f| f / scale_n).collect(),
            linear_means: vec![0.0; datasets.len()],
            counted: columns.iter().map(|c| c.force_n.len() as f64).collect(),
            premises,
        })
    }

    /// RMSE, N, for each sum of squared errors over all rows.
    fn rsse_n(&self, errors: &[f64]) -> Vec<f64> {
        let rows = self.sums.rows() as f64;
        errors.iter().map(|error| self.scale_n * (error / rows).sqrt()).collect()
    }

    /// Fits the linear function of the inputs and subtracts it from the targets. Conclusions that no row
    /// determines then equal that function.
    fn take_out_linear(&mut self) {
        if self.order == Order::Constant && self.premises.shape != Trained::Triangle {
            // Constant conclusions under curved memberships cannot represent a linear function.
            return;
        }
        let inputs = self.premises.axes.len();
        let mut square = DMatrix::<f64>::identity(MAX_INPUTS, MAX_INPUTS) * 1e-9;
        let mut rhs = DVector::<f64>::zeros(MAX_INPUTS);
        let means: Vec<DVector<f64>> = self
            .sums
            .runs
            .iter()
            .map(|run| {
                let mut mean = DVector::zeros(MAX_INPUTS);
                run.u.iter().for_each(|u| mean += DVector::from_column_slice(u));
                mean / run.u.len().max(1) as f64
            })
            .collect();
        for (run, mean) in self.sums.runs.iter().zip(&means) {
            for (u, target) in run.u.iter().zip(&run.target) {
                let about = DVector::from_column_slice(u) - mean;
                square.ger(1.0, &about, &about, 1.0);
                rhs.axpy(*target, &about, 1.0);
            }
        }
        let Some(slopes) = square.cholesky().map(|factors| factors.solve(&rhs)) else { return };
        self.slopes[..inputs].copy_from_slice(&slopes.as_slice()[..inputs]);
        let at = |u: &[f64]| u.iter().zip(&self.slopes).map(|(u, s)| u * s).sum::<f64>();
        for ((run, mean), linear) in self.sums.runs.iter_mut().zip(&means).zip(&mut self.linear_means) {
            *linear = at(mean.as_slice());
            for (u, target) in run.u.iter().zip(&mut run.target) {
                *target -= at(u) - *linear;
            }
        }
    }

    /// Weight of the regularisation towards the linear function, as a share of the rows, for a fit with error
    /// `power`.
    fn ridge(&self, power: f64) -> f64 {
        (PRIOR_ROWS * power / self.sums.rows() as f64).max(LEAST_RIDGE)
    }

    /// Mean squared error at the memberships `parameters`.
    fn power(&self, parameters: &[f64], ridge: f64) -> Result<f64, Error> {
        let inputs = self.premises.inputs(parameters)?;
        let solved = self.solve(&self.sums, &inputs, ridge).ok_or(Error::Cancelled)?;
        Ok((self.sums.power() - solved.linear.rhs.dot(&solved.conclusions)).max(0.0)
            / self.sums.rows() as f64)
    }

    /// The best-fitting conclusions, with the intermediate results; `None` if cancelled.
    fn solve(&self, sums: &Sums, inputs: &[TskInput], ridge: f64) -> Option<Solved> {
        let linear = sums.linear(inputs)?;
        let mut ridge = ridge * sums.rows() as f64;
        loop {
            let mut square = linear.square.clone();
            (0..square.nrows()).for_each(|j| square[(j, j)] += ridge);
            if let Some(factors) = square.cholesky() {
                let conclusions = factors.solve(&linear.rhs);
                return Some(Solved { linear, factors, conclusions });
            }
            // Non-finite sums never factorise; all others do long before this limit.
            if ridge.is_nan() || ridge > 1e12 * sums.rows() as f64 {
                return None;
            }
            ridge *= 10.0;
        }
    }

    /// The model at the memberships `parameters`, and the runs' offsets in newtons.
    fn model(&self, kind: TskKind, parameters: &[f64], ridge: f64) -> Result<(Tsk, Vec<f64>), Error> {
        let inputs = self.premises.inputs(parameters)?;
        let solved = self.solve(&self.sums, &inputs, ridge).ok_or(Error::Cancelled)?;
        let mean =
            |(run, sums): (usize, &DVector<f64>)| sums.dot(&solved.conclusions) / self.counted[run].max(1.0);
        let rule_means: Vec<f64> = solved.linear.run_sums.iter().enumerate().map(mean).collect();
        self.assemble(kind, &inputs, solved.conclusions.as_slice(), &rule_means)
    }

    /// The model with these memberships and conclusions, which are ordered by coefficient, and the runs' offsets in
    /// newtons. `rule_means` holds the mean output of the rules over each run.
    fn assemble(
        &self,
        kind: TskKind,
        inputs: &[TskInput],
        found: &[f64],
        rule_means: &[f64],
    ) -> Result<(Tsk, Vec<f64>), Error> {
        let rules = self.sums.rules();
        let mut conclusions = Vec::with_capacity(self.sums.len());
        for rule in 0..rules {
            let own = |a: usize| found[a * rules + rule];
            match self.order {
                Order::First => {
                    let slopes = self.slopes.iter().enumerate().take(self.sums.width - 1);
                    conclusions.extend(slopes.map(|(a, slope)| own(a) + slope));
                    conclusions.push(own(self.sums.width - 1));
                }
                // Triangles interpolate, so constants at the peaks reproduce the linear function.
                Order::Constant => conclusions.push(own(0) + self.linear_at_peaks(inputs, rule)),
            }
        }
        let offset_n = |(run, mean): (usize, &f64)| {
            self.scale_n * (self.force_means[run] - self.linear_means[run] - mean)
        };
        let offsets_n: Vec<f64> = rule_means.iter().enumerate().map(offset_n).collect();
        let total: f64 = self.counted.iter().sum();
        let offset_n = offsets_n.iter().zip(&self.counted).map(|(o, n)| o * n).sum::<f64>() / total;
        let output = OutputScale { mean_n: 0.0, std_dev_n: self.scale_n };
        let model = Tsk::new(kind, inputs, self.order, &conclusions, output, offset_n)?;
        Ok((model, offsets_n))
    }

    /// The linear function at the peaks of a rule's triangles.
    fn linear_at_peaks(&self, inputs: &[TskInput], rule: usize) -> f64 {
        let [_, n1, n2] = self.sums.counts;
        let at = [rule / (n1 * n2), rule / n2 % n1, rule % n2];
        let peak = |i: usize, input: &TskInput| input.sets().nth(at[i]).map_or(0.0, |set| set.top());
        inputs.iter().enumerate().map(|(i, input)| self.slopes[i] * peak(i, input)).sum()
    }
}

/// Refuses too few rows.
fn check_size(
    kind: TskKind,
    shape: Trained,
    structure: &[(Signal, usize)],
    found: usize,
) -> Result<(), Error> {
    let rules: usize = structure.iter().map(|(_, sets)| sets).product();
    let numbers = if shape == Trained::Bell { 3 } else { 2 };
    let memberships: usize = structure.iter().map(|(_, sets)| numbers * sets).sum();
    let parameters = rules * kind.order().width(structure.len()) + memberships;
    let needed = ROWS_PER_PARAMETER * parameters;
    if found >= needed {
        return Ok(());
    }
    let names: Vec<&str> = structure.iter().map(|(signal, _)| signal.name()).collect();
    Err(IdentifyError::TooFewSamples {
        model: kind.name(),
        which: Some(format!("with {}", names.join(", "))),
        samples: found,
        needed,
        count: parameters,
        parts: "parameters",
    }
    .into())
}

/// The columns of one run, for the used rows.
struct Columns {
    inputs: Vec<Vec<f64>>,
    force_n: Vec<f64>,
}

impl Columns {
    fn of(dataset: &Dataset, structure: &[(Signal, usize)]) -> Self {
        let mut columns = Self { inputs: vec![Vec::new(); structure.len()], force_n: Vec::new() };
        for row in Self::rows_of(dataset, structure) {
            for (column, (signal, _)) in columns.inputs.iter_mut().zip(structure) {
                column.push(signal.of(&row.inputs()));
            }
            columns.force_n.push(force_of(dataset, row));
        }
        columns
    }

    /// Counted rows with finite inputs. Acceleration, for example, is unknown at the first sample.
    fn rows_of<'d>(
        dataset: &'d Dataset,
        structure: &'d [(Signal, usize)],
    ) -> impl Iterator<Item = &'d Row> + 'd {
        let known = |row: &&Row| {
            let inputs = row.inputs();
            structure.iter().all(|(signal, _)| signal.of(&inputs).is_finite())
        };
        dataset.rows.iter().filter(|row| row.counts && force_of(dataset, row).is_finite()).filter(known)
    }

    fn rows(&self, premises: &Premises, force_n: &[f64], scale_n: f64) -> Rows {
        let mut rows = Rows { u: vec![[0.0; MAX_INPUTS]; force_n.len()], target: Vec::new() };
        for (j, (axis, column)) in premises.axes.iter().zip(&self.inputs).enumerate() {
            let normalised = column.iter().map(|value| (value - axis.mean) / axis.std_dev);
            rows.u.iter_mut().zip(normalised).for_each(|(u, value)| u[j] = value);
        }
        rows.target = force_n.iter().map(|f| f / scale_n).collect();
        rows
    }
}

/// The force that a row is compared with, N: unfiltered if the conditioning filters the output.
fn force_of(dataset: &Dataset, row: &Row) -> f64 {
    match dataset.conditioning.apply_to {
        ApplyTo::Output => row.raw_force_n,
        ApplyTo::Inputs | ApplyTo::None => row.force_n,
    }
}

/// Gradient-based learning of memberships.
struct Learner<'a> {
    data: &'a Data<'a>,
    /// Weight of the regularisation towards the linear function, as a share of the rows.
    ridge: f64,
    epochs: usize,
    watch: &'a Watch<'a>,
    /// Lowest cost so far, including the regularisation.
    lowest: Cell<f64>,
    /// Sum of squared errors at the lowest cost, after each epoch.
    errors: RefCell<Vec<f64>>,
}

impl Problem for Learner<'_> {
    fn normal(&self, parameters: &[f64]) -> Option<Normal> {
        let data = self.data;
        let inputs = data.premises.inputs(parameters).ok()?;
        let solved = data.solve(&data.sums, &inputs, self.ridge)?;
        let links = data.premises.links(parameters);
        let slopes = data.sums.nonlinear(
            &inputs,
            &links,
            parameters.len(),
            &solved.conclusions,
            &solved.linear.run_sums,
        )?;
        let answered = solved.factors.l_dirty().solve_lower_triangular(&slopes.cross)?;
        let drawn = self.ridge * data.sums.rows() as f64 * solved.conclusions.norm_squared();
        let cost = slopes.cost + drawn;
        let mut errors = self.errors.borrow_mut();
        let before = errors.last().copied().filter(|_| cost >= self.lowest.get());
        errors.push(before.unwrap_or(slopes.cost));
        self.lowest.set(cost.min(self.lowest.get()));
        self.watch.report(Progress::Epoch { done: errors.len() as u32, of: self.epochs as u32 });
        Some(Normal { cost, square: slopes.square - answered.tr_mul(&answered), gradient: slopes.gradient })
    }
}

impl Learner<'_> {
    /// Levenberg-Marquardt steps until the error stalls. If the error has fallen so far that the
    /// regularisation is far too strong, learning continues with a weaker one.
    fn learn(&mut self) -> Result<(Vec<f64>, bool), Error> {
        let bounds = self.data.premises.bounds();
        let mut here = self.data.premises.start();
        loop {
            let done = self.errors.borrow().len();
            self.lowest.set(f64::INFINITY);
            let stop = Stop { evaluations: self.epochs - done, cost: STALLED, step: STALLED };
            let minimum = minimise(self, &here, &bounds, &stop).ok_or(Error::Cancelled)?;
            here = minimum.parameters;
            let lighter = self.data.ridge(self.data.power(&here, self.ridge)?);
            if !minimum.converged
                || lighter > LIGHTER * self.ridge
                || self.errors.borrow().len() >= self.epochs
            {
                return Ok((here, minimum.converged));
            }
            self.ridge = lighter;
        }
    }

    /// Jang's rule: steps of one length along the negative gradient. The length grows by a tenth after four
    /// improvements in a row, and shrinks by a tenth after two alternations of improvement and deterioration.
    /// Steps are in spacings of the grid. Returns the best memberships; `None` if cancelled.
    fn descend(&self) -> Option<(Vec<f64>, bool)> {
        const FIRST_STEP: f64 = 0.01;
        let bounds = self.data.premises.bounds();
        let mut here = self.data.premises.start();
        let (mut best, mut lowest) = (here.clone(), f64::INFINITY);
        let (mut step, mut before, mut falls) = (FIRST_STEP, f64::INFINITY, Vec::new());
        for _ in 0..self.epochs {
            let normal = self.normal(&here)?;
            falls.push(normal.cost < before);
            before = normal.cost;
            if normal.cost < lowest {
                (best, lowest) = (here.clone(), normal.cost);
            }
            if falls.ends_with(&[true; 4]) {
                step *= 1.1;
                falls.clear();
            } else if falls.ends_with(&[false, true, false, true])
                || falls.ends_with(&[true, false, true, false])
            {
                step *= 0.9;
                falls.clear();
            }
            let length = normal.gradient.norm();
            if length <= f64::MIN_POSITIVE {
                return Some((best, true));
            }
            for ((p, g), b) in here.iter_mut().zip(normal.gradient.iter()).zip(&bounds) {
                *p = (*p - step * g / length).clamp(b[0], b[1]);
            }
        }
        Some((best, false))
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Mean, standard deviation and range over all parts of a column.
fn moments<'s>(
    parts: impl Iterator<Item = &'s [f64]> + Clone,
    name: &'static str,
) -> Result<(f64, f64, [f64; 2]), Error> {
    let all = || parts.clone().flatten().copied();
    let count = all().count().max(1) as f64;
    let mean = all().sum::<f64>() / count;
    let std_dev = (all().map(|v| (v - mean).powi(2)).sum::<f64>() / count).sqrt();
    let range = range(all());
    if std_dev > CONSTANT * range[0].abs().max(range[1].abs()) {
        return Ok((mean, std_dev, range));
    }
    Err(IdentifyError::ConstantInput { input: name }.into())
}
