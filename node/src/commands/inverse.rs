//! `mr-damper inverse`: computes the current for a demanded force, and the tracking error on the model and on the rig.

use crate::commands::context::CliContext;
use crate::commands::output::OutputArgs;
use crate::commands::run_args::RunArgs;
use crate::commands::targets;
use crate::estimation::control::say_fold;
use crate::estimation::models;
use crate::settings::error::NodeError;
use mr_damper_model::condition::{Conditioning, VelocitySource};
use mr_damper_model::identify::{Dataset, DatasetOptions};
use mr_damper_model::inverse::track::{Figures, Point, TrackingRig, Trajectory, on_model, on_rig};
use mr_damper_model::inverse::{InverseController, Limits, Method, Shape};
use mr_damper_model::model::Model;
use mr_damper_model::rig::signal::RATE_HZ;
use mr_damper_model::rig::{Channels, Motion, Plant};
use mr_damper_model::sample::Run;
use mr_damper_reports::inverse as report;
use std::path::{Path, PathBuf};

/// Find the current that yields a demanded force, and report the tracking error.
///
/// The demanded force is the force of a run, with the run's motion. The command tracks it on the model itself and on the
/// virtual rig, whose damper differs from the model: with feedforward only, and with feedback from the rig's load cell. A
/// semi-active damper can only produce forces between the force at zero current and the force at the largest current. A
/// demand outside that range is clipped, and counted. The rig's damper has 1 kN and 15 mm; for a damper of another size use
/// --no-rig.
#[derive(Debug, Clone, clap::Args)]
pub struct Args {
    /// Model file or preset; its drive must be a coil current.
    #[arg(value_name = "MODEL")]
    pub model: String,
    /// Run that holds the motion and, as its force, the demanded force: CSV file (time_s, displacement_m, force_n), rosbag2
    /// directory, .mcap.
    #[arg(long, value_name = "RUN")]
    pub force: PathBuf,
    /// Largest current, A.
    #[arg(long, value_name = "A", default_value_t = Limits::default().current_max_a, allow_negative_numbers = true)]
    pub current_max: f64,
    /// Largest rate of change of the current, A/s; by default it is not limited.
    #[arg(long, value_name = "A/S", allow_negative_numbers = true)]
    pub rate_max: Option<f64>,
    /// Time constant of the coil current with lead compensation, s; used for models with the effect coil_lag.
    #[arg(long, value_name = "S", default_value_t = Limits::default().lead_s, allow_negative_numbers = true)]
    pub lead_s: f64,
    /// How the current is found: search (on the model); polynomial or fuzzy (inverses fitted to the model); chen, wang-liao or
    /// wang-hu (the inverse model in the model file, see `mr-damper identify --inverse`).
    #[arg(long, value_name = "NAME", default_value = Method::Search.name(), value_parser = method)]
    pub method: Method,
    /// Do not track the demand on the rig.
    #[arg(long)]
    pub no_rig: bool,
    /// Seed of the rig's noise.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Output files.
    #[command(flatten)]
    pub output: OutputArgs,
    /// How the run is read.
    #[command(flatten)]
    pub load: RunArgs,
}

/// No method has the given name.
#[derive(Debug, Clone, Copy, thiserror::Error)]
#[error("take one of {}", Method::ALL.map(Method::name).join(", "))]
pub(super) struct UnknownMethod;

/// Parses the name of a method.
pub(super) fn method(name: &str) -> Result<Method, UnknownMethod> {
    Method::named(name).ok_or(UnknownMethod)
}

impl Args {
    fn limits(&self) -> Limits {
        Limits {
            current_max_a: self.current_max,
            rate_max_a_s: self.rate_max.unwrap_or(f64::INFINITY),
            lead_s: self.lead_s,
            ..Limits::default()
        }
    }
}

/// Tracks the demanded force and reports the error.
///
/// # Errors
/// When the model or the run does not load, the model has no inverse, or a report cannot be written;
/// [`NodeError::Interrupted`].
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    targets::check([args.force.as_path(), Path::new(&args.model)], args.output.targets())?;
    let model = models::load(&args.model)?;
    let run = args.load.load(&args.force)?.run;
    let limits = args.limits();
    if let Some([_, high]) = model.envelope.drive.filter(|[_, high]| limits.current_max_a > *high) {
        tracing::warn!(
            "the model was identified up to {high} A, and beyond that it extrapolates: currents up to --current-max {} A may give another force",
            limits.current_max_a
        );
    }
    let controller = InverseController::with_method(&model, limits, args.method)?;
    let fold = controller.shape().and_then(Shape::real_fold);
    if let Some(fold) = &fold {
        say_fold(fold);
    }
    let demand = demand(&run)?;
    let mut followed = vec![(report::TrackingSetup::Model, on_model(&model, &controller, &demand)?)];
    if !args.no_rig {
        for setup in [report::TrackingSetup::Rig, report::TrackingSetup::RigWithFeedback] {
            if context.interrupt.is_raised() {
                return Err(NodeError::Interrupted);
            }
            followed.push((setup, rig(&model, &controller, &demand, setup, args.seed)?));
        }
    }
    let results: Vec<report::TrackingResult> = followed
        .into_iter()
        .map(|(setup, points)| report::TrackingResult { setup, figures: Figures::of(&points), points })
        .collect();
    let outcome = report::InverseOutcome {
        model: args.model.clone(),
        run: args.force.display().to_string(),
        limits,
        fold,
        method: args.method,
        fit: controller.fit().copied(),
        results,
    };
    args.output.page(|| Ok(report::html(&outcome)))?;
    args.output.figures(&report::json(&outcome), || report::text(&outcome))
}

/// The recorded motion and the demanded force of `run`.
fn demand(run: &Run) -> Result<Trajectory, NodeError> {
    let as_recorded = Conditioning { velocity: VelocitySource::Backward, ..Conditioning::default() };
    let options = DatasetOptions { moving_only: false, ..DatasetOptions::default() };
    let rows = Dataset::from_run(run, &as_recorded, &options)?.rows;
    Ok(Trajectory {
        dt_s: rows.iter().map(|row| row.dt_s).collect(),
        displacement_m: rows.iter().map(|row| row.displacement_m).collect(),
        force_n: rows.iter().map(|row| row.raw_force_n).collect(),
        case_temp_c: rows.iter().map(|row| row.case_temp_c).collect(),
    })
}

/// Tracks the demanded force on the rig, at the rig's rate. A gap in the run has zero duration.
fn rig(
    model: &Model,
    controller: &InverseController,
    demand: &Trajectory,
    setup: report::TrackingSetup,
    seed: u64,
) -> Result<Vec<Point>, NodeError> {
    let times_s: Vec<f64> = demand
        .dt_s
        .iter()
        .scan(0.0, |time_s, dt_s| {
            *time_s += dt_s.unwrap_or(0.0);
            Some(*time_s)
        })
        .collect();
    let samples = (times_s.last().copied().unwrap_or(0.0) * RATE_HZ) as usize + 1;
    let at = |values: &[f64]| -> Vec<f64> {
        let mut index = 0;
        let sample = |k: usize| {
            let time_s = k as f64 / RATE_HZ;
            while index + 2 < times_s.len() && times_s[index + 1] <= time_s {
                index += 1;
            }
            let (from_s, to_s) = (times_s[index], times_s.get(index + 1).copied().unwrap_or(f64::INFINITY));
            let share = if to_s > from_s { ((time_s - from_s) / (to_s - from_s)).min(1.0) } else { 0.0 };
            let to = values.get(index + 1).copied().unwrap_or(values[index]);
            values[index] + share * (to - values[index])
        };
        (0..samples).map(sample).collect()
    };
    let (motion, force_n) = (Motion::recorded(at(&demand.displacement_m)), at(&demand.force_n));
    let (plant, channels) = (Plant::default(), Channels::default());
    let feedback = setup == report::TrackingSetup::RigWithFeedback;
    let tracking_rig = TrackingRig { plant: &plant, channels: &channels, seed, feedback };
    Ok(on_rig(model, controller, &motion, &force_n, &tracking_rig)?)
}
