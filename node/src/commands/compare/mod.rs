//! `mr-damper compare`: identifies every model on every experiment and tests it on all others.

pub(super) mod drawn;
mod error;
mod inverses;
mod output;
pub(super) mod pictures;
pub(super) mod runs;
pub(super) mod state;
mod tables;
pub(super) mod work;

use crate::commands::conditioning::{ConditioningArgs, FilterArg, VelocityArg};
use crate::commands::context::CliContext;
use crate::commands::inverse::method;
use crate::commands::output::OutputArgs;
use crate::commands::run_args::RunArgs;
use crate::commands::targets::{self, Target};
use crate::commands::units::UnitsArgs;
use crate::settings::error::NodeError;
use clap::ValueEnum;
use clap::builder::PossibleValuesParser;
use error::{CompareError, OnlyForm};
use indicatif::{ProgressBar, ProgressStyle};
use mr_damper_base::shown;
use mr_damper_model::compare::{self, Cell, Experiment, InverseRow, Summary};
use mr_damper_model::identify::{Form, ModelSpec, Options, Structure, Watch};
use mr_damper_model::inverse::Method;
use mr_damper_model::model_file::{ModelFile, Provenance};
use mr_damper_model::sample::DriveKind;
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
/// each experiment and tested on every other run. If each run holds one level of the drive, the levels are held out in turn
/// instead (--folds). Finished work is kept in a file: after Ctrl-C the same command continues
/// where it stopped.
///
/// By default displacement passes a low-pass of 20 Hz and velocity is the backward difference, as in the thesis. `identify` has no
/// filter and chooses the velocity, so its errors differ unless both commands get the same --filter and --velocity.
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
    /// Inverse methods to compare, such as search,chen: the current that each finds for the measured force of a run, against the
    /// recorded current. By default all, if all models are compared and the drive is a coil current.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', value_parser = method)]
    pub inverse: Vec<Method>,
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
    /// How runs are divided into training and test. levels: hold out each level of the drive in turn, and identify on the runs of
    /// all other levels; experiments: identify on each experiment alone; auto: levels, if each run holds one of at least three
    /// levels.
    #[arg(long, value_enum, default_value_t, conflicts_with = "train")]
    pub folds: FoldsArg,
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
    /// Unit of forces.
    #[command(flatten)]
    pub units: UnitsArgs,
    /// How runs are read.
    #[command(flatten)]
    pub load: RunArgs,
}

/// How runs are divided into training and test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum FoldsArg {
    /// By levels, if each run holds one level.
    #[default]
    Auto,
    /// Each level is held out in turn.
    Levels,
    /// Each experiment is a training set.
    Experiments,
}

/// Fewest levels that are held out in turn: with two, a fold has one level, which does not show how the force depends on the drive.
const FEWEST_LEVELS: usize = 3;

/// Names of all models.
fn names() -> Vec<&'static str> {
    Structure::all().into_iter().map(Structure::name).collect()
}

/// The models, experiments and options of a comparison.
pub(super) struct ComparisonPlan {
    /// The models.
    pub(super) specs: Vec<ModelSpec>,
    /// The inverse methods.
    pub(super) inverses: Vec<Method>,
    /// The experiments with their rows.
    pub(super) experiments: Vec<Experiment>,
    /// The origin of each run.
    pub(super) sources: Vec<Source>,
    /// Settings of the fits.
    pub(super) options: Options,
    /// Number of cells that are computed at the same time.
    pub(super) threads: usize,
    /// Description of the folds, in sentences; `None` without folds.
    pub(super) design: Option<String>,
}

/// Compares the models and writes the results.
///
/// # Errors
/// When the folder holds no runs, a run does not load or cannot be conditioned, or a file cannot be written; when
/// interrupted, in which case the finished work is kept.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    let started = Instant::now();
    let inputs = args.train.iter().chain(&args.test).map(PathBuf::as_path);
    let kept = args.resume.iter().map(|path| Target::new("--resume", path));
    targets::check(inputs, args.output.targets().chain(kept))?;
    let work = prepare(args, context)?;
    let path = state_path(args);
    let cells = compare::cells(&work.specs, &work.experiments);
    let computed = compute_cells(&work, &cells, &State::open(&path)?, context)
        .and_then(|lines| Ok((lines, inverses::compute(&work, &State::open(&path)?, context)?)));
    let (lines, inverses) = match computed {
        Err(NodeError::Interrupted) => {
            let text =
                format!("finished work is kept in {}: the same command continues from there", path.display());
            eprintln!("{}", shown::line(&text));
            return Err(NodeError::Interrupted);
        }
        computed => computed?,
    };
    let cells: Vec<_> = lines.iter().map(|line| line.cell.clone()).collect();
    let summaries = match &work.design {
        Some(_) => Summary::of(&compare::over_folds(&cells, &work.experiments)),
        None => Summary::of(&cells),
    };
    let done = output::ComparisonResult {
        summaries,
        design: work.design.clone(),
        persistence: compare::persistence(&work.experiments),
        published: published(&work.experiments),
        seconds: started.elapsed().as_secs_f64(),
        inverse_ranking: InverseRow::best(&inverses),
        inverses,
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
    let (experiments, design) = divided(experiments, args)?;
    if let Some(design) = &design {
        tracing::info!("{design}");
    }
    let inverses = inverses::methods(args, &experiments);
    Ok(ComparisonPlan { specs, inverses, experiments, sources, options, threads, design })
}

/// The experiments, with folds if the runs hold one level each or if folds are asked for; and what the folds are.
fn divided(
    experiments: Vec<Experiment>,
    args: &Args,
) -> Result<(Vec<Experiment>, Option<String>), CompareError> {
    if args.folds == FoldsArg::Experiments || args.runs.is_none() {
        return Ok((experiments, None));
    }
    let levels = compare::levels(&experiments);
    let levels = match levels {
        Some(levels) if levels.len() >= FEWEST_LEVELS => levels,
        found if args.folds == FoldsArg::Levels => {
            return Err(CompareError::NoLevels {
                found: found.map(|levels| levels.len()),
                fewest: FEWEST_LEVELS,
            });
        }
        Some(levels) => {
            tracing::warn!(
                "each run holds one of {} of the drive: a model that is identified on one run cannot know how the force depends on \
                 the drive, so the ranking of models with a drive means little; record runs whose drive varies, or runs at {} or more \
                 levels",
                shown::count(levels.len(), "level"),
                FEWEST_LEVELS
            );
            return Ok((experiments, None));
        }
        None => return Ok((experiments, None)),
    };
    let kind = experiments.iter().flat_map(|e| &e.replicates).find_map(|replicate| replicate.data.drive);
    let unit = kind.map_or("A", DriveKind::unit);
    let drives: Vec<String> = levels.iter().map(|level| format!("{:.2}", level.drive)).collect();
    let design = format!(
        "Each run holds one level of the drive ({} {unit}). So each level is held out in turn: the models are identified on the runs of \
         all other levels and tested on the runs of this one. At the lowest and the highest level they extrapolate. \
         (--folds experiments identifies on each experiment alone.)",
        drives.join(", ")
    );
    Ok((compare::with_folds(experiments, &levels, unit), Some(design)))
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
    state: &State<FinishedCell>,
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
    let lines_of_progress = ProgressLines::new(&bar, context, cells.len());
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
        let left = left.after(index, line.seconds);
        bar.inc(1);
        lines_of_progress.after(bar.position(), &left);
        bar.set_prefix(left);
        Ok(line)
    };
    let lines = in_parallel(cells.len(), work.threads, one).into_iter().collect();
    bar.finish_and_clear();
    lines
}

/// Lines of progress in the log, for a comparison without a terminal.
struct ProgressLines {
    /// `None` if the bar is shown, or nothing is to be shown.
    last: Option<Mutex<Instant>>,
    of: usize,
}

impl ProgressLines {
    /// Time between two lines.
    const EVERY: Duration = Duration::from_secs(30);

    fn new(bar: &ProgressBar, context: &CliContext, of: usize) -> Self {
        let is_needed = bar.is_hidden() && !context.quiet;
        if is_needed {
            tracing::info!("comparing: {}", shown::count(of, "cell"));
        }
        Self { last: is_needed.then(|| Mutex::new(Instant::now())), of }
    }

    /// Logs a line if the last one is old enough; `left` is the time left.
    fn after(&self, done: u64, left: &str) {
        let Some(last) = &self.last else { return };
        let mut last = last.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if last.elapsed() >= Self::EVERY {
            *last = Instant::now();
            tracing::info!("comparing: {done} of {}, {left} left", shown::count(self.of, "cell"));
        }
    }
}

fn compute_cell(
    work: &ComparisonPlan,
    cell: Cell,
    key: &str,
    context: &CliContext,
) -> Result<FinishedCell, NodeError> {
    let watch = Watch { cancel: Some(context.interrupt.flag()), progress: None };
    let start = Instant::now();
    let (finished, model) = compare::run(cell, &work.experiments, &work.options, &watch)?;
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
    fn new(cells: &'a [Cell], keys: &[String], state: &State<FinishedCell>, threads: usize) -> Self {
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
