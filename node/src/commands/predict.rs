//! `mr-damper predict`: the forces of a model at the stamps of a recorded run, as a table or as messages in a bag.

use crate::commands::bag_args::BagArgs;
use crate::commands::context::CliContext;
use crate::commands::run_args::RunArgs;
use crate::commands::targets::{self, Target};
use crate::estimation::{models, wire};
use crate::settings::error::NodeError;
use mr_damper_base::shown;
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{
    Estimate, Event, Mode, Models, Pipeline, Reasons, Residual, Settings, Slot, Transition, Validity,
};
use mr_damper_model::sample::{Channel, Run, Stamp};
use mr_damper_reports::evaluate::Refusals;
use mr_damper_runs::{BagMessages, BagWriter, RunError, save_with, seconds_text, write_text};
use std::collections::HashMap;
use std::iter::Peekable;
use std::path::{Path, PathBuf};
use std::vec::IntoIter;

/// Write the force of a model at each displacement of a recorded run to a CSV file or a bag.
///
/// A CSV file is a table. Its columns are the estimate that the node would publish, the simulation (displacement and drive alone), the
/// one-step-ahead prediction (models that use measured force, where it was measured), the 90 % band, the measured force,
/// the residual of the simulation, the mode, the validity and its reasons. A value that does not exist is an empty cell.
/// Stamps are those of the run, exact to the nanosecond. A displacement that is refused, for example because it is not plausible, has no
/// row; a warning counts the refused samples of each channel and says why.
///
/// A bag holds the run and, as the node would publish them, force_estimate, force_residual and mode.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Model file, or preset.
    #[arg(value_name = "MODEL")]
    model: String,
    /// Run: a CSV file, rosbag2 directory, .mcap file or log of a CAN bus. Measured force is used if the run has it.
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// Target: a .csv, .mcap or .db3 file, or a new rosbag2 directory, without extension. A bag must not exist.
    #[arg(long, value_name = "OUT")]
    out: PathBuf,
    /// Namespace of the topics in the bag, e.g. /front_left.
    #[arg(long, value_name = "NS", default_value = "")]
    namespace: String,
    /// How bags are written.
    #[command(flatten)]
    bag: BagArgs,
    /// How the run is read.
    #[command(flatten)]
    load: RunArgs,
}

/// The columns, with their units.
const COLUMNS: &str = "time_s,estimate_n,simulation_n,one_step_n,band_low_n,band_high_n,band_calibrated,\
                       measured_n,residual_n,mode,validity,reasons";

/// Steps the model over the run and writes the table or the bag.
///
/// # Errors
/// When the model or the run does not load, the run lacks a channel that the model needs, all displacements are refused, or the target
/// exists (a bag) or cannot be written; when interrupted. In all these cases nothing is written.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    targets::check([args.run.as_path(), Path::new(&args.model)], [Target::run_or_table("--out", &args.out)])?;
    args.bag.check(&args.out)?;
    let model = models::load(&args.model)?;
    let run = args.load.load(&args.run)?.run;
    let cancelled = || context.interrupt.is_raised();
    let Some(Reported { events, refusals }) = reported(&model, &run, cancelled)? else {
        return Err(NodeError::Interrupted);
    };
    let forces = events.iter().filter_map(|event| match event {
        Event::Estimate(estimate) => Some(estimate.force.get()),
        _ => None,
    });
    let (used, valid) = forces
        .fold((0_u64, 0_u64), |(used, valid), force_n| (used + 1, valid + u64::from(force_n.is_finite())));
    if used == 0 {
        return Err(nothing_used(args, &refusals));
    }
    if args.out.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv")) {
        let mut text = format!("{COLUMNS}\n");
        for row in rows(&events) {
            push_row(&mut text, &row);
        }
        write_text(&args.out, &text)?;
    } else {
        args.save_bag(&model, &run, events)?;
    }
    for text in refusals.texts() {
        tracing::warn!(run = %args.run.display(), "{text}");
    }
    if valid == 0 {
        tracing::warn!(
            run = %args.run.display(),
            "there is no force: at no displacement does the model have all its inputs. The column `reasons` of a CSV target says why"
        );
    }
    if !context.quiet {
        let forces = shown::count(valid, "force");
        let displacements = match refusals.samples(Channel::Displacement) {
            0 => shown::count(used, "displacement"),
            refused => format!("{used} of {}", shown::count(used + refused, "displacement")),
        };
        let line = format!("{forces} at {displacements} in {}", args.out.display());
        eprintln!("{}", shown::line(&line));
    }
    Ok(())
}

/// The error for a run of which no displacement can be used.
fn nothing_used(args: &Args, refusals: &Refusals) -> NodeError {
    let reasons: Vec<String> = refusals.texts().collect();
    let message = format!(
        "no displacement can be used, so {} is not written. {}",
        args.out.display(),
        reasons.join(" ")
    );
    NodeError::File { path: args.run.clone(), message: message.trim_end().to_owned() }
}

impl Args {
    /// Writes the run and the messages of `events`.
    fn save_bag(&self, model: &Model, run: &Run, mut events: Vec<Event>) -> Result<(), NodeError> {
        // A residual has the stamp of its measured force, which may be earlier than that of the displacement before it.
        events.sort_by_key(stamp_of);
        let namespace = format!("/{}", self.namespace.trim_matches('/'));
        let mut messages = EventMessages {
            events: events.into_iter().peekable(),
            names: models::names_alone(&self.model, model)?,
            frame_id: wire::frame_id(&namespace),
            below: namespace.trim_end_matches('/').to_owned(),
        };
        Ok(save_with(run, &self.out, &self.namespace, &self.bag.options(), &mut messages)?)
    }
}

/// Estimates, residuals and changes of mode, as the node would publish them.
struct EventMessages {
    /// In order of their stamps; only events of these three kinds.
    events: Peekable<IntoIter<Event>>,
    names: wire::ModelNames,
    frame_id: String,
    /// Namespace of the topics without a slash at the end.
    below: String,
}

impl BagMessages for EventMessages {
    fn next_stamp(&mut self) -> Option<Stamp> {
        self.events.peek().and_then(stamp_of)
    }

    fn write_next(&mut self, writer: &mut BagWriter) -> Result<(), RunError> {
        let Some(event) = self.events.next() else { return Ok(()) };
        let at_ns = stamp_of(&event).map_or(0, Stamp::nanos);
        let topic = |name: &str| format!("{}/{name}", self.below);
        match event {
            Event::Estimate(estimate) => {
                let message = wire::force_estimate(&estimate, &self.names, &self.frame_id);
                writer.write_message(&topic("force_estimate"), &message, at_ns, at_ns)
            }
            Event::Residual(residual) => {
                let message = wire::force_residual(&residual, &self.frame_id);
                writer.write_message(&topic("force_residual"), &message, at_ns, at_ns)
            }
            Event::Transition(transition) => {
                let message = wire::mode_change(&transition, &self.frame_id);
                writer.write_message(&topic("mode"), &message, at_ns, at_ns)
            }
            _ => Ok(()),
        }
    }
}

/// The stamp of an event that a bag gets; `None` for others.
fn stamp_of(event: &Event) -> Option<Stamp> {
    match event {
        Event::Estimate(Estimate { stamp, .. })
        | Event::Residual(Residual { stamp, .. })
        | Event::Transition(Transition { stamp, .. }) => Some(*stamp),
        _ => None,
    }
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

/// The forces of `model` at each displacement of `run` that the pipeline accepts; `None` when `cancelled`.
///
/// # Errors
/// When the run lacks a channel that the model needs, or its drive is of another kind.
pub fn predict(
    model: &Model,
    run: &Run,
    cancelled: impl Fn() -> bool,
) -> Result<Option<Vec<PredictedRow>>, NodeError> {
    Ok(reported(model, run, cancelled)?.map(|reported| rows(&reported.events).collect()))
}

/// What the pipeline reports on a run.
struct Reported {
    /// Estimates, residuals and changes of mode, in the order in which they come.
    events: Vec<Event>,
    refusals: Refusals,
}

/// What the pipeline reports on `run` with `model`; `None` when `cancelled`.
fn reported(model: &Model, run: &Run, cancelled: impl Fn() -> bool) -> Result<Option<Reported>, NodeError> {
    mr_damper_model::evaluate::require_inputs(model, run)?;
    let mut pipeline = Pipeline::new(Models::alone(*model), Settings::default())?;
    let (mut events, mut refusals) = (Vec::new(), Refusals::default());
    for (index, sample) in run.samples().enumerate() {
        if index % 4096 == 0 && cancelled() {
            return Ok(None);
        }
        pipeline.step(&sample, &mut |event| match event {
            Event::Refusal(refusal) => refusals.take(&refusal, run),
            event if stamp_of(&event).is_some() => events.push(event),
            _ => {}
        });
    }
    Ok(Some(Reported { events, refusals }))
}

/// The row of each estimate, with the residual of its stamp.
fn rows(events: &[Event]) -> impl Iterator<Item = PredictedRow> {
    let residuals: HashMap<Stamp, &Residual> = events
        .iter()
        .filter_map(|event| match event {
            Event::Residual(residual) => Some((residual.stamp, residual)),
            _ => None,
        })
        .collect();
    events.iter().filter_map(move |event| match event {
        Event::Estimate(estimate) => {
            Some(PredictedRow::of(estimate, residuals.get(&estimate.stamp).copied()))
        }
        _ => None,
    })
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
