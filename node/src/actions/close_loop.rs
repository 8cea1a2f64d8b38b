//! The action `close_loop`: names what the running model lacks, on what the service remembers.
//!
//! Nothing is swapped in unless `close_loop.auto_load` says so.

use super::{Job, Remembered, Step, Work, total_s, write_new};
use crate::closing::{Origin, drive, model_file, rows, training_runs};
use crate::command::close::in_words;
use crate::control::Control;
use crate::error::NodeError;
use crate::far::{self, Shorten};
use crate::parameters::Parameters;
use crate::report::close as report;
use crate::report::close::json::{self, SCHEMA};
use mr_damper_model::diagnose::{self, Closing, Runs, Settings, Stage};
use mr_damper_model::identify::Watch;
use mr_damper_model::model::Model;
use mr_damper_model::model_file::Role;
use mr_damper_model::sample::Run;
use mr_damper_msgs::action::{CloseLoop, CloseLoopFeedback, CloseLoopGoal, CloseLoopResult};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Shares of the history, by time: effects are found on the first, confirmed on the second, proved on the rest.
const SHARES: [(Role, f64); 3] = [(Role::Estimate, 0.6), (Role::Confirm, 0.2), (Role::Test, 0.2)];
/// Seed of sign flips and bootstrap.
const SEED: u64 = 0;
/// What a reader of the report has to know of the runs.
const NOTE: &str = "the runs are parts of one recording: first 60 % estimate, next 20 % confirm, last 20 % test. Parts of one \
                    session share what a session has; runs recorded apart (`mr-damper close`) prove more";

/// The action.
pub(super) struct CloseLoopWork {
    remembered: Remembered,
    parameters: Arc<Parameters>,
}

impl CloseLoopWork {
    /// The action on what is remembered; `parameters` are told of a model that is swapped in.
    pub(super) fn new(remembered: Remembered, parameters: Arc<Parameters>) -> Self {
        Self { remembered, parameters }
    }
}

impl Work for CloseLoopWork {
    type Action = CloseLoop;
    /// The report, JSON.
    type Done = String;
    const NAME: &'static str = "close_loop";

    fn consider(&self, goal: &CloseLoopGoal) -> Result<Job<String>, String> {
        let control = &self.remembered.control;
        let config = control.config();
        let running = control.models().ok_or("the node has no model; configure it first")?.free;
        let mut base = running;
        // The rows must be what the model runs on.
        if let Some((apply_to, cutoff_hz)) = config.pipeline_settings(base.conditioning.cutoff_hz).filter {
            (base.conditioning.apply_to, base.conditioning.cutoff_hz) = (apply_to, cutoff_hz);
        }
        let swap = config.close_loop_auto_load.then(|| Swap {
            control: Arc::clone(control),
            parameters: Arc::clone(&self.parameters),
            running,
        });
        let diagnosis = Diagnosis {
            base,
            runs: self.remembered.runs(goal.history)?,
            folder: self.remembered.folder(),
            damper: self.remembered.damper.clone(),
            swap,
        };
        Ok(Box::new(move |cancelled, say| {
            let say = |stage| say(Step { stage: in_words(stage), progress: progress(stage) });
            diagnosis.work(cancelled, &say)
        }))
    }

    fn feedback(Step { stage, progress }: Step) -> CloseLoopFeedback {
        CloseLoopFeedback { stage, progress }
    }

    const SHORTEN: Option<Shorten<CloseLoopResult>> = Some(far::short_report);

    fn result(worked: Result<String, &NodeError>) -> CloseLoopResult {
        let success = worked.is_ok();
        CloseLoopResult { success, report: worked.unwrap_or_else(error_json) }
    }
}

/// About how much of the work is done when `stage` begins.
fn progress(stage: Stage) -> f32 {
    match stage {
        Stage::Base => 0.0,
        Stage::Scores(round) => (0.05 + 0.2 * (round as f32 - 1.0)).min(0.6),
        Stage::Refits(round) => (0.15 + 0.2 * (round as f32 - 1.0)).min(0.65),
        Stage::Pruning => 0.7,
        Stage::Rival => 0.75,
        Stage::Sealed => 0.95,
    }
}

/// What a diagnosis needs, taken when the goal comes.
struct Diagnosis {
    /// The running free model, conditioned as it runs.
    base: Model,
    /// The history, oldest first.
    runs: Vec<Run>,
    /// Directory of the model file.
    folder: PathBuf,
    /// Name of the damper.
    damper: String,
    /// How to swap the model in; `None` when that is not allowed.
    swap: Option<Swap>,
}

/// The running service, into which a model may be swapped.
struct Swap {
    control: Arc<Control>,
    parameters: Arc<Parameters>,
    /// The free model that ran when the goal came.
    running: Model,
}

/// What a goal is answered: what `mr-damper close` writes, and what is special here.
#[derive(Debug, Serialize)]
struct Answer<'a> {
    #[serde(flatten)]
    written: json::Written<'a, RunRow>,
    note: &'static str,
    /// The model runs already.
    loaded: bool,
    /// Why it does not, though `close_loop.auto_load` asks for it.
    load_error: Option<String>,
    /// The same for people.
    text: String,
}

#[derive(Debug, Serialize)]
struct RunRow {
    role: Role,
    run: String,
    seconds: f64,
}

/// The report of a goal that came to nothing.
fn error_json(error: &NodeError) -> String {
    serde_json::json!({ "schema": SCHEMA, "error": error.to_string() }).to_string()
}

impl Diagnosis {
    /// Diagnoses, writes the model file when an effect was named, swaps the model in where that is allowed, and returns
    /// the report as JSON.
    ///
    /// # Errors
    /// When the history is too short or lacks a channel, the model can be no base, or the file cannot be written;
    /// [`NodeError::Interrupted`].
    fn work(&self, cancelled: &AtomicBool, say: &dyn Fn(Stage)) -> Result<String, NodeError> {
        let history_s = format!("{:.1}", total_s(&self.runs));
        tracing::info!(history_s, "close_loop: a goal is worked on");
        let worked = self.report(cancelled, say);
        if let Err(error) = &worked {
            tracing::warn!("close_loop came to nothing: {error}");
        }
        worked
    }

    fn report(&self, cancelled: &AtomicBool, say: &dyn Fn(Stage)) -> Result<String, NodeError> {
        let started = Instant::now();
        if !self.folder.is_dir() {
            let message =
                "is no directory that a model could be written to; set close_loop.out to one".to_owned();
            return Err(NodeError::File { path: self.folder.clone(), message });
        }
        let parts = split(&self.runs)?;
        let of = |role: Role| {
            let runs: Vec<Run> =
                parts.iter().filter(|part| part.0 == role).map(|part| part.1.clone()).collect();
            rows(&runs, &self.base)
        };
        let on_history = |error| self.on_history(error);
        let estimate = of(Role::Estimate).map_err(on_history)?;
        let confirm = of(Role::Confirm).map_err(on_history)?;
        let test = of(Role::Test).map_err(on_history)?;
        let runs = Runs { estimate: &estimate, confirm: &confirm, test: &test, ..Runs::default() };
        let settings = Settings { seed: SEED, ..Settings::default() };
        let watch = Watch { cancel: Some(cancelled), progress: None };
        let closing = diagnose::close(&self.base, &runs, &settings, &watch, say).map_err(on_history)?;
        // From here on there is something to be undone.
        if cancelled.load(Ordering::Acquire) {
            return Err(NodeError::Interrupted);
        }
        let origin = || Origin { seed: SEED, runs: training_runs(&closing, &runs), ..Origin::default() };
        let path = (!closing.effects.is_empty())
            .then(|| {
                write_new(
                    &self.folder,
                    &self.damper,
                    "close",
                    &model_file(&closing, &runs, origin()).to_toml()?,
                )
            })
            .transpose()?;
        let loaded = match (&path, &self.swap) {
            (Some(path), Some(swap)) => swap.load(path).map(|()| true),
            _ => Ok(false),
        };
        tracing::info!(model_file = ?path, ?loaded, "close_loop: {}", in_short(&closing));
        let parts = parts.into_iter();
        let row = |(role, run): (_, Run)| RunRow { role, seconds: run.duration().get(), run: run.name };
        let seconds = started.elapsed().as_secs_f64();
        let answer = Answer {
            written: json::Written::new(&closing, SEED, seconds, parts.map(row), path.as_deref()),
            note: NOTE,
            loaded: *loaded.as_ref().unwrap_or(&false),
            load_error: loaded.err().map(|error| error.to_string()),
            text: report::text(&closing, drive(&closing, &runs)),
        };
        serde_json::to_string(&answer)
            .map_err(|error| NodeError::Failed(format!("the report cannot be written as JSON: {error}")))
    }

    /// An error of the diagnosis, with what it was made on: the model knows of runs, but not where they come from.
    fn on_history(&self, error: mr_damper_model::Error) -> NodeError {
        match NodeError::from(error) {
            NodeError::Interrupted => NodeError::Interrupted,
            error => NodeError::Failed(format!(
                "on {:.1} s of history, of which the first 60 % are estimate runs, the next 20 % confirm and the rest test \
                 runs: {error}. The node keeps history.duration_s of it; another base is swapped in with load_model",
                total_s(&self.runs)
            )),
        }
    }
}

impl Swap {
    /// Swaps the model in `path` in, unless another one than that which was diagnosed runs by now.
    fn load(&self, path: &Path) -> Result<(), NodeError> {
        self.control.load_model_over(&path.display().to_string(), &self.running)?;
        self.parameters.announce(&["model".to_owned()]);
        Ok(())
    }
}

/// The verdict and what was named, for the log.
fn in_short(closing: &Closing) -> String {
    let named: Vec<_> = closing.effects.iter().map(|named| named.effect.effect().title()).collect();
    let named = if named.is_empty() { "nothing named".to_owned() } else { named.join(", ") };
    format!("{}: {named}", closing.verdict.name())
}

/// The runs, cut where the time that they hold together reaches each share.
fn split(runs: &[Run]) -> Result<Vec<(Role, Run)>, NodeError> {
    /// Shorter pieces, s, hold no row that counts.
    const LEAST_S: f64 = 0.5;
    /// A cut nearer to the end of a piece than this is at its end: seconds are not whole in binary.
    const SAME_S: f64 = 1e-6;
    let total_s = total_s(runs);
    if total_s <= 0.0 {
        return Err(NodeError::Failed(
            "there is no history yet: the node keeps displacement, drive and force as they come, for history.duration_s"
                .to_owned(),
        ));
    }
    let mut parts = Vec::new();
    let (mut shares, mut begun_s) = (SHARES.iter(), 0.0);
    let mut current = shares.next().map(|(role, share)| (*role, share * total_s));
    for run in runs {
        let Some(first) = run.displacement_m.stamps.first() else { continue };
        let length_s = run.duration().get();
        let mut from_s = 0.0;
        while let Some((role, until_s)) = current {
            let here_s = until_s - begun_s;
            let is_last = shares.as_slice().is_empty();
            let to_s = if is_last || here_s >= length_s - SAME_S { length_s } else { here_s };
            if to_s - from_s >= LEAST_S {
                let at = |s: f64| first.shifted((s * 1e9) as i64);
                // The end of the run belongs to it.
                let to = if to_s == length_s { at(length_s).shifted(1_000) } else { at(to_s) };
                let mut part = run.between(at(from_s), to);
                part.name = format!("{}, {from_s:.1} to {to_s:.1} s", run.name);
                parts.push((role, part));
            }
            if is_last || here_s > length_s + SAME_S {
                break;
            }
            from_s = to_s;
            current = shares.next().map(|(role, share)| (*role, until_s + share * total_s));
        }
        begun_s += length_s;
    }
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_model::sample::{Stamp, Trace};

    /// A run from `from_s` on, of `seconds`, at 100 Hz.
    fn run(from_s: i64, seconds: i64) -> Run {
        let stamps: Vec<Stamp> =
            (0..=100 * seconds).map(|k| Stamp::from_nanos(from_s * 1_000_000_000 + k * 10_000_000)).collect();
        let values = vec![0.0; stamps.len()];
        Run { name: format!("at {from_s}"), displacement_m: Trace { stamps, values }, ..Run::default() }
    }

    fn parts(runs: &[Run]) -> Vec<(Role, usize)> {
        split(runs)
            .expect("there is something")
            .iter()
            .map(|(r, run)| (*r, run.displacement_m.len()))
            .collect()
    }

    #[test]
    fn a_history_is_split_by_time_and_no_sample_serves_twice() {
        use Role::{Confirm, Estimate, Test};
        assert_eq!(parts(&[run(0, 100)]), [(Estimate, 6000), (Confirm, 2000), (Test, 2001)]);
        // A gap: the first piece holds 30 s of 100 s.
        let pieces = [run(0, 30), run(50, 70)];
        assert_eq!(parts(&pieces), [(Estimate, 3001), (Estimate, 3000), (Confirm, 2000), (Test, 2001)]);
        // The cut falls on the gap.
        let pieces = [run(0, 60), run(80, 40)];
        assert_eq!(parts(&pieces), [(Estimate, 6001), (Confirm, 2000), (Test, 2001)]);
        assert!(split(&[]).is_err());
    }
}
