//! Arguments that set how runs become rows.

use crate::commands::number::{hertz, seconds};
use crate::settings::error::NodeError;
use clap::ValueEnum;
use mr_damper_model::condition::{ApplyTo, Conditioning, VelocitySource};
use mr_damper_model::identify::DatasetOptions;

/// Filter, derivative, rate, and which samples count.
#[derive(Debug, clap::Args)]
pub struct ConditioningArgs {
    /// Where the second-order low-pass filter is applied; by default nowhere, in `compare` on the inputs (as in the
    /// thesis), in `close` on the output.
    #[arg(long, value_enum)]
    pub filter: Option<FilterArg>,
    /// Corner frequency of the low-pass filter, Hz [default: 20].
    #[arg(long, value_name = "HZ", allow_hyphen_values = true, value_parser = hertz)]
    pub cutoff: Option<f64>,
    /// Source of velocity; by default the difference or slope that fits the runs best. The default is the backward
    /// difference for models that use measured force and for all models in `compare`, and in `close` the parabola through
    /// three points, which has no delay.
    #[arg(long, value_enum)]
    pub velocity: Option<VelocityArg>,
    /// Window of the slope if --velocity is slope, s [default: 0.01].
    #[arg(long, value_name = "S", allow_hyphen_values = true, value_parser = seconds)]
    pub slope_window: Option<f64>,
    /// Rate of the rows, Hz, reached by keeping every n-th sample; by default all are kept.
    #[arg(long, value_name = "HZ", allow_hyphen_values = true, value_parser = hertz)]
    pub rate: Option<f64>,
    /// Use all samples, not only the samples in which the damper moves.
    #[arg(long)]
    pub all_samples: bool,
}

impl ConditioningArgs {
    /// The conditioning; `filter` and `velocity` are the defaults for flags that were not given.
    ///
    /// # Errors
    /// When a number is out of its range, or a flag has no effect beside the others.
    pub fn conditioning(&self, filter: FilterArg, velocity: VelocityArg) -> Result<Conditioning, NodeError> {
        let filter = self.filter.unwrap_or(filter);
        if self.cutoff.is_some() && filter == FilterArg::None {
            let say = "--cutoff has no effect without a filter: give --filter inputs or --filter output, too, or leave it out";
            return Err(NodeError::Usage(say.to_owned()));
        }
        if self.slope_window.is_some() && self.velocity.is_some_and(|velocity| velocity != VelocityArg::Slope)
        {
            let say =
                "--slope-window has no effect without --velocity slope: give one or leave out the other";
            return Err(NodeError::Usage(say.to_owned()));
        }
        let conditioning = Conditioning {
            apply_to: filter.into(),
            cutoff_hz: self.cutoff.unwrap_or(20.0),
            velocity: self.velocity.unwrap_or(velocity).into(),
            slope_window_s: self.slope_window.unwrap_or(0.01),
        };
        conditioning.validate()?;
        Ok(conditioning)
    }

    /// The first given flag whose value a model file already holds.
    #[must_use]
    pub fn given(&self) -> Option<&'static str> {
        let flags = [
            ("--filter", self.filter.is_some()),
            ("--cutoff", self.cutoff.is_some()),
            ("--velocity", self.velocity.is_some()),
            ("--slope-window", self.slope_window.is_some()),
        ];
        flags.into_iter().find_map(|(flag, given)| given.then_some(flag))
    }

    /// The options that select the samples for the rows.
    #[must_use]
    pub fn dataset(&self) -> DatasetOptions {
        DatasetOptions { moving_only: !self.all_samples, rate_hz: self.rate, ..DatasetOptions::default() }
    }
}

/// Where the low-pass filter is applied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FilterArg {
    /// On displacement.
    Inputs,
    /// On the model's force and the force it is compared with.
    Output,
    /// Nowhere.
    None,
}

impl From<FilterArg> for ApplyTo {
    fn from(filter: FilterArg) -> Self {
        match filter {
            FilterArg::Inputs => Self::Inputs,
            FilterArg::Output => Self::Output,
            FilterArg::None => Self::None,
        }
    }
}

/// Source of velocity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum VelocityArg {
    /// Backward difference of displacement.
    Backward,
    /// Parabola through the last three displacements: no delay, more noise.
    ThreePoint,
    /// Least-squares slope over a trailing window.
    Slope,
    /// The runs' own velocity.
    Measured,
}

impl From<VelocityArg> for VelocitySource {
    fn from(velocity: VelocityArg) -> Self {
        match velocity {
            VelocityArg::Backward => Self::Backward,
            VelocityArg::ThreePoint => Self::ThreePoint,
            VelocityArg::Slope => Self::Slope,
            VelocityArg::Measured => Self::Measured,
        }
    }
}

/// The source of velocity as text.
#[must_use]
pub fn velocity_text(source: VelocitySource, slope_window_s: f64) -> String {
    match source {
        VelocitySource::Backward => "backward difference".to_owned(),
        VelocitySource::ThreePoint => "parabola through three points".to_owned(),
        VelocitySource::Slope => format!("slope over {slope_window_s} s"),
        VelocitySource::Measured => "measured".to_owned(),
    }
}
