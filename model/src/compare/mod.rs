//! Comparison of models: each model is identified on an experiment's training runs and tested on all other
//! runs.
//!
//! ```text
//! experiment = replicates 1, 2, ...          one conditioning for all: rows are computed once and shared by all models
//! cell       = one model on one experiment:  identify on its training runs (usually the first replicate alone),
//!                                            score on every other replicate of every experiment (cross-validation)
//! ```
//!
//! Cells are independent: they can run in any order, on any number of threads, and before or after a restart
//! of the program, with the same result. If a model cannot be identified on an experiment, its cell holds the
//! reason, and the other cells still run.
//!
//! **Rows**: the counted rows of each [`Dataset`] (force known, filters settled, damper moving).
//!
//! **Offset**: the force offset of a session (gas preload, zero of the load cell) is identified with the
//! model, and the model keeps it in every test. A drift of the zero between sessions therefore counts as an
//! error. The thesis has no offset.
//!
//! **Divergence**: a simulation (free run) with non-finite numbers, or beyond a hundred times the largest
//! measured force, is reported as diverged and has no error figure.
//!
//! **Predictors** are never mixed: a model whose input includes force has one figure for its simulation and
//! another for the one-step-ahead prediction, which must be compared with persistence. The phase-transition
//! relation cannot run and has figures of a third kind, because its input is the force that it explains.

mod design;
mod inverse;
mod rank;
mod summary;

pub use design::{ALL_FOLDS, Level, levels, over_folds, with_folds};
pub use inverse::{CurrentFigure, FinishedInverse, InverseRow, InverseTest, run_inverse};
pub use rank::{BoxPlot, kendall_tau};
pub use summary::{Class, Row, Summary};

use crate::error::{Error, IdentifyError};
use crate::identify::{self, Dataset, ModelSpec, Options, PhaseOptions, Scores, Watch};
use crate::metrics::Fit;
use crate::model::Model;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// Runs that belong together: replicates of one excitation, or runs that train one model together.
#[derive(Debug, Clone, PartialEq)]
pub struct Experiment {
    /// Name of the experiment.
    pub name: String,
    /// Its replicates, at least one.
    pub replicates: Vec<Replicate>,
    /// Number of training runs, counted from the first replicate; 0 for an experiment that is only tested on.
    pub training: usize,
    /// For a fold: the runs that it is tested on, as indices of experiment and replicate. A fold has no replicates of its own; its
    /// models are identified on all other runs of the comparison. Empty for an experiment.
    pub held_out: Vec<(usize, usize)>,
}

/// One run of an experiment.
#[derive(Debug, Clone, PartialEq)]
pub struct Replicate {
    /// Number of the replicate in reports.
    pub number: u32,
    /// Its conditioned rows.
    pub data: Dataset,
}

/// One unit of work: one model on one experiment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Cell {
    /// The model.
    pub spec: ModelSpec,
    /// Index of the experiment.
    pub experiment: usize,
}

/// The data that a model uses to predict a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Predictor {
    /// Simulation: displacement and drive alone.
    FreeRun,
    /// One-step-ahead prediction: also the measured force up to the previous sample.
    OneStep,
    /// The measured force of the same sample and its derivatives. This measures how well a relation holds; it
    /// is not a prediction.
    SameInstant,
}

/// One error figure, or the reason why it is missing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// How the model was used.
    pub predictor: Predictor,
    /// Root mean squared error (RMSE), N; `None` without a figure.
    pub rsse_n: Option<f64>,
    /// Normalised mean squared error (NMSE): error power over force variance; `None` without a figure, or if
    /// the force is constant.
    pub esr: Option<f64>,
    /// Why the figure is missing: `diverged`, or the reason in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

/// Error figures of one test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Test {
    /// Name of the experiment.
    pub tested_on: String,
    /// Number of the replicate.
    pub replicate: u32,
    /// One figure for each predictor of the model.
    pub figures: Vec<Figure>,
}

/// Result of a cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Finished {
    /// Name of the model, with its variant ([`ModelSpec::label`]).
    pub model: String,
    /// How the drive enters the model: `passive`, `semi_active`, `fuzzy`.
    pub form: String,
    /// Name of the experiment.
    pub trained_on: String,
    /// Number of identified parameters; `None` without a model.
    pub parameters: Option<usize>,
    /// Figures on the training runs; empty without a model.
    pub identification: Vec<Figure>,
    /// Figures on all other runs; empty without a model.
    pub cross_validation: Vec<Test>,
    /// Warnings of the identification.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Why the identification failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub failure: Option<String>,
}

/// Error of persistence on one run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Persistence {
    /// Name of the experiment.
    pub experiment: String,
    /// Number of the replicate.
    pub replicate: u32,
    /// Root mean squared error, N.
    pub rsse_n: Option<f64>,
    /// NMSE: error power over force variance.
    pub esr: Option<f64>,
}

/// One cell for each of `specs` and each of `experiments` that has training runs or is a fold, in the order of the
/// experiments.
#[must_use]
pub fn cells(specs: &[ModelSpec], experiments: &[Experiment]) -> Vec<Cell> {
    let training = experiments.iter().enumerate().filter(|(_, experiment)| experiment.is_trained_on());
    training
        .map(|(index, _)| index)
        .flat_map(|experiment| specs.iter().map(move |spec| Cell { spec: *spec, experiment }))
        .collect()
}

/// Runs one cell: identifies the model on the experiment's training runs and tests it on every other run.
/// Also returns the model, if there is one.
///
/// ```
/// use mr_damper_model::compare::{self, Experiment, Replicate, Summary};
/// use mr_damper_model::condition::Conditioning;
/// use mr_damper_model::identify::{Dataset, DatasetOptions, ModelSpec, Options, Watch};
/// use mr_damper_model::rig::{self, Channels, Plant, record};
///
/// let planned = rig::Experiment::thesis("RP-ICPS").expect("an experiment of the thesis").with_duration_s(5.0);
/// let replicate = |number: u32| {
///     let run = record(&planned, &Plant::default(), &Channels::default(), number.into());
///     let data = Dataset::from_run(&run, &Conditioning::default(), &DatasetOptions::default())?;
///     Ok::<_, mr_damper_model::Error>(Replicate { number, data })
/// };
/// // Trained on the first replicate, tested on the second
/// let experiments =
///     [Experiment { name: planned.name.clone(), replicates: vec![replicate(1)?, replicate(2)?], training: 1, held_out: vec![] }];
/// let mut finished = Vec::new();
/// for cell in compare::cells(&[ModelSpec::ARX_PASSIVE, ModelSpec::ARX_SEMI_ACTIVE], &experiments) {
///     finished.push(compare::run(cell, &experiments, &Options::default(), &Watch::none())?.0);
/// }
/// assert_eq!(finished.iter().map(|cell| cell.cross_validation.len()).collect::<Vec<_>>(), [1, 1]);
/// // Simulation and one-step-ahead prediction are ranked apart, so two models have four summaries.
/// assert_eq!(Summary::of(&finished).len(), 4);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// [`Error::Cancelled`] only; any other failure is recorded in the cell.
///
/// # Panics
/// If the cell's experiment is not an index of `experiments`.
pub fn run(
    cell: Cell,
    experiments: &[Experiment],
    options: &Options,
    watch: &Watch,
) -> Result<(Finished, Option<Model>), Error> {
    let experiment = &experiments[cell.experiment];
    let mut finished = Finished {
        model: cell.spec.label(),
        form: cell.spec.form().name().to_owned(),
        trained_on: experiment.name.clone(),
        parameters: None,
        identification: Vec::new(),
        cross_validation: Vec::new(),
        warnings: Vec::new(),
        failure: None,
    };
    if !cell.spec.structure().can_run() {
        phase_cell(cell, experiments, options, watch, &mut finished)?;
        return Ok((finished, None));
    }
    let training = experiment.training_runs(experiments);
    let found = match training.as_ref() {
        [] => Err(IdentifyError::ExperimentWithoutTraining { experiment: experiment.name.clone() }.into()),
        runs => identify::identify_datasets(cell.spec, runs, options, watch),
    };
    let found = match found {
        Ok(found) => found,
        Err(Error::Cancelled) => return Err(Error::Cancelled),
        Err(error) => {
            finished.failure = Some(error.to_string());
            return Ok((finished, None));
        }
    };
    let model = found.model;
    finished.warnings = found.warnings;
    finished.parameters = Some(model.force.parameter_count());
    let scores = Scores {
        free_run: found.free_run,
        free_run_without_offset: found.free_run,
        diverged: found.free_run.is_none(),
        one_step: found.one_step,
    };
    finished.identification = figures(&model, Ok(scores));
    for (tested, replicate) in tests_of(cell.experiment, experiments) {
        let scored = match identify::score(&model.augmented(), &replicate.data, watch) {
            Err(Error::Cancelled) => return Err(Error::Cancelled),
            scored => scored,
        };
        finished.cross_validation.push(Test {
            tested_on: tested.name.clone(),
            replicate: replicate.number,
            figures: figures(&model, scored),
        });
    }
    Ok((finished, Some(model)))
}

impl Experiment {
    /// True if models are identified on it: it has training runs, or is a fold.
    #[must_use]
    pub fn is_trained_on(&self) -> bool {
        self.training > 0 || self.is_fold()
    }

    /// The training runs as a slice, as the fit needs them; `experiments` are all of the comparison.
    fn training_runs(&self, experiments: &[Self]) -> Cow<'_, [Dataset]> {
        if self.is_fold() {
            return Cow::Owned(design::training_of(self, experiments));
        }
        let runs = &self.replicates[..self.training.min(self.replicates.len())];
        match runs {
            [one] => Cow::Borrowed(std::slice::from_ref(&one.data)),
            several => several.iter().map(|replicate| replicate.data.clone()).collect(),
        }
    }
}

/// All runs that a model of the experiment `index` is not identified on, and their experiments.
fn tests_of(index: usize, experiments: &[Experiment]) -> impl Iterator<Item = (&Experiment, &Replicate)> {
    let own = &experiments[index];
    experiments.iter().enumerate().flat_map(move |(e, experiment)| {
        let skipped = if e == index { experiment.training } else { 0 };
        let runs = experiment.replicates.iter().enumerate().skip(skipped);
        let is_tested = move |r: usize| !own.is_fold() || own.held_out.contains(&(e, r));
        runs.filter(move |(r, _)| is_tested(*r)).map(move |(_, replicate)| (experiment, replicate))
    })
}

/// Runs a cell of the phase-transition relation. It yields no model; its figures say how well the relation
/// holds.
fn phase_cell(
    cell: Cell,
    experiments: &[Experiment],
    options: &Options,
    watch: &Watch,
    finished: &mut Finished,
) -> Result<(), Error> {
    let training = experiments[cell.experiment].training_runs(experiments);
    let Some(first) = training.first() else {
        finished.failure = Some(format!("experiment {}: has no training runs", finished.trained_on));
        return Ok(());
    };
    let drive = if cell.spec.needs_drive() { first.drive } else { None };
    let settings = PhaseOptions { drive, degree: options.degree, ..PhaseOptions::default() };
    let missing = cell.spec.needs_drive() && drive.is_none();
    let found = match missing {
        true => Err(Error::MissingChannel {
            run: first.name.clone(),
            channel: "current_a or command_v",
            needed_by: "the semi-active form of p".to_owned(),
        }),
        false => identify::identify_phase(&training, &settings, watch),
    };
    let found = match found {
        Ok(found) => found,
        Err(Error::Cancelled) => return Err(Error::Cancelled),
        Err(error) => {
            finished.failure = Some(error.to_string());
            return Ok(());
        }
    };
    let figure = |fit: Option<Fit>, note: Option<String>| Figure {
        predictor: Predictor::SameInstant,
        rsse_n: fit.map(|fit| fit.rsse_n),
        esr: fit.map(|fit| fit.esr).filter(|esr| esr.is_finite()),
        note,
    };
    finished.parameters = Some(found.phase.parameter_count());
    finished.identification = vec![figure(Some(found.same_instant), None)];
    for (tested, replicate) in tests_of(cell.experiment, experiments) {
        if watch.is_cancelled() {
            return Err(Error::Cancelled);
        }
        let figure = match identify::score_phase(&found.phase, &replicate.data, &settings) {
            Ok(Some(fit)) => figure(Some(fit), None),
            Ok(None) => figure(None, Some("no counted row has force readings on both sides".to_owned())),
            Err(error) => figure(None, Some(error.to_string())),
        };
        finished.cross_validation.push(Test {
            tested_on: tested.name.clone(),
            replicate: replicate.number,
            figures: vec![figure],
        });
    }
    Ok(())
}

/// Errors of persistence on every run.
#[must_use]
pub fn persistence(experiments: &[Experiment]) -> Vec<Persistence> {
    let one = |experiment: &Experiment, replicate: &Replicate| {
        let fit = identify::persistence(&replicate.data);
        Persistence {
            experiment: experiment.name.clone(),
            replicate: replicate.number,
            rsse_n: fit.map(|fit| fit.rsse_n),
            esr: fit.map(|fit| fit.esr).filter(|esr| esr.is_finite()),
        }
    };
    experiments.iter().flat_map(|e| e.replicates.iter().map(move |r| one(e, r))).collect()
}

/// Figures from the scores of `model`, one for each predictor.
fn figures(model: &Model, scored: Result<Scores, Error>) -> Vec<Figure> {
    let feeds_on_force = model.force.force_fed_period().is_some();
    let figure = |predictor, pick: fn(&Scores) -> Option<Fit>| match &scored {
        Ok(scores) => {
            let fit = pick(scores);
            let note = match (fit, predictor) {
                (None, Predictor::FreeRun) if scores.diverged => Some("diverged".to_owned()),
                (None, _) => Some("the model has no force at any counted row".to_owned()),
                (Some(fit), _) if !fit.esr.is_finite() => Some("the measured force is constant".to_owned()),
                (Some(_), _) => None,
            };
            let esr = fit.map(|fit| fit.esr).filter(|esr| esr.is_finite());
            Figure { predictor, rsse_n: fit.map(|fit| fit.rsse_n), esr, note }
        }
        Err(error) => Figure { predictor, rsse_n: None, esr: None, note: Some(error.to_string()) },
    };
    let mut figures = vec![figure(Predictor::FreeRun, |scores| scores.free_run)];
    if feeds_on_force {
        figures.push(figure(Predictor::OneStep, |scores| scores.one_step));
    }
    figures
}
