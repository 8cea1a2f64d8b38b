//! Identification of the ARX model by the regression of [`super::regression`], with lags of the drive.

use super::Watch;
use super::dataset::Dataset;
use super::regression::{LAG_LISTS, Regression, common_rate};
use super::report::ParameterValue;
use crate::error::Error;
use crate::force::{Arx, ArxShape, Dependence};
use crate::sample::DriveKind;
use crate::units::Second;

/// Result of the fit.
pub(super) struct Fitted {
    /// The model; its offset is the mean of the runs' offsets.
    pub(super) model: Arx,
    /// Offset of each run, N.
    pub(super) offsets_n: Vec<f64>,
    /// Rank of the regression; a recursive fit does not compute it.
    pub(super) rank: Option<usize>,
    /// The coefficients with their standard errors; empty after a recursive fit.
    pub(super) parameters: Vec<ParameterValue>,
}

/// Fits a passive (`drive` is `None`) or semi-active ARX of `shape` to `datasets`, in one step or, `recursively`, sample by
/// sample.
pub(super) fn fit(
    datasets: &[Dataset],
    shape: ArxShape,
    drive: Option<DriveKind>,
    recursively: bool,
    watch: &Watch,
) -> Result<Fitted, Error> {
    let ArxShape { lags, delay } = shape;
    let period_s = 1.0 / common_rate(datasets, shape.name())?;
    let dependence = Dependence::None;
    let (model, drive_lags) = (shape.name(), drive.is_some());
    let regression = Regression { model, period_s, lags, delay, dependence, drive_lags };
    let found = if recursively {
        regression.fit_recursively(datasets, watch)?
    } else {
        regression.fit(datasets, watch)?
    };
    let of = |signal: usize| &found.coefficients.as_slice()[signal * lags..(signal + 1) * lags];
    let (offset_n, period) = (super::mean_offset(datasets, &found.offsets_n), Second(period_s));
    let model = shape.model([of(0), of(1), of(2)], drive.map(|kind| (kind, of(3))), period, offset_n)?;
    let name = |j: usize| format!("{}[{}]", lag_lists(drive)[j / lags], j % lags);
    let parameters = ParameterValue::all(found.coefficients.as_slice(), &found.standard_errors, name);
    Ok(Fitted { model, offsets_n: found.offsets_n, rank: found.rank, parameters })
}

/// The lists of coefficients in a model file, in the order of the regression.
fn lag_lists(drive: Option<DriveKind>) -> [&'static str; 4] {
    let of_drive = match drive {
        Some(DriveKind::CommandVoltage) => "voltage_lags_n_v",
        Some(DriveKind::CoilCurrent) | None => "current_lags_n_a",
    };
    let [force, displacement, velocity] = LAG_LISTS;
    [force, displacement, velocity, of_drive]
}
