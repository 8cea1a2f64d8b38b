//! The end of the demo: the loop is closed around the model that the alarm was raised on.
//!
//! ```text
//! history of the service + a fresh run ─→ estimate ┐
//! two more fresh runs ─────→ confirm, sealed ──────┴→ diagnosis ─→ model+.toml ─→ swapped into the running service
//! ```

use super::Args;
use super::damper::{self, BENCH_S, Purpose};
use crate::closing::{Origin, model_file, rows, training_runs};
use crate::command::Surroundings;
use crate::command::close::in_words;
use crate::error::NodeError;
use crate::run::write_text;
use mr_damper_model::diagnose::{self, Closing, Runs, Settings};
use mr_damper_model::identify::{Dataset, Watch};
use mr_damper_model::model::Model;
use mr_damper_model::sample::Run;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::Instant;

/// A live run that is shorter than this is joined by one more fresh run to find the effect on, s.
const ENOUGH_S: f64 = 20.0;
/// Longest run that is played with the new model, and the shortest, s.
const AFTER_S: (f64, f64) = (4.0, 10.0);

/// Fresh runs of the same damper.
pub(super) struct Fresh {
    estimate: Vec<Run>,
    confirm: [Run; 1],
    sealed: [Run; 1],
    /// What is played with the new model in force.
    pub(super) after: Run,
}

impl Fresh {
    /// Begins to make them, on another thread.
    ///
    /// # Errors
    /// When the system starts no thread.
    pub(super) fn begin(args: &Args) -> Result<JoinHandle<Result<Self, NodeError>>, NodeError> {
        let (seconds, seed) = (args.seconds, args.seed);
        std::thread::Builder::new()
            .name("demo-rig".to_owned())
            .spawn(move || Self::make(seconds, seed))
            .map_err(NodeError::io("starting the thread that makes more runs"))
    }

    fn make(seconds: f64, seed: u64) -> Result<Self, NodeError> {
        let bench = |purpose| damper::lagging(purpose, BENCH_S, seed);
        let mut estimate = vec![bench(Purpose::Estimate)?];
        if seconds < ENOUGH_S {
            estimate.push(bench(Purpose::EstimateToo)?);
        }
        let after_s = (seconds / 3.0).clamp(AFTER_S.0, AFTER_S.1);
        Ok(Self {
            estimate,
            confirm: [bench(Purpose::Confirm)?],
            sealed: [bench(Purpose::Sealed)?],
            after: damper::lagging(Purpose::PlayedAfter, after_s, seed)?,
        })
    }
}

/// What was found.
pub(super) struct Found {
    pub(super) closing: Closing,
    /// The model with the effect; `None` when nothing was named.
    pub(super) model: Option<PathBuf>,
    pub(super) seconds: f64,
    /// What it was found on, in words.
    pub(super) runs: String,
}

/// Finds what `base` lacks, on what the service remembers and on fresh runs, and writes the model with it to `path`.
///
/// # Errors
/// Those of [`diagnose::close`]; when the file cannot be written; [`NodeError::Interrupted`].
pub(super) fn close(
    base: &Model,
    history: &[Run],
    fresh: &Fresh,
    args: &Args,
    around: &Surroundings,
    path: &Path,
) -> Result<Found, NodeError> {
    let started = Instant::now();
    // A piece of the live run without measured force, or at rest, has nothing to say.
    let remembered: Vec<Dataset> = history
        .iter()
        .filter_map(|run| rows(std::slice::from_ref(run), base).ok())
        .flatten()
        .filter(|data| data.counted() > 0)
        .collect();
    let remembered_s: f64 = remembered.iter().map(|data| data.counted() as f64 / data.rate_hz).sum();
    let mut estimate = remembered;
    estimate.extend(rows(&fresh.estimate, base)?);
    let (confirm, sealed) = (rows(&fresh.confirm, base)?, rows(&fresh.sealed, base)?);
    let runs = Runs { estimate: &estimate, confirm: &confirm, test: &sealed, ..Runs::default() };
    // What the model left over of the healthy damper is no news: the same yardstick as the alarm's.
    let floor_n = base.expected.free_run_rsse_n;
    let settings = Settings { noise_floor_n: floor_n, seed: args.seed, ..Settings::default() };
    let watch = Watch { cancel: Some(around.interrupt.flag()), progress: None };
    let say = |stage| {
        if !around.quiet {
            println!("  {:4.1} s  {}", started.elapsed().as_secs_f64(), in_words(stage));
        }
    };
    let closing = diagnose::close(base, &runs, &settings, &watch, &say)?;
    let named = !closing.effects.is_empty();
    if named {
        let origin = Origin { seed: args.seed, runs: training_runs(&closing, &runs), ..Origin::default() };
        let text = model_file(&closing, &runs, origin).to_toml()?;
        write_text(path, &text)?;
    }
    Ok(Found {
        closing,
        model: named.then(|| path.to_owned()),
        seconds: started.elapsed().as_secs_f64(),
        runs: format!(
            "found on {remembered_s:.0} s that the service remembers and {} fresh run{} of {BENCH_S:.0} s, confirmed on \
             another, proved on one more that nothing had touched{}",
            fresh.estimate.len(),
            if fresh.estimate.len() == 1 { "" } else { "s" },
            floor_n.map_or_else(String::new, |floor_n| format!(
                "; what the model left over in health, {floor_n:.1} N, counts as noise"
            )),
        ),
    })
}
