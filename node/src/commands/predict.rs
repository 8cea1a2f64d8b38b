//! `mr-damper predict`: the forces of a model at the stamps of a recorded run, as a table.

use crate::commands::context::CliContext;
use crate::commands::run_args::RunArgs;
use crate::estimation::models;
use crate::settings::error::NodeError;
use mr_damper_base::shown;
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{
    Estimate, Event, Mode, Models, Pipeline, Reasons, Residual, Settings, Slot, Validity,
};
use mr_damper_model::sample::{Run, Stamp};
use mr_damper_runs::{seconds_text, write_text};
use std::collections::HashMap;
use std::path::PathBuf;

/// Write the force of a model at each displacement of a recorded run to a CSV file.
///
/// The columns are the estimate that the node would publish, the simulation (displacement and drive alone), the
/// one-step-ahead prediction (models that use measured force, where it was measured), the 90 % band, the measured force,
/// the residual of the simulation, the mode, the validity and its reasons. A value that does not exist is an empty cell.
/// Stamps are those of the run, exact to the nanosecond.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Model file, or preset.
    #[arg(value_name = "MODEL")]
    model: String,
    /// Run: a CSV file, rosbag2 directory, .mcap file or log of a CAN bus. Measured force is used if the run has it.
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// File to write.
    #[arg(long, value_name = "FILE.csv")]
    out: PathBuf,
    /// How the run is read.
    #[command(flatten)]
    load: RunArgs,
}

/// The columns, with their units.
const COLUMNS: &str = "time_s,estimate_n,simulation_n,one_step_n,band_low_n,band_high_n,band_calibrated,\
                       measured_n,residual_n,mode,validity,reasons";

/// Steps the model over the run and writes the table.
///
/// # Errors
/// When the model or the run does not load, the run lacks a channel that the model needs, or the file cannot be written; when
/// interrupted, in which case nothing is written.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    let model = models::load(&args.model)?;
    let run = args.load.load(&args.run)?.run;
    let Some(rows) = predict(&model, &run, || context.interrupt.is_raised())? else {
        return Err(NodeError::Interrupted);
    };
    let mut text = format!("{COLUMNS}\n");
    for row in &rows {
        push_row(&mut text, row);
    }
    write_text(&args.out, &text)?;
    if !context.quiet {
        let valid = rows.iter().filter(|row| row.estimate_n.is_finite()).count();
        let line = format!(
            "{} at {} in {}",
            shown::count(valid, "force"),
            shown::count(rows.len(), "displacement"),
            args.out.display()
        );
        eprintln!("{}", shown::line(&line));
    }
    Ok(())
}

/// The forces of a model at one displacement of a run. A value that does not exist is NaN.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictedRow {
    /// Stamp of the displacement.
    pub stamp: Stamp,
    /// Force that the node would publish, N.
    pub estimate_n: f64,
    /// Force of the simulation, from displacement and drive alone, N.
    pub simulation_n: f64,
    /// One-step-ahead prediction, N.
    pub one_step_n: f64,
    /// 90 % band of the estimate, low and high, N.
    pub band_n: [f64; 2],
    /// True if the band is calibrated.
    pub band_calibrated: bool,
    /// Measured force, filtered as the model's output, N.
    pub measured_n: f64,
    /// Measured minus simulated reading of the load cell, N.
    pub residual_n: f64,
    /// Mode of the pipeline.
    pub mode: Mode,
    /// How far the estimate can be trusted.
    pub validity: Validity,
    /// Why it is not valid.
    pub reasons: Reasons,
}

impl PredictedRow {
    /// The row of an estimate.
    #[must_use]
    pub fn of(estimate: &Estimate, residual: Option<&Residual>) -> Self {
        // The mode's model alone: the estimate is smoothed after a change of mode.
        let own_n = estimate.unsmoothed_n();
        let [measured_n, residual_n] =
            residual.map_or([f64::NAN; 2], |residual| [residual.measured.get(), residual.residual.get()]);
        Self {
            stamp: estimate.stamp,
            estimate_n: estimate.force.get(),
            simulation_n: match (residual, estimate.slot) {
                (Some(residual), _) => residual.predicted.get() - residual.load_cell.get(),
                (None, Slot::Free) => own_n,
                (None, _) => f64::NAN,
            },
            one_step_n: if estimate.mode == Mode::Arx { own_n } else { f64::NAN },
            band_n: estimate.band.map(|end| end.get()),
            band_calibrated: estimate.calibrated,
            measured_n,
            residual_n,
            mode: estimate.mode,
            validity: estimate.validity,
            reasons: estimate.reasons,
        }
    }
}

/// The forces of `model` at each displacement of `run`; `None` when `cancelled`.
///
/// # Errors
/// When the run lacks a channel that the model needs, or its drive is of another kind.
pub fn predict(
    model: &Model,
    run: &Run,
    cancelled: impl Fn() -> bool,
) -> Result<Option<Vec<PredictedRow>>, NodeError> {
    mr_damper_model::evaluate::require_inputs(model, run)?;
    let pipeline = Pipeline::new(Models::alone(*model), Settings::default())?;
    let Some((estimates, residuals)) = stepped(pipeline, run, cancelled) else { return Ok(None) };
    let row = |estimate: &Estimate| PredictedRow::of(estimate, residuals.get(&estimate.stamp));
    Ok(Some(estimates.iter().map(row).collect()))
}

/// The estimates of `run`, and the residuals by stamp; `None` when `cancelled`.
fn stepped(
    mut pipeline: Pipeline,
    run: &Run,
    cancelled: impl Fn() -> bool,
) -> Option<(Vec<Estimate>, HashMap<Stamp, Residual>)> {
    let (mut estimates, mut residuals) = (Vec::new(), HashMap::new());
    for (index, sample) in run.samples().enumerate() {
        if index % 4096 == 0 && cancelled() {
            return None;
        }
        pipeline.step(&sample, &mut |event| match event {
            Event::Estimate(estimate) => estimates.push(estimate),
            Event::Residual(residual) => {
                residuals.insert(residual.stamp, residual);
            }
            _ => {}
        });
    }
    Some((estimates, residuals))
}

/// Appends a row of the table.
fn push_row(text: &mut String, row: &PredictedRow) {
    let [low_n, high_n] = row.band_n;
    let cell = |value: f64| if value.is_finite() { value.to_string() } else { String::new() };
    let reasons: Vec<&str> = row.reasons.names().collect();
    let cells = [
        seconds_text(row.stamp),
        cell(row.estimate_n),
        cell(row.simulation_n),
        cell(row.one_step_n),
        cell(low_n),
        cell(high_n),
        row.band_calibrated.to_string(),
        cell(row.measured_n),
        cell(row.residual_n),
        row.mode.name().to_owned(),
        row.validity.name().to_owned(),
        reasons.join("|"),
    ];
    text.push_str(&cells.join(","));
    text.push('\n');
}
