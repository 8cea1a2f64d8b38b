//! The commands as functions: their arguments are the words of the command line, their runs are in memory.

use crate::arguments::parse;
use crate::model::Model;
use crate::run::Run;
use crate::work;
use mr_damper_model::sample::Run as Recorded;
use mr_damper_node::NodeError;
use mr_damper_node::commands::output::{Kept, KeptOutput, OutputArgs, json_text};
use mr_damper_node::commands::run_args::RunArgs;
use mr_damper_node::commands::{close as closing, compare as comparing, evaluate as evaluating};
use mr_damper_node::commands::{identify as identifying, simulate as simulating};
use mr_damper_node::estimation::models;
use mr_damper_runs::Loaded;
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// An identified model with its figures and the runs, which its report shows.
#[pyclass(frozen, module = "mr_damper._native")]
pub(crate) struct Identification {
    found: identifying::Identification,
    runs: Vec<Recorded>,
    held_out: Vec<Recorded>,
}

#[pymethods]
impl Identification {
    #[getter]
    fn model(&self) -> Model {
        Model(Arc::new(self.found.file.clone()))
    }

    /// The figures in the schema `mr-damper/identify/1`.
    fn to_json(&self, py: Python<'_>) -> PyResult<String> {
        json_text(&self.found.report()).map_err(|error| crate::error::exception(py, &error))
    }

    /// Sentences that a user should know before using the model.
    #[getter]
    fn remarks(&self) -> Vec<String> {
        self.found.remarks()
    }

    /// The report with plots.
    fn html(&self, py: Python<'_>) -> PyResult<String> {
        work::run(py, None, |_| self.found.page(&self.runs, &self.held_out))
    }
}

/// Identifies the model of `--model` in `words` from `runs`.
#[pyfunction]
pub(crate) fn identify(
    py: Python<'_>,
    words: Vec<String>,
    runs: Vec<Bound<'_, Run>>,
    validate: Vec<Bound<'_, Run>>,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<Identification> {
    let (runs, held_out) = (loaded(&runs), loaded(&validate));
    work::run(py, progress.as_ref(), |context| {
        // The parser asks for the paths of a run and of the model file. Neither is used.
        let words: Vec<String> = words.into_iter().chain(["--out=-".into(), "-".into()]).collect();
        let args: identifying::Args = parse(&words)?;
        let spec = identifying::spec(&args)?;
        let hashed = |runs: &[Arc<Loaded>]| -> (Vec<Recorded>, Vec<String>) {
            runs.iter().map(|run| (run.run.clone(), run.sha256_hex())).unzip()
        };
        let ((runs, hashes), (held_out, held_out_hashes)) = (hashed(&runs), hashed(&held_out));
        let found = identifying::Identification::of(
            spec,
            (&runs, &hashes),
            (&held_out, &held_out_hashes),
            &args,
            context,
        )?;
        Ok(Identification { found, runs, held_out })
    })
}

/// The figures of `model` on `runs` in the schema `mr-damper/evaluate/1`.
#[pyfunction]
pub(crate) fn evaluate(
    py: Python<'_>,
    model: &Model,
    name: &str,
    runs: Vec<Bound<'_, Run>>,
) -> PyResult<String> {
    let (runs, file) = (loaded(&runs), &model.0);
    work::run(py, None, |context| {
        let figures = |run: &Arc<Loaded>| {
            if context.interrupt.is_raised() {
                return Err(NodeError::Interrupted);
            }
            evaluating::EvaluatedRun::of(run.run.name.clone(), file, run)
        };
        let rows = runs.iter().map(figures).collect::<Result<Vec<_>, _>>()?;
        json_text(&evaluating::Report::of(name, rows))
    })
}

/// Diagnoses the base of `--base` in `words`, or `base` in its place, on the runs of each role (`estimate`, `confirm`, ...). Returns the
/// JSON, the report, the text, and the augmented model if an effect was found.
#[pyfunction]
pub(crate) fn close(
    py: Python<'_>,
    words: Vec<String>,
    base: Option<&Model>,
    runs: Vec<(String, Vec<Bound<'_, Run>>)>,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<(String, String, String, Option<Model>)> {
    let roles: Vec<(String, Vec<Arc<Loaded>>)> =
        runs.iter().map(|(role, runs)| (role.clone(), loaded(runs))).collect();
    work::run(py, progress.as_ref(), |context| {
        let dir = tempfile::tempdir().map_err(NodeError::io("creating a temporary directory"))?;
        let out = dir.path().join("model.toml");
        let mut words = words;
        words.push(format!("--out={}", out.display()));
        if let Some(base) = base {
            let path = dir.path().join("base.toml");
            mr_damper_runs::write_text(&path, &base.0.to_toml()?)?;
            words.push(format!("--base={}", path.display()));
        }
        let mut held = Held::default();
        for (role, runs) in roles {
            words.extend(runs.into_iter().map(|run| format!("--{role}={}", held.add(run).display())));
        }
        let mut args: closing::Args = parse(&words)?;
        let kept = keep(&mut args.output);
        if let Some(recorded) = &mut args.recorded {
            held.hand_to(&mut recorded.load);
        }
        closing::run(&args, context)?;
        let KeptOutput { html, json, text } = kept.take();
        let model = out.exists().then(|| models::load_file(&out)).transpose()?;
        let model = model.map(|file| Model(Arc::new(file)));
        Ok((json.unwrap_or_default(), html.unwrap_or_default(), text.unwrap_or_default(), model))
    })
}

/// Compares the models in `words` on `train` and `test`, or on the folder in `words`. Returns the JSON, the report and the text.
#[pyfunction]
pub(crate) fn compare(
    py: Python<'_>,
    words: Vec<String>,
    train: Vec<Bound<'_, Run>>,
    test: Vec<Bound<'_, Run>>,
    progress: Option<Bound<'_, PyAny>>,
) -> PyResult<(String, String, String)> {
    let roles = [("train", loaded(&train)), ("test", loaded(&test))];
    work::run(py, progress.as_ref(), |context| {
        let dir = tempfile::tempdir().map_err(NodeError::io("creating a temporary directory"))?;
        let mut words = words;
        // `--pictures` needs a report. The report is kept in memory.
        words.push("--report=-".to_owned());
        if !words.iter().any(|word| word.starts_with("--resume")) {
            words.push(format!("--resume={}", dir.path().join("cells.jsonl").display()));
        }
        let mut held = Held::default();
        for (role, runs) in roles {
            words.extend(runs.into_iter().map(|run| format!("--{role}={}", held.add(run).display())));
        }
        let mut args: comparing::Args = parse(&words)?;
        let kept = keep(&mut args.output);
        held.hand_to(&mut args.load);
        comparing::run(&args, context)?;
        let KeptOutput { html, json, text } = kept.take();
        Ok((json.unwrap_or_default(), html.unwrap_or_default(), text.unwrap_or_default()))
    })
}

/// The runs of the virtual rig that `words` ask for.
#[pyfunction]
pub(crate) fn simulate(py: Python<'_>, words: Vec<String>) -> PyResult<Vec<Run>> {
    work::run(py, None, |context| {
        // The parser asks for a folder, which is not used.
        let words: Vec<String> = words.into_iter().chain(["--out=-".into()]).collect();
        let runs = simulating::runs(&parse(&words)?, &context.interrupt)?;
        let run = |run| Ok(Run::of(mr_damper_runs::of_run(run, Vec::new())?));
        runs.into_iter().map(run).collect()
    })
}

fn loaded(runs: &[Bound<'_, Run>]) -> Vec<Arc<Loaded>> {
    runs.iter().map(|run| Arc::clone(&run.get().0)).collect()
}

/// Keeps the output of a command in memory.
fn keep(output: &mut OutputArgs) -> Kept {
    let kept = Kept::default();
    output.kept = Some(kept.clone());
    kept
}

/// Runs under names that are different from each other.
#[derive(Default)]
struct Held(Vec<(PathBuf, Arc<Loaded>)>);

impl Held {
    /// Adds a run under its own name, with a number if that is taken, and returns the name.
    fn add(&mut self, run: Arc<Loaded>) -> PathBuf {
        let own = &run.run.name;
        let numbered = (2..).map(|number| PathBuf::from(format!("{own} ({number})")));
        let mut names = std::iter::once(PathBuf::from(own)).chain(numbered);
        let name = names.find(|name| !self.has(name)).unwrap_or_default();
        self.0.push((name.clone(), run));
        name
    }

    fn has(&self, name: &Path) -> bool {
        self.0.iter().any(|(other, _)| other == name)
    }

    fn hand_to(self, load: &mut RunArgs) {
        load.held = self.0;
    }
}
