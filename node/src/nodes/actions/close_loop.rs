//! The action `close_loop`: diagnoses the running model on the service's history, and adds the effects that it lacks.
//!
//! The new model is loaded only if `close_loop.auto_load` is set, and it includes neither a drift of the load cell nor a term that counts from
//! the start of a run.

use super::{ActionContext, ActionError, ActionWork, Job, Step, total_s, write_new};
use crate::estimation::control::Control;
use crate::ros2::answer_limit::{self, Shorten};
use crate::settings::error::{NodeError, RequestError};
use crate::streams::parameters::Parameters;
use mr_damper_model::diagnose::{self, DiagnosisResult, Runs, Settings, Stage};
use mr_damper_model::effect::{Effect, Effects};
use mr_damper_model::identify::Watch;
use mr_damper_model::model::Model;
use mr_damper_model::model_file::Role;
use mr_damper_model::sample::Run;
use mr_damper_msgs::action::{CloseLoop, CloseLoopFeedback, CloseLoopGoal, CloseLoopResult};
use mr_damper_reports::augmented_file::{TrainingOrigin, drive, model_file, rows, training_runs};
use mr_damper_reports::diagnosis as report;
use mr_damper_reports::diagnosis::json;
use mr_damper_reports::diagnosis::words::{stage_in_words, term_title, titles};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Shares of the history, by time, for training (estimate), validation (confirm) and test.
const SHARES: [(Role, f64); 3] = [(Role::Estimate, 0.6), (Role::Confirm, 0.2), (Role::Test, 0.2)];
/// Seed of the sign flips and of the noise that is added to inputs.
const SEED: u64 = 0;
/// Note in the report about the runs.
const NOTE: &str = "the runs are parts of one recording: the first 60 % for training (estimate), the next 20 % for validation (confirm), \
                    the last 20 % for the test. Parts of one session are not independent; runs recorded separately (`mr-damper close`) \
                    prove more";

/// The action `close_loop`.
pub(super) struct CloseLoopWork {
    context: ActionContext,
    parameters: Arc<Parameters>,
}

impl CloseLoopWork {
    /// The action on the service's history. After a swap, `parameters` announces the new model.
    pub(super) fn new(context: ActionContext, parameters: Arc<Parameters>) -> Self {
        Self { context, parameters }
    }
}

impl ActionWork for CloseLoopWork {
    type Action = CloseLoop;
    /// The report as JSON.
    type Done = String;
    const NAME: &'static str = "close_loop";

    fn prepare(&self, goal: &CloseLoopGoal) -> Result<Job<String>, NodeError> {
        let control = &self.context.control;
        let config = control.config();
        let running = control.models().ok_or(RequestError::NoModel)?.free;
        let mut base = running;
        // The diagnosis must use the same filter as the running model.
        if let Some((apply_to, cutoff_hz)) = config.pipeline_settings(base.conditioning.cutoff_hz).filter {
            (base.conditioning.apply_to, base.conditioning.cutoff_hz) = (apply_to, cutoff_hz);
        }
        let auto_load = config.close_loop_auto_load.then(|| AutoLoad {
            control: Arc::clone(control),
            parameters: Arc::clone(&self.parameters),
            running,
        });
        let diagnosis = Diagnosis {
            base,
            runs: self.context.runs(goal.history)?,
            folder: self.context.folder(),
            damper: self.context.damper.clone(),
            auto_load,
        };
        Ok(Box::new(move |cancelled, say| {
            let say = |stage| say(Step { stage: stage_in_words(stage), progress: progress(stage) });
            diagnosis.work(cancelled, &say)
        }))
    }

    fn feedback(Step { stage, progress }: Step) -> CloseLoopFeedback {
        CloseLoopFeedback { stage, progress }
    }

    const SHORTEN: Option<Shorten<CloseLoopResult>> = Some(answer_limit::short_report);

    fn result(worked: Result<String, &NodeError>) -> CloseLoopResult {
        let success = worked.is_ok();
        CloseLoopResult { success, report: worked.unwrap_or_else(error_json) }
    }
}

/// Approximate share of the work that is done when `stage` begins.
fn progress(stage: Stage) -> f32 {
    match stage {
        Stage::Structure(_) | Stage::Base => 0.0,
        Stage::Search(round) | Stage::Scores(round) => (0.05 + 0.2 * (round as f32 - 1.0)).min(0.6),
        Stage::Refits(round) => (0.15 + 0.2 * (round as f32 - 1.0)).min(0.65),
        Stage::Pruning => 0.7,
        Stage::Alternative => 0.75,
        Stage::Terms(round) => (0.8 + 0.05 * (round as f32 - 1.0)).min(0.9),
        Stage::Completion => 0.92,
        Stage::TestRuns => 0.95,
    }
}

/// The data of a diagnosis, collected when the goal arrives.
struct Diagnosis {
    /// The running simulated model (free run), with its filter.
    base: Model,
    /// The history, oldest first.
    runs: Vec<Run>,
    /// Directory for the model file.
    folder: PathBuf,
    /// Name of the damper.
    damper: String,
    /// How to load the new model; `None` when that is not allowed.
    auto_load: Option<AutoLoad>,
}

/// The running service, into which the new model may be loaded.
struct AutoLoad {
    control: Arc<Control>,
    parameters: Arc<Parameters>,
    /// The simulated model that ran when the goal arrived.
    running: Model,
}

/// The report on a goal: the JSON that `mr-damper close` writes, with additional fields.
#[derive(Debug, Serialize)]
struct GoalReport<'a> {
    #[serde(flatten)]
    written: json::ReportDocument<'a, RunRow>,
    note: &'static str,
    /// True when the node runs the new model.
    loaded: bool,
    /// Why the node does not run it although `close_loop.auto_load` is set.
    load_error: Option<String>,
    /// The result as text.
    text: String,
}

#[derive(Debug, Serialize)]
struct RunRow {
    role: Role,
    run: String,
    seconds: f64,
}

/// The report of a goal that failed.
fn error_json(error: &NodeError) -> String {
    serde_json::json!(json::FailureDocument::new(error.to_string(), error.reason())).to_string()
}

impl Diagnosis {
    /// Runs the diagnosis, writes a model file if an effect or a term was found, loads the model if that is allowed, and returns the
    /// report as JSON.
    ///
    /// # Errors
    /// When the history is too short or lacks a channel, the model cannot be a base, or the file cannot be written;
    /// [`NodeError::Interrupted`].
    fn work(&self, cancelled: &AtomicBool, say: &dyn Fn(Stage)) -> Result<String, NodeError> {
        let history_s = format!("{:.1}", total_s(&self.runs));
        tracing::info!(history_s, "close_loop: working on a goal");
        let worked = self.report(cancelled, say);
        if let Err(error) = &worked {
            tracing::warn!("close_loop failed: {error}");
        }
        worked
    }

    fn report(&self, cancelled: &AtomicBool, say: &dyn Fn(Stage)) -> Result<String, NodeError> {
        let started = Instant::now();
        if !self.folder.is_dir() {
            let message =
                "is not a directory, so the model cannot be written; set close_loop.out to a directory"
                    .to_owned();
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
        let result = diagnose::close(&self.base, &runs, &settings, &watch, say).map_err(on_history)?;
        // After this point files are written, so check for cancellation here.
        if cancelled.load(Ordering::Acquire) {
            return Err(NodeError::Interrupted);
        }
        let origin = || TrainingOrigin {
            seed: SEED,
            runs: training_runs(&result, &runs),
            ..TrainingOrigin::default()
        };
        let path = result
            .is_augmented()
            .then(|| {
                write_new(
                    &self.folder,
                    &self.damper,
                    "close",
                    &model_file(&result, &runs, origin())?.to_toml()?,
                )
            })
            .transpose()?;
        let loaded = match (&path, &self.auto_load) {
            (Some(path), Some(auto_load)) => auto_load.load(path, &result.after).map(|()| true),
            _ => Ok(false),
        };
        let file =
            path.as_deref().map_or_else(|| "none".to_owned(), |path: &Path| path.display().to_string());
        match &loaded {
            Ok(is_loaded) => {
                tracing::info!(model_file = file, loaded = is_loaded, "close_loop: {}", in_short(&result));
            }
            Err(why) => {
                tracing::info!(model_file = file, "close_loop: {}; not loaded: {why}", in_short(&result))
            }
        }
        let parts = parts.into_iter();
        let row = |(role, run): (_, Run)| RunRow { role, seconds: run.duration().get(), run: run.name };
        let seconds = started.elapsed().as_secs_f64();
        let drive = drive(&result, &runs);
        let report = GoalReport {
            written: json::ReportDocument::new(
                &result,
                drive,
                SEED,
                seconds,
                parts.map(row),
                path.as_deref(),
            ),
            note: NOTE,
            loaded: *loaded.as_ref().unwrap_or(&false),
            load_error: loaded.err().map(|error| error.to_string()),
            text: report::text(&result, drive),
        };
        Ok(serde_json::to_string(&report).map_err(ActionError::Report)?)
    }

    /// Adds to an error of the diagnosis that its runs come from the history.
    fn on_history(&self, error: mr_damper_model::Error) -> NodeError {
        match error {
            mr_damper_model::Error::Cancelled => NodeError::Interrupted,
            error => ActionError::OnHistory { history_s: total_s(&self.runs), error: Box::new(error) }.into(),
        }
    }
}

impl AutoLoad {
    /// Loads `model` from `path`, unless it includes an effect or a term that belongs to the past, or the diagnosed model has been replaced
    /// meanwhile.
    fn load(&self, path: &Path, model: &Model) -> Result<(), NodeError> {
        check_history(&model.effects, path)?;
        self.control.load_model_over(&path.display().to_string(), &self.running)?;
        self.parameters.announce(&["model".to_owned()]);
        Ok(())
    }
}

/// Refuses `effects` that belong to the history that they were found on: a drift of the load cell, and a term that counts from the start of
/// a run.
fn check_history(effects: &Effects, path: &Path) -> Result<(), RequestError> {
    let path = || path.display().to_string();
    if effects.as_slice().iter().any(|effect| effect.effect() == Effect::LoadCellDrift) {
        return Err(RequestError::IncludesDrift { effect: Effect::LoadCellDrift.id(), path: path() });
    }
    match effects.terms().iter().find(|term| term.kind().1.counts_from_start()) {
        Some(term) => Err(RequestError::IncludesHistory { term: term_title(term), path: path() }),
        None => Ok(()),
    }
}

/// The verdict, and the effects and terms that were found, for the log.
fn in_short(result: &DiagnosisResult) -> String {
    let named = titles(result);
    let named = if named.is_empty() { "no effect named".to_owned() } else { named.join(", ") };
    format!("{}: {named}", result.verdict.name())
}

/// Splits the runs at the times at which their total length reaches each of the [`SHARES`].
fn split(runs: &[Run]) -> Result<Vec<(Role, Run)>, ActionError> {
    /// Minimum length of a piece, s; shorter pieces have no row that counts.
    const LEAST_S: f64 = 0.5;
    /// A split closer to the end of a piece than this, in seconds, is at its end: allows for rounding errors.
    const SAME_S: f64 = 1e-6;
    let total_s = total_s(runs);
    if total_s <= 0.0 {
        return Err(ActionError::EmptyHistory);
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
                // Include the last sample of the run.
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
    use mr_damper_model::effect::EffectModel;
    use mr_damper_model::effect::term::{Argument, Form, Modulator, Term, Terms};
    use mr_damper_model::sample::{Stamp, Trace};

    /// A run at 100 Hz that begins at `from_s` and lasts `seconds`.
    fn run(from_s: i64, seconds: i64) -> Run {
        let stamps: Vec<Stamp> =
            (0..=100 * seconds).map(|k| Stamp::from_nanos(from_s * 1_000_000_000 + k * 10_000_000)).collect();
        let values = vec![0.0; stamps.len()];
        Run { name: format!("at {from_s}"), displacement_m: Trace { stamps, values }, ..Run::default() }
    }

    fn parts(runs: &[Run]) -> Vec<(Role, usize)> {
        split(runs)
            .expect("the history is not empty")
            .iter()
            .map(|(r, run)| (*r, run.displacement_m.len()))
            .collect()
    }

    #[test]
    fn a_drift_or_a_term_that_counts_from_the_start_is_not_loaded_unasked() {
        let refused = |effects: &Effects| check_history(effects, Path::new("/tmp/new.toml")).err();
        let term = |argument| {
            let kind = (Modulator::Force, argument, Form::Linear);
            let term = Term::new(kind, -0.01, &[], [0.0, 30.0]).expect("valid");
            Effects::NONE.with_terms(Terms::new(&[term]).expect("one"))
        };
        for argument in [Argument::Time, Argument::Path, Argument::Energy, Argument::TemperatureRise] {
            let error = refused(&term(argument)).expect("it counts from the start").to_string();
            let title = format!("term (force, {}, linear)", argument.name());
            assert!(error.contains(&title) && error.contains("load_model with /tmp/new.toml"), "{error}");
        }
        assert_eq!(refused(&term(Argument::TimeSinceReversal)), None);
        let drift = EffectModel::new(Effect::LoadCellDrift, &[0.1]).expect("in range");
        let error = refused(&Effects::new(&[drift]).expect("one"));
        assert!(matches!(error, Some(RequestError::IncludesDrift { .. })), "{error:?}");
    }

    #[test]
    fn the_history_is_split_by_time_without_overlap() {
        use Role::{Confirm, Estimate, Test};
        assert_eq!(parts(&[run(0, 100)]), [(Estimate, 6000), (Confirm, 2000), (Test, 2001)]);
        // With a gap: the first piece has 30 s of 100 s.
        let pieces = [run(0, 30), run(50, 70)];
        assert_eq!(parts(&pieces), [(Estimate, 3001), (Estimate, 3000), (Confirm, 2000), (Test, 2001)]);
        // The split is at the gap.
        let pieces = [run(0, 60), run(80, 40)];
        assert_eq!(parts(&pieces), [(Estimate, 6001), (Confirm, 2000), (Test, 2001)]);
        assert!(split(&[]).is_err());
    }
}
