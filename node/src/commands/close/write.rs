//! Output of a diagnosis: model file, JSON, report, text.

use super::RecordedArgs;
use super::base::Identified;
use super::roles::{self, Given};
use crate::commands::context::CliContext;
use crate::commands::output::OutputArgs;
use crate::commands::targets::{self, Target};
use crate::settings::error::NodeError;
use mr_damper_base::provenance::TOOL;
use mr_damper_model::diagnose::{DiagnosisResult, Runs};
use mr_damper_model::model_file::{Role, TrainingRun};
use mr_damper_reports::augmented_file::{self, TrainingOrigin};
use mr_damper_reports::diagnosis::{self as report, json};
use mr_damper_runs::write_text;
use serde::Serialize;
use std::path::Path;

/// The result of a diagnosis and its inputs.
pub(super) struct Done<'a> {
    pub(super) result: DiagnosisResult,
    pub(super) base: Identified,
    pub(super) runs: Runs<'a>,
    pub(super) given: &'a [Given],
    pub(super) seconds: f64,
}

#[derive(Debug, Serialize)]
struct RunRow<'a> {
    role: Role,
    run: String,
    sha256: &'a str,
}

/// Checks, before the work starts, that the output files can be written and overwrite no input.
///
/// # Errors
/// When a folder does not exist, or an input would be overwritten.
pub(super) fn check_targets(args: &RecordedArgs, output: &OutputArgs) -> Result<(), NodeError> {
    let inputs = roles::paths(args).into_iter().map(|(_, path)| path).chain([Path::new(&args.base)]);
    targets::check(inputs, std::iter::once(Target::new("--out", &args.out)).chain(output.targets()))?;
    for target in std::iter::once(args.out.as_path()).chain(output.files()) {
        let folder = target.parent().filter(|folder| !folder.as_os_str().is_empty());
        if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
            return Err(NodeError::File {
                path: target.to_owned(),
                message: format!(
                    "cannot be written: there is no folder {}; create it first",
                    folder.display()
                ),
            });
        }
    }
    Ok(())
}

/// Writes the model file, the report, the JSON and the text, as requested.
///
/// # Errors
/// When a file cannot be written; [`NodeError::Interrupted`].
pub(super) fn all(
    args: &RecordedArgs,
    output: &OutputArgs,
    done: &Done<'_>,
    context: &CliContext,
) -> Result<(), NodeError> {
    if context.interrupt.is_raised() {
        return Err(NodeError::Interrupted);
    }
    let found = done.result.is_augmented();
    let written = found.then(|| model_file(args, done)).transpose();
    output.page(|| Ok(report::html(&outcome(args, done, context)?)))?;
    let drive = augmented_file::drive(&done.result, &done.runs);
    let runs = done.given.iter().map(run_row);
    let path = (found && written.is_ok()).then_some(args.out.as_path());
    let document = json::ReportDocument::new(&done.result, drive, args.seed, done.seconds, runs, path);
    output.figures(&document, || report::text(&done.result, drive) + &ending(args, done, path.is_some()))?;
    written.map(|_| ())
}

/// Writes the model file. If it cannot be written, the report still is.
fn model_file(args: &RecordedArgs, done: &Done<'_>) -> Result<(), NodeError> {
    let origin = TrainingOrigin { seed: args.seed, restarts: done.base.restarts, runs: training_runs(done) };
    let file = augmented_file::model_file(&done.result, &done.runs, origin)?;
    Ok(write_text(&args.out, &file.to_toml()?)?)
}

/// The content of the report. It shows the test runs; without test runs it shows the validation runs.
fn outcome<'a>(
    args: &RecordedArgs,
    done: &'a Done<'_>,
    context: &CliContext,
) -> Result<report::DiagnosisOutcome<'a>, NodeError> {
    let runs = &done.runs;
    let pictured = if runs.test.is_empty() { runs.confirm } else { runs.test };
    let mut traces = Vec::with_capacity(pictured.len());
    for data in pictured {
        if context.interrupt.is_raised() {
            return Err(NodeError::Interrupted);
        }
        traces.push(report::RunTrace::of(&done.result, data, runs.reference));
    }
    let count = |role: Role| done.given.iter().filter(|given| given.role == role).count();
    let row = |name: &str, value: String| (name.to_owned(), value);
    let mut provenance = vec![
        row("made by", TOOL.to_owned()),
        row("base", format!("{}, {}", done.base.source, done.result.before.force.name())),
        row("seed", args.seed.to_string()),
        row("time", format!("{:.1} s", done.seconds)),
    ];
    provenance.extend(done.given.iter().map(|given| {
        row(role_in_words(given.role), format!("{}, SHA-256 {}", given.path.display(), given.sha256))
    }));
    Ok(report::DiagnosisOutcome {
        what: format!(
            "Effects that the base model ({}) lacks. Training runs: {}, validation runs: {}, test runs: {}.",
            done.base.source,
            count(Role::Estimate),
            count(Role::Confirm),
            count(Role::Test)
        ),
        result: &done.result,
        drive: augmented_file::drive(&done.result, &done.runs),
        traces,
        provenance,
    })
}

const fn role_in_words(role: Role) -> &'static str {
    match role {
        Role::Base => "training run of the base",
        Role::Estimate => "training run",
        Role::Confirm => "validation run",
        Role::Test => "test run",
        Role::Validate => "validation run of the base",
        Role::Reference => "reference run",
        Role::Replicate => "replicate",
        Role::Healthy => "healthy run",
    }
}

/// Lines on the model file that was written and on the time taken.
fn ending(args: &RecordedArgs, done: &Done<'_>, is_written: bool) -> String {
    let out = args.out.display();
    let model = match (is_written, done.result.is_augmented(), args.out.exists()) {
        (true, ..) => format!("model file: {out}"),
        (false, true, _) => "no model file is written".to_owned(),
        (false, false, true) => format!("no effect was found: no model file is written, {out} is unchanged"),
        (false, false, false) => "no effect was found: no model file is written".to_owned(),
    };
    format!("\n{model}\n{:.1} s\n", done.seconds)
}

fn run_row(given: &Given) -> RunRow<'_> {
    RunRow { role: given.role, run: given.path.display().to_string(), sha256: &given.sha256 }
}

/// All runs of this diagnosis, then the runs of the base that are not among them.
fn training_runs(done: &Done<'_>) -> Vec<TrainingRun> {
    let own =
        done.given.iter().zip(augmented_file::training_runs(&done.result, &done.runs)).map(|(given, run)| {
            TrainingRun { name: given.path.display().to_string(), sha256: given.sha256.clone(), ..run }
        });
    let known = |run: &&TrainingRun| done.given.iter().all(|given| given.sha256 != run.sha256);
    let before = done.base.runs.iter().filter(known);
    own.chain(before.map(|run| TrainingRun { role: Some(Role::Base), ..run.clone() })).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::close::Args;
    use crate::estimation::models;
    use crate::settings::config::RosArgs;
    use crate::settings::interrupt::Interrupt;
    use clap::Parser;
    use mr_damper_model::diagnose::discover::{Claim, Discovery, FoundTerm};
    use mr_damper_model::diagnose::{DiagnosisMode, FloorSource, NoiseFloor, RemainingError, Verdict};
    use mr_damper_model::effect::Effects;
    use mr_damper_model::effect::term::{Argument, Form, Modulator, Term, Terms};
    use mr_damper_model::model::Model;
    use mr_damper_model::preset;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        args: Args,
    }

    /// A diagnosis that found no effect of the library, and these terms.
    fn diagnosis(before: Model, terms: &[Term]) -> DiagnosisResult {
        let found = |term: &Term| FoundTerm {
            term: *term,
            claim: Claim::Effect { on_healthy: None },
            class: Vec::new(),
            p: 0.002,
            confirmed: 0.6,
            ci95: Vec::new(),
            curve: Vec::new(),
        };
        let discovery = Discovery { terms: terms.iter().map(found).collect(), ..Discovery::default() };
        DiagnosisResult {
            mode: DiagnosisMode::Absolute,
            verdict: Verdict::PartlyExplained,
            base_fault: None,
            noise_floor: NoiseFloor { source: FloorSource::Declared, rsse_n: 5.0, esr: 1.6e-4 },
            effects: Vec::new(),
            refused: Vec::new(),
            untestable: Vec::new(),
            candidates: Vec::new(),
            blocks: 30,
            searched: None,
            confirm: Vec::new(),
            test: None,
            remaining: RemainingError { lof: 0.1, lof_before: 0.9, share: 0.3, correlates_with: Vec::new() },
            after: Model {
                effects: Effects::NONE.with_terms(Terms::new(terms).expect("few enough")),
                ..before
            },
            before,
            discovery,
            structures: Vec::new(),
            alignments: Vec::new(),
            mean_shift: None,
            swept: None,
        }
    }

    #[test]
    fn a_term_without_an_effect_is_written_to_the_model_file_and_read_back() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let [out, json] = ["new.toml", "new.json"].map(|name| dir.path().join(name));
        let write = |terms: &[Term]| {
            let flags = ["close", "--estimate", "a.csv", "--confirm", "b.csv", "--out"].map(Path::new);
            let line = flags.into_iter().chain([out.as_path(), Path::new("--json"), json.as_path()]);
            let Args { output, recorded, .. } = Line::try_parse_from(line).expect("valid flags").args;
            let recorded = recorded.expect("recorded runs");
            assert_eq!(recorded.terms, 3, "the default");
            let model = preset::load(preset::BEST_FUZZY_TANH).expect("a preset");
            let done = Done {
                result: diagnosis(model, terms),
                base: Identified { model, source: "a preset".to_owned(), runs: Vec::new(), restarts: 0 },
                runs: Runs::default(),
                given: &[],
                seconds: 1.0,
            };
            let context = CliContext {
                interrupt: Interrupt::manual(),
                quiet: true,
                ros_args: RosArgs::default(),
                progress: None,
            };
            all(&recorded, &output, &done, &context).expect("it is written");
            let text = std::fs::read_to_string(&json).expect("JSON");
            let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
            (done.result.after.effects, json)
        };
        let (_, json) = write(&[]);
        assert!(!out.exists() && json["model_file"].is_null(), "{json:#}");

        let kind = (Modulator::Force, Argument::Time, Form::Step);
        let (effects, json) = write(&[Term::new(kind, -0.126, &[11.5, 0.05], [0.0, 30.0]).expect("valid")]);
        assert_eq!(models::load_file(&out).expect("a model file").model.effects, effects);
        assert_eq!(json["model_file"], out.display().to_string());
        assert_eq!(
            (&json["terms"][0]["argument"], &json["effects"]),
            (&"time".into(), &serde_json::json!([]))
        );
    }
}
