//! The model file that a diagnosis writes, and the rows that it reads. The command `close`, the demo and the action
//! `close_loop` use them.

use mr_damper_base::provenance::{TOOL, date};
use mr_damper_model::Error;
use mr_damper_model::diagnose::{DiagnosisError, DiagnosisResult, Runs};
use mr_damper_model::effect::Augmented;
use mr_damper_model::identify::{Dataset, DatasetOptions, SweptRange, walk};
use mr_damper_model::metrics::ErrorSum;
use mr_damper_model::model::{Expected, Model};
use mr_damper_model::model_file::{ModelFile, Provenance, Role, TrainingRun};
use mr_damper_model::sample::{DriveKind, Run};
use std::ops::ControlFlow;

/// Rows of `runs` for a diagnosis around `base`, with the base model's conditioning.
///
/// # Errors
/// When a run has no force or is too short for one row.
pub fn rows(runs: &[Run], base: &Model) -> Result<Vec<Dataset>, Error> {
    runs.iter().map(|run| Dataset::from_run(run, &base.conditioning, &DatasetOptions::default())).collect()
}

/// Provenance for a model file, besides the errors.
#[derive(Debug, Clone, Default)]
pub struct TrainingOrigin {
    /// Seed of everything random.
    pub seed: u64,
    /// Number of restarts used to identify the base.
    pub restarts: u32,
    /// The runs that were used.
    pub runs: Vec<TrainingRun>,
}

/// The runs of a diagnosis by role, as a model file lists them. Runs in memory have no SHA-256.
#[must_use]
pub fn training_runs(result: &DiagnosisResult, runs: &Runs) -> Vec<TrainingRun> {
    let by_role = [
        (Role::Estimate, runs.estimate),
        (Role::Confirm, runs.confirm),
        (Role::Test, runs.test),
        (Role::Reference, runs.reference),
        (Role::Replicate, runs.replicates),
        (Role::Healthy, runs.healthy),
    ];
    let took_part = by_role.iter().flat_map(|(role, data)| data.iter().map(move |data| (*role, data)));
    took_part
        .map(|(role, data)| TrainingRun {
            name: data.name.clone(),
            sha256: String::new(),
            samples: data.counted() as u64,
            force_offset_n: centred(&result.after, data).0,
            role: Some(role),
        })
        .collect()
}

/// The drive of the damper in a diagnosis: from the base model, or from its runs.
#[must_use]
pub fn drive(result: &DiagnosisResult, runs: &Runs) -> Option<DriveKind> {
    result.before.force.drive().or(runs.estimate.first().and_then(|data| data.drive))
}

/// The model file of the augmented model. The expected error is the error on the test runs (`--test`), or on the
/// validation runs (`--confirm`) without test runs. Both use the model's own force offset.
///
/// # Errors
/// [`DiagnosisError::AugmentedDiverges`] if the simulation of the model does not stay finite over the range of its runs.
pub fn model_file(result: &DiagnosisResult, runs: &Runs, origin: TrainingOrigin) -> Result<ModelFile, Error> {
    if let Some(sine) = result.swept.as_ref().and_then(SweptRange::diverges) {
        return Err(DiagnosisError::AugmentedDiverges { sine: sine.to_string() }.into());
    }
    let after = &result.after;
    let over = |data: &[Dataset]| sum(data.iter().map(|data| errors(&after.augmented(), data)));
    let validation = over(runs.test).fit();
    let tested = validation.or_else(|| over(runs.confirm).fit());
    let expected = Expected { free_run_rsse_n: tested.map(|fit| fit.rsse_n), ..Expected::default() };
    Ok(ModelFile {
        model: Model { expected, ..*after },
        provenance: Provenance {
            tool: TOOL.to_owned(),
            date: date(),
            seed: origin.seed,
            restarts: origin.restarts,
            runs: origin.runs,
            training_free_run: sum(runs.estimate.iter().map(|data| centred(after, data).1)).fit(),
            validation_free_run: validation,
            ..Provenance::default()
        },
    })
}

/// Errors of a simulation (free run) over the rows that count, with the model's own offset.
fn errors(model: &Augmented, data: &Dataset) -> ErrorSum {
    let mut errors = ErrorSum::default();
    let ended = walk(model, data, |row, predicted| {
        if row.counts {
            errors.add(row.force_n, predicted.free_run_n);
        }
        ControlFlow::Continue(())
    });
    debug_assert!(ended.is_continue(), "nothing ends the walk early");
    errors
}

/// The force offset with the smallest error on `data`, N, and the errors with it.
fn centred(model: &Model, data: &Dataset) -> (f64, ErrorSum) {
    let offset_n = model.force.force_offset_n() + errors(&model.augmented(), data).mean_error_n();
    (offset_n, errors(&model.augmented().with_force_offset_n(offset_n), data))
}

/// The sum of all `errors`.
fn sum(errors: impl Iterator<Item = ErrorSum>) -> ErrorSum {
    errors.fold(ErrorSum::default(), |mut all, one| {
        all.merge(&one);
        all
    })
}
