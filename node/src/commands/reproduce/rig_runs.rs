//! The runs: of the virtual rig, or recorded ones.

use super::first_paper::PaperRun;
use crate::commands::compare::bar;
use crate::commands::compare::runs::{self, Source};
use crate::commands::compare::work::{in_parallel, threads};
use crate::commands::context::CliContext;
use crate::commands::run_args::RunArgs;
use crate::commands::simulate::{Job, Selection, rig_jobs};
use crate::settings::error::{NodeError, PartError};
use mr_damper_model::compare::{Experiment, Replicate};
use mr_damper_model::identify::{Dataset, Options};
use mr_damper_model::rig;
use std::path::{Path, PathBuf};

/// The recorded runs lack an experiment.
#[derive(Debug, thiserror::Error)]
#[error(
    "{} has no runs of {}: the runs of each experiment must be named like rp-icps-01.csv; without --runs they are simulated",
    dir.display(), missing.join(", ")
)]
struct MissingExperiments {
    dir: PathBuf,
    missing: Vec<&'static str>,
}

impl PartError for MissingExperiments {}

/// The thesis' experiments among the runs in `dir`, in the order of the thesis.
pub(super) fn recorded(
    dir: &Path,
    options: &Options,
    context: &CliContext,
) -> Result<(Vec<Experiment>, Vec<Source>), NodeError> {
    let mut planned = runs::discover(dir)?;
    planned.retain(|plan| rig::Experiment::names().any(|name| name == plan.name));
    let missing: Vec<&str> =
        rig::Experiment::names().filter(|name| !planned.iter().any(|plan| plan.name == *name)).collect();
    if !missing.is_empty() {
        return Err(MissingExperiments { dir: dir.to_owned(), missing }.into());
    }
    let files: usize = planned.iter().map(|plan| plan.replicates.len()).sum();
    let bar = bar(context, files, "reading runs [{bar:40}] {pos}/{len}");
    let found = runs::load(
        &planned,
        &RunArgs::default(),
        (&options.conditioning, &options.dataset),
        threads(),
        (context.interrupt.flag(), &|| bar.inc(1)),
    );
    bar.finish_and_clear();
    found
}

/// The 43 runs of the thesis' experiments, from the rig.
pub(super) fn of_thesis(
    seed: u64,
    duration_s: Option<f64>,
    options: &Options,
    context: &CliContext,
) -> Result<(Vec<Experiment>, Vec<Source>), NodeError> {
    let jobs = rig_jobs(&Selection::Thesis, seed, duration_s)?;
    let rows = conditioned(&jobs, options, context)?;
    let mut experiments: Vec<Experiment> = Vec::new();
    let mut sources = Vec::new();
    for (job, data) in jobs.iter().zip(rows) {
        let (name, number) = (job.experiment.name.clone(), job.replicate());
        // The rig's runs follow from these.
        let sha256 = format!("rig, seed {seed}, {} s", job.experiment.duration_s);
        sources.push(Source { experiment: name.clone(), replicate: number, sha256 });
        if experiments.last().is_none_or(|last| last.name != name) {
            experiments.push(Experiment { name, replicates: Vec::new(), training: 1, held_out: Vec::new() });
        }
        if let Some(last) = experiments.last_mut() {
            last.replicates.push(Replicate { number, data });
        }
    }
    Ok((experiments, sources))
}

/// The runs of the first paper's experiments, from the rig.
pub(super) fn of_first_paper(
    seed: u64,
    duration_s: Option<f64>,
    options: &Options,
    context: &CliContext,
) -> Result<Vec<PaperRun>, NodeError> {
    let jobs = rig_jobs(&Selection::Paper1, seed, duration_s)?;
    let rows = conditioned(&jobs, options, context)?;
    let number = |job: &Job| {
        rig::Experiment::paper1_names()
            .position(|name| name == job.experiment.name)
            .map_or(0, |place| place + 1)
    };
    Ok(jobs.iter().zip(rows).map(|(job, data)| PaperRun { experiment: number(job), data }).collect())
}

/// The rows of each job's run.
fn conditioned(jobs: &[Job], options: &Options, context: &CliContext) -> Result<Vec<Dataset>, NodeError> {
    let bar = bar(context, jobs.len(), "simulating the runs [{bar:40}] {pos}/{len}");
    let one = |index: usize| -> Result<Dataset, NodeError> {
        let run = jobs[index].record(&context.interrupt, &mut |_| ()).ok_or(NodeError::Interrupted)?;
        let mut data = Dataset::from_run(&run, &options.conditioning, &options.dataset)?;
        data.rows.shrink_to_fit();
        bar.inc(1);
        Ok(data)
    };
    let rows = in_parallel(jobs.len(), threads(), one).into_iter().collect();
    bar.finish_and_clear();
    rows
}
