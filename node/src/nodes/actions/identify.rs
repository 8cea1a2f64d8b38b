//! The action `identify`: fits a model of a given kind to the service's history, and writes the model file.
//!
//! The model is fitted to the first four fifths of the history. Its error on the last fifth, which is held out, becomes the expected
//! error in the file. Parts of one session are not independent, so `mr-damper identify` on separately recorded runs proves more. The
//! model is not loaded; use `load_model` for that.

use super::{ActionContext, ActionError, ActionWork, Job, Step, create, total_s, write_new};
use crate::settings::error::{NodeError, RequestError};
use mr_damper_base::provenance::{TOOL, date, expect};
use mr_damper_base::shown;
use mr_damper_model::evaluate::{Evaluator, evaluate_into};
use mr_damper_model::identify::{Form, Identified, ModelSpec, Options, Progress, Watch, identify};
use mr_damper_model::model_file::{ModelFile, Provenance, Role, TrainingRun};
use mr_damper_model::pipeline::Settings;
use mr_damper_model::sample::Run;
use mr_damper_msgs::action::{Identify, IdentifyFeedback, IdentifyGoal, IdentifyResult};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

/// Share of the history, by time, that the model is fitted to.
const FITTED: f64 = 0.8;
/// Minimum duration of motion to identify a model, s.
const LEAST_S: f64 = 5.0;

/// The action `identify`.
pub(super) struct IdentifyWork {
    context: ActionContext,
}

impl IdentifyWork {
    /// The action on the service's history.
    pub(super) fn new(context: ActionContext) -> Self {
        Self { context }
    }
}

/// Result of a goal.
#[derive(Debug)]
pub(super) struct WrittenModel {
    /// Message for people.
    message: String,
    path: PathBuf,
}

impl ActionWork for IdentifyWork {
    type Action = Identify;
    type Done = WrittenModel;
    const NAME: &'static str = "identify";

    fn prepare(&self, goal: &IdentifyGoal) -> Result<Job<WrittenModel>, NodeError> {
        let spec = ModelSpec::named(&goal.model, Form::SemiActive)?;
        let runs = self.context.runs(goal.history)?;
        let out = if goal.out.is_empty() {
            Out::New(self.context.folder(), self.context.damper.clone())
        } else if Path::new(&goal.out).exists() {
            return Err(RequestError::FileExists { path: goal.out.clone() }.into());
        } else {
            Out::At(goal.out.clone().into())
        };
        let fit = Fitting { spec, runs, out };
        Ok(Box::new(move |cancelled, say| fit.work(cancelled, say)))
    }

    fn feedback(Step { stage, progress }: Step) -> IdentifyFeedback {
        IdentifyFeedback { stage, progress }
    }

    fn result(worked: Result<WrittenModel, &NodeError>) -> IdentifyResult {
        match worked {
            Ok(WrittenModel { message, path }) => {
                IdentifyResult { success: true, message, model_file: path.display().to_string() }
            }
            Err(error) => {
                IdentifyResult { success: false, message: error.to_string(), model_file: String::new() }
            }
        }
    }
}

/// Place of the model file.
enum Out {
    /// In this directory, under a new name with this damper's name.
    New(PathBuf, String),
    /// At this path.
    At(PathBuf),
}

/// The work on a goal.
struct Fitting {
    spec: ModelSpec,
    /// The history, oldest first.
    runs: Vec<Run>,
    out: Out,
}

impl Fitting {
    fn work(&self, cancelled: &AtomicBool, say: &(dyn Fn(Step) + Sync)) -> Result<WrittenModel, NodeError> {
        let history_s = total_s(&self.runs);
        tracing::info!(history_s, "identify: working on a goal");
        let worked = self.fit(history_s, cancelled, say);
        match &worked {
            Ok(written) => {
                tracing::info!(model_file = %written.path.display(), "identify: {}", written.message)
            }
            Err(error) => tracing::warn!("identify failed: {error}"),
        }
        worked
    }

    fn fit(
        &self,
        history_s: f64,
        cancelled: &AtomicBool,
        say: &(dyn Fn(Step) + Sync),
    ) -> Result<WrittenModel, NodeError> {
        if history_s < LEAST_S {
            return Err(ActionError::ShortHistory { history_s, least_s: LEAST_S }.into());
        }
        let (fitted, held_out) = split(&self.runs, FITTED * history_s);
        // Restarts end on several threads in any order; report only increasing progress.
        let behind = Mutex::new(-1.0);
        let progress = |progress: Progress| {
            let step = in_words(progress);
            let mut behind = behind.lock().unwrap_or_else(PoisonError::into_inner);
            if step.progress > *behind {
                *behind = step.progress;
                say(step);
            }
        };
        // Form, filter and velocity are the defaults of the command `identify`.
        let options = Options::default();
        let watch = Watch { cancel: Some(cancelled), progress: Some(&progress) };
        let found = identify(self.spec, &fitted, &options, &watch)?;
        say(Step { stage: "scoring the held-out part".to_owned(), progress: 0.95 });
        self.write(found, &fitted, &held_out, &options, cancelled)
    }

    fn write(
        &self,
        mut found: Identified,
        fitted: &[Run],
        held_out: &[Run],
        options: &Options,
        cancelled: &AtomicBool,
    ) -> Result<WrittenModel, NodeError> {
        let mut evaluator = Evaluator::default();
        for run in held_out {
            evaluate_into(&mut evaluator, found.model, run, Settings::default(), |_| {
                !cancelled.load(Ordering::Acquire)
            })?;
        }
        if cancelled.load(Ordering::Acquire) {
            return Err(NodeError::Interrupted);
        }
        let scored = evaluator.finish();
        expect(&mut found.model.expected, &scored);
        let row = |role: Role| move |run: &Run| TrainingRun::of(run, role);
        let provenance = Provenance {
            tool: TOOL.to_owned(),
            date: date(),
            seed: options.seed,
            restarts: options.restarts,
            rank: found.rank.and_then(|rank| u32::try_from(rank).ok()),
            weak_prior: found.without_prior.is_some(),
            runs: fitted
                .iter()
                .map(row(Role::Estimate))
                .chain(held_out.iter().map(row(Role::Test)))
                .collect(),
            training_free_run: found.free_run,
            training_one_step: found.one_step,
            validation_free_run: scored.free_run,
            validation_one_step: scored.one_step,
            persistence: scored.persistence,
        };
        let text = ModelFile { model: found.model, provenance }.to_toml()?;
        let path = match &self.out {
            Out::New(folder, damper) => write_new(folder, damper, found.model.force.name(), &text)?,
            Out::At(path) => create(path, &text)?,
        };
        let figure = |what: &str, fit: Option<mr_damper_model::metrics::Fit>| {
            fit.map(|fit| format!("; {what} RMSE {:.2} N, NMSE {:.4}", fit.rsse_n, fit.esr))
                .unwrap_or_default()
        };
        let warnings: String = found.warnings.iter().map(|warning| format!("; {warning}")).collect();
        let message = format!(
            "{}, {} parameters, fitted to {:.0} s of history{}{}{}{}{warnings}",
            found.model.force.name(),
            found.model.force.parameter_count(),
            total_s(fitted),
            figure("training, simulation (free run)", found.free_run),
            figure("held out, simulation (free run)", scored.free_run),
            figure("held out, one-step-ahead prediction", scored.one_step),
            figure("held out, persistence (one step)", scored.persistence),
        );
        Ok(WrittenModel { message, path })
    }
}

/// Splits `runs` into the part before `until_s` seconds of motion and the rest. Empty pieces are left out.
fn split(runs: &[Run], until_s: f64) -> (Vec<Run>, Vec<Run>) {
    let (mut before, mut after) = (Vec::new(), Vec::new());
    let mut begun_s = 0.0;
    for run in runs {
        let Some((first, last)) = run.displacement_m.stamps.first().zip(run.displacement_m.stamps.last())
        else {
            continue;
        };
        let cut = first.shifted(((until_s - begun_s) * 1e9) as i64);
        begun_s += run.duration().get();
        let end = last.shifted(1);
        if cut > *first {
            before.push(run.between(*first, cut.min(end)));
        }
        if cut < *last {
            after.push(run.between(cut.max(*first), end));
        }
    }
    (before, after)
}

/// The current stage, as text and share of the work.
fn in_words(progress: Progress) -> Step {
    let share = |done: u32, of: u32| done as f32 / of.max(1) as f32;
    let (stage, progress) = match progress {
        Progress::Conditioning { runs } => (format!("conditioning {}", shown::count(runs, "run")), 0.0),
        Progress::Restart { done, of } => (format!("restart {done} of {of}"), 0.05 + 0.6 * share(done, of)),
        Progress::Epoch { done, of } => (format!("epoch {done} of {of}"), 0.05 + 0.6 * share(done, of)),
        Progress::Polish { done, of } => (format!("finish {done} of {of}"), 0.65 + 0.3 * share(done, of)),
    };
    Step { stage, progress }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_model::sample::{Stamp, Trace};

    #[test]
    fn the_history_is_split_by_time() {
        let at = |from_s: i64, samples: i64| {
            let stamps: Vec<_> =
                (0..samples).map(|k| Stamp::from_nanos(from_s * 1_000_000_000 + k * 10_000_000)).collect();
            let values = vec![0.0; stamps.len()];
            Run { displacement_m: Trace { stamps, values }, ..Run::default() }
        };
        let lengths = |runs: &[Run]| runs.iter().map(|run| run.displacement_m.len()).collect::<Vec<_>>();
        let (before, after) = split(&[at(0, 1001), at(20, 1001)], 8.0);
        assert_eq!((lengths(&before), lengths(&after)), (vec![800], vec![201, 1001]));
        let (before, after) = split(&[at(0, 1001), at(20, 1001)], 16.0);
        assert_eq!((lengths(&before), lengths(&after)), (vec![1001, 600], vec![401]));
    }
}
