//! `mr-damper reproduce`: reproduces the tables and figures of the thesis and its two papers.
//!
//! ```text
//! 43 runs of the thesis' eight experiments  ->  64 + 3 cells of `compare`  ->  chapters 3 to 5, second paper
//! 79 runs of the first paper's ten          ->  one fit per run            ->  first paper
//! ```
//!
//! The virtual rig makes the runs, or a folder holds recorded ones. Each model is fitted and used as in the publication: ARX one
//! step ahead, p with the measured force as an input, all others in simulation.

mod curves;
mod first_paper;
mod patterns;
mod rig_runs;
mod second_paper;
mod thesis_tables;

use crate::commands::compare::state::State;
use crate::commands::compare::work::threads;
use crate::commands::compare::{self, ComparisonPlan};
use crate::commands::context::CliContext;
use crate::commands::output;
use crate::settings::error::NodeError;
use mr_damper_base::provenance::TOOL;
use mr_damper_base::shown;
use mr_damper_model::compare::{Cell, Experiment, Figure, Finished, Predictor};
use mr_damper_model::condition::Conditioning;
use mr_damper_model::force::TskKind;
use mr_damper_model::force::{ForceLaw, Form};
use mr_damper_model::identify::{ModelSpec, Options, Structure};
use mr_damper_model::model::Model;
use mr_damper_model::model_file::ModelFile;
use mr_damper_reports::reproduction::{self, Reproduction, TableFigures};
use mr_damper_runs::write_text;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Reproduce the tables and figures of the thesis, each beside its published numbers.
///
/// The command writes thesis.html, a report with a table of contents, and thesis.json, which holds the figures of all
/// tables. The virtual rig makes the runs. It is another damper than in the thesis: orders and shapes can be compared,
/// single numbers only roughly. After Ctrl-C the same command continues where it stopped.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// What to reproduce.
    #[arg(value_name = "WHAT", value_parser = ["thesis"])]
    what: String,
    /// Folder to write to; created if it does not exist.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Folder with recorded runs in place of the rig's, named after the experiments (rp-icps-01.csv, ...). The first
    /// paper is then left out.
    #[arg(long, value_name = "DIR", conflicts_with = "duration")]
    runs: Option<PathBuf>,
    /// Random starting points of a nonlinear fit.
    #[arg(long, value_name = "N", default_value_t = 25)]
    restarts: u32,
    /// Seed of the rig's runs and of the starting points.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Duration of each run, s, to try the command; by default as in the publications.
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
}

impl Args {
    /// Settings of the fits: rows as in the thesis.
    fn options(&self) -> Options {
        Options {
            conditioning: Conditioning::THESIS,
            choose_velocity: false,
            most_rows: Some(30_000),
            restarts: self.restarts,
            seed: self.seed,
            ..Options::default()
        }
    }
}

/// The results on the thesis' experiments.
struct Results {
    experiments: Vec<Experiment>,
    cells: Vec<Finished>,
    /// The model of each cell, if there is one.
    models: Vec<Option<Model>>,
}

impl Results {
    /// The cell of a model in a form, trained on an experiment, and its model.
    fn find(&self, model: &str, form: Form, trained_on: &str) -> Option<(&Finished, Option<&Model>)> {
        let at = self.cells.iter().position(|cell| {
            cell.model == model
                && cell.form == form.name()
                && cell.trained_on.eq_ignore_ascii_case(trained_on)
        })?;
        Some((&self.cells[at], self.models[at].as_ref()))
    }

    /// The experiment called `name`.
    fn experiment(&self, name: &str) -> Option<&Experiment> {
        self.experiments.iter().find(|experiment| experiment.name.eq_ignore_ascii_case(name))
    }
}

/// A model of the thesis, and how it is used there.
#[derive(Debug, Clone, Copy)]
struct ThesisModel {
    name: &'static str,
    structure: Structure,
    predictor: Predictor,
}

const ARX: ThesisModel =
    ThesisModel { name: "arx", structure: Structure::Arx, predictor: Predictor::OneStep };
const SP: ThesisModel =
    ThesisModel { name: "sp", structure: Structure::Law(ForceLaw::Sp), predictor: Predictor::FreeRun };
const P: ThesisModel =
    ThesisModel { name: "p", structure: Structure::Phase, predictor: Predictor::SameInstant };
const ANFIS: ThesisModel =
    ThesisModel { name: "anfis", structure: Structure::Tsk(TskKind::Anfis), predictor: Predictor::FreeRun };
const FUZZY_TANH: ThesisModel =
    ThesisModel { name: "fuzzy-tanh", structure: Structure::FuzzyTanh, predictor: Predictor::FreeRun };

/// The models in the forms that the thesis identifies.
const IDENTIFIED: [(ThesisModel, Form); 8] = [
    (ARX, Form::Passive),
    (ARX, Form::SemiActive),
    (SP, Form::Passive),
    (SP, Form::SemiActive),
    (P, Form::Passive),
    (P, Form::SemiActive),
    (ANFIS, Form::SemiActive),
    (FUZZY_TANH, Form::SemiActive),
];

/// The experiments with stepped current, on which alone the thesis identifies the fuzzy-tanh model.
const STEPPED: [&str; 3] = ["RP1-CS", "RP2-CS", "RP3-CS"];

/// The figure of `figures` for `predictor`.
fn of(predictor: Predictor, figures: &[Figure]) -> Option<&Figure> {
    figures.iter().find(|figure| figure.predictor == predictor)
}

#[derive(Debug, Serialize)]
struct Report<'a> {
    schema: &'static str,
    tool: &'static str,
    seed: u64,
    seconds: f64,
    tables: Vec<TableFigures<'a>>,
}

/// Makes the report.
///
/// # Errors
/// When a run does not load, an experiment of the thesis is missing, or a file cannot be written; when interrupted, in which case the
/// finished work is kept.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    let started = Instant::now();
    std::fs::create_dir_all(&args.out).map_err(NodeError::io(format!("creating {}", args.out.display())))?;
    let results = identified(args, context)?;
    let mut chapters = vec![
        patterns::chapter(&results.experiments),
        thesis_tables::chapter_4(&results),
        curves::chapter_5(&results),
        second_paper::chapter(&results),
    ];
    if args.runs.is_none() {
        chapters.insert(3, first_paper::chapter(args, context)?);
    }
    let seconds = started.elapsed().as_secs_f64();
    let fact = |name: &str, value: String| (name.to_owned(), value);
    let report = Reproduction {
        lead: format!(
            "Tables and figures of the thesis and its two papers, reproduced on {}.",
            if args.runs.is_some() { "recorded runs" } else { "runs of the virtual rig" }
        ),
        facts: vec![
            fact(
                "runs",
                match &args.runs {
                    Some(dir) => dir.display().to_string(),
                    None => format!("the virtual rig's, seed {}; a damper with another structure than any model", args.seed),
                },
            ),
            fact(
                "duration",
                args.duration.map_or("as published".to_owned(), |s| format!("{s} s each: a trial, not a reproduction")),
            ),
            fact("rows", "displacement low-passed by two poles at 20 Hz, backward difference, rows in which the damper moves".to_owned()),
            fact("fits", format!("{} random starts, seed {}", args.restarts, args.seed)),
            fact("training", "first replicate of one experiment; tests on all other runs of all experiments".to_owned()),
            fact("time", format!("{seconds:.0} s")),
            fact("made by", TOOL.to_owned()),
        ],
        chapters,
    };
    let page = args.out.join("thesis.html");
    write_text(&page, &reproduction::html(&report))?;
    let tables = reproduction::table_figures(&report);
    let json = Report { schema: "mr-damper/reproduce/1", tool: TOOL, seed: args.seed, seconds, tables };
    output::json(&args.out.join("thesis.json"), &json)?;
    let items: usize = report.chapters.iter().map(|chapter| chapter.items.len()).sum();
    let text = format!("{items} tables and figures in {}, {seconds:.0} s", page.display());
    println!("{}", shown::line(&text));
    remove_state(args)
}

/// Reads or simulates the thesis' runs and identifies its models on them.
fn identified(args: &Args, context: &CliContext) -> Result<Results, NodeError> {
    let options = args.options();
    let (experiments, sources) = match &args.runs {
        Some(dir) => rig_runs::recorded(dir, &options, context)?,
        None => rig_runs::of_thesis(args.seed, args.duration, &options, context)?,
    };
    let specs = IDENTIFIED.map(|(model, form)| ModelSpec::new(model.structure, form));
    let specs = specs.into_iter().collect::<Result<Vec<_>, _>>()?;
    let plan = ComparisonPlan {
        specs,
        inverses: Vec::new(),
        experiments,
        sources,
        options,
        threads: threads(),
        design: None,
    };
    let is_published = |cell: &Cell| {
        let on = &plan.experiments[cell.experiment].name;
        cell.spec != ModelSpec::FUZZY_TANH || STEPPED.contains(&on.as_str())
    };
    let cells: Vec<Cell> = mr_damper_model::compare::cells(&plan.specs, &plan.experiments)
        .into_iter()
        .filter(is_published)
        .collect();
    let state = State::open(&state_path(args))?;
    let lines = compare::compute_cells(&plan, &cells, &state, context)?;
    let model = |text: &String| Ok::<_, NodeError>(ModelFile::from_toml(text)?.model);
    let models =
        lines.iter().map(|line| line.model.as_ref().map(model).transpose()).collect::<Result<_, _>>()?;
    let cells = lines.into_iter().map(|line| line.cell).collect();
    Ok(Results { experiments: plan.experiments, cells, models })
}

/// The file that keeps finished work.
fn state_path(args: &Args) -> PathBuf {
    args.out.join("reproduce.partial.jsonl")
}

fn remove_state(args: &Args) -> Result<(), NodeError> {
    let path = state_path(args);
    std::fs::remove_file(&path).map_err(NodeError::io(format!("removing {}", path.display())))
}
