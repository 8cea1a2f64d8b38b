//! How runs become rows, as the command line has it.

use clap::ValueEnum;
use mr_damper_model::condition::{ApplyTo, Conditioning, VelocitySource};
use mr_damper_model::identify::DatasetOptions;

/// Filter, derivative, rate, and which samples count.
#[derive(Debug, clap::Args)]
pub struct ConditioningArgs {
    /// Where the second-order low-pass sits; by default nowhere, and in `compare` on the inputs, the thesis' own place.
    #[arg(long, value_enum)]
    pub filter: Option<FilterArg>,
    /// Corner of the low-pass, Hz.
    #[arg(long, value_name = "HZ", default_value_t = 20.0)]
    pub cutoff: f64,
    /// Where velocity comes from; by default the difference or slope that fits the runs best. Models that feed on force,
    /// and all in `compare`, have the backward difference.
    #[arg(long, value_enum)]
    pub velocity: Option<VelocityArg>,
    /// Window of the slope when --velocity is slope, s.
    #[arg(long, value_name = "S", default_value_t = 0.01)]
    pub slope_window: f64,
    /// Thin runs to this rate first, Hz.
    #[arg(long, value_name = "HZ")]
    pub rate: Option<f64>,
    /// Count all samples, not only those in which the damper moves.
    #[arg(long)]
    pub all_samples: bool,
}

impl ConditioningArgs {
    /// The conditioning, with `filter` where none was asked for.
    ///
    /// # Errors
    /// When a number is out of its range.
    pub fn conditioning(&self, filter: FilterArg) -> Result<Conditioning, mr_damper_model::Error> {
        let conditioning = Conditioning {
            apply_to: self.filter.unwrap_or(filter).into(),
            cutoff_hz: self.cutoff,
            velocity: self.velocity.unwrap_or(VelocityArg::Backward).into(),
            slope_window_s: self.slope_window,
        };
        conditioning.validate()?;
        Ok(conditioning)
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
    /// Least-squares slope over a trailing window.
    Slope,
    /// The runs' own velocity.
    Measured,
}

impl From<VelocityArg> for VelocitySource {
    fn from(velocity: VelocityArg) -> Self {
        match velocity {
            VelocityArg::Backward => Self::Backward,
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
        VelocitySource::Slope => format!("slope over {slope_window_s} s"),
        VelocitySource::Measured => "measured".to_owned(),
    }
}
