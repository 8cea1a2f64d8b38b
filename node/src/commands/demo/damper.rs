//! The demo's virtual damper, healthy and with a coil lag, and the models that are identified on the healthy one.

use super::error::DemoError;
use crate::commands::context::CliContext;
use crate::settings::error::NodeError;
use mr_damper_model::condition::{Conditioning, VelocitySource};
use mr_damper_model::evaluate::evaluate;
use mr_damper_model::identify::{ModelSpec, Options, Watch, identify};
use mr_damper_model::model::Model;
use mr_damper_model::model_file::{ModelFile, Provenance, TrainingRun};
use mr_damper_model::pipeline::Settings;
use mr_damper_model::rig::{Channels, Experiment, Plant, inject, record};
use mr_damper_model::sample::Run;
use mr_damper_runs::write_text;
use std::path::Path;

/// Id of the effect that the models do not include.
pub(super) const EFFECT: &str = "coil_lag";
/// Its size: the lag of the coil, s.
pub(super) const LAG_S: f64 = 0.012;
/// Length of the runs that are not played, s.
pub(super) const BENCH_S: f64 = 31.0;
/// Random road and random steps of the current, several per second: they excite a coil lag.
const EXPERIMENT: &str = "RP-APRBS";
/// Number of restarts when a model is identified.
const RESTARTS: u32 = 5;

/// Purpose of a run. Each purpose has its own road, currents and sensor noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Purpose {
    /// Played to the service before the diagnosis; its seed is the demo's own.
    Played = 0,
    /// Healthy damper: the models are identified on this run.
    Identify,
    /// Healthy damper: gives the error that is expected of the models.
    Validate,
    /// Training run of the diagnosis, besides the service's history.
    Estimate,
    /// A second training run, for a short demo.
    EstimateToo,
    /// Validation run of the diagnosis.
    Confirm,
    /// Test run of the diagnosis: read once, at the end.
    Test,
    /// Played to the service after it has loaded the model with the effect.
    PlayedAfter,
}

impl Purpose {
    /// Seed of the run. The large step between purposes avoids the seeds of other demos, which are likely to be
    /// neighbours of `demo`.
    const fn seed(self, demo: u64) -> u64 {
        demo.wrapping_add((self as u64).wrapping_mul(1_000_003))
    }
}

fn run(purpose: Purpose, seconds: f64, seed: u64, lag_s: f64) -> Result<Run, NodeError> {
    let experiment = Experiment::thesis(EXPERIMENT)
        .ok_or(DemoError::NoExperiment { name: EXPERIMENT })?
        .with_duration_s(seconds);
    let mut plant = Plant::quasi_static();
    // A fine resolution of displacement makes a velocity filter, which would delay the force, unnecessary.
    let mut channels = Channels::default().with_fine_displacement();
    inject::inject(EFFECT, lag_s, &mut plant, &mut channels)?;
    Ok(record(&experiment, &plant, &channels, purpose.seed(seed)))
}

/// A run of the healthy damper.
///
/// # Errors
/// When the rig does not have the experiment.
pub(super) fn healthy(purpose: Purpose, seconds: f64, seed: u64) -> Result<Run, NodeError> {
    run(purpose, seconds, seed, 0.0)
}

/// A run of the damper with a coil lag of [`LAG_S`].
///
/// # Errors
/// When the rig does not have the experiment.
pub(super) fn lagging(purpose: Purpose, seconds: f64, seed: u64) -> Result<Run, NodeError> {
    run(purpose, seconds, seed, LAG_S)
}

/// Identifies both models on a healthy run, and writes the simulating model to `free` and the ARX model to `seeded`.
///
/// # Errors
/// When a fit fails or a file cannot be written; [`NodeError::Interrupted`].
pub(super) fn identify_models(
    seed: u64,
    context: &CliContext,
    free: &Path,
    seeded: &Path,
) -> Result<(), NodeError> {
    let training = [healthy(Purpose::Identify, BENCH_S, seed)?];
    let held_out = healthy(Purpose::Validate, BENCH_S, seed)?;
    let watch = Watch { cancel: Some(context.interrupt.flag()), progress: None };
    let conditioning = Conditioning { velocity: VelocitySource::ThreePoint, ..Conditioning::default() };
    for (spec, path) in [(ModelSpec::FUZZY_TANH, free), (ModelSpec::ARX_SEMI_ACTIVE, seeded)] {
        let options =
            Options { conditioning, choose_velocity: false, restarts: RESTARTS, seed, ..Options::default() };
        let mut found = identify(spec, &training, &options, &watch)?;
        let scored = evaluate(found.model, &held_out, Settings::default(), |_| true)?;
        let expected = &mut found.model.expected;
        expected.free_run_rsse_n = scored.free_run.map(|fit| fit.rsse_n);
        expected.one_step_rsse_n = scored.one_step.map(|fit| fit.rsse_n);
        let provenance = Provenance {
            tool: mr_damper_base::provenance::TOOL.to_owned(),
            seed,
            restarts: RESTARTS,
            runs: vec![TrainingRun {
                name: training[0].name.clone(),
                samples: found.runs.iter().map(|run| run.samples).sum(),
                force_offset_n: found.runs.first().map_or(0.0, |run| run.force_offset_n),
                ..TrainingRun::default()
            }],
            training_free_run: found.free_run,
            training_one_step: found.one_step,
            validation_free_run: scored.free_run,
            validation_one_step: scored.one_step,
            persistence: scored.persistence,
            ..Provenance::default()
        };
        write(found.model, provenance, path)?;
    }
    Ok(())
}

fn write(model: Model, provenance: Provenance, path: &Path) -> Result<(), NodeError> {
    let text = ModelFile { model, provenance }.to_toml()?;
    Ok(write_text(path, &text)?)
}
