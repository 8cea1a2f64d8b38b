//! Output of a comparison: JSON, the report, tables on the terminal.

use super::state::FinishedCell;
use super::{Args, ComparisonPlan, pictures, tables};
use crate::commands::conditioning::velocity_text;
use crate::settings::error::NodeError;
use mr_damper_base::provenance::TOOL;
use mr_damper_base::shown;
use mr_damper_model::compare::{
    ALL_FOLDS, Figure, Finished, FinishedInverse, InverseRow, Persistence, Predictor, Summary,
};
use mr_damper_model::model::Model;
use mr_damper_model::model_file::ModelFile;
use mr_damper_reports::compare::published::Published;
use mr_damper_reports::compare::{CompareOutcome, StepTime, html};
use serde::Serialize;

/// The results of a comparison.
pub(super) struct ComparisonResult {
    pub(super) lines: Vec<FinishedCell>,
    pub(super) cells: Vec<Finished>,
    pub(super) summaries: Vec<Summary>,
    pub(super) persistence: Vec<Persistence>,
    pub(super) published: Option<Published>,
    pub(super) inverses: Vec<FinishedInverse>,
    pub(super) inverse_ranking: Vec<InverseRow>,
    pub(super) seconds: f64,
    /// Description of the folds; `None` without folds.
    pub(super) design: Option<String>,
}

#[derive(Debug, Serialize)]
struct Report<'a> {
    schema: &'static str,
    tool: &'static str,
    options: OptionsRow,
    /// Description of the folds; absent without folds.
    #[serde(skip_serializing_if = "Option::is_none")]
    design: Option<&'a str>,
    experiments: Vec<ExperimentRow<'a>>,
    identification: Vec<IdentificationRow<'a>>,
    cross_validation: Vec<CrossRow<'a>>,
    ranking: Vec<RankRow<'a>>,
    persistence: Vec<PersistenceRow<'a>>,
    /// Each method on each training experiment, with all tests; absent if no inverse is compared.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    inverse: &'a [FinishedInverse],
    /// The best training experiment of each method.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    inverse_ranking: &'a [InverseRow],
    models: &'a [StepTime],
}

#[derive(Debug, Serialize)]
struct OptionsRow {
    restarts: u32,
    seed: u64,
    most_rows: usize,
    moving_only: bool,
    rate_hz: Option<f64>,
    conditioning: mr_damper_model::condition::Conditioning,
}

#[derive(Debug, Serialize)]
struct ExperimentRow<'a> {
    experiment: &'a str,
    replicate: u32,
    run: &'a str,
    sha256: &'a str,
    rate_hz: f64,
    samples: usize,
}

#[derive(Debug, Serialize)]
struct IdentificationRow<'a> {
    model: &'a str,
    form: &'a str,
    experiment: &'a str,
    rsse_n: Option<f64>,
    esr: Option<f64>,
    predictor: Predictor,
    parameters: Option<usize>,
    restarts: u32,
    seconds: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    note: Option<&'a str>,
}

#[derive(Debug, Serialize)]
struct CrossRow<'a> {
    model: &'a str,
    form: &'a str,
    trained_on: &'a str,
    tested_on: &'a str,
    replicate: u32,
    predictor: Predictor,
    rsse_n: Option<f64>,
    esr: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    note: Option<&'a str>,
}

/// Mean errors of a model over the tests of its best training experiment, or over all folds.
#[derive(Debug, Serialize)]
struct RankRow<'a> {
    model: &'a str,
    form: &'a str,
    predictor: Predictor,
    trained_on: &'a str,
    tests: usize,
    mean_rsse_n: Option<f64>,
    /// 95 % interval of the mean; absent with fewer than two tested experiments or folds.
    #[serde(skip_serializing_if = "Option::is_none")]
    rsse_interval_n: Option<[f64; 2]>,
    mean_esr: Option<f64>,
}

/// Persistence on an experiment: the mean over its replicates, and each replicate.
#[derive(Debug, Serialize)]
struct PersistenceRow<'a> {
    experiment: &'a str,
    rsse_n: Option<f64>,
    esr: Option<f64>,
    replicates: Vec<&'a Persistence>,
}

/// Writes the report, the JSON and the tables, as requested.
///
/// # Errors
/// When a file cannot be written, or a stored model cannot be read.
pub(super) fn write(args: &Args, work: &ComparisonPlan, done: &ComparisonResult) -> Result<(), NodeError> {
    let models = done.lines.iter().map(model).collect::<Result<Vec<_>, _>>()?;
    let times = step_times(work, done, &models);
    args.output.page(|| Ok(html(&outcome(args, work, done, &models, &times))))?;
    args.output.figures(&report(args, work, done, &times), || tables::text(done, &times, args.units.units))
}

fn model(line: &FinishedCell) -> Result<Option<Model>, NodeError> {
    Ok(line.model.as_deref().map(ModelFile::from_toml).transpose()?.map(|file| file.model))
}

/// Time per step of each model, as identified on the first experiment that gave a model.
fn step_times(work: &ComparisonPlan, done: &ComparisonResult, models: &[Option<Model>]) -> Vec<StepTime> {
    let Some(first) = work.experiments.first().and_then(|e| e.replicates.first()) else { return Vec::new() };
    let mut once: Vec<(&str, &str, &Model)> = Vec::new();
    for (cell, model) in done.cells.iter().zip(models) {
        let known = once.iter().any(|(name, form, _)| *name == cell.model && *form == cell.form);
        once.extend(model.as_ref().filter(|_| !known).map(|m| (cell.model.as_str(), cell.form.as_str(), m)));
    }
    pictures::step_times(once.into_iter(), &first.data)
}

fn outcome<'a>(
    args: &Args,
    work: &ComparisonPlan,
    done: &'a ComparisonResult,
    models: &[Option<Model>],
    times: &'a [StepTime],
) -> CompareOutcome<'a> {
    let find = |model: &str, form: &str, on: &str| {
        // Over folds there is a model for each fold; the first one is drawn.
        let is_it = |c: &Finished| c.trained_on == on || (on == ALL_FOLDS && c.failure.is_none());
        let cell = done.cells.iter().position(|c| c.model == model && c.form == form && is_it(c))?;
        models[cell]
    };
    let drawn = match args.pictures.as_slice() {
        [] => pictures::best(&done.summaries, find),
        some => pictures::named(some, &done.summaries, (&work.experiments, work.options.degree), find),
    };
    let (force_velocity, force_velocity_caption) = pictures::force_velocity(&work.experiments, &drawn);
    let rows: usize = work.experiments.iter().flat_map(|e| &e.replicates).map(|r| r.data.rows.len()).sum();
    let own = || work.experiments.iter().filter(|experiment| !experiment.is_fold());
    let fact = |name: &str, value: String| (name.to_owned(), value);
    let conditioning = &work.options.conditioning;
    let runs = |e: &mr_damper_model::compare::Experiment| {
        let seconds = e.replicates.first().map_or(0.0, |r| r.data.rows.len() as f64 / r.data.rate_hz);
        format!("{} ({} of {seconds:.0} s)", e.name, shown::count(e.replicates.len(), "run"))
    };
    CompareOutcome {
        what: tables::headline(work.specs.len(), own().count(), work.sources.len()),
        facts: vec![
            fact(
                "division",
                done.design.clone().unwrap_or_else(|| "each experiment is a training set".to_owned()),
            ),
            fact("experiments", own().map(runs).collect::<Vec<_>>().join(", ")),
            fact("rows", format!("{rows} in all")),
            fact(
                "runs",
                match &args.runs {
                    Some(dir) => dir.display().to_string(),
                    None => format!(
                        "{}, fitted together; {}",
                        shown::count(args.train.len(), "training run"),
                        shown::count(args.test.len(), "test run")
                    ),
                },
            ),
            fact(
                "filter",
                format!(
                    "{} at {} Hz, velocity by {}",
                    format!("{:?}", conditioning.apply_to).to_lowercase(),
                    conditioning.cutoff_hz,
                    velocity_text(conditioning.velocity, conditioning.slope_window_s)
                ),
            ),
            fact(
                "rows that count",
                if work.options.dataset.moving_only { "rows in which the damper moves" } else { "all" }
                    .to_owned(),
            ),
            fact("restarts", format!("{}, seed {}", args.restarts, args.seed)),
            fact("maximum rows of a nonlinear fit", args.most_rows.to_string()),
            fact("time", format!("{:.0} s on {}", done.seconds, shown::count(work.threads, "thread"))),
            fact("made by", TOOL.to_owned()),
        ],
        cells: &done.cells,
        summaries: &done.summaries,
        persistence: &done.persistence,
        published: done.published.as_ref(),
        step_times: times,
        inverses: &done.inverses,
        inverse_ranking: &done.inverse_ranking,
        force_time: pictures::force_time(&work.experiments, &drawn),
        force_velocity,
        force_velocity_caption,
    }
}

fn report<'a>(
    args: &Args,
    work: &'a ComparisonPlan,
    done: &'a ComparisonResult,
    times: &'a [StepTime],
) -> Report<'a> {
    let replicates = work.experiments.iter().flat_map(|e| e.replicates.iter().map(move |r| (e, r)));
    Report {
        schema: "mr-damper/compare/1",
        tool: TOOL,
        options: OptionsRow {
            restarts: args.restarts,
            seed: args.seed,
            most_rows: args.most_rows,
            moving_only: work.options.dataset.moving_only,
            rate_hz: work.options.dataset.rate_hz,
            conditioning: work.options.conditioning,
        },
        design: done.design.as_deref(),
        experiments: replicates
            .zip(&work.sources)
            .map(|((experiment, replicate), source)| ExperimentRow {
                experiment: &experiment.name,
                replicate: replicate.number,
                run: &replicate.data.name,
                sha256: &source.sha256,
                rate_hz: replicate.data.rate_hz,
                samples: replicate.data.counted(),
            })
            .collect(),
        identification: done.lines.iter().flat_map(|line| identification(args, line)).collect(),
        cross_validation: done.cells.iter().flat_map(cross_validation).collect(),
        ranking: done.summaries.iter().filter_map(rank_row).collect(),
        persistence: work
            .experiments
            .iter()
            .filter(|e| !e.is_fold())
            .map(|e| persistence(&e.name, &done.persistence))
            .collect(),
        inverse: &done.inverses,
        inverse_ranking: &done.inverse_ranking,
        models: times,
    }
}

fn identification<'a>(args: &Args, line: &'a FinishedCell) -> Vec<IdentificationRow<'a>> {
    let row = |predictor, figure: Option<&'a Figure>| IdentificationRow {
        model: &line.cell.model,
        form: &line.cell.form,
        experiment: &line.cell.trained_on,
        rsse_n: figure.and_then(|f| f.rsse_n),
        esr: figure.and_then(|f| f.esr),
        predictor,
        parameters: line.cell.parameters,
        restarts: args.restarts,
        seconds: line.seconds,
        note: figure.map_or(line.cell.failure.as_deref(), |f| f.note.as_deref()),
    };
    if line.cell.failure.is_some() {
        return vec![row(Predictor::FreeRun, None)];
    }
    line.cell.identification.iter().map(|figure| row(figure.predictor, Some(figure))).collect()
}

fn cross_validation(cell: &Finished) -> Vec<CrossRow<'_>> {
    let tests = cell.cross_validation.iter().flat_map(|test| test.figures.iter().map(move |f| (test, f)));
    tests
        .map(|(test, figure)| CrossRow {
            model: &cell.model,
            form: &cell.form,
            trained_on: &cell.trained_on,
            tested_on: &test.tested_on,
            replicate: test.replicate,
            predictor: figure.predictor,
            rsse_n: figure.rsse_n,
            esr: figure.esr,
            note: figure.note.as_deref(),
        })
        .collect()
}

fn rank_row(summary: &Summary) -> Option<RankRow<'_>> {
    let best = summary.best()?;
    Some(RankRow {
        model: &summary.class.model,
        form: &summary.class.form,
        predictor: summary.class.predictor,
        trained_on: &best.trained_on,
        tests: best.tests,
        mean_rsse_n: best.mean_rsse_n,
        rsse_interval_n: best.rsse_interval_n,
        mean_esr: best.mean_esr,
    })
}

fn persistence<'a>(experiment: &'a str, all: &'a [Persistence]) -> PersistenceRow<'a> {
    let replicates: Vec<&Persistence> = all.iter().filter(|p| p.experiment == experiment).collect();
    let mean = |pick: fn(&Persistence) -> Option<f64>| {
        let values: Vec<f64> = replicates.iter().filter_map(|p| pick(p)).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    };
    PersistenceRow { experiment, rsse_n: mean(|p| p.rsse_n), esr: mean(|p| p.esr), replicates }
}
