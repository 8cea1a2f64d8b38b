//! How well a model predicts a conditioned run: running free, one step ahead, and persistence beside it.
//!
//! Every figure is over the rows that count ([`super::Row::counts`]): force known, filters settled, damper moving.
//! Rows between them are stepped all the same, since a model may remember. A run is scored with the offset that
//! the model carries; nothing is fitted to the run that is scored.

use super::Watch;
use super::dataset::{Dataset, Row};
use crate::condition::{ApplyTo, LowPassState};
use crate::effect::{Augmented, AugmentedState, Need};
use crate::error::Error;
use crate::force::{ForceModel, History, Inputs};
use crate::metrics::{ErrorSum, Fit};
use std::ops::ControlFlow;

/// A free run beyond this multiple of the largest measured force has diverged.
const DIVERGED: f64 = 100.0;
/// A cancelled score ends within so many rows.
const CANCEL_EVERY: usize = 4096;
/// The rate of a run may differ by this share from the one that a force-fed model holds at.
const RATE_TOLERANCE: f64 = 0.01;

/// Figures of a model on one conditioned run.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Scores {
    /// Running free, with the model's own offset; `None` when it diverged, or gave no force on a row that counts.
    pub free_run: Option<Fit>,
    /// The same after the mean error is taken out: what a session's offset alone would mend.
    pub free_run_without_offset: Option<Fit>,
    /// True when the free run left the finite numbers, or went beyond a hundred times the largest measured force.
    pub diverged: bool,
    /// One step ahead of measured force; `None` for a model without force inputs.
    pub one_step: Option<Fit>,
}

/// Scores `model` on `dataset`.
///
/// # Errors
/// [`Error::WrongDrive`] and [`Error::MissingChannel`] when the run does not hold the model's drive, or an effect's
/// channel;
/// [`Error::Data`] when a model that feeds on force holds at another rate; [`Error::Cancelled`].
pub fn score(model: &Augmented, dataset: &Dataset, watch: &Watch) -> Result<Scores, Error> {
    check(model, dataset)?;
    let largest_n = dataset.envelope.force_n.map_or(0.0, |[low, high]| low.abs().max(high.abs()));
    let limit_n = DIVERGED * largest_n.max(1.0);
    let (mut free, mut stepped) = (ErrorSum::default(), ErrorSum::default());
    let (mut begun, mut diverged, mut left) = (false, false, CANCEL_EVERY);
    let outcome = walk(model, dataset, |row, predicted| {
        left -= 1;
        if left == 0 {
            left = CANCEL_EVERY;
            if watch.is_cancelled() {
                return ControlFlow::Break(());
            }
        }
        // The first samples of a segment are silent while a history fills: that is no divergence.
        begun = (begun && row.dt_s.is_some()) || predicted.free_run_n.is_finite();
        let held = (-limit_n..=limit_n).contains(&predicted.free_run_n);
        diverged |= begun && predicted.driven && !held;
        if row.counts {
            free.add(row.force_n, predicted.free_run_n);
            stepped.add(row.force_n, predicted.one_step_n);
        }
        ControlFlow::Continue(())
    });
    if outcome.is_break() {
        return Err(Error::Cancelled);
    }
    Ok(Scores {
        free_run: sound(&free).filter(|_| !diverged),
        free_run_without_offset: free.fit_without_offset().filter(|_| !diverged),
        diverged,
        one_step: sound(&stepped),
    })
}

/// Persistence on `dataset`: the force stays what it was one sample ago. The yardstick of every one-step figure.
#[must_use]
pub fn persistence(dataset: &Dataset) -> Option<Fit> {
    let (mut sum, mut last_n) = (ErrorSum::default(), f64::NAN);
    for row in &dataset.rows {
        if row.dt_s.is_some() && row.counts {
            sum.add(row.force_n, last_n);
        }
        last_n = row.force_n;
    }
    sound(&sum)
}

/// That `model` can run on `dataset` at all.
pub(crate) fn check(model: &Augmented, dataset: &Dataset) -> Result<(), Error> {
    let force = model.force();
    if let Some(effect) = model.effects().needing(Need::CaseTemperature)
        && dataset.rows.iter().all(|row| row.case_temp_c.is_nan())
    {
        return Err(Error::MissingChannel {
            run: dataset.name.clone(),
            channel: Need::CaseTemperature.name(),
            needed_by: format!("the effect {}", effect.id()),
        });
    }
    if let Some(wanted) = force.drive() {
        let Some(found) = dataset.drive else {
            return Err(Error::MissingChannel {
                run: dataset.name.clone(),
                channel: wanted.name(),
                needed_by: format!("the {} model", force.name()),
            });
        };
        if found != wanted {
            return Err(Error::WrongDrive {
                run: dataset.name.clone(),
                found: found.name(),
                wanted: wanted.name(),
            });
        }
    }
    match force.force_fed_period() {
        Some(period) if (period.get() * dataset.rate_hz - 1.0).abs() > RATE_TOLERANCE => Err(Error::Data {
            message: format!(
                "run {}: is at {:.6} Hz, but the {} model holds at {:.6} Hz; bring both to one rate first",
                dataset.name,
                dataset.rate_hz,
                force.name(),
                1.0 / period.get()
            ),
        }),
        _ => Ok(()),
    }
}

/// What a model says at one row.
#[derive(Debug, Clone, Copy)]
pub struct Predicted {
    /// Running free, N; NaN while the history fills, without drive, or after the numbers ran off.
    pub free_run_n: f64,
    /// One step ahead of measured force, N; NaN while the history fills, or for a model without force inputs or with
    /// effects.
    pub one_step_n: f64,
    /// False when the model wants a drive and the row has none.
    pub driven: bool,
}

/// Steps `model` over all rows, free and one step ahead, each segment from a fresh state, and hands what it says to
/// `take` until that breaks.
pub fn walk(
    model: &Augmented,
    dataset: &Dataset,
    mut take: impl FnMut(&Row, Predicted) -> ControlFlow<()>,
) -> ControlFlow<()> {
    let filter = dataset.conditioning.low_pass();
    let filters_output = dataset.conditioning.apply_to == ApplyTo::Output;
    let (mut free, mut output, mut history) = (AugmentedState::default(), None, History::default());
    let (force, feeds_on_force) = (model.force(), model.feeds_on_force());
    for row in &dataset.rows {
        if row.dt_s.is_none() {
            (free, output, history) = (AugmentedState::default(), None, History::default());
        }
        let inputs = row.inputs();
        let driven = force.drive().is_none() || row.drive.is_finite();
        let mut free_n =
            if driven { model.free_run(&mut free, &inputs).filter(|f| f.is_finite()) } else { None };
        if let (Some(raw), true) = (free_n, filters_output) {
            let fresh = output.is_none();
            let state = output.get_or_insert_with(LowPassState::default);
            free_n = Some(filter.step(state, row.dt_s.filter(|_| !fresh), raw));
        }
        let one_step_n = if feeds_on_force { one_step(force, &mut history, row, &inputs) } else { f64::NAN };
        take(row, Predicted { free_run_n: free_n.unwrap_or(f64::NAN), one_step_n, driven })?;
    }
    ControlFlow::Continue(())
}

/// Steps `model` over `rows` as they come, free and from one fresh state, and adds up what it says, N: the bare cost of
/// a model, for measuring its time.
#[must_use]
pub fn sum_of_free_run(model: &Augmented, rows: &[Row]) -> f64 {
    let mut state = AugmentedState::default();
    rows.iter().filter_map(|row| model.free_run(&mut state, &row.inputs())).sum()
}

/// Prediction from the measured forces before this row, N; NaN while there are none.
fn one_step(force: &ForceModel, history: &mut History, row: &Row, inputs: &Inputs) -> f64 {
    history.push_inputs(inputs);
    let predicted_n = force.predict_n(history).unwrap_or(f64::NAN);
    history.push_force(row.force_n);
    predicted_n
}

/// The figures, unless the sum ran off.
pub(super) fn sound(sum: &ErrorSum) -> Option<Fit> {
    sum.fit().filter(|fit| fit.rsse_n.is_finite())
}
