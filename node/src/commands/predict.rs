//! `mr-damper predict`: the forces of a model at the stamps of a recorded run, as a table.

use crate::commands::context::CliContext;
use crate::commands::run_args::RunArgs;
use crate::estimation::models;
use crate::settings::error::NodeError;
use mr_damper_base::shown;
use mr_damper_model::pipeline::{Estimate, Event, Mode, Models, Pipeline, Residual, Settings, Slot};
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
    /// Run: a CSV file, rosbag2 directory or .mcap file. Measured force is used if the run has it.
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
    mr_damper_model::evaluate::require_inputs(&model, &run)?;
    let pipeline = Pipeline::new(Models::alone(model), Settings::default())?;
    let Some((estimates, residuals)) = stepped(pipeline, &run, || context.interrupt.is_raised()) else {
        return Err(NodeError::Interrupted);
    };
    let mut text = format!("{COLUMNS}\n");
    for estimate in &estimates {
        push_row(&mut text, estimate, residuals.get(&estimate.stamp));
    }
    write_text(&args.out, &text)?;
    if !context.quiet {
        let valid = estimates.iter().filter(|e| e.force.get().is_finite()).count();
        let line = format!(
            "{} at {} in {}",
            shown::count(valid, "force"),
            shown::count(estimates.len(), "displacement"),
            args.out.display()
        );
        eprintln!("{}", shown::line(&line));
    }
    Ok(())
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

/// Appends the row of an estimate.
fn push_row(text: &mut String, estimate: &Estimate, residual: Option<&Residual>) {
    // The mode's model alone: the estimate is smoothed after a change of mode.
    let own_n = estimate.unsmoothed_n();
    let simulated_n = match (residual, estimate.slot) {
        (Some(residual), _) => residual.predicted.get() - residual.load_cell.get(),
        (None, Slot::Free) => own_n,
        (None, _) => f64::NAN,
    };
    let one_step_n = if estimate.mode == Mode::Arx { own_n } else { f64::NAN };
    let [low_n, high_n] = estimate.band.map(|end| end.get());
    let [measured_n, residual_n] =
        residual.map_or([f64::NAN; 2], |residual| [residual.measured.get(), residual.residual.get()]);
    let cell = |value: f64| if value.is_finite() { value.to_string() } else { String::new() };
    let reasons: Vec<&str> = estimate.reasons.names().collect();
    let cells = [
        seconds_text(estimate.stamp),
        cell(estimate.force.get()),
        cell(simulated_n),
        cell(one_step_n),
        cell(low_n),
        cell(high_n),
        estimate.calibrated.to_string(),
        cell(measured_n),
        cell(residual_n),
        estimate.mode.name().to_owned(),
        estimate.validity.name().to_owned(),
        reasons.join("|"),
    ];
    text.push_str(&cells.join(","));
    text.push('\n');
}
