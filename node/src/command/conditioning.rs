//! How runs become rows, as the command line has it.

use clap::ValueEnum;
use mr_damper_model::condition::{ApplyTo, Conditioning, VelocitySource};
use mr_damper_model::identify::DatasetOptions;

/// Filter, derivative, rate, and which samples count.
#[derive(Debug, clap::Args)]
pub struct ConditioningArgs {
    /// Where the second-order low-pass sits; by default nowhere, in `compare` on the inputs, the thesis' own place, in
    /// `close` on the output.
    #[arg(long, value_enum)]
    pub filter: Option<FilterArg>,
    /// Corner of the low-pass, Hz [default: 20].
    #[arg(long, value_name = "HZ")]
    pub cutoff: Option<f64>,
    /// Where velocity comes from; by default the difference or slope that fits the runs best. Models that feed on force,
    /// and all in `compare`, have the backward difference; in `close` it is the parabola through three points, which is
    /// not late.
    #[arg(long, value_enum)]
    pub velocity: Option<VelocityArg>,
    /// Window of the slope when --velocity is slope, s [default: 0.01].
    #[arg(long, value_name = "S")]
    pub slope_window: Option<f64>,
    /// Thin runs to this rate first, Hz.
    #[arg(long, value_name = "HZ")]
    pub rate: Option<f64>,
    /// Count all samples, not only those in which the damper moves.
    #[arg(long)]
    pub all_samples: bool,
}

impl ConditioningArgs {
    /// The conditioning, with `filter` and `velocity` where none was asked for.
    ///
    /// # Errors
    /// When a number is out of its range.
    pub fn conditioning(
        &self,
        filter: FilterArg,
        velocity: VelocityArg,
    ) -> Result<Conditioning, mr_damper_model::Error> {
        let conditioning = Conditioning {
            apply_to: self.filter.unwrap_or(filter).into(),
            cutoff_hz: self.cutoff.unwrap_or(20.0),
            velocity: self.velocity.unwrap_or(velocity).into(),
            slope_window_s: self.slope_window.unwrap_or(0.01),
        };
        conditioning.validate()?;
        Ok(conditioning)
    }

    /// The first flag that was given of those that a model file answers by itself.
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

    /// Which samples make rows.
    #[must_use]
    pub fn dataset(&self) -> DatasetOptions {
        DatasetOptions { moving_only: !self.all_samples, rate_hz: self.rate, ..DatasetOptions::default() }
    }
}

/// Where the low-pass sits.
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

/// Where velocity comes from.
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

/// A derivative in words.
#[must_use]
pub fn velocity_text(source: VelocitySource, slope_window_s: f64) -> String {
    match source {
        VelocitySource::Backward => "backward difference".to_owned(),
        VelocitySource::ThreePoint => "parabola through three points".to_owned(),
        VelocitySource::Slope => format!("slope over {slope_window_s} s"),
        VelocitySource::Measured => "measured".to_owned(),
    }
}
