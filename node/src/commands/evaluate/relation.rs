//! `mr-damper evaluate` of a published relation p, which is no model: how well it explains measured force.
//!
//! Runs are conditioned as in the thesis, and the rows in which the damper moves count, as in its identification.

use super::{Args, row};
use crate::commands::context::CliContext;
use crate::commands::output;
use crate::commands::units::Units;
use crate::settings::error::NodeError;
use mr_damper_base::shown;
use mr_damper_model::condition::Conditioning;
use mr_damper_model::force::Phase;
use mr_damper_model::identify::{Dataset, DatasetOptions, PhaseOptions, score_phase};
use mr_damper_model::metrics::Fit;
use mr_damper_model::preset;
use serde::Serialize;

#[derive(Debug, Serialize)]
struct Report<'a> {
    schema: &'static str,
    model: &'a str,
    runs: Vec<ExplainedRun>,
}

/// How well the relation holds on a run; `None` if no row has force readings on both sides.
#[derive(Debug, Serialize)]
struct ExplainedRun {
    run: String,
    same_instant: Option<Fit>,
}

/// The relation called `name`, if it is one.
pub(super) fn named(name: &str) -> Option<Phase> {
    preset::phase(name).ok()
}

/// Prints how well `relation` holds on each run.
///
/// # Errors
/// When a run does not load, or has no measured force or not the drive of the relation; for `--calibrate`, because the relation is not a
/// model that could be written.
pub(super) fn run(args: &Args, relation: &Phase, context: &CliContext) -> Result<(), NodeError> {
    if args.calibrate.is_some() {
        preset::load(&args.model)?;
    }
    let options = PhaseOptions { drive: relation.drive(), ..PhaseOptions::default() };
    let mut runs = Vec::with_capacity(args.runs.len());
    for path in &args.runs {
        if context.interrupt.is_raised() {
            return Err(NodeError::Interrupted);
        }
        let loaded = args.load.load(path)?;
        let data = Dataset::from_run(&loaded.run, &Conditioning::THESIS, &DatasetOptions::default())?;
        let same_instant = score_phase(relation, &data, &options)?;
        runs.push(ExplainedRun { run: path.display().to_string(), same_instant });
    }
    let report = Report { schema: "mr-damper/evaluate/1", model: &args.model, runs };
    match &args.json {
        Some(path) => output::json(path, &report)?,
        None => print!("{}", shown::lines(&table(&report, args.units.units))),
    }
    Ok(())
}

fn table(report: &Report<'_>, units: Units) -> String {
    let mut text = format!("{}: not a prediction, it explains each measured force by itself\n", report.model);
    for ExplainedRun { run, same_instant } in &report.runs {
        text += &format!("\n{}\n", shown::line(run));
        text += &row("same instant", *same_instant, units);
        if same_instant.is_none() {
            text += "  no counted row has force readings on both sides\n";
        }
    }
    text
}
