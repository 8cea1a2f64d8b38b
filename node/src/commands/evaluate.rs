//! `mr-damper evaluate`: reports how well a model predicts recorded runs.

use crate::commands::context::CliContext;
use crate::commands::output;
use crate::commands::run_args::RunArgs;
use crate::estimation::models;
use crate::settings::error::NodeError;
use mr_damper_base::shown;
use mr_damper_model::calibrate::Calibrator;
use mr_damper_model::metrics::Fit;
use mr_damper_model::units::N_PER_LBF;
use mr_damper_reports::evaluate::{RunReport, figures};
use mr_damper_runs::write_text;
use serde::Serialize;
use std::path::PathBuf;

/// Report how well a model predicts recorded runs: RMSE and NMSE (RSSE and ESR in the thesis).
///
/// Two predictions are scored: the simulation (free_run in JSON), which uses displacement and drive only, and the
/// one-step-ahead prediction (one_step in JSON; ARX only), which also uses the measured force. Persistence, which repeats
/// the last measured force, is the baseline for the one-step-ahead prediction. If the model has a calibrated 90 % band, the
/// share of measured forces within it is reported too.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Model file, or preset.
    #[arg(value_name = "MODEL")]
    pub model: String,
    /// Runs: CSV files, rosbag2 directories, .mcap files.
    #[arg(required = true, value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    /// Write the figures as JSON to a file; without a file name, or with -, to stdout in place of the table.
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-")]
    pub json: Option<PathBuf>,
    /// Also write the model to a file, with its standard deviation and 90 % band calibrated on these runs. Give at least
    /// three runs that the model was not identified from and that resemble its later use.
    #[arg(long, value_name = "MODEL.toml")]
    pub calibrate: Option<PathBuf>,
    /// How runs are read.
    #[command(flatten)]
    pub load: RunArgs,
}

#[derive(Debug, Serialize)]
struct Report<'a> {
    schema: &'static str,
    model: &'a str,
    runs: Vec<RunReport>,
}

/// Evaluates the model on all runs and prints the figures.
///
/// # Errors
/// When the model or a run does not load, or they do not fit together.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    let mut file = models::load_whole(&args.model)?;
    let model = file.model;
    let mut calibrator = Calibrator::new(model);
    let mut reports = Vec::with_capacity(args.runs.len());
    for path in &args.runs {
        if context.interrupt.is_raised() {
            return Err(NodeError::Interrupted);
        }
        let loaded = args.load.load(path)?;
        reports.push(figures(path.display().to_string(), model, &loaded.run)?);
        if args.calibrate.is_some() {
            calibrator.add(&loaded.run)?;
        }
    }
    let report = Report { schema: "mr-damper/evaluate/1", model: &args.model, runs: reports };
    match &args.json {
        Some(path) => output::json(path, &report)?,
        None => print!("{}", shown::lines(&table(&report))),
    }
    if let Some(out) = &args.calibrate {
        file.model.expected.uncertainty = Some(calibrator.finish()?);
        write_text(out, &file.to_toml()?)?;
        tracing::info!(model = %out.display(), runs = args.runs.len(), "calibrated");
    }
    Ok(())
}

fn table(report: &Report<'_>) -> String {
    let mut text = format!("{}\n", report.model);
    for run in &report.runs {
        text += &format!("\n{}\n", shown::line(&run.run));
        let mut row = |name: &str, fit: &Option<Fit>| {
            text += &match fit {
                Some(fit) => format!(
                    "  {name:<24} RMSE {:9.2} N ({:7.2} lbf)   NMSE {:.6}   {} samples\n",
                    fit.rsse_n,
                    fit.rsse_n / N_PER_LBF,
                    fit.esr,
                    fit.samples
                ),
                None => format!("  {name:<24} -\n"),
            };
        };
        row("simulation (free run)", &run.free_run);
        row("simulation, offset out", &run.free_run_without_offset);
        row("one step ahead", &run.one_step);
        row("persistence (one step)", &run.persistence);
        if let Some(band) = &run.band {
            text += &format!(
                "  within the 90 % band      {:.1} % of {} samples\n",
                100.0 * band.share,
                band.samples
            );
        }
        text += &format!("  mean error {:.2} N", run.offset_n);
        text +=
            &if run.refused > 0 { format!(", {} samples refused\n", run.refused) } else { "\n".to_owned() };
    }
    text
}
