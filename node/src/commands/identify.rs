//! `mr-damper identify`: identifies a model from recorded runs.

mod report;

pub use report::Report;

use crate::commands::coefficients::fitted::{self, Draws};
use crate::commands::coefficients::{self, Format};
use crate::commands::conditioning::{ConditioningArgs, FilterArg, VelocityArg, velocity_text};
use crate::commands::context::CliContext;
use crate::commands::fis;
use crate::commands::number::newtons;
use crate::commands::output::OutputArgs;
use crate::commands::progress::Working;
use crate::commands::run_args::RunArgs;
use crate::commands::targets::{self, Target};
use crate::commands::units::UnitsArgs;
use crate::settings::error::NodeError;
use clap::builder::PossibleValuesParser;
use mr_damper_base::provenance::{TOOL, date, expect};
use mr_damper_model::calibrate::Calibrator;
use mr_damper_model::evaluate::{Evaluator, evaluate_into};
use mr_damper_model::identify::{
    Form, Identified, Loss, ModelSpec, Options, Placement, Structure, Variant, Watch, identify,
    identify_inverse, score_inverse,
};
use mr_damper_model::inverse::InverseKind;
use mr_damper_model::model::{Envelope, Model};
use mr_damper_model::model_file::{ModelFile, Provenance, Role, TrainingRun};
use mr_damper_model::pipeline::{Models, Pipeline, Plausible, Settings};
use mr_damper_model::sample::{DriveKind, Run};
use mr_damper_model::statistics::bootstrap::resampled_runs;
use mr_damper_reports::Recording;
use mr_damper_reports::identify::{self as page, IdentifyOutcome, SteppedRun};
use mr_damper_reports::swept::SweptReport;
use mr_damper_runs::write_text;
use report::{
    Estimate, InverseReport, Scores, VelocityReport, WithoutPriorReport, figures, headline, remarks,
    run_report, table,
};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Identify a model from recorded runs and write a model file.
///
/// Several runs, at different rates and currents, are fitted together; each run has its own force offset. Validation
/// runs (`--validate`) are not fitted: the model is scored on them, and the model file stores their error as the
/// error that the node should expect.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Model to identify.
    #[arg(long, value_name = "NAME", value_parser = PossibleValuesParser::new(names()))]
    pub model: String,
    /// Identify the form without the drive.
    #[arg(long)]
    pub passive: bool,
    /// Use fuzzy sets over the drive in place of polynomials, for a force law (kwok, bouc-wen, ...) or lpv.
    #[arg(long, conflicts_with = "passive")]
    pub fuzzy: bool,
    /// Degree of the polynomials over the drive, for a force law or lpv; kwok, li and choi are linear in their publications.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=5))]
    pub degree: u8,
    /// Fit as in the model's publication, in place of the better default.
    #[arg(long, value_name = "NAME", value_parser = PossibleValuesParser::new(Variant::FITS.map(Variant::name)))]
    pub fit: Option<String>,
    /// Also identify an inverse model, which computes the current for a force, and store it in the model file for the inverse
    /// controller (`inverse.method`).
    #[arg(long, value_name = "KIND", conflicts_with = "passive", value_parser = PossibleValuesParser::new(InverseKind::ALL.map(InverseKind::name)))]
    pub inverse: Option<String>,
    /// Minimise Huber's loss in place of squares: residuals beyond N newtons get less weight.
    #[arg(long, value_name = "N", allow_hyphen_values = true, value_parser = newtons)]
    pub huber: Option<f64>,
    /// Runs to fit: CSV files, rosbag2 directories, .mcap files, logs of a CAN bus.
    #[arg(required = true, value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    /// Model file to write.
    #[arg(long, value_name = "MODEL.toml")]
    pub out: PathBuf,
    /// Also write the model as a FIS file of MATLAB; for models of fuzzy rules (anfis, tsk-...). It holds the rules on
    /// normalised values; the model file holds the normalisation.
    #[arg(long, value_name = "MODEL.fis")]
    pub fis: Option<PathBuf>,
    /// Also write the coefficients as a table with symbol, value, unit and standard error: .csv, .md (Markdown) or .tex (LaTeX).
    #[arg(long, value_name = "TABLE")]
    pub coefficients: Option<PathBuf>,
    /// Fit N times more, each time to runs that are drawn from the given runs with replacement, and write the scatter of each
    /// coefficient beside its standard error. The standard error covers the scatter within these runs; the bootstrap also covers
    /// differences between runs. A hundred fits or more are usual.
    #[arg(long, value_name = "N", requires = "coefficients", value_parser = clap::value_parser!(u32).range(10..=10_000))]
    pub bootstrap: Option<u32>,
    /// Validation runs: held out of the fit, and scored.
    #[arg(long, value_name = "RUN", num_args = 1..)]
    pub validate: Vec<PathBuf>,
    /// Random starting points of the nonlinear fit.
    #[arg(long, value_name = "N", default_value_t = 25)]
    pub restarts: u32,
    /// Seed of the starting points.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Centres of the fuzzy sets, in A or V, like the drive of the runs; by default chosen from that drive.
    #[arg(long, value_name = "C,C,...", value_delimiter = ',', allow_hyphen_values = true)]
    pub centres: Option<Vec<f64>>,
    /// Width (standard deviation) of the fuzzy sets, in A or V; by default half the spacing of the centres.
    #[arg(long, value_name = "S", requires = "centres")]
    pub sigma: Option<f64>,
    /// Number of fuzzy sets, spaced evenly over the range of the drive.
    #[arg(long, value_name = "N", conflicts_with = "centres")]
    pub sets: Option<usize>,
    /// Also identify the centres and widths of the fuzzy sets. The search starts at the values that would otherwise be fixed.
    #[arg(long, conflicts_with = "passive")]
    pub free_sets: bool,
    /// How runs become rows.
    #[command(flatten)]
    pub conditioning: ConditioningArgs,
    /// Output files.
    #[command(flatten)]
    pub output: OutputArgs,
    /// Unit of the printed forces.
    #[command(flatten)]
    pub units: UnitsArgs,
    /// How runs are read.
    #[command(flatten)]
    pub load: RunArgs,
}

/// Largest drive of a damper, A or V.
const MOST_DRIVE: f64 = 50.0;

/// Names of all models that can be identified.
fn names() -> Vec<&'static str> {
    Structure::all().into_iter().map(Structure::name).collect()
}

/// Identifies the model, scores it on the validation runs, and writes the results.
///
/// # Errors
/// When a run does not load, the model cannot be identified from the runs, or a file cannot be written; when interrupted,
/// in which case nothing is written.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    let spec = spec(args)?;
    if let Some(path) = &args.fis {
        fis::check_rules(spec.structure())?;
        if !fis::is_fis(path) {
            let path = path.display();
            return Err(NodeError::Usage(format!("--fis {path}: give a name that ends in .fis")));
        }
    }
    let inputs = args.runs.iter().chain(&args.validate).map(PathBuf::as_path);
    let own = [Some(&args.out), args.fis.as_ref()].into_iter().zip(["--out", "--fis"]);
    let own = own.filter_map(|(path, option)| Some(Target::new(option, path?)));
    let coefficients = args.coefficients.iter().map(|path| Target::run_or_table("--coefficients", path));
    targets::check(inputs, own.chain(coefficients).chain(args.output.targets()))?;
    let format = args.coefficients.as_deref().map(Format::of).transpose()?;
    if args.bootstrap.is_some() && args.runs.len() < fitted::FEWEST_RUNS {
        return Err(NodeError::Usage(format!(
            "--bootstrap draws from the runs, so it needs at least {} of them, but {} given",
            fitted::FEWEST_RUNS,
            if args.runs.len() == 1 { "one is".to_owned() } else { format!("{} are", args.runs.len()) }
        )));
    }
    let (mut runs, mut hashes): (Vec<Run>, Vec<String>) = (Vec::new(), Vec::new());
    for path in args.runs.iter().chain(&args.validate) {
        let loaded = args.load.load(path)?;
        let hash = loaded.sha256_hex();
        let mut before = args.runs.iter().chain(&args.validate).zip(&hashes);
        if let Some((same, _)) = before.find(|(_, other)| **other == hash) {
            return Err(given_twice(path, same, &hash));
        }
        runs.push(loaded.run);
        hashes.push(hash);
    }
    let (held_out, held_out_hashes) = (runs.split_off(args.runs.len()), hashes.split_off(args.runs.len()));
    let found = Identification::of(spec, (&runs, &hashes), (&held_out, &held_out_hashes), args, context)?;
    let model = &found.file.model;
    for doubt in doubtful_units(&model.envelope) {
        tracing::warn!("{doubt}");
    }
    let fis_text = args.fis.as_ref().map(|path| fis::text_of(model, &path.to_string_lossy())).transpose()?;
    let coefficients = format.map(|format| found.coefficients(&runs, format, args, context)).transpose()?;
    write_text(&args.out, &found.file.to_toml()?)?;
    if let (Some(path), Some(text)) = (&args.coefficients, coefficients) {
        write_text(path, &text)?;
    }
    if let (Some(path), Some(text)) = (&args.fis, fis_text) {
        write_text(path, &text)?;
    }
    args.output.page(|| found.page(&runs, &held_out))?;
    let report = found.report();
    args.output.figures(&report, || table(&report, &args.out, args.units.units))
}

/// Ranges of the training runs that a damper does not have, most likely because a column has another unit.
fn doubtful_units(envelope: &Envelope) -> Vec<String> {
    let most = Plausible::default();
    let quantities = [
        ("displacement", envelope.displacement_m, most.displacement_max_m, "m"),
        ("velocity", envelope.velocity_m_s, most.speed_max_m_s, "m/s"),
        ("force", envelope.force_n, most.force_max_n, "N"),
        ("drive", envelope.drive, MOST_DRIVE, "A or V"),
    ];
    let doubt = |(name, range, most, unit): (&str, Option<[f64; 2]>, f64, &str)| {
        let largest = range.map(|[low, high]| high.abs().max(low.abs())).filter(|largest| *largest > most)?;
        Some(format!(
            "the {name} of the training runs reaches {largest:.4} {unit}, and no damper exceeds {most} {unit}: is the unit right? The name of \
             a column says its unit, as in displacement_mm or current_ma"
        ))
    };
    quantities.into_iter().filter_map(doubt).collect()
}

/// The error for the run `path`, which has the same content as `same`.
fn given_twice(path: &Path, same: &Path, sha256: &str) -> NodeError {
    NodeError::File {
        path: path.to_owned(),
        message: format!(
            "has the same content as {} (SHA-256 {}...): twice, a run counts double or validates itself. Give another run, or leave it out",
            same.display(),
            &sha256[..12]
        ),
    }
}

/// The model that `args` ask for.
///
/// # Errors
/// When the model does not have this form or variant.
pub fn spec(args: &Args) -> Result<ModelSpec, NodeError> {
    let form = match (args.passive, args.fuzzy, args.free_sets) {
        (true, _, _) => Form::Passive,
        (false, _, true) => Form::FreeFuzzy,
        (false, true, false) => Form::Fuzzy,
        (false, false, false) => Form::SemiActive,
    };
    let spec = ModelSpec::named(&args.model, form)?;
    match args.fit.as_deref().and_then(Variant::named) {
        Some(fit) => Ok(spec.with_variant(fit)?),
        None => Ok(spec),
    }
}

/// An identified model, its inverse model if one was asked for, and their errors on the training and validation runs.
#[derive(Debug)]
pub struct Identification {
    /// The model file.
    pub file: ModelFile,
    spec: ModelSpec,
    /// Its model is the one in the file.
    found: Identified,
    inverse: Option<InverseReport>,
    validation: Option<Scores>,
    seconds: f64,
    restarts: u32,
    seed: u64,
}

impl Identification {
    /// Identifies `spec` with the options of `args` from `runs` (each with the SHA-256 of its source), and scores it on the runs `held_out`.
    /// The paths in `args` are not used.
    ///
    /// # Errors
    /// When the model cannot be identified from the runs, or cannot be scored on those held out; [`NodeError::Interrupted`].
    pub fn of(
        spec: ModelSpec,
        (runs, hashes): (&[Run], &[String]),
        (held_out, held_out_hashes): (&[Run], &[String]),
        args: &Args,
        context: &CliContext,
    ) -> Result<Self, NodeError> {
        let start = Instant::now();
        let mut found = fit(spec, runs, args, context)?;
        let seconds = start.elapsed().as_secs_f64();
        let mut inverse = fit_inverse(&mut found, runs, args, context)?;
        let validation = validate(&mut found, held_out, context)?;
        if let Some((report, model)) = inverse.as_mut().zip(found.model.inverse) {
            report.validation = score_inverse(&model, &found.model, held_out, &args.conditioning.dataset())?;
        }
        let mut provenance = provenance(args, &found, hashes, validation);
        provenance.runs.extend(held_out.iter().zip(held_out_hashes).map(|(run, sha256)| TrainingRun {
            sha256: sha256.clone(),
            ..TrainingRun::of(run, Role::Validate)
        }));
        let file = ModelFile { model: found.model, provenance };
        let (restarts, seed) = (args.restarts, args.seed);
        Ok(Self { file, spec, found, inverse, validation, seconds, restarts, seed })
    }

    /// The figures, for JSON.
    #[must_use]
    pub fn report(&self) -> Report<'_> {
        let Self { found, inverse, .. } = self;
        let conditioning = &found.model.conditioning;
        Report {
            schema: "mr-damper/identify/1",
            model: found.model.force.name(),
            form: self.spec.form().name(),
            parameters: found.model.force.parameter_count(),
            restarts: self.restarts,
            seed: self.seed,
            seconds: self.seconds,
            rank: found.rank,
            velocity: velocity_text(conditioning.velocity, conditioning.slope_window_s),
            velocity_trials: found
                .velocity_trials
                .iter()
                .map(|trial| VelocityReport {
                    velocity: velocity_text(trial.velocity, trial.slope_window_s),
                    mean_esr: trial.mean_esr,
                })
                .collect(),
            training: Scores {
                free_run: found.free_run,
                one_step: found.one_step,
                persistence: found.persistence,
            },
            validation: self.validation,
            band_calibrated: found.model.expected.uncertainty.is_some(),
            runs: found.runs.iter().map(run_report).collect(),
            active_bounds: found
                .active_bounds
                .iter()
                .map(|b| format!("{} = {}", b.parameter, b.value))
                .collect(),
            swept: found.swept.as_ref().map(SweptReport::of),
            without_prior: found.without_prior.as_ref().map(WithoutPriorReport::of),
            warnings: &found.warnings,
            estimates: found.parameters.iter().map(Estimate::of).collect(),
            restart_rsse_n: &found.restart_rsse_n,
            inverse: inverse.as_ref(),
        }
    }

    /// The report with plots of the runs as HTML.
    ///
    /// # Errors
    /// When the model cannot be stepped over a run.
    pub fn page(&self, runs: &[Run], held_out: &[Run]) -> Result<String, NodeError> {
        Ok(page::html(&pictured(&self.found.model, runs, held_out, &self.report())?))
    }

    /// The coefficients as a table, with the spread of refits to resampled runs if `args` ask for them.
    fn coefficients(
        &self,
        runs: &[Run],
        format: Format,
        args: &Args,
        context: &CliContext,
    ) -> Result<String, NodeError> {
        let draws = match args.bootstrap {
            Some(draws) => Some(bootstrap(self.spec, &self.found, runs, draws, args, context)?),
            None => None,
        };
        let (coefficients, notes) = fitted::rows(&self.found, runs.len(), draws)?;
        Ok(coefficients::table(&coefficients, format, &notes))
    }

    /// Remarks on the fit: what a user should know before using the model.
    #[must_use]
    pub fn remarks(&self) -> Vec<String> {
        remarks(&self.report())
    }
}

fn fit(spec: ModelSpec, runs: &[Run], args: &Args, context: &CliContext) -> Result<Identified, NodeError> {
    let options = options(args)?;
    watched(context, |watch| identify(spec, runs, &options, watch))
}

/// Fits `draws` times to resampled runs. The derivative and the fuzzy sets are those of `found`, so that the coefficients mean
/// the same in each fit.
fn bootstrap(
    spec: ModelSpec,
    found: &Identified,
    runs: &[Run],
    draws: u32,
    args: &Args,
    context: &CliContext,
) -> Result<Draws, NodeError> {
    let given = options(args)?;
    let placement = found.memberships.as_ref().map_or(given.placement, |memberships| Placement::Given {
        centres: memberships.sets.centres().to_vec(),
        sigma: memberships.sets.sigmas().first().copied(),
    });
    let options =
        Options { conditioning: found.model.conditioning, choose_velocity: false, placement, ..given };
    let working = Working::new(context.quiet);
    working.stage("bootstrap over runs");
    let watch = Watch { cancel: Some(context.interrupt.flag()), progress: None };
    let mut result = Draws::default();
    for (done, drawn) in resampled_runs(runs.len(), draws as usize, args.seed).into_iter().enumerate() {
        let drawn: Vec<Run> = drawn.into_iter().map(|run| runs[run].clone()).collect();
        match identify(spec, &drawn, &options, &watch) {
            Ok(fitted) => result.fitted.push(coefficients::of_model(&fitted.model)?),
            Err(mr_damper_model::Error::Cancelled) => return Err(NodeError::Interrupted),
            // Runs that lack a level cannot place the model there. The note counts such draws.
            Err(error) => {
                result.failed += 1;
                result.first_failure.get_or_insert(error.to_string());
            }
        }
        working.done("fits", done as u64 + 1, u64::from(draws));
    }
    Ok(result)
}

/// Identifies the inverse model that was asked for, and puts it into the model.
fn fit_inverse(
    found: &mut Identified,
    runs: &[Run],
    args: &Args,
    context: &CliContext,
) -> Result<Option<InverseReport>, NodeError> {
    let Some(kind) = args.inverse.as_deref().and_then(InverseKind::named) else { return Ok(None) };
    let options = options(args)?;
    let start = Instant::now();
    let inverse = watched(context, |watch| identify_inverse(kind, found, runs, &options, watch))?;
    found.model.inverse = Some(inverse.model);
    Ok(Some(InverseReport {
        kind: kind.name(),
        parameters: inverse.model.parameter_count(),
        seconds: start.elapsed().as_secs_f64(),
        training: inverse.training,
        validation: None,
        warnings: inverse.warnings,
    }))
}

/// The options of the identification.
fn options(args: &Args) -> Result<Options, NodeError> {
    Ok(Options {
        conditioning: args.conditioning.conditioning(FilterArg::None, VelocityArg::Backward)?,
        choose_velocity: args.conditioning.velocity.is_none(),
        dataset: args.conditioning.dataset(),
        placement: match (&args.centres, args.sets) {
            (Some(centres), _) => Placement::Given { centres: centres.clone(), sigma: args.sigma },
            (None, Some(sets)) => Placement::Even(sets),
            (None, None) => Placement::FromRuns,
        },
        degree: usize::from(args.degree),
        loss: match args.huber {
            Some(threshold_n) => Loss::Huber { threshold_n },
            None => Loss::Squares,
        },
        most_rows: None,
        restarts: args.restarts,
        seed: args.seed,
    })
}

/// Runs `work` with a progress display; it ends when interrupted.
fn watched<T>(
    context: &CliContext,
    work: impl FnOnce(&Watch) -> Result<T, mr_damper_model::Error>,
) -> Result<T, NodeError> {
    let working = Working::of(context);
    let progress = |progress| working.progress(progress);
    let watch = Watch { cancel: Some(context.interrupt.flag()), progress: Some(&progress) };
    Ok(work(&watch)?)
}

/// Scores the model on the held-out runs. Their error becomes the model's expected error, and they calibrate its band.
fn validate(
    found: &mut Identified,
    held_out: &[Run],
    context: &CliContext,
) -> Result<Option<Scores>, NodeError> {
    if held_out.is_empty() {
        return Ok(None);
    }
    let mut all = Evaluator::default();
    let mut calibrator = Calibrator::new(found.model);
    for run in held_out {
        if context.interrupt.is_raised() {
            return Err(NodeError::Interrupted);
        }
        evaluate_into(&mut all, found.model, run, Settings::default(), |_| true)?;
        calibrator.add(run)?;
    }
    match calibrator.finish() {
        Ok(uncertainty) => found.model.expected.uncertainty = Some(uncertainty),
        Err(why) => found.warnings.push(format!("the 90 % band of the estimates is not calibrated: {why}")),
    }
    let scored = all.finish();
    expect(&mut found.model.expected, &scored);
    Ok(Some(Scores { free_run: scored.free_run, one_step: scored.one_step, persistence: scored.persistence }))
}

fn provenance(args: &Args, found: &Identified, hashes: &[String], validation: Option<Scores>) -> Provenance {
    Provenance {
        tool: TOOL.to_owned(),
        date: date(),
        seed: args.seed,
        restarts: u32::try_from(found.restart_rsse_n.len()).unwrap_or(args.restarts),
        rank: found.rank.and_then(|rank| u32::try_from(rank).ok()),
        weak_prior: found.without_prior.is_some(),
        runs: found
            .runs
            .iter()
            .zip(hashes)
            .map(|(run, sha256)| TrainingRun {
                name: run.name.clone(),
                sha256: sha256.clone(),
                samples: run.samples,
                force_offset_n: run.force_offset_n,
                role: None,
            })
            .collect(),
        training_free_run: found.free_run,
        training_one_step: found.one_step,
        validation_free_run: validation.and_then(|v| v.free_run),
        validation_one_step: validation.and_then(|v| v.one_step),
        persistence: found.persistence,
    }
}

/// Steps every run through the pipeline with the identified model, for the plots of the report.
fn pictured(
    model: &Model,
    fitted: &[Run],
    held_out: &[Run],
    report: &Report<'_>,
) -> Result<IdentifyOutcome, NodeError> {
    let step = |run: &Run, held_out| -> Result<SteppedRun, NodeError> {
        let mut pipeline = Pipeline::new(Models::alone(*model), Settings::default())?;
        let mut recording = Recording::default();
        for sample in run.samples() {
            pipeline.step(&sample, &mut |event| recording.take(&event));
        }
        let name = Path::new(&run.name).file_name().map_or(run.name.clone(), |n| n.to_string_lossy().into());
        Ok(SteppedRun { name, held_out, recording })
    };
    let runs = fitted.iter().map(|run| step(run, false)).chain(held_out.iter().map(|run| step(run, true)));
    let row = |name: &str, value: String| (name.to_owned(), value);
    Ok(IdentifyOutcome {
        what: headline(report),
        figures: figures(report),
        notes: remarks(report),
        drive: model.force.drive().unwrap_or(DriveKind::CoilCurrent),
        runs: runs.collect::<Result<_, _>>()?,
        provenance: vec![
            row("made by", TOOL.to_owned()),
            row("seed", report.seed.to_string()),
            row("restarts", report.restarts.to_string()),
        ],
    })
}
