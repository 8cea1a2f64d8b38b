//! The action `design`: designs the run that best tells apart effects that a diagnosis could not, for the running model, and writes it.
//!
//! The question comes with the goal, or from the report of a diagnosis. The run is that of `mr-damper design`.

use super::{ActionContext, ActionError, ActionWork, Job, Step, new_path};
use crate::ros2::answer_limit::{self, Shorten};
use crate::settings::error::{NodeError, RequestError};
use mr_damper_model::diagnose::design::{Limits, Question, Settings, design};
use mr_damper_model::identify::Watch;
use mr_damper_model::model::Model;
use mr_damper_msgs::action::{Design, DesignFeedback, DesignGoal, DesignResult};
use mr_damper_reports::design::{self as report, DesignOutcome};
use mr_damper_reports::open_questions::OpenQuestions;
use mr_damper_runs::{SaveOptions, save};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

/// The action `design`.
pub(super) struct DesignWork {
    context: ActionContext,
}

impl DesignWork {
    /// The action on the running model.
    pub(super) fn new(context: ActionContext) -> Self {
        Self { context }
    }
}

/// Result of a goal.
#[derive(Debug)]
pub(super) struct WrittenRun {
    /// What the run decides, for people.
    message: String,
    path: PathBuf,
    /// The figures as JSON.
    report: String,
}

impl ActionWork for DesignWork {
    type Action = Design;
    type Done = WrittenRun;
    const NAME: &'static str = "design";

    fn prepare(&self, goal: &DesignGoal) -> Result<Job<WrittenRun>, NodeError> {
        let control = &self.context.control;
        let path = if goal.out.is_empty() {
            new_path(&self.context.folder(), &self.context.damper, "design", "csv")
        } else {
            goal.out.clone().into()
        };
        let path = std::path::absolute(path).map_err(NodeError::io("finding the current directory"))?;
        if path.symlink_metadata().is_ok() {
            return Err(RequestError::FileExists { path: path.display().to_string() }.into());
        }
        let work = Planning {
            model: control.models().ok_or(RequestError::NoModel)?.free,
            name: control.models_names().free,
            open: open(goal)?,
            limits: limits(goal)?,
            noise_n: given(goal.noise),
            seed: goal.seed,
            path,
        };
        Ok(Box::new(move |cancelled, say| work.work(cancelled, say)))
    }

    fn feedback(Step { stage, progress }: Step) -> DesignFeedback {
        DesignFeedback { stage, progress }
    }

    const SHORTEN: Option<Shorten<DesignResult>> = Some(answer_limit::short_design);

    fn result(worked: Result<WrittenRun, &NodeError>) -> DesignResult {
        match worked {
            Ok(WrittenRun { message, path, report }) => {
                DesignResult { success: true, message, run_file: path.display().to_string(), report }
            }
            Err(error) => DesignResult { message: error.to_string(), ..DesignResult::default() },
        }
    }
}

/// The question of a goal, from the goal or from the report in it.
fn open(goal: &DesignGoal) -> Result<OpenQuestions, NodeError> {
    if !goal.question.is_empty() {
        return Ok(OpenQuestions::asked(Question::parse(&goal.question)?));
    }
    if goal.report.is_empty() {
        return Err(RequestError::NoQuestion.into());
    }
    OpenQuestions::of_report(&goal.report).map_err(|error| ActionError::OpenQuestions(error).into())
}

/// The number of a goal; `None` for the default, which is 0, or NaN in JSON.
fn given(value: f64) -> Option<f64> {
    (value != 0.0 && !value.is_nan()).then_some(value)
}

/// The limits of a goal.
fn limits(goal: &DesignGoal) -> Result<Limits, NodeError> {
    let usual = Limits::default();
    let has_drive = given(goal.drive_min).or(given(goal.drive_max)).is_some();
    let limits = Limits {
        stroke_m: goal.stroke,
        speed_m_s: goal.speed,
        acceleration_m_s2: given(goal.acceleration).unwrap_or(usual.acceleration_m_s2),
        drive: has_drive.then_some([goal.drive_min, goal.drive_max]),
        duration_s: given(goal.duration).unwrap_or(usual.duration_s),
        rate_hz: given(goal.rate).unwrap_or(usual.rate_hz),
    };
    limits.check()?;
    Ok(limits)
}

/// The work on a goal.
struct Planning {
    model: Model,
    /// Name of the model.
    name: String,
    open: OpenQuestions,
    limits: Limits,
    noise_n: Option<f64>,
    seed: u64,
    /// Place of the run; nothing was there when the goal arrived.
    path: PathBuf,
}

impl Planning {
    fn work(self, cancelled: &AtomicBool, say: &(dyn Fn(Step) + Sync)) -> Result<WrittenRun, NodeError> {
        let groups = self.open.question.to_string();
        tracing::info!("design: working on {groups}");
        let worked = self.design(cancelled, say);
        match &worked {
            Ok(written) => tracing::info!(run = %written.path.display(), "design: a run for {groups}"),
            Err(error) => tracing::warn!("design failed: {error}"),
        }
        worked
    }

    fn design(
        mut self,
        cancelled: &AtomicBool,
        say: &(dyn Fn(Step) + Sync),
    ) -> Result<WrittenRun, NodeError> {
        say(Step { stage: "designing the run".to_owned(), progress: 0.05 });
        let noise_n = self.open.noise(self.noise_n);
        let Self { model, name, open: OpenQuestions { question, mut notes, .. }, limits, seed, path, .. } =
            self;
        notes.extend(report::beyond(&model, &limits));
        let settings = Settings { noise_n, seed, ..Settings::default() };
        let watch = Watch { cancel: Some(cancelled), progress: None };
        let design = design(&model, &question, &limits, &settings, &watch)?;
        say(Step { stage: "writing the run".to_owned(), progress: 0.95 });
        save(&design.run, &path, &SaveOptions::default())?;
        let outcome = DesignOutcome {
            model: name,
            drive: model.force.drive(),
            question,
            limits,
            design,
            run: path.display().to_string(),
            seed,
            notes,
        };
        let report = serde_json::to_string(&report::json(&outcome)).map_err(ActionError::Report)?;
        Ok(WrittenRun { message: report::text(&outcome), path, report })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    fn goal() -> DesignGoal {
        DesignGoal { stroke: 0.02, speed: 0.4, drive_max: 2.0, ..DesignGoal::default() }
    }

    #[test]
    fn zeros_are_the_defaults() {
        let usual = Limits::default();
        let found = limits(&goal()).expect("they fit");
        assert_eq!((found.duration_s, found.rate_hz), (usual.duration_s, usual.rate_hz));
        assert_eq!((found.acceleration_m_s2, found.drive), (usual.acceleration_m_s2, Some([0.0, 2.0])));
        let found = limits(&DesignGoal { drive_max: 0.0, duration: 12.0, ..goal() }).expect("they fit");
        assert_eq!((found.drive, found.duration_s), (None, 12.0));
        let error = limits(&DesignGoal { stroke: 0.0, ..goal() }).expect_err("no stroke").to_string();
        assert!(error.contains("stroke"), "{error}");
    }

    #[test]
    fn a_goal_needs_a_question_or_a_report_that_leaves_one_open() {
        let message = |goal: DesignGoal| open(&goal).expect_err("no question").to_string();
        assert!(message(goal()).contains("question"), "{}", message(goal()));
        let report = DesignGoal { report: "{}".to_owned(), ..goal() };
        assert!(message(report.clone()).contains("report"), "{}", message(report.clone()));
        let unknown = DesignGoal { question: "friction|frition".to_owned(), ..goal() };
        assert!(message(unknown.clone()).contains("frition"), "{}", message(unknown));
        let asked = DesignGoal { question: "friction|gas_spring".to_owned(), ..report };
        assert_eq!(open(&asked).expect("it is asked").question.groups().len(), 1);
    }

    #[test]
    fn a_run_is_written_for_the_question() {
        let dir = tempfile::tempdir().expect("a directory");
        let path = dir.path().join("next.csv");
        let model =
            mr_damper_model::preset::load(mr_damper_model::preset::BEST_FUZZY_TANH).expect("a preset");
        let goal =
            DesignGoal { question: "friction|gas_spring".to_owned(), duration: 12.0, rate: 128.0, ..goal() };
        let work = || Planning {
            model,
            name: "a model".to_owned(),
            open: open(&goal).expect("asked"),
            limits: limits(&goal).expect("they fit"),
            noise_n: Some(2.0),
            seed: 3,
            path: path.clone(),
        };
        let stages = Mutex::new(Vec::new());
        let written = work()
            .work(&AtomicBool::new(false), &|step: Step| stages.lock().expect("open").push(step.stage))
            .expect("a run");
        assert_eq!(stages.into_inner().expect("open"), ["designing the run", "writing the run"]);
        let report: serde_json::Value = serde_json::from_str(&written.report).expect("JSON");
        assert_eq!(report["schema"], "mr-damper/design/1");
        assert_eq!(report["run"], path.display().to_string());
        assert!(written.message.contains("friction"), "{}", written.message);
        let run = std::fs::read_to_string(&path).expect("it is there");
        assert!(run.lines().count() > 12 * 128, "{} lines", run.lines().count());
        let cancelled = work().work(&AtomicBool::new(true), &|_| ()).expect_err("cancelled");
        assert!(matches!(cancelled, NodeError::Interrupted), "{cancelled}");
    }
}
