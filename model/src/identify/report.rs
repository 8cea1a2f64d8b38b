//! Result of an identification, and its fit to the training runs.

use super::dataset::Dataset;
use super::levels::Memberships;
use super::score::{sound, walk};
use super::search::Found;
use super::swept::{SweptFault, SweptRange, sweep};
use super::velocity::VelocityTrial;
use crate::effect::Augmented;
use crate::metrics::{ErrorSum, Fit};
use crate::model::{Expected, Model};
use crate::parallel;
use std::fmt;
use std::ops::ControlFlow;

/// An identified model.
#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// The model. Its offset is the mean of the runs' offsets. Its expected error is the training error until
    /// a validation replaces it.
    pub model: Model,
    /// The training runs, in the given order.
    pub runs: Vec<RunFit>,
    /// Simulation error over all counted training rows, each run with its own offset; `None` if the
    /// simulation does not stay finite.
    pub free_run: Option<Fit>,
    /// Error of the one-step-ahead prediction, each run with its own offset; `None` for a model without force
    /// inputs.
    pub one_step: Option<Fit>,
    /// Error of persistence, which predicts the force of the previous sample; the reference for `one_step`.
    pub persistence: Option<Fit>,
    /// Membership functions and their source (fuzzy-tanh).
    pub memberships: Option<Memberships>,
    /// Derivatives that were tried (fuzzy-tanh with automatic choice).
    pub velocity_trials: Vec<VelocityTrial>,
    /// Rank of the regression (ARX): less than the number of coefficients if regressors are collinear.
    pub rank: Option<usize>,
    /// Parameters of a fit and their standard errors; empty for networks, fuzzy rules, lazy learning and recursive fits.
    pub parameters: Vec<ParameterValue>,
    /// RMSE of each restart, N, lowest first: on its sample of the rows (fuzzy-tanh), of the simulation over
    /// the held-back rows (networks), or of each choice of metric and neighbours (boada). If many are close
    /// to the first, the minimum is reliable.
    pub restart_rsse_n: Vec<f64>,
    /// Parameters that ended on a bound: the data ask for a meaningless value, or do not determine the
    /// parameter.
    pub active_bounds: Vec<ActiveBound>,
    /// False if the last fit used up its evaluations before it converged. Always true for networks, which
    /// stop by the error on held-back rows.
    pub converged: bool,
    /// The model over the whole range of its runs; `None` for a model that uses measured force.
    pub swept: Option<SweptRange>,
    /// The fit by least squares alone, if it had faults over that range and a weak prior was added.
    pub without_prior: Option<WithoutPrior>,
    /// Facts that a user must know before using the model, such as a diverging simulation; complete sentences.
    pub warnings: Vec<String>,
}

/// A fit by least squares alone, which a fit with a weak prior replaced: the force of a step and a viscous damping that grow
/// with the drive.
#[derive(Debug, Clone, PartialEq)]
pub struct WithoutPrior {
    /// Its model.
    pub model: Box<Model>,
    /// Faults of the model over the whole range of its runs.
    pub faults: Vec<SweptFault>,
    /// The model's simulation error over all counted training rows.
    pub free_run: Option<Fit>,
}

impl fmt::Display for WithoutPrior {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the runs alone do not determine the model: ")?;
        if let Some(fault) = self.faults.first() {
            write!(f, "{fault}")?;
        }
        f.write_str("; so a weak prior was added, a step and a viscous damping that grow with the drive")?;
        match self.free_run {
            Some(fit) => write!(f, " (training NMSE without it {:.5})", fit.esr),
            None => Ok(()),
        }
    }
}

impl Identified {
    /// Faults of the model over the whole range of its runs.
    pub(super) fn faults(&self) -> &[SweptFault] {
        self.swept.as_ref().map_or(&[], |swept| &swept.faults)
    }
}

/// Fit to one training run.
#[derive(Debug, Clone, PartialEq)]
pub struct RunFit {
    /// Name of the run.
    pub name: String,
    /// Number of counted rows.
    pub samples: u64,
    /// Rate of the rows, Hz.
    pub rate_hz: f64,
    /// Force offset of the run, N.
    pub force_offset_n: f64,
    /// Simulation error with this offset.
    pub free_run: Option<Fit>,
    /// Error of the one-step-ahead prediction with this offset; `None` for a model without force inputs.
    pub one_step: Option<Fit>,
}

/// A parameter on a bound.
#[derive(Debug, Clone, PartialEq)]
pub struct ActiveBound {
    /// Name as in the model file, with the index of the function.
    pub parameter: String,
    /// The value, in the parameter's unit.
    pub value: f64,
}

/// An identified parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterValue {
    /// Name as in the model file, with the index of the set or of the power of the drive.
    pub name: String,
    /// The value, in the parameter's unit.
    pub value: f64,
    /// Its standard error, from the scatter of the gradient over blocks of one second; NaN if the runs do not
    /// determine the parameter.
    pub standard_error: f64,
}

/// Length of the blocks whose scatter gives standard errors, s: longer than the correlation time of residuals.
pub(super) const BLOCK_S: f64 = 1.0;

impl ParameterValue {
    /// The parameters with `values` and standard `errors`; `name` gives the name of each.
    pub(super) fn all(values: &[f64], errors: &[f64], name: impl Fn(usize) -> String) -> Vec<Self> {
        let one = |(j, (value, error)): (usize, (&f64, &f64))| Self {
            name: name(j),
            value: *value,
            standard_error: *error,
        };
        values.iter().zip(errors).enumerate().map(one).collect()
    }
}

/// Details that depend on the kind of model.
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
    /// Details of a search over parameters with the given `names`.
    pub(super) fn of(found: &Found, names: &[String]) -> Self {
        let name = |j: usize| names[j].clone();
        let bound = |&j: &usize| ActiveBound { parameter: name(j), value: found.natural[j] };
        Self {
            parameters: ParameterValue::all(&found.natural, &found.standard_errors, name),
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

/// Names of parameters that exist in `copies` copies.
pub(super) fn names_of_copies<'a>(
    names: impl Iterator<Item = &'a str> + Clone,
    copies: usize,
) -> Vec<String> {
    let copy = |copy: usize| names.clone().map(move |name| format!("{name}[{copy}]"));
    (0..copies).flat_map(copy).collect()
}

/// Error sums of simulation, one-step-ahead prediction and persistence.
#[derive(Debug, Default)]
struct Errors {
    free_run: ErrorSum,
    one_step: ErrorSum,
    persistence: ErrorSum,
}

/// Combines `model` and `details` with the errors on the training runs.
pub(super) fn assemble(
    model: Model,
    datasets: &[Dataset],
    offsets_n: &[f64],
    details: Details,
) -> Identified {
    let mut all = Errors::default();
    let mut runs = Vec::with_capacity(datasets.len());
    let of_run =
        |index: usize| run_errors(&model.augmented().with_force_offset_n(offsets_n[index]), &datasets[index]);
    let of_runs: Vec<Errors> = parallel::map_indices(datasets.len(), of_run);
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
    let swept =
        model.force.force_fed_period().is_none().then(|| sweep(&model.augmented(), datasets)).flatten();
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
        swept,
        without_prior: None,
        warnings: details.warnings,
    }
}

/// Errors of `model` on the counted rows: simulation, one-step-ahead prediction and persistence.
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
    debug_assert!(done.is_continue(), "the closure never stops the walk");
    errors
}
