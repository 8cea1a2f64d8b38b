//! Errors of a model on a conditioned run: simulation (free run), one-step-ahead prediction, and persistence.
//!
//! Error figures use the counted rows ([`super::Row::counts`]): force known, filters settled, damper moving.
//! The model also steps over the other rows, because it may have memory. The model's own offset is used;
//! nothing is fitted to the scored run.

use super::Watch;
use super::dataset::{Dataset, Row};
use crate::condition::{ApplyTo, LowPassState};
use crate::effect::{Augmented, AugmentedState, Need};
use crate::error::Error;
use crate::force::{ForceModel, History, Inputs};
use crate::metrics::{ErrorSum, Fit};
use std::ops::ControlFlow;

/// A simulation beyond this multiple of the largest measured force has diverged.
pub(super) const DIVERGED: f64 = 100.0;
/// Number of rows after which a cancelled score ends.
const CANCEL_EVERY: usize = 4096;
/// Largest relative difference between a run's rate and the rate of a model whose input includes force.
const RATE_TOLERANCE: f64 = 0.01;

/// Error figures of a model on one conditioned run.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Scores {
    /// Simulation error with the model's own offset; `None` if it diverged or has no force at any counted
    /// row.
    pub free_run: Option<Fit>,
    /// Simulation error after the mean error is removed: the error that remains with the best offset for this
    /// session.
    pub free_run_without_offset: Option<Fit>,
    /// True when the simulation became non-finite or exceeded a hundred times the largest measured force.
    pub diverged: bool,
    /// Error of the one-step-ahead prediction; `None` for a model without force inputs.
    pub one_step: Option<Fit>,
}

/// Scores `model` on `dataset`.
///
/// ```
/// use mr_damper_model::identify::{Dataset, DatasetOptions, Scores, Watch, score, walk};
/// use mr_damper_model::metrics::ErrorSum;
/// use mr_damper_model::preset;
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
/// use std::ops::ControlFlow;
///
/// let model = preset::load(preset::BEST_FUZZY_TANH)?;
/// let run = record(&Experiment::sine(0.01, 2.0, 1.2, 3.0), &Plant::default(), &Channels::default(), 1);
/// let data = Dataset::from_run(&run, &model.conditioning, &DatasetOptions::default())?;
/// let Scores { free_run, one_step, diverged, .. } = score(&model.augmented(), &data, &Watch::none())?;
/// assert!(!diverged && one_step.is_none(), "fuzzy-tanh does not predict from measured force");
///
/// // The same figure, row by row
/// let mut sum = ErrorSum::default();
/// let ended = walk(&model.augmented(), &data, |row, predicted| {
///     if row.counts {
///         sum.add(row.force_n, predicted.free_run_n);
///     }
///     ControlFlow::Continue(())
/// });
/// assert!(ended.is_continue() && sum.fit() == free_run);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// [`Error::WrongDrive`] and [`Error::MissingChannel`] if the run does not have the model's drive or an
/// effect's channel; [`Error::WrongRate`] if the model's input includes force and its rate differs from the run's;
/// [`Error::Cancelled`].
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
        // The model has no force at the start of a segment until its history is full; this is not a divergence.
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

/// Persistence on `dataset`: the predicted force is the force of the previous sample. The reference for every
/// one-step figure.
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

/// Checks that `model` can run on `dataset`.
pub(crate) fn check(model: &Augmented, dataset: &Dataset) -> Result<(), Error> {
    let force = model.force();
    if let Some(effect) = model.effects().needing(Need::CaseTemperature)
        && dataset.rows.iter().all(|row| row.case_temp_c.is_nan())
    {
        return Err(Error::MissingChannel {
            run: dataset.name.clone(),
            channel: Need::CaseTemperature.name(),
            needed_by: format!("the effect {effect}"),
        });
    }
    if let Some(needed) = force.drive() {
        let Some(found) = dataset.drive else {
            return Err(Error::MissingChannel {
                run: dataset.name.clone(),
                channel: needed.name(),
                needed_by: format!("the {} model", force.name()),
            });
        };
        if found != needed {
            return Err(Error::WrongDrive {
                run: dataset.name.clone(),
                found: found.name(),
                needed: needed.name(),
            });
        }
    }
    match force.force_fed_period() {
        Some(period) if (period.get() * dataset.rate_hz - 1.0).abs() > RATE_TOLERANCE => {
            Err(Error::WrongRate {
                run: dataset.name.clone(),
                rate_hz: dataset.rate_hz,
                model: force.name(),
                needed_hz: 1.0 / period.get(),
            })
        }
        _ => Ok(()),
    }
}

/// Predictions of a model at one row.
#[derive(Debug, Clone, Copy)]
pub struct Predicted {
    /// Force of the simulation, N; NaN while the history fills, without drive, or after a divergence.
    pub free_run_n: f64,
    /// Force of the one-step-ahead prediction, N; NaN while the history fills, or for a model without force
    /// inputs or with effects.
    pub one_step_n: f64,
    /// False when the model needs a drive but the row's drive is missing.
    pub driven: bool,
}

/// Steps `model` over all rows, as a simulation and one step ahead, with a new state for each segment. Calls
/// `take` with the predictions of each row until it breaks.
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
            (free, output, history) = (model.begin(dataset.past(row)), None, History::default());
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

/// Simulates `model` over `rows` from one new state and sums its force, N. It does nothing else, so that
/// benchmarks measure the bare cost of a model.
///
/// ```
/// use mr_damper_model::identify::{Dataset, DatasetOptions, sum_of_free_run};
/// use mr_damper_model::preset;
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let model = preset::load(preset::BEST_FUZZY_TANH)?;
/// let run = record(&Experiment::sine(0.01, 2.0, 1.2, 3.0), &Plant::default(), &Channels::PERFECT, 1);
/// let data = Dataset::from_run(&run, &model.conditioning, &DatasetOptions::default())?;
/// // An offset of 10 N adds 10 N at each row with a force.
/// let with_n = |offset_n| sum_of_free_run(&model.augmented().with_force_offset_n(offset_n), &data.rows);
/// let forces = ((with_n(10.0) - with_n(0.0)) / 10.0).round() as usize;
/// assert!(forces <= data.rows.len() && forces + 2 >= data.rows.len(), "{forces} of {}", data.rows.len());
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[must_use]
pub fn sum_of_free_run(model: &Augmented, rows: &[Row]) -> f64 {
    let mut state = AugmentedState::default();
    rows.iter().filter_map(|row| model.free_run(&mut state, &row.inputs())).sum()
}

/// Prediction from the measured forces before this row, N; NaN without such forces.
fn one_step(force: &ForceModel, history: &mut History, row: &Row, inputs: &Inputs) -> f64 {
    history.push_inputs(inputs);
    let predicted_n = force.predict_n(history).unwrap_or(f64::NAN);
    history.push_force(row.force_n);
    predicted_n
}

/// The error figures, unless the sum is not finite.
pub(super) fn sound(sum: &ErrorSum) -> Option<Fit> {
    sum.fit().filter(|fit| fit.rsse_n.is_finite())
}
