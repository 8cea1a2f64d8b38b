//! Comparison of inverse methods: the current that each finds for the measured force of a run, against the recorded current.
//!
//! ```text
//! cell    one experiment: fuzzy-tanh and the learned inverses are identified on its training runs
//! test    every sample of every other run: motion and measured force -> inverse -> current i*
//! error   recorded current - i*, over the samples that count
//! ```
//!
//! [`Method`] lists the methods. `search`, `polynomial` and `fuzzy` invert the fuzzy-tanh model, in the inverse controller and within
//! its limits. `chen`, `wang-liao` and `wang-hu` are identified from the same runs, and their own currents count, without a controller: it
//! would add the achievable range of the force model.
//!
//! **Rows**: the counted rows of each [`Dataset`](crate::identify::Dataset) with at least the speed [`Limits::hold_m_s`]. At lower
//! speeds the controller keeps its current.
//!
//! **Simulation**: the currents that were found are the past currents, and no force is fed back. The measured force is the demand, because
//! a run records which current gave it.
//!
//! **Meaning**: an error of the current contains the error of the force model and the noise of the load cell, divided by the slope of the
//! force over the current. The error of the *force* under control is a different figure: [`track`](crate::inverse::track) gives it.

use super::{Experiment, tests_of};
use crate::error::{Error, IdentifyError};
use crate::force::Inputs;
use crate::identify::{self, CurrentFit, Dataset, ModelSpec, Options, Watch};
use crate::inverse::{Demand, InverseController, Limits, Method};
use crate::inverse_model::InverseModel;
use crate::metrics::ErrorSum;
use crate::sample::DriveKind;
use serde::{Deserialize, Serialize};

/// Error of the current, or the reason why there is none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CurrentFigure {
    /// Root mean squared error, A; `None` without a figure.
    pub rmse_a: Option<f64>,
    /// Error power over the variance of the recorded current, 1; `None` without a figure, or if that current is constant.
    pub nmse: Option<f64>,
    /// Why a figure is missing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// Error of the current on one run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct InverseTest {
    /// Name of the experiment.
    pub tested_on: String,
    /// Number of the replicate.
    pub replicate: u32,
    /// The error.
    pub figure: CurrentFigure,
}

/// Result of one method on one training experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FinishedInverse {
    /// Name of the method, see [`Method::name`].
    pub method: String,
    /// Name of the experiment.
    pub trained_on: String,
    /// Error on the training runs; `None` without an inverse.
    pub identification: Option<CurrentFigure>,
    /// Error on all other runs; empty without an inverse.
    pub cross_validation: Vec<InverseTest>,
    /// The reason, if an inverse could not be had.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
}

/// Means of a method over the tests of one training experiment.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InverseRow {
    /// Name of the method.
    pub method: String,
    /// Name of the training experiment.
    pub trained_on: String,
    /// Mean RMSE over all tests, A.
    pub mean_rmse_a: f64,
    /// Mean NMSE over the tests whose recorded current varies, 1; `None` if it varies in none.
    pub mean_nmse: Option<f64>,
    /// Number of tests.
    pub tests: usize,
}

impl InverseRow {
    /// For each method the training experiment with the lowest mean RMSE over its tests, best method first. A method without a figure on
    /// some test of an experiment has no mean there.
    #[must_use]
    pub fn best(all: &[FinishedInverse]) -> Vec<Self> {
        let mut best: Vec<Self> = Vec::new();
        for row in all.iter().filter_map(Self::of) {
            match best.iter_mut().find(|known| known.method == row.method) {
                Some(known) if known.mean_rmse_a <= row.mean_rmse_a => {}
                Some(known) => *known = row,
                None => best.push(row),
            }
        }
        best.sort_by(|a, b| a.mean_rmse_a.total_cmp(&b.mean_rmse_a));
        best
    }

    /// The means of one result; `None` without tests, or if a test has no figure.
    #[must_use]
    pub fn of(finished: &FinishedInverse) -> Option<Self> {
        let figures = || finished.cross_validation.iter().map(|test| &test.figure);
        let rmse_a: Vec<f64> = figures().map(|figure| figure.rmse_a).collect::<Option<_>>()?;
        let nmse: Vec<f64> = figures().filter_map(|figure| figure.nmse).collect();
        Some(Self {
            method: finished.method.clone(),
            trained_on: finished.trained_on.clone(),
            mean_rmse_a: mean(&rmse_a)?,
            mean_nmse: mean(&nmse),
            tests: rmse_a.len(),
        })
    }
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Identifies the inverse of each of `methods` on the training runs of the experiment `index` and tests it on every other run.
///
/// ```
/// use mr_damper_model::compare::{self, Experiment, InverseRow, Replicate};
/// use mr_damper_model::condition::Conditioning;
/// use mr_damper_model::identify::{Dataset, DatasetOptions, Options, Watch};
/// use mr_damper_model::inverse::Method;
/// use mr_damper_model::rig::{self, Channels, Plant, record};
///
/// let planned = rig::Experiment::thesis("RP-APRBS").expect("an experiment of the thesis").with_duration_s(8.0);
/// let replicate = |number: u32| {
///     let run = record(&planned, &Plant::default(), &Channels::default(), number.into());
///     let data = Dataset::from_run(&run, &Conditioning::default(), &DatasetOptions::default())?;
///     Ok::<_, mr_damper_model::Error>(Replicate { number, data })
/// };
/// let experiments =
///     [Experiment { name: planned.name.clone(), replicates: vec![replicate(1)?, replicate(2)?], training: 1, held_out: vec![] }];
/// assert!(experiments[0].is_trained_on());
/// let options = Options { restarts: 2, ..Options::default() };
/// let found = compare::run_inverse(0, &[Method::Search, Method::WangHu], &experiments, &options, &Watch::none())?;
/// // The rules find the current better than its mean does. The search inverts a model of 8 s of data, and does not.
/// let best = &InverseRow::best(&found)[0];
/// assert!(best.method == "wang-hu" && best.mean_nmse.is_some_and(|nmse| nmse < 1.0), "{best:?}");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// [`Error::Cancelled`] only; any other failure is recorded in the results.
///
/// # Panics
/// If `index` is not an index of `experiments`.
pub fn run_inverse(
    index: usize,
    methods: &[Method],
    experiments: &[Experiment],
    options: &Options,
    watch: &Watch,
) -> Result<Vec<FinishedInverse>, Error> {
    let experiment = &experiments[index];
    let training = experiment.training_runs(experiments);
    let without = |method: &Method, error: &Error| FinishedInverse {
        method: method.name().to_owned(),
        trained_on: experiment.name.clone(),
        identification: None,
        cross_validation: Vec::new(),
        failure: Some(error.to_string()),
    };
    let force = match training.as_ref() {
        [] => Err(IdentifyError::ExperimentWithoutTraining { experiment: experiment.name.clone() }.into()),
        runs => identify::identify_datasets(ModelSpec::FUZZY_TANH, runs, options, watch),
    };
    let force = match force {
        Ok(force) => force,
        Err(Error::Cancelled) => return Err(Error::Cancelled),
        Err(error) => return Ok(methods.iter().map(|method| without(method, &error)).collect()),
    };
    let mut all = Vec::with_capacity(methods.len());
    for method in methods {
        let inverse = match method.learned() {
            None => InverseController::with_method(&force.model, limits(&training), *method)
                .map(|controller| Inverse::Controller(Box::new(controller))),
            Some(kind) => identify::identify_inverse_datasets(kind, &force, &training, options, watch)
                .map(|found| Inverse::Learned(Box::new(found.model), force.model.force.force_offset_n())),
        };
        let inverse = match inverse {
            Ok(inverse) => inverse,
            Err(Error::Cancelled) => return Err(Error::Cancelled),
            Err(error) => {
                all.push(without(method, &error));
                continue;
            }
        };
        let mut cross_validation = Vec::new();
        for (tested, replicate) in tests_of(index, experiments) {
            if watch.is_cancelled() {
                return Err(Error::Cancelled);
            }
            let runs = std::slice::from_ref(&replicate.data);
            cross_validation.push(InverseTest {
                tested_on: tested.name.clone(),
                replicate: replicate.number,
                figure: inverse.figure(runs),
            });
        }
        all.push(FinishedInverse {
            method: method.name().to_owned(),
            trained_on: experiment.name.clone(),
            identification: Some(inverse.figure(&training)),
            cross_validation,
            failure: None,
        });
    }
    Ok(all)
}

/// Limits that allow every current of the training runs.
fn limits(training: &[Dataset]) -> Limits {
    let defaults = Limits::default();
    let currents = training.iter().flat_map(|run| &run.rows).map(|row| row.drive);
    let largest_a = currents.filter(|current| current.is_finite()).fold(defaults.current_max_a, f64::max);
    Limits { current_max_a: largest_a, ..defaults }
}

/// An inverse under test.
enum Inverse {
    /// Of a force model.
    Controller(Box<InverseController>),
    /// Learned, with the force offset of its runs, N.
    Learned(Box<InverseModel>, f64),
}

impl Inverse {
    /// Error of the currents that it finds for the measured forces of `runs`.
    fn figure(&self, runs: &[Dataset]) -> CurrentFigure {
        let none = |why: &str| CurrentFigure { rmse_a: None, nmse: None, note: Some(why.to_owned()) };
        let mut errors = ErrorSum::default();
        for run in runs {
            if run.drive != Some(DriveKind::CoilCurrent) {
                return none("the run has no coil current");
            }
            match self {
                Self::Controller(controller) => command_all(controller, run, &mut errors),
                Self::Learned(model, offset_n) => {
                    identify::simulate_inverse(model, run, *offset_n, &mut errors)
                }
            }
        }
        match CurrentFit::of(&errors) {
            None => none(
                "no sample shows the current: the damper hardly moves, or it is not recorded at the rate of the training",
            ),
            Some(fit) => {
                let note = (!fit.nmse.is_finite()).then(|| "the recorded current is constant".to_owned());
                let nmse = Some(fit.nmse).filter(|nmse| nmse.is_finite());
                CurrentFigure { rmse_a: Some(fit.rmse_a), nmse, note }
            }
        }
    }
}

/// Adds the errors of the currents that a copy of `controller` commands along a run.
fn command_all(controller: &InverseController, run: &Dataset, errors: &mut ErrorSum) {
    let mut controller = *controller;
    for row in &run.rows {
        let inputs = Inputs { drive: f64::NAN, ..row.inputs() };
        let command = controller.step(&inputs, Demand::Force(row.raw_force_n), None);
        if identify::shows_current(row) {
            errors.add(row.drive, command.current.get());
        }
    }
}
