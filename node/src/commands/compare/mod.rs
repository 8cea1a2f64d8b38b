//! `mr-damper compare`: identifies every model on every experiment and tests it on all others.

pub(super) mod drawn;
mod error;
mod output;
pub(super) mod pictures;
pub(super) mod runs;
pub(super) mod state;
mod tables;
pub(super) mod work;

use crate::commands::conditioning::{ConditioningArgs, FilterArg, VelocityArg};
use crate::commands::context::CliContext;
use crate::commands::output::OutputArgs;
use crate::commands::run_args::RunArgs;
use crate::settings::error::NodeError;
use clap::builder::PossibleValuesParser;
use error::{CompareError, OnlyForm};
use indicatif::{ProgressBar, ProgressStyle};
use mr_damper_base::shown;
use mr_damper_model::compare::{self, Cell, Experiment, Summary};
use mr_damper_model::identify::{Form, ModelSpec, Options, Structure, Watch};
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_reports::compare::published::Published;
use pictures::Picture;
use runs::{PlannedExperiment, Source};
use state::{CellKeys, FinishedCell, State};
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::{Duration, Instant};
use work::in_parallel;

/// Identify every model on every experiment and test it on all others.
///
/// RUNS_DIR holds run files. Files whose names differ only in a trailing -NN (rp-icps-01.csv, rp-icps-02.csv) are
/// replicates of one experiment, and so are the runs of a sub-folder. Each model is identified on the first replicate of
/// each experiment and tested on every other run. Finished work is kept in a file: after Ctrl-C the same command continues
/// where it stopped.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder with runs.
    #[arg(value_name = "RUNS_DIR", required_unless_present = "train")]
    pub runs: Option<PathBuf>,
    /// In place of a folder: runs on which each model is identified, all runs together.
    #[arg(long, value_name = "RUN", num_args = 1.., conflicts_with_all = ["runs", "experiments"], requires = "test")]
    pub train: Vec<PathBuf>,
    /// Runs on which each model is tested.
    #[arg(long, value_name = "RUN", num_args = 1.., requires = "train")]
    pub test: Vec<PathBuf>,
    /// Models to compare; by default all.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', value_parser = PossibleValuesParser::new(names()))]
    pub models: Vec<String>,
    /// Compare only the forms without the drive.
    #[arg(long, conflicts_with = "semi_active_only")]
    pub passive_only: bool,
    /// Compare only the forms with the drive.
    #[arg(long)]
    pub semi_active_only: bool,
    /// Also compare force laws whose fuzzy sets have free centres and widths, which takes half as much time again.
    /// (fuzzy-tanh is always compared in that form too.)
    #[arg(long, conflicts_with = "passive_only")]
    pub free_sets: bool,
    /// Experiments to take, by name in any case; by default all.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub experiments: Vec<String>,
    /// Models in the pictures of the report, at most three, such as fuzzy-tanh,arx:one-step; by default the best three in
    /// simulation. Each is drawn as identified on its best experiment: in simulation, or one step ahead with
    /// `:one-step`; p is drawn from the measured force of the same instant.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', requires = "report")]
    pub pictures: Vec<Picture>,
    /// Degree of the polynomials over the drive, for force laws, lpv and p. Laws that their publication makes linear in the
    /// drive are also compared in that form (kwok/linear).
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=5))]
    pub degree: u8,
    /// Random starting points of a nonlinear fit.
    #[arg(long, value_name = "N", default_value_t = 25)]
    pub restarts: u32,
    /// Seed of the starting points.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Maximum number of rows in the final nonlinear fit; a longer run is sampled. Tests always use all rows.
    #[arg(long, value_name = "N", default_value_t = 30_000)]
    pub most_rows: usize,
    /// How runs become rows.
    #[command(flatten)]
    pub conditioning: ConditioningArgs,
    /// Output files.
    #[command(flatten)]
    pub output: OutputArgs,
    /// File that keeps finished work, so that the command can continue after an interrupt; it is not deleted. By default
    /// compare.partial.jsonl next to the JSON or the report, which is deleted when all is done.
    #[arg(long, value_name = "FILE")]
    pub resume: Option<PathBuf>,
    /// How runs are read.
    #[command(flatten)]
    pub load: RunArgs,
}

/// Names of all models.
fn names() -> Vec<&'static str> {
    Structure::all().into_iter().map(Structure::name).collect()
}

/// The models, experiments and options of a comparison.
pub(super) struct ComparisonPlan {
    /// The models.
    pub(super) specs: Vec<ModelSpec>,
    /// The experiments with their rows.
    pub(super) experiments: Vec<Experiment>,
    /// The origin of each run.
    pub(super) sources: Vec<Source>,
    /// Settings of the fits.
    pub(super) options: Options,
    /// Number of cells that are computed at the same time.
    pub(super) threads: usize,
}

/// Compares the models and writes the results.
///
/// # Errors
/// When the folder holds no runs, a run does not load or cannot be conditioned, or a file cannot be written; when
/// interrupted, in which case the finished work is kept.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    let started = Instant::now();
    let work = prepare(args, context)?;
    let path = state_path(args);
    let state = State::open(&path)?;
    let cells = compare::cells(&work.specs, &work.experiments);
    let lines = match compute_cells(&work, &cells, &state, context) {
        Err(NodeError::Interrupted) => {
            let text =
                format!("finished work is kept in {}: the same command continues from there", path.display());
            eprintln!("{}", shown::line(&text));
            return Err(NodeError::Interrupted);
        }
        lines => lines?,
    };
    let cells: Vec<_> = lines.iter().map(|line| line.cell.clone()).collect();
    let done = output::ComparisonResult {
        summaries: Summary::of(&cells),
        persistence: compare::persistence(&work.experiments),
        published: published(&work.experiments),
        seconds: started.elapsed().as_secs_f64(),
        cells,
        lines,
    };
    output::write(args, &work, &done)?;
    if args.resume.is_none() {
        std::fs::remove_file(&path).map_err(NodeError::io(format!("removing {}", path.display())))?;
    }
    Ok(())
}

/// The figures of the thesis, if one of the experiments has the name of a thesis experiment.
fn published(experiments: &[Experiment]) -> Option<Published> {
    let thesis = Published::thesis();
    experiments.iter().any(|experiment| thesis.knows(&experiment.name)).then_some(thesis)
}

/// The file that keeps finished work.
fn state_path(args: &Args) -> PathBuf {
    const NAME: &str = "compare.partial.jsonl";
    let beside = args.output.files().next();
    args.resume
        .clone()
        .unwrap_or_else(|| beside.map_or(PathBuf::from(NAME), |path| path.with_file_name(NAME)))
}

fn prepare(args: &Args, context: &CliContext) -> Result<ComparisonPlan, NodeError> {
    let specs = specs(args)?;
    check_pictures(args, &specs)?;
    let planned = match &args.runs {
        Some(dir) => chosen(runs::discover(dir)?, &args.experiments)?,
        None => runs::given(&args.train, &args.test, &args.load)?,
    };
    let options = Options {
        conditioning: args.conditioning.conditioning(FilterArg::Inputs, VelocityArg::Backward)?,
        choose_velocity: false,
        dataset: args.conditioning.dataset(),
        degree: usize::from(args.degree),
        most_rows: Some(args.most_rows),
        restarts: args.restarts,
        seed: args.seed,
        ..Options::default()
    };
    let threads = work::threads();
    let files: usize = planned.iter().map(|p| p.replicates.len()).sum();
    let bar = bar(context, files, "reading runs [{bar:40}] {pos}/{len}");
    let (experiments, sources) = runs::load(
        &planned,
        &args.load,
        (&options.conditioning, &options.dataset),
        threads,
        (context.interrupt.flag(), &|| bar.inc(1)),
    )?;
    bar.finish_and_clear();
    if files == 1 {
        tracing::warn!(
            "there is only one run: models are identified, but they cannot be tested on another run"
        );
    }
    Ok(ComparisonPlan { specs, experiments, sources, options, threads })
}

/// The requested models in all requested forms.
fn specs(args: &Args) -> Result<Vec<ModelSpec>, CompareError> {
    let is_selected = |spec: &ModelSpec| {
        let named = args.models.is_empty() || args.models.iter().any(|name| name == spec.structure().name());
        let passive = spec.form() == Form::Passive;
        let dear = matches!(spec.structure(), Structure::Law(_)) && spec.form() == Form::FreeFuzzy;
        named
            && (passive || !args.passive_only)
            && (!passive || !args.semi_active_only)
            && (!dear || args.free_sets)
    };
    let with_variants = |spec: ModelSpec| {
        let variants = spec.variants().iter().filter_map(move |variant| spec.with_variant(*variant).ok());
        std::iter::once(spec).chain(variants)
    };
    let specs: Vec<ModelSpec> =
        ModelSpec::all().into_iter().filter(is_selected).flat_map(with_variants).collect();
    if specs.is_empty() {
        let form = if args.passive_only { OnlyForm::Passive } else { OnlyForm::SemiActive };
        return Err(CompareError::NoForm { models: args.models.clone(), form });
    }
    Ok(specs)
}

/// Refuses pictures of models that are not compared, and more than a plot can show.
fn check_pictures(args: &Args, specs: &[ModelSpec]) -> Result<(), CompareError> {
    let most = pictures::MODELS;
    if args.pictures.len() > most {
        return Err(CompareError::TooManyPictures { found: args.pictures.len(), most });
    }
    match args.pictures.iter().find(|picture| !specs.iter().any(|spec| picture.is_of(*spec))) {
        Some(unknown) => Err(CompareError::NoPicture { picture: unknown.to_string() }),
        None => Ok(()),
    }
}

/// The requested experiments.
fn chosen(planned: Vec<PlannedExperiment>, names: &[String]) -> Result<Vec<PlannedExperiment>, CompareError> {
    let known = |name: &String| planned.iter().any(|p| p.name.eq_ignore_ascii_case(name));
    if let Some(unknown) = names.iter().find(|name| !known(name)) {
        let known = planned.iter().map(|p| p.name.clone()).collect();
        return Err(CompareError::UnknownExperiment { name: unknown.clone(), known });
    }
    let is_selected = |p: &PlannedExperiment| {
        names.is_empty() || names.iter().any(|name| p.name.eq_ignore_ascii_case(name))
    };
    Ok(planned.into_iter().filter(is_selected).collect())
}

/// A progress bar over `length` steps, hidden with `--quiet`.
pub(super) fn bar(context: &CliContext, length: usize, template: &str) -> ProgressBar {
    let bar = if context.quiet { ProgressBar::hidden() } else { ProgressBar::new(length as u64) };
    bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}

/// Computes `cells`, or takes them from `state`. The result is in the same order.
///
/// # Errors
/// When the state cannot be written; when interrupted.
pub(super) fn compute_cells(
    work: &ComparisonPlan,
    cells: &[Cell],
    state: &State,
    context: &CliContext,
) -> Result<Vec<FinishedCell>, NodeError> {
    let cell_keys = CellKeys::new(&work.options, &work.sources);
    let keys: Vec<String> =
        cells.iter().map(|cell| cell_keys.key(cell.spec, &work.experiments[cell.experiment].name)).collect();
    let known = keys.iter().filter(|key| state.get(key).is_some()).count();
    if known > 0 {
        tracing::info!(done = known, of = cells.len(), "continuing the work of an earlier call");
    }
    let bar = bar(context, cells.len(), "{msg} [{bar:40}] {pos}/{len}, {prefix} left");
    let left = TimeLeft::new(cells, &keys, state, work.threads);
    bar.set_position(known as u64);
    bar.set_prefix("?");
    let one = |index: usize| -> Result<FinishedCell, NodeError> {
        let (cell, key) = (cells[index], &keys[index]);
        if let Some(line) = state.get(key) {
            return Ok(line.clone());
        }
        if context.interrupt.is_raised() {
            return Err(NodeError::Interrupted);
        }
        bar.set_message(format!("{} ({})", cell.spec.label(), cell.spec.form().name()));
        let line = compute_cell(work, cell, key, context)?;
        state.add(&line)?;
        bar.set_prefix(left.after(index, line.seconds));
        bar.inc(1);
        Ok(line)
    };
    let lines = in_parallel(cells.len(), work.threads, one).into_iter().collect();
    bar.finish_and_clear();
    lines
}

fn compute_cell(
    work: &ComparisonPlan,
    cell: Cell,
    key: &str,
    context: &CliContext,
) -> Result<FinishedCell, NodeError> {
    let watch = Watch { cancel: Some(context.interrupt.flag()), progress: None };
    let start = Instant::now();
    let (finished, model) =
        compare::run(cell, &work.experiments, &work.options, &watch).map_err(|error| match error {
            mr_damper_model::Error::Cancelled => NodeError::Interrupted,
            error => error.into(),
        })?;
    let file = |model| ModelFile { model, provenance: Provenance::default() }.to_toml();
    Ok(FinishedCell {
        key: key.to_owned(),
        seconds: start.elapsed().as_secs_f64(),
        cell: finished,
        model: model.map(file).transpose()?,
    })
}

/// Estimate of the time left: each model is expected to take as long on the open experiments as on the finished ones.
struct TimeLeft<'a> {
    cells: &'a [Cell],
    threads: usize,
    so_far: Mutex<CellTimes>,
}

/// The times of the finished cells.
#[derive(Default)]
struct CellTimes {
    /// True for each finished cell.
    done: Vec<bool>,
    /// Seconds and number of the finished cells of each model.
    took: HashMap<ModelSpec, (f64, f64)>,
}

impl CellTimes {
    fn add(&mut self, spec: ModelSpec, seconds: f64) {
        let of = self.took.entry(spec).or_default();
        *of = (of.0 + seconds, of.1 + 1.0);
    }

    /// Expected time of a cell of `spec`, s: the mean over its finished cells; without any, over all finished cells.
    fn estimate(&self, spec: ModelSpec) -> f64 {
        let all = || self.took.values().fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        let (seconds, cells) = self.took.get(&spec).copied().unwrap_or_else(all);
        seconds / f64::max(cells, 1.0)
    }
}

impl<'a> TimeLeft<'a> {
    fn new(cells: &'a [Cell], keys: &[String], state: &State, threads: usize) -> Self {
        let mut so_far = CellTimes::default();
        for (cell, line) in cells.iter().zip(keys.iter().map(|key| state.get(key))) {
            so_far.done.push(line.is_some());
            if let Some(line) = line {
                so_far.add(cell.spec, line.seconds);
            }
        }
        Self { cells, threads, so_far: Mutex::new(so_far) }
    }

    /// The time left as text, after cell `index` took `seconds`.
    fn after(&self, index: usize, seconds: f64) -> String {
        let mut so_far = self.so_far.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        so_far.done[index] = true;
        so_far.add(self.cells[index].spec, seconds);
        let open = self.cells.iter().zip(&so_far.done).filter(|(_, done)| !**done);
        let seconds = open.map(|(cell, _)| so_far.estimate(cell.spec)).sum::<f64>() / self.threads as f64;
        indicatif::HumanDuration(Duration::from_secs_f64(seconds.max(0.0))).to_string()
    }
}
