//! The end of the demo: diagnosis of the model that raised the alarm.
//!
//! ```text
//! history of the service + a fresh run ─→ training ─┐
//! two more fresh runs ─────→ validation, test ──────┴→ diagnosis ─→ model+.toml ─→ loaded by the running service
//! ```

use super::Args;
use super::damper::{self, BENCH_S, Purpose};
use crate::commands::context::CliContext;
use crate::settings::error::NodeError;
use mr_damper_model::diagnose::{self, DiagnosisResult, Runs, Settings};
use mr_damper_model::identify::{Dataset, Watch};
use mr_damper_model::model::Model;
use mr_damper_model::sample::Run;
use mr_damper_reports::augmented_file::{TrainingOrigin, model_file, rows, training_runs};
use mr_damper_reports::diagnosis::words::stage_in_words;
use mr_damper_runs::write_text;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::Instant;

/// If the live run is shorter than this, s, one more fresh run is added to the training runs.
const ENOUGH_S: f64 = 20.0;
/// Shortest and longest run that is played with the new model, s.
const AFTER_S: (f64, f64) = (4.0, 10.0);

/// Fresh runs of the same damper: training, validation and test runs for the diagnosis.
pub(super) struct FreshRuns {
    estimate: Vec<Run>,
    confirm: [Run; 1],
    test: [Run; 1],
    /// The run that is played after the new model is loaded.
    pub(super) after: Run,
}

impl FreshRuns {
    /// Starts a thread that generates the runs.
    ///
    /// # Errors
    /// When the system cannot start a thread.
    pub(super) fn begin(args: &Args) -> Result<JoinHandle<Result<Self, NodeError>>, NodeError> {
        let (seconds, seed) = (args.seconds, args.seed);
        std::thread::Builder::new()
            .name("demo-rig".to_owned())
            .spawn(move || Self::make(seconds, seed))
            .map_err(NodeError::io("starting the thread that makes more runs"))
    }

    fn make(seconds: f64, seed: u64) -> Result<Self, NodeError> {
        let rig_run = |purpose| damper::lagging(purpose, BENCH_S, seed);
        let mut estimate = vec![rig_run(Purpose::Estimate)?];
        if seconds < ENOUGH_S {
            estimate.push(rig_run(Purpose::EstimateToo)?);
        }
        let after_s = (seconds / 3.0).clamp(AFTER_S.0, AFTER_S.1);
        Ok(Self {
            estimate,
            confirm: [rig_run(Purpose::Confirm)?],
            test: [rig_run(Purpose::Test)?],
            after: damper::lagging(Purpose::PlayedAfter, after_s, seed)?,
        })
    }
}

/// The result of the diagnosis.
pub(super) struct DemoResult {
    pub(super) result: DiagnosisResult,
    /// Path of the model with what was found; `None` if nothing was found.
    pub(super) model: Option<PathBuf>,
    pub(super) seconds: f64,
    /// Description of the runs that were used.
    pub(super) runs: String,
}

/// Finds the effects that `base` lacks, using the service's history and fresh runs, and writes the augmented model to `path`.
///
/// # Errors
/// The errors of [`diagnose::close`]; when the file cannot be written; [`NodeError::Interrupted`].
pub(super) fn run(
    base: &Model,
    history: &[Run],
    fresh: &FreshRuns,
    args: &Args,
    context: &CliContext,
    path: &Path,
) -> Result<DemoResult, NodeError> {
    let started = Instant::now();
    // Pieces of the live run without measured force, or with the damper at rest, carry no information.
    let recorded: Vec<Dataset> = history
        .iter()
        .filter_map(|run| rows(std::slice::from_ref(run), base).ok())
        .flatten()
        .filter(|data| data.counted() > 0)
        .collect();
    let recorded_s: f64 = recorded.iter().map(|data| data.counted() as f64 / data.rate_hz).sum();
    let mut estimate = recorded;
    estimate.extend(rows(&fresh.estimate, base)?);
    let (confirm, test) = (rows(&fresh.confirm, base)?, rows(&fresh.test, base)?);
    let runs = Runs { estimate: &estimate, confirm: &confirm, test: &test, ..Runs::default() };
    // The model's error on the healthy damper counts as noise, as it does for the alarm.
    let floor_n = base.expected.free_run_rsse_n;
    let settings = Settings { noise_floor_n: floor_n, seed: args.seed, ..Settings::default() };
    let watch = Watch { cancel: Some(context.interrupt.flag()), progress: None };
    let say = |stage| {
        if !context.quiet {
            println!("  {:4.1} s  {}", started.elapsed().as_secs_f64(), stage_in_words(stage));
        }
    };
    let result = diagnose::close(base, &runs, &settings, &watch, &say)?;
    let found = result.is_augmented();
    if found {
        let origin = TrainingOrigin {
            seed: args.seed,
            runs: training_runs(&result, &runs),
            ..TrainingOrigin::default()
        };
        let text = model_file(&result, &runs, origin)?.to_toml()?;
        write_text(path, &text)?;
    }
    Ok(DemoResult {
        result,
        model: found.then(|| path.to_owned()),
        seconds: started.elapsed().as_secs_f64(),
        runs: format!(
            "found on {recorded_s:.0} s of the service's history and {} fresh run{} of {BENCH_S:.0} s, validated on \
             another run, and tested on one more that was not used before{}",
            fresh.estimate.len(),
            if fresh.estimate.len() == 1 { "" } else { "s" },
            floor_n.map_or_else(String::new, |floor_n| format!(
                "; the model's RMSE on the healthy damper, {floor_n:.1} N, counts as noise"
            )),
        ),
    })
}
