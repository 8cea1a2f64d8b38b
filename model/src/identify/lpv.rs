//! Identification of the LPV model: the regression of [`super::regression`], where the drive determines the
//! weight of each copy of the regressors.

use super::Watch;
use super::dataset::Dataset;
use super::regression::{LAG_LISTS, Regression, common_rate};
use super::report::ParameterValue;
use crate::error::Error;
use crate::force::{Dependence, LAGS, LPV_REGRESSORS, Lpv};
use crate::units::Second;

/// Number of drive values, over the range in the runs, at which poles are checked.
const FROZEN: usize = 51;

/// Result of the fit.
pub(super) struct Fitted {
    /// The model; its offset is the mean of the runs' offsets.
    pub(super) model: Lpv,
    /// Offset of each run, N.
    pub(super) offsets_n: Vec<f64>,
    /// Rank of the regression.
    pub(super) rank: Option<usize>,
    /// The coefficients with their standard errors.
    pub(super) parameters: Vec<ParameterValue>,
    /// Warnings for the user of the model.
    pub(super) warnings: Vec<String>,
}

/// Fits an LPV model to `datasets`; `dependence` must be on a drive.
pub(super) fn fit(datasets: &[Dataset], dependence: Dependence, watch: &Watch) -> Result<Fitted, Error> {
    let period_s = 1.0 / common_rate(datasets, "lpv")?;
    let regression =
        Regression { model: "lpv", period_s, lags: LAGS, delay: 0, dependence, drive_lags: false };
    let found = regression.fit(datasets, watch)?;
    let offset_n = super::mean_offset(datasets, &found.offsets_n);
    let model = Lpv::new(dependence, found.coefficients.as_slice(), Second(period_s), offset_n)?;
    // The model file lists the copies of each coefficient.
    let name = |j: usize| {
        let (copy, regressor) = (j / LPV_REGRESSORS, j % LPV_REGRESSORS);
        format!("{}[{}][{copy}]", LAG_LISTS[regressor / LAGS], regressor % LAGS)
    };
    let (warnings, parameters) = (
        unstable(&model, datasets)?,
        ParameterValue::all(found.coefficients.as_slice(), &found.standard_errors, name),
    );
    Ok(Fitted { warnings, model, offsets_n: found.offsets_n, rank: found.rank, parameters })
}

/// A warning if a pole lies on or outside the unit circle at some constant drive within the runs' range.
fn unstable(model: &Lpv, datasets: &[Dataset]) -> Result<Vec<String>, Error> {
    let ranges = datasets.iter().filter_map(|d| d.envelope.drive);
    let (low, high) = ranges.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), [a, b]| (l.min(a), h.max(b)));
    let mut worst = (0.0, low);
    for k in 0..FROZEN {
        let drive = low + (high - low) * k as f64 / (FROZEN - 1) as f64;
        let modulus = model.frozen(drive)?.pole_moduli()[0];
        if modulus > worst.0 {
            worst = (modulus, drive);
        }
    }
    let (modulus, drive) = worst;
    let name = model.dependence().drive().map_or("the drive", crate::sample::DriveKind::name);
    Ok((modulus >= 1.0)
        .then(|| {
            format!(
                "at {name} = {drive:.3} a pole has the modulus {modulus:.4}: the one-step-ahead prediction is usable, but the \
                 simulation diverges there"
            )
        })
        .into_iter()
        .collect())
}
