//! Conditioning as the command line has it.

use clap::ValueEnum;
use mr_damper_model::condition::{ApplyTo, VelocitySource};

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
