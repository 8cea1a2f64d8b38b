//! `mr-damper evaluate`: reports how well a model predicts recorded runs.

mod relation;

use crate::commands::context::CliContext;
use crate::commands::output;
use crate::commands::run_args::RunArgs;
use crate::commands::targets::{self, Target};
use crate::commands::units::{Units, UnitsArgs};
use crate::estimation::models;
use crate::settings::error::{NodeError, PartError};
use mr_damper_base::shown;
use mr_damper_model::calibrate::Calibrator;
use mr_damper_model::metrics::Fit;
use mr_damper_model::model_file::{ModelFile, Provenance, Role, TrainingRun};
use mr_damper_model::sample::Channel;
use mr_damper_reports::evaluate::{RunReport, figures};
use mr_damper_runs::{Loaded, write_text};
use serde::Serialize;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// Report how well a model predicts recorded runs: RMSE and NMSE (RSSE and ESR in the thesis).
///
/// Two predictions are scored: the simulation (free_run in JSON), which uses displacement and drive only, and the
/// one-step-ahead prediction (one_step in JSON; ARX only), which also uses the measured force. Persistence, which repeats
/// the last measured force, is the baseline for the one-step-ahead prediction. If the model has a calibrated 90 % band, the
/// share of measured forces within it is reported too.
///
/// All samples with a measured force count, also those at rest, as in live use; identify and compare count the moving
/// part. Runs that the model was made with are marked, and the total leaves them out.
///
/// A relation p (a preset thesis/p-...) needs runs with measured force. It is not a prediction: the table shows how well it
/// explains the measured force of an instant by the same force and its derivatives.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Model file, or preset.
    #[arg(value_name = "MODEL")]
    pub model: String,
    /// Runs: CSV files, rosbag2 directories, .mcap files, logs of a CAN bus.
    #[arg(required = true, value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    /// Write the figures as JSON to a file; without a file name, or with -, to stdout in place of the table.
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-")]
    pub json: Option<PathBuf>,
    /// Also write the model to a file, with its standard deviation and 90 % band calibrated on these runs. Give at least
    /// three runs that the model was not identified from and that resemble its later use.
    #[arg(long, value_name = "MODEL.toml")]
    pub calibrate: Option<PathBuf>,
    /// Unit of forces.
    #[command(flatten)]
    pub units: UnitsArgs,
    /// How runs are read.
    #[command(flatten)]
    pub load: RunArgs,
}

/// The figures of a model on several runs, as they are written to JSON.
#[derive(Debug, Serialize)]
pub struct Report<'a> {
    schema: &'static str,
    model: &'a str,
    runs: Vec<EvaluatedRun>,
    /// Over the runs that neither the model nor its band depends on, if there are at least two.
    #[serde(skip_serializing_if = "Option::is_none")]
    other_runs: Option<Totals>,
}

/// A run with the model's errors.
#[derive(Debug, Serialize)]
pub struct EvaluatedRun {
    #[serde(flatten)]
    figures: RunReport,
    /// Purpose that the run served when the model was made.
    #[serde(skip_serializing_if = "Option::is_none")]
    used_as: Option<Role>,
}

impl<'a> Report<'a> {
    /// The figures of the model that is called `model`, and their totals.
    #[must_use]
    pub fn of(model: &'a str, runs: Vec<EvaluatedRun>) -> Self {
        let other_runs = Totals::of(&runs);
        Self { schema: "mr-damper/evaluate/1", model, runs, other_runs }
    }
}

impl EvaluatedRun {
    /// The figures of the model in `file` on a run called `name`.
    ///
    /// # Errors
    /// When the run lacks a channel that the model needs, or its drive is of another kind.
    pub fn of(name: String, file: &ModelFile, loaded: &Loaded) -> Result<Self, NodeError> {
        let used_as = used_as(&file.provenance, &loaded.sha256_hex());
        Ok(Self { figures: figures(name, file.model, &loaded.run)?, used_as })
    }

    /// True if the model or its band depends on the run. Test runs were only read.
    fn is_fitted(&self) -> bool {
        self.used_as.is_some_and(|role| role != Role::Test)
    }

    /// True if a sample has both an estimate and a measured force.
    const fn is_compared(&self) -> bool {
        self.figures.free_run.is_some() || self.figures.one_step.is_some()
    }
}

/// No run has a figure.
#[derive(Debug, thiserror::Error)]
#[error(
    "{model} cannot be evaluated: no sample has both an estimate and a measured force. `mr-damper predict` on a run says why"
)]
struct NothingCompared {
    model: String,
}

impl PartError for NothingCompared {}

/// Errors over several runs.
#[derive(Debug, Serialize)]
struct Totals {
    runs: usize,
    free_run: Option<Fit>,
    free_run_without_offset: Option<Fit>,
    one_step: Option<Fit>,
    persistence: Option<Fit>,
}

impl Totals {
    fn of(all: &[EvaluatedRun]) -> Option<Self> {
        let others: Vec<&RunReport> =
            all.iter().filter(|run| !run.is_fitted()).map(|run| &run.figures).collect();
        let total = |fit: fn(&RunReport) -> Option<Fit>| pooled(others.iter().map(|run| fit(run)));
        (others.len() > 1).then(|| Self {
            runs: others.len(),
            free_run: total(|run| run.free_run),
            free_run_without_offset: total(|run| run.free_run_without_offset),
            one_step: total(|run| run.one_step),
            persistence: total(|run| run.persistence),
        })
    }
}

/// The error over all samples, relative to the variance within each run; `None` if it is not known for each run.
fn pooled(fits: impl Iterator<Item = Option<Fit>>) -> Option<Fit> {
    let (mut samples, mut squares, mut spread) = (0, 0.0, 0.0);
    for fit in fits {
        let fit = fit?;
        let square = fit.samples as f64 * fit.rsse_n.powi(2);
        samples += fit.samples;
        squares += square;
        // A run without any error says nothing about its variance.
        spread += if fit.esr > 0.0 { square / fit.esr } else { 0.0 };
    }
    Some(Fit { rsse_n: (squares / samples as f64).sqrt(), esr: squares / spread, samples })
}

/// Evaluates the model on all runs and prints the figures.
///
/// # Errors
/// When the model or a run does not load, or they do not fit together; when no run has a sample to compare, in which case the figures are
/// printed all the same.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    if let Some(relation) = relation::named(&args.model) {
        return relation::run(args, &relation, context);
    }
    let (runs, json) = (args.runs.iter().map(PathBuf::as_path), targets::json(args.json.as_deref()));
    targets::check([Path::new(&args.model)], json)?;
    // The calibrated model may take the place of the model.
    targets::check(runs, args.calibrate.iter().map(|path| Target::new("--calibrate", path)).chain(json))?;
    let mut file = models::load_whole(&args.model)?;
    let mut calibrator = Calibrator::new(file.model);
    let (mut reports, mut calibrated_on) = (Vec::with_capacity(args.runs.len()), HashSet::new());
    let mut calibration = Vec::new();
    for path in &args.runs {
        if context.interrupt.is_raised() {
            return Err(NodeError::Interrupted);
        }
        let loaded = args.load.load(path)?;
        let report = EvaluatedRun::of(path.display().to_string(), &file, &loaded)?;
        let used_as = report.used_as;
        reports.push(report);
        if args.calibrate.is_some() {
            check_for_calibration(path, used_as, loaded.sha256, &mut calibrated_on)?;
            calibrator.add(&loaded.run)?;
            if used_as.is_none() {
                let run = TrainingRun::of(&loaded.run, Role::Validate);
                calibration.push(TrainingRun { sha256: loaded.sha256_hex(), ..run });
            }
        }
    }
    let report = Report::of(&args.model, reports);
    match &args.json {
        Some(path) => output::json(path, &report)?,
        None => print!("{}", shown::lines(&table(&report, args.units.units))),
    }
    if !report.runs.iter().any(EvaluatedRun::is_compared) {
        return Err(NothingCompared { model: args.model.clone() }.into());
    }
    if let Some(out) = &args.calibrate {
        file.model.expected.uncertainty = Some(calibrator.finish()?);
        file.provenance.runs.extend(calibration);
        write_text(out, &file.to_toml()?)?;
        tracing::info!(model = %out.display(), runs = args.runs.len(), "calibrated");
    }
    Ok(())
}

/// Refuses the run `path` for a calibration if the model was identified from it, or if it is among the runs `before`.
fn check_for_calibration(
    path: &Path,
    used_as: Option<Role>,
    sha256: [u8; 32],
    before: &mut HashSet<[u8; 32]>,
) -> Result<(), NodeError> {
    let why = match used_as {
        Some(Role::Base | Role::Estimate) => {
            "the model was identified from this run, so a band that is calibrated on it is too narrow"
        }
        _ if !before.insert(sha256) => "the run is given twice, so it would count double in the calibration",
        _ => return Ok(()),
    };
    Err(NodeError::File { path: path.to_owned(), message: format!("{why}. Leave it out of --calibrate") })
}

/// Purpose that the run with this SHA-256 served when the model was made; `None` if it served none.
fn used_as(provenance: &Provenance, sha256: &str) -> Option<Role> {
    let run = provenance.runs.iter().find(|run| run.sha256 == sha256)?;
    Some(run.role.unwrap_or(Role::Estimate))
}

fn table(report: &Report<'_>, units: Units) -> String {
    let mut text = format!("{}\n", report.model);
    for evaluated in &report.runs {
        let EvaluatedRun { figures: run, used_as } = evaluated;
        let mark = match used_as {
            Some(Role::Base | Role::Estimate) => " (a training run of the model)",
            Some(Role::Test) => " (a test run of the model)",
            Some(Role::Validate) => " (a validation run of the model)",
            Some(_) => " (used when the model was made)",
            None => "",
        };
        text += &format!("\n{}{mark}\n", shown::line(&run.run));
        text += &rows([run.free_run, run.free_run_without_offset, run.one_step, run.persistence], units);
        if let Some(band) = &run.band {
            text += &format!(
                "  within the 90 % band      {:.1} % of {}\n",
                100.0 * band.share,
                shown::count(band.samples, "sample")
            );
        }
        text += &if evaluated.is_compared() {
            format!("  mean error {:.2} {}\n", units.of_n(run.offset_n), units.symbol())
        } else {
            nothing_to_compare(run)
        };
        for refused in run.refusals.texts() {
            text += &format!("  {refused}\n");
        }
    }
    if let Some(all) = &report.other_runs {
        let excluded = if all.runs < report.runs.len() { " that the model was not made with" } else { "" };
        text += &format!("\nall {} runs{excluded}\n", all.runs);
        text += &rows([all.free_run, all.free_run_without_offset, all.one_step, all.persistence], units);
    }
    text
}

/// The line of a run without figures.
fn nothing_to_compare(run: &RunReport) -> String {
    // Without a displacement, `predict` has no row either.
    let more = if run.refusals.is_all_of(Channel::Displacement) {
        ""
    } else {
        ". The column `reasons` of `mr-damper predict` says why for each displacement"
    };
    format!("  nothing to compare: no sample has both an estimate and a measured force{more}\n")
}

/// The errors of the simulation, of the simulation without offset, of the one-step-ahead prediction, and of persistence.
fn rows(fits: [Option<Fit>; 4], units: Units) -> String {
    let names =
        ["simulation (free run)", "simulation, offset out", "one step ahead", "persistence (one step)"];
    names.into_iter().zip(fits).map(|(name, fit)| row(name, fit, units)).collect()
}

/// The line of one kind of error.
fn row(name: &str, fit: Option<Fit>, units: Units) -> String {
    match fit {
        Some(fit) => format!(
            "  {name:<24} RMSE {:9.2} {}   NMSE {:.6}   {}\n",
            units.of_n(fit.rsse_n),
            units.symbol(),
            fit.esr,
            shown::count(fit.samples, "sample")
        ),
        None => format!("  {name:<24} -\n"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_total_weighs_runs_by_their_samples() {
        // 100 samples with an error of 3 N, 300 with 5 N; variances of 90 and 100 N².
        let fits =
            [Fit { rsse_n: 3.0, esr: 0.1, samples: 100 }, Fit { rsse_n: 5.0, esr: 0.25, samples: 300 }];
        let all = pooled(fits.into_iter().map(Some)).expect("both are known");
        assert_eq!(all.samples, 400);
        assert!((all.rsse_n - 21.0_f64.sqrt()).abs() < 1e-12, "{all:?}");
        assert!((all.esr - 21.0 / 97.5).abs() < 1e-12, "{all:?}");
        assert_eq!(pooled([Some(fits[0]), None].into_iter()), None);
    }
}
