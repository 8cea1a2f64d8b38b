//! Errors of the calibration of an uncertainty.

use serde::Serialize;
use thiserror::Error;

/// Reasons why the uncertainty of a model cannot be calibrated on the held-out runs.
#[derive(Debug, Clone, PartialEq, Error, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
#[non_exhaustive]
pub enum CalibrationError {
    /// There are too few runs.
    #[error("held-out runs are too few to calibrate the uncertainty: {runs} of {needed}; {}", advice(*needed))]
    TooFewRuns {
        /// Number of held-out runs.
        runs: usize,
        /// Number that is needed.
        needed: usize,
    },
    /// The runs are equivalent to too few independent residuals, or these come from too few of the runs.
    #[error(
        "held-out runs are too few to calibrate the uncertainty: {predictor}: the {residuals} residuals of {runs} held-out runs are \
         equivalent to {independent:.0} independent ones of the {needed} that are needed, or they come from fewer than {needed_runs} of the \
         runs; {}",
        advice(*needed_runs)
    )]
    TooFewResiduals {
        /// The predictor, as a phrase: "in simulation".
        predictor: &'static str,
        /// Number of held-out runs.
        runs: usize,
        /// Number of residuals in them.
        residuals: usize,
        /// Number of independent residuals that they are equivalent to.
        independent: f64,
        /// Number of independent residuals that is needed.
        needed: f64,
        /// Number of runs that is needed.
        needed_runs: usize,
    },
}

fn advice(runs: usize) -> String {
    format!("hold out at least {runs} runs, or longer ones, similar to the runs that the model will meet")
}
