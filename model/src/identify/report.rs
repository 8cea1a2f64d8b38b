//! What an identification found, and how well it fits the runs it was found on.

use super::dataset::Dataset;
use super::levels::Memberships;
use super::score::{sound, walk};
use super::search::Found;
use super::velocity::VelocityTrial;
use crate::effect::Augmented;
use crate::metrics::{ErrorSum, Fit};
use crate::model::{Expected, Model};
use rayon::prelude::*;
use std::ops::ControlFlow;

/// An identified model.
#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// The model. Its offset is the mean of the runs' offsets, and its expected error that of training, until
    /// a validation gives better ones.
    pub model: Model,
    /// The training runs, in the order given.
    pub runs: Vec<RunFit>,
    /// Fit of all training rows that count, running free, each run with its own offset; `None` when the
    /// free run does not stay finite.
    pub free_run: Option<Fit>,
    /// One step ahead of measured force, each run with its own offset; `None` for a model without force
    /// inputs.
    pub one_step: Option<Fit>,
    /// Predicting that the force stays what it was one sample ago: what `one_step` is to be held against.
    pub persistence: Option<Fit>,
    /// Membership functions and where they come from (fuzzy-tanh).
    pub memberships: Option<Memberships>,
    /// Derivatives that were tried (fuzzy-tanh, when the choice was left to the data).
    pub velocity_trials: Vec<VelocityTrial>,
    /// Rank of the regression (ARX): below the number of coefficients where regressors are collinear.
    pub rank: Option<usize>,
    /// The parameters of a nonlinear fit, with their standard errors.
    pub parameters: Vec<ParameterValue>,
    /// RSSE of each restart on its sample of the rows, N, best first (fuzzy-tanh); of its free run over
    /// the held-back rows (networks), or of each choice of metric and neighbours (boada). When many come close to
    /// the first, the minimum is well found.
    pub restart_rsse_n: Vec<f64>,
    /// Parameters that ended on a bound: the data ask for a value that means nothing, or none at all.
    pub active_bounds: Vec<ActiveBound>,
    /// False when the last fit ran out of evaluations before it converged. Networks end by their held-back rows
    /// and not by converging: always true.
    pub converged: bool,
    /// What must be known before the model is used, such as a free run that diverges; whole sentences.
    pub warnings: Vec<String>,
}

/// How one training run came out.
#[derive(Debug, Clone, PartialEq)]
pub struct RunFit {
    /// The run's name.
    pub name: String,
    /// Rows that count.
    pub samples: u64,
    /// Rate of its rows, Hz.
    pub rate_hz: f64,
    /// Its force offset, N.
    pub force_offset_n: f64,
    /// Fit running free, with this offset.
    pub free_run: Option<Fit>,
    /// Fit one step ahead, with this offset; `None` for a model without force inputs.
    pub one_step: Option<Fit>,
}

/// A parameter on a bound.
#[derive(Debug, Clone, PartialEq)]
pub struct ActiveBound {
    /// Name as in the model file, with the function's index.
    pub parameter: String,
    /// The value, in the parameter's unit.
    pub value: f64,
}

/// A parameter that was sought.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterValue {
    /// Name as in the model file, with the index of the set or of the power of the drive.
    pub name: String,
    /// The value, in the parameter's unit.
    pub value: f64,
    /// Its standard error, from the scatter of the gradient over blocks of a second; NaN where the runs do not
    /// determine the parameter.
    pub standard_error: f64,
}

/// What only the fit of one kind of model knows.
#[derive(Debug, Default)]
pub(super) struct Details {
    pub(super) memberships: Option<Memberships>,
    pub(super) rank: Option<usize>,
    pub(super) parameters: Vec<ParameterValue>,
    pub(super) restart_rsse_n: Vec<f64>,
    pub(super) active_bounds: Vec<ActiveBound>,
    pub(super) converged: bool,
    pub(super) warnings: Vec<String>,
}

impl Details {
    /// What a search found of parameters called `names`.
    pub(super) fn of(found: &Found, names: &[String]) -> Self {
        let name = |j: usize| names[j].clone();
        let parameter = |(j, (value, error)): (usize, (&f64, &f64))| ParameterValue {
            name: name(j),
            value: *value,
            standard_error: *error,
        };
        let values = found.natural.iter().zip(&found.standard_errors).enumerate();
        let bound = |&j: &usize| ActiveBound { parameter: name(j), value: found.natural[j] };
        Self {
            parameters: values.map(parameter).collect(),
            restart_rsse_n: found.restart_rsse_n.clone(),
            active_bounds: found.on_bound.iter().map(bound).collect(),
            converged: found.converged,
            ..Self::default()
        }
    }

    pub(super) fn with_memberships(self, memberships: Option<Memberships>) -> Self {
        Self { memberships, ..self }
    }
}

/// Names of parameters that come in so many copies.
pub(super) fn names_of_copies<'a>(
    names: impl Iterator<Item = &'a str> + Clone,
    copies: usize,
) -> Vec<String> {
    let copy = |copy: usize| names.clone().map(move |name| format!("{name}[{copy}]"));
    (0..copies).flat_map(copy).collect()
}

/// Sums of error: running free, one step ahead, persistence.
#[derive(Debug, Default)]
struct Errors {
    free_run: ErrorSum,
    one_step: ErrorSum,
    persistence: ErrorSum,
}

/// Adds the training fits to `model`.
pub(super) fn assemble(
    model: Model,
    datasets: &[Dataset],
    offsets_n: &[f64],
    details: Details,
) -> Identified {
    let mut all = Errors::default();
    let mut runs = Vec::with_capacity(datasets.len());
    let of_run = |(dataset, offset_n): (&Dataset, &f64)| {
        run_errors(&model.augmented().with_force_offset_n(*offset_n), dataset)
    };
    let of_runs: Vec<Errors> = datasets.par_iter().zip(offsets_n).map(of_run).collect();
    for ((dataset, &force_offset_n), own) in datasets.iter().zip(offsets_n).zip(of_runs) {
        all.free_run.merge(&own.free_run);
        all.one_step.merge(&own.one_step);
        all.persistence.merge(&own.persistence);
        runs.push(RunFit {
            name: dataset.name.clone(),
            samples: dataset.counted() as u64,
            rate_hz: dataset.rate_hz,
            force_offset_n,
            free_run: sound(&own.free_run),
            one_step: sound(&own.one_step),
        });
    }
    let (free_run, one_step) = (sound(&all.free_run), sound(&all.one_step));
    let expected = Expected {
        free_run_rsse_n: free_run.map(|fit| fit.rsse_n),
        one_step_rsse_n: one_step.map(|fit| fit.rsse_n),
        uncertainty: None,
    };
    Identified {
        model: Model { expected, ..model },
        runs,
        free_run,
        one_step,
        persistence: sound(&all.persistence),
        memberships: details.memberships,
        velocity_trials: Vec::new(),
        rank: details.rank,
        parameters: details.parameters,
        restart_rsse_n: details.restart_rsse_n,
        active_bounds: details.active_bounds,
        converged: details.converged,
        warnings: details.warnings,
    }
}

/// Errors of `model` on the rows that count, free and one step ahead.
fn run_errors(model: &Augmented, dataset: &Dataset) -> Errors {
    let (mut errors, mut last_force_n) = (Errors::default(), f64::NAN);
    let done = walk(model, dataset, |row, predicted| {
        if row.dt_s.is_none() {
            last_force_n = f64::NAN;
        }
        if row.counts {
            errors.free_run.add(row.force_n, predicted.free_run_n);
            errors.one_step.add(row.force_n, predicted.one_step_n);
            errors.persistence.add(row.force_n, last_force_n);
        }
        last_force_n = row.force_n;
        ControlFlow::Continue(())
    });
    debug_assert!(done.is_continue(), "nothing ends the walk early");
    errors
}
