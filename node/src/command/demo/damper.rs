//! The demo's damper in health and with its coil lag, and the models that were identified on it in health.

use crate::command::Surroundings;
use crate::error::NodeError;
use crate::run::write_text;
use mr_damper_model::condition::{Conditioning, VelocitySource};
use mr_damper_model::evaluate::evaluate;
use mr_damper_model::identify::{ModelSpec, Options, Watch, identify};
use mr_damper_model::model::Model;
use mr_damper_model::model_file::{ModelFile, Provenance, TrainingRun};
use mr_damper_model::pipeline::Settings;
use mr_damper_model::rig::{Channels, Experiment, Plant, inject, record};
use mr_damper_model::sample::Run;
use std::path::Path;

/// The effect that the models are not told of, as the rig calls it.
pub(super) const EFFECT: &str = "coil_lag";
/// Its size: the lag of the coil, s.
pub(super) const LAG_S: f64 = 0.012;
/// Length of the runs that are not played, s.
pub(super) const BENCH_S: f64 = 31.0;
/// Random road and random steps of the current, several a second: they excite a lag of the coil.
const EXPERIMENT: &str = "RP-APRBS";
/// Restarts of the fuzzy-tanh model's search.
const RESTARTS: u32 = 5;

/// What a run is for. Each has its own road, currents and sensor noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Purpose {
    /// Played; the first has the demo's own seed.
    Played = 0,
    /// Healthy: the models are identified on it.
    Identify,
    /// Healthy: says which error to expect of them.
    Validate,
    /// The effect is sought on it, beside what the service remembers.
    Estimate,
    /// The same.
    EstimateToo,
    /// Decides whether a finding holds.
    Confirm,
    /// Read once, at the end.
    Sealed,
    /// Played when the model with the effect is in force.
    PlayedAfter,
}

impl Purpose {
    /// Seeds of other demos are not met: theirs are next to each other.
    const fn seed(self, demo: u64) -> u64 {
        demo.wrapping_add((self as u64).wrapping_mul(1_000_003))
    }
}

fn run(purpose: Purpose, seconds: f64, seed: u64, lag_s: f64) -> Result<Run, NodeError> {
    let experiment = Experiment::thesis(EXPERIMENT)
        .ok_or_else(|| NodeError::Failed(format!("the rig has no experiment {EXPERIMENT}")))?
        .with_duration_s(seconds);
    let mut plant = Plant::quasi_static();
    // So fine that velocity needs no filter, which would make the force late.
    let mut channels = Channels::default().with_fine_displacement();
    inject::inject(EFFECT, lag_s, &mut plant, &mut channels)?;
    Ok(record(&experiment, &plant, &channels, purpose.seed(seed)))
}

/// A run of the damper in health.
///
/// # Errors
/// When the rig does not know the experiment.
pub(super) fn healthy(purpose: Purpose, seconds: f64, seed: u64) -> Result<Run, NodeError> {
    run(purpose, seconds, seed, 0.0)
}

/// A run of the damper as it is by now.
///
/// # Errors
/// Those of [`healthy`].
pub(super) fn lagging(purpose: Purpose, seconds: f64, seed: u64) -> Result<Run, NodeError> {
    run(purpose, seconds, seed, LAG_S)
}

/// Identifies both models on a healthy run, and writes them to `free` and `seeded`.
///
/// # Errors
/// When a fit fails or a file cannot be written; [`NodeError::Interrupted`].
pub(super) fn identify_models(
    seed: u64,
    around: &Surroundings,
    free: &Path,
    seeded: &Path,
) -> Result<(), NodeError> {
    let bench = [healthy(Purpose::Identify, BENCH_S, seed)?];
    let held_out = healthy(Purpose::Validate, BENCH_S, seed)?;
    let watch = Watch { cancel: Some(around.interrupt.flag()), progress: None };
    let conditioning = Conditioning { velocity: VelocitySource::ThreePoint, ..Conditioning::default() };
    for (spec, path) in [(ModelSpec::FUZZY_TANH, free), (ModelSpec::ARX_SEMI_ACTIVE, seeded)] {
        let options =
            Options { conditioning, choose_velocity: false, restarts: RESTARTS, seed, ..Options::default() };
        let mut found = identify(spec, &bench, &options, &watch)?;
        let scored = evaluate(found.model, &held_out, Settings::default(), |_| true)?;
        let expected = &mut found.model.expected;
        expected.free_run_rsse_n = scored.free_run.map(|fit| fit.rsse_n);
        expected.one_step_rsse_n = scored.one_step.map(|fit| fit.rsse_n);
        let provenance = Provenance {
            tool: crate::provenance::TOOL.to_owned(),
            seed,
            restarts: RESTARTS,
            runs: vec![TrainingRun {
                name: bench[0].name.clone(),
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
