//! The test runs: read once, when everything else is decided.
//!
//! The interval of the error ratio is computed in [`crate::statistics::error_ratio`].

use super::Settings;
use super::finding::{RunErrors, TestResult};
use super::joint::Fitted;
use super::rows::Rows;
use crate::effect::Augmented;
use crate::error::{DiagnosisError, Error};
use crate::metrics::{ErrorSum, Fit};
use crate::statistics::error_ratio::{ErrorRatio, Residuals, error_ratio};

/// Errors of `before` and `after` on `rows`, run by run, with each run's mean error removed.
pub(super) fn run_errors(rows: &Rows, before: &Fitted, after: &Fitted) -> Vec<RunErrors> {
    let change = |run: &super::rows::RunRows| {
        let part = |fitted: &Fitted| fit(rows, fitted, std::slice::from_ref(&run.range));
        Some(RunErrors { run: run.dataset.name.clone(), before: part(before)?, after: part(after)? })
    };
    rows.runs().iter().filter_map(change).collect()
}

/// The result of the test runs for `before` and `after`, with a noise floor of `noise_n` (root mean square, N); `None` if no row
/// counts.
pub(super) fn read(
    rows: &Rows,
    before: &Fitted,
    after: &Fitted,
    noise_n: f64,
    settings: &Settings,
) -> Option<TestResult> {
    let ranges: Vec<_> = rows.runs().iter().map(|run| run.range.clone()).collect();
    let (all_before, all_after) = (fit(rows, before, &ranges)?, fit(rows, after, &ranges)?);
    let residuals = |run: &super::rows::RunRows| {
        let of = |fitted: &Fitted| fitted.residual_n[run.range.clone()].to_vec();
        Residuals { step_s: run.step_s, before: of(before), after: of(after) }
    };
    let runs: Vec<Residuals> = rows.runs().iter().map(residuals).collect();
    let ErrorRatio { ratio, ci95, blocks, block_s } = error_ratio(&runs, settings.block_s);
    let noise = noise_n * noise_n * rows.len() as f64;
    let explainable = before.squares - noise;
    Some(TestResult {
        before: all_before,
        after: all_after,
        ratio,
        ratio_ci95: ci95,
        blocks,
        block_s,
        removed: (explainable > 0.0).then(|| (before.squares - after.squares) / explainable),
        runs: run_errors(rows, before, after),
    })
}

/// `model` on `rows`, without refitting.
///
/// # Errors
/// [`DiagnosisError::ModelDiverges`].
pub(super) fn fitted(rows: &Rows, model: &Augmented) -> Result<Fitted, Error> {
    Fitted::as_is(*model, rows).ok_or_else(|| DiagnosisError::ModelDiverges.into())
}

/// `before` and `after` on `rows`, without refitting; simulated once if they are the same model.
pub(super) fn both(rows: &Rows, before: &Augmented, after: &Augmented) -> Result<[Fitted; 2], Error> {
    let first = fitted(rows, before)?;
    let second = if after == before { first.clone() } else { fitted(rows, after)? };
    Ok([first, second])
}

/// Error figures over these ranges of rows; `None` without rows.
fn fit(rows: &Rows, fitted: &Fitted, ranges: &[std::ops::Range<usize>]) -> Option<Fit> {
    let mut force_n = rows.measured_n().to_vec();
    rows.centre(&mut force_n);
    let mut sum = ErrorSum::default();
    for k in ranges.iter().cloned().flatten() {
        sum.add(force_n[k], force_n[k] - fitted.residual_n[k]);
    }
    sum.fit()
}
