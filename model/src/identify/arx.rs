//! Identification of the ARX model by the regression of [`super::regression`], with lags of the drive.

use super::Watch;
use super::dataset::Dataset;
use super::regression::{Regression, common_rate};
use crate::error::Error;
use crate::force::{Arx, Dependence, SAVARESI_LAGS};
use crate::sample::DriveKind;
use crate::units::Second;

/// Result of the fit.
pub(super) struct Fitted {
    /// The model; its offset is the mean of the runs' offsets.
    pub(super) model: Arx,
    /// Offset of each run, N.
    pub(super) offsets_n: Vec<f64>,
    /// Rank of the regression.
    pub(super) rank: usize,
}

/// Fits a passive (`drive` is `None`) or semi-active ARX of `lags` lags (3, or 2: `savaresi`) to `datasets`.
pub(super) fn fit(
    datasets: &[Dataset],
    lags: usize,
    drive: Option<DriveKind>,
    watch: &Watch,
) -> Result<Fitted, Error> {
    let model = if lags == SAVARESI_LAGS { "savaresi" } else { "arx" };
    let period_s = 1.0 / common_rate(datasets, model)?;
    let dependence = Dependence::None;
    let regression = Regression { model, period_s, lags, dependence, drive_lags: drive.is_some() };
    let found = regression.fit(datasets, watch)?;
    let a = &found.coefficients;
    let (offset_n, period) = (super::mean_offset(datasets, &found.offsets_n), Second(period_s));
    let model = if lags == SAVARESI_LAGS {
        let of = |signal: usize| std::array::from_fn(|j| a[signal * lags + j]);
        Arx::savaresi(of(0), of(1), of(2), drive.map(|kind| (kind, of(3))), period, offset_n)?
    } else {
        let of = |signal: usize| std::array::from_fn(|j| a[signal * lags + j]);
        Arx::new(of(0), of(1), of(2), drive.map(|kind| (kind, of(3))), period, offset_n)?
    };
    Ok(Fitted { model, offsets_n: found.offsets_n, rank: found.rank })
}
