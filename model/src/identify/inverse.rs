//! Identification of learned inverse models: the direct structures, fitted to rows with force and current exchanged.
//!
//! ```text
//! row of a run       x, v, a, current i, force F
//! exchanged row      x, v, a, "drive" F - offset of the run, "force" i
//! ```
//!
//! The structures of a publication's direct and inverse model are the same, so the fits are the same too. Networks minimise the error of
//! their simulation, with their own current fed back: `chen` by back-propagation through time in mini-batches, `wang-liao` by the
//! Levenberg-Marquardt method. The fuzzy rules of `wang-hu` are fitted by hybrid learning. A simulation matters for an inverse as well:
//! the current hardly changes within a sample, so a network that is trained one step ahead learns to repeat the last current.
//!
//! All runs form one data set, because the mean current of a run is not an offset. A row counts if it counts for the force model (by
//! default: the damper moves) and its speed is at least the default of [`Limits::hold_m_s`]: near rest the force hardly depends on the
//! current, and the controller holds its current. Other rows only pass through the history.
//!
//! Source: `[chen2009]`, `[wangliao2001]` and `[wanghu2009]` in the bibliography (node/docs/guide/bibliography.md).

use super::dataset::{Dataset, DatasetOptions, Row};
use super::network::{self, is_constant, normalisation};
use super::tsk::{TskOptions, fit_tsk};
use super::{Identified, Options, Watch, regression};
use crate::error::{Error, IdentifyError};
use crate::force::TskKind;
use crate::inverse::Limits;
use crate::inverse_model::{InverseFuzzy, InverseKind, InverseModel, InverseNetwork, InverseState};
use crate::metrics::ErrorSum;
use crate::model::Model;
use crate::sample::{DriveKind, Run};
use serde::Serialize;

/// Error of a learned inverse: of its current in simulation, with its own current fed back.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CurrentFit {
    /// Root mean squared error, A.
    pub rmse_a: f64,
    /// Error power over the variance of the recorded current, 1. Infinite if that current is constant.
    pub nmse: f64,
    /// Number of samples used.
    pub samples: u64,
}

impl CurrentFit {
    /// The error of a sum of currents; `None` for an empty sum.
    pub(crate) fn of(errors: &ErrorSum) -> Option<Self> {
        errors.fit().map(|fit| Self { rmse_a: fit.rsse_n, nmse: fit.esr, samples: fit.samples })
    }
}

/// An identified inverse model.
#[derive(Debug, Clone, PartialEq)]
pub struct IdentifiedInverse {
    /// The inverse model.
    pub model: InverseModel,
    /// Its error on the training runs; `None` if its current is nowhere finite.
    pub training: Option<CurrentFit>,
    /// Facts that a user must know before using it; complete sentences.
    pub warnings: Vec<String>,
}

/// Identifies the inverse model `kind` from `runs`, the runs from which `found` was identified. The rows are conditioned as for
/// `found`, and each run has the force offset of `found`.
///
/// ```
/// use mr_damper_model::identify::{ModelSpec, Options, Watch, identify, identify_inverse, score_inverse};
/// use mr_damper_model::inverse::{InverseController, InverseKind, Limits, Method};
/// use mr_damper_model::model::Model;
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let experiment = Experiment::thesis("RP-APRBS").expect("an experiment of the thesis").with_duration_s(8.0);
/// let run = |seed| record(&experiment, &Plant::default(), &Channels::default(), seed);
/// let (options, runs) = (Options { restarts: 2, ..Options::default() }, [run(1)]);
/// let found = identify(ModelSpec::FUZZY_TANH, &runs, &options, &Watch::none())?;
/// let inverse = identify_inverse(InverseKind::WangHu, &found, &runs, &options, &Watch::none())?;
///
/// let model = Model { inverse: Some(inverse.model), ..found.model };
/// let held_out = score_inverse(&inverse.model, &model, &[run(2)], &options.dataset)?.expect("it moves");
/// assert!(held_out.nmse < 1.0, "{held_out:?}");
/// assert!(InverseController::with_method(&model, Limits::default(), Method::WangHu).is_ok());
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// [`IdentifyError::InverseWithoutCurrent`] for a force model without a current input; [`IdentifyError::ConstantDrive`] for runs at one
/// current; otherwise as [`identify`](super::identify).
pub fn identify_inverse(
    kind: InverseKind,
    found: &Identified,
    runs: &[Run],
    options: &Options,
    watch: &Watch,
) -> Result<IdentifiedInverse, Error> {
    check_current(kind, &found.model)?;
    let datasets = super::datasets(runs, &found.model.conditioning, options, watch)?;
    identify_inverse_datasets(kind, found, &datasets, options, watch)
}

/// Like [`identify_inverse`], from the conditioned rows of the runs.
///
/// # Errors
/// As [`identify_inverse`].
pub(crate) fn identify_inverse_datasets(
    kind: InverseKind,
    found: &Identified,
    datasets: &[Dataset],
    options: &Options,
    watch: &Watch,
) -> Result<IdentifiedInverse, Error> {
    let model = &found.model;
    check_current(kind, model)?;
    let offsets_n: Vec<f64> = found.runs.iter().map(|run| run.force_offset_n).collect();
    let current = normalisation(datasets, |_, row| row.drive);
    if is_constant(&current) {
        let drive = DriveKind::CoilCurrent;
        return Err(IdentifyError::ConstantDrive { drive, value: current.mean }.into());
    }
    let inverse = match kind.network() {
        Some(structure) => {
            // Checked before the runs become one data set.
            regression::common_rate(datasets, kind.name())?;
            let exchanged = [exchanged(datasets, &offsets_n)];
            let mean_a = normalisation(&exchanged, |_, row| row.force_n).mean;
            let drive = Some(DriveKind::CoilCurrent);
            let restarts = options.restarts.div_ceil(network::RESTARTS_PER_RESTART);
            let first = Some(vec![mean_a]);
            let fitted =
                network::fit_about(&exchanged, structure, drive, first, restarts, options.seed, watch)?;
            InverseNetwork::of_exchanged(fitted.model).map(InverseModel::Network)
        }
        None => {
            let exchanged = [exchanged(datasets, &offsets_n)];
            let drive = Some(DriveKind::CoilCurrent);
            let fitted = fit_tsk(&exchanged, TskKind::WangHu, drive, &TskOptions::of(options, None), watch)?;
            InverseFuzzy::of_exchanged(&fitted.model)?.map(InverseModel::Fuzzy)
        }
    };
    // Both fits keep the structure that they were given.
    let inverse = inverse.ok_or(IdentifyError::NoFiniteError)?;
    let mut errors = ErrorSum::default();
    for (dataset, offset_n) in datasets.iter().zip(&offsets_n) {
        simulate_inverse(&inverse, dataset, *offset_n, &mut errors);
    }
    let training = CurrentFit::of(&errors);
    let warnings = warnings(kind, model, training);
    Ok(IdentifiedInverse { model: inverse, training, warnings })
}

/// Error of `inverse` on `runs`, with the conditioning and the force offset of `model`. `None` if no row counts.
///
/// # Errors
/// [`Error::MissingChannel`] or [`Error::WrongDrive`] for a run without current; otherwise as [`Dataset::from_run`].
pub fn score_inverse(
    inverse: &InverseModel,
    model: &Model,
    runs: &[Run],
    options: &DatasetOptions,
) -> Result<Option<CurrentFit>, Error> {
    let mut errors = ErrorSum::default();
    for run in runs {
        match run.drive_kind() {
            Some(DriveKind::CoilCurrent) => {}
            Some(other) => {
                let needed = DriveKind::CoilCurrent.name();
                return Err(Error::WrongDrive { run: run.name.clone(), found: other.name(), needed });
            }
            None => {
                return Err(Error::MissingChannel {
                    run: run.name.clone(),
                    channel: "current_a",
                    needed_by: format!("the inverse model {}", inverse.kind().name()),
                });
            }
        }
        let dataset = Dataset::from_run(run, &model.conditioning, options)?;
        simulate_inverse(inverse, &dataset, model.force.force_offset_n(), &mut errors);
    }
    Ok(CurrentFit::of(&errors))
}

/// Refuses a force model whose input is not a current.
fn check_current(kind: InverseKind, model: &Model) -> Result<(), Error> {
    match model.force.drive() {
        Some(DriveKind::CoilCurrent) => Ok(()),
        drive => Err(IdentifyError::InverseWithoutCurrent {
            inverse: kind.name(),
            model: model.force.name(),
            drive,
        }
        .into()),
    }
}

/// True for a row whose force shows the current: it counts, and is fast enough.
pub(crate) fn shows_current(row: &Row) -> bool {
    row.counts && row.drive.is_finite() && row.velocity_m_s.abs() >= Limits::default().hold_m_s
}

/// The rows of all runs, with force and current exchanged.
fn exchanged(datasets: &[Dataset], offsets_n: &[f64]) -> Dataset {
    let mut rows = Vec::with_capacity(datasets.iter().map(|dataset| dataset.rows.len()).sum());
    for (dataset, offset_n) in datasets.iter().zip(offsets_n) {
        let first = rows.len();
        rows.extend(dataset.rows.iter().map(|row| Row {
            drive: row.raw_force_n - offset_n,
            force_n: row.drive,
            raw_force_n: row.drive,
            counts: shows_current(row),
            ..*row
        }));
        if let Some(first) = rows.get_mut(first) {
            first.dt_s = None;
        }
    }
    Dataset { rows, ..datasets[0].clone() }
}

/// Adds the errors of `inverse` along a run whose force has the offset `offset_n`. The history starts with recorded currents; after that
/// the model's own current is fed back.
pub(crate) fn simulate_inverse(
    inverse: &InverseModel,
    dataset: &Dataset,
    offset_n: f64,
    errors: &mut ErrorSum,
) {
    let mut state = InverseState::default();
    for row in &dataset.rows {
        let found_a = inverse.step(&mut state, &row.inputs(), row.raw_force_n - offset_n);
        state.feed(found_a.unwrap_or(row.drive));
        if let Some(found_a) = found_a.filter(|_| shows_current(row)) {
            errors.add(row.drive, found_a);
        }
    }
}

/// Warnings about an inverse model that is of no use, or that the controller will refuse with this force model.
fn warnings(kind: InverseKind, model: &Model, training: Option<CurrentFit>) -> Vec<String> {
    let name = kind.name();
    let mut warnings = Vec::new();
    if training.is_none_or(|fit| fit.nmse >= 1.0) {
        let nmse = training.map_or(f64::INFINITY, |fit| fit.nmse);
        warnings.push(format!(
            "the inverse model {name} is not better than the mean current: NMSE {nmse:.2} on the training runs; identify it from runs in \
             which the current varies while the damper moves, or use another inverse method"
        ));
    }
    if model.force.force_fed_period().is_some() {
        warnings.push(format!(
            "the inverse controller refuses the method {name} with this {} model, because it is autoregressive in force; identify the \
             inverse together with another force model",
            model.force.name()
        ));
    }
    warnings
}
