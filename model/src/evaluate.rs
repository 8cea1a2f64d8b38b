//! Evaluates a model on a recorded run: runs the pipeline over it and accumulates the errors.
//!
//! Two figures are reported separately: **simulation** (free run, key `free_run`), in which the model sees
//! displacement and drive only, and the **one-step-ahead prediction** (key `one_step`), in which an ARX model
//! also sees the measured force of earlier samples. The prediction is reported together with **persistence**
//! (the force equals the last measured force), because on smooth data even persistence has a small error.

use crate::effect::Need;
use crate::error::Error;
use crate::metrics::{ErrorSum, Fit};
use crate::model::Model;
use crate::pipeline::{Estimate, Event, Mode, Models, Pipeline, Settings, Slot};
use crate::sample::{Run, Stamp};
use crate::units::Newton;
use serde::Serialize;
use std::collections::VecDeque;

/// Result of an evaluation.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// Error of the simulation.
    pub free_run: Option<Fit>,
    /// Error of the simulation after its mean error (the force offset of the session) is removed.
    pub free_run_without_offset: Option<Fit>,
    /// The removed mean error: measured minus predicted.
    pub offset: Newton,
    /// Error of the ARX one-step-ahead prediction; `None` for models whose input does not include force.
    pub one_step: Option<Fit>,
    /// Error of persistence on the samples of `one_step` or `free_run`.
    pub persistence: Option<Fit>,
    /// Share of measured forces inside the calibrated 90 % band; `None` for a model without a band.
    pub band: Option<Coverage>,
    /// Number of the run's samples that the pipeline refused.
    pub refused: u64,
}

/// How often the measured force was inside the band.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Coverage {
    /// Share of the samples inside, 1.
    pub share: f64,
    /// Number of estimates that have a calibrated band and a measured force.
    pub samples: u64,
}

/// Accumulates an evaluation from the events of a live or replaying pipeline.
///
/// ```
/// use mr_damper_model::evaluate::{Evaluator, evaluate_into};
/// use mr_damper_model::pipeline::Settings;
/// use mr_damper_model::preset;
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let model = preset::load(preset::BEST_FUZZY_TANH)?;
/// let run = |current_a| {
///     record(&Experiment::sine(0.01, 2.0, current_a, 2.0), &Plant::default(), &Channels::default(), 1)
/// };
/// // One error over two runs, at 0 A and 1.2 A
/// let mut evaluator = Evaluator::default();
/// evaluate_into(&mut evaluator, model, &run(0.0), Settings::default(), |_| true)?;
/// let soft = evaluator.finish().free_run.expect("the run has a force");
/// evaluate_into(&mut evaluator, model, &run(1.2), Settings::default(), |_| true)?;
/// let both = evaluator.finish().free_run.expect("the runs have a force");
/// assert_eq!(both.samples, 2 * soft.samples);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Evaluator {
    free: ErrorSum,
    one_step: ErrorSum,
    persistence: ErrorSum,
    waiting: VecDeque<Estimate>,
    /// Measured forces inside a calibrated band, and all measured forces with one.
    banded: [u64; 2],
    last_measured: Option<(Stamp, f64)>,
    refused: u64,
}

impl Evaluator {
    /// Longest gap over which persistence counts as a one-step prediction, s.
    const STEP_S: f64 = 0.1;
    /// Most estimates kept until their measured force arrives.
    const WAITING: usize = 512;

    /// Processes an event. `counts` says whether a residual with this stamp is included.
    pub fn take(&mut self, event: &Event, counts: impl Fn(Stamp) -> bool) {
        match event {
            Event::Estimate(estimate) => {
                if self.waiting.len() == Self::WAITING {
                    self.waiting.pop_front();
                }
                self.waiting.push_back(*estimate);
            }
            Event::Residual(residual) => {
                let (stamp, measured_n) = (residual.stamp, residual.measured.get());
                while self.waiting.front().is_some_and(|estimate| estimate.stamp < stamp) {
                    self.waiting.pop_front();
                }
                let estimate = self.waiting.front().filter(|estimate| estimate.stamp == stamp);
                let one_step =
                    estimate.filter(|estimate| estimate.mode == Mode::Arx).map(Estimate::unsmoothed_n);
                if counts(stamp) {
                    self.free.add(measured_n, residual.predicted.get());
                    if let Some(estimate) = estimate.filter(|estimate| estimate.calibrated) {
                        // The band of the free-run model lies around the damper's force; the seeded model predicts readings.
                        let load_cell_n =
                            if estimate.slot == Slot::Free { residual.load_cell.get() } else { 0.0 };
                        let [low_n, high_n] = estimate.band.map(|end| end.get() + load_cell_n);
                        self.banded[0] += u64::from((low_n..=high_n).contains(&measured_n));
                        self.banded[1] += 1;
                    }
                    if let Some(predicted_n) = one_step {
                        self.one_step.add(measured_n, predicted_n);
                    }
                    if let Some((before, force_n)) = self.last_measured
                        && stamp.since(before).get() <= Self::STEP_S
                    {
                        self.persistence.add(measured_n, force_n);
                    }
                }
                self.last_measured = Some((stamp, measured_n));
            }
            Event::Refusal(_) => self.refused += 1,
            Event::Input(_) | Event::Transition(_) | Event::Alarm(_) | Event::Command(_) => {}
        }
    }

    /// Drops estimates and the last force of the previous run, and keeps the accumulated errors. Call it
    /// before the first event of another run.
    pub fn new_run(&mut self) {
        self.waiting.clear();
        self.last_measured = None;
    }

    /// The evaluation of all events so far.
    #[must_use]
    pub fn finish(&self) -> Evaluation {
        let [inside, samples] = self.banded;
        Evaluation {
            free_run: self.free.fit(),
            free_run_without_offset: self.free.fit_without_offset(),
            offset: Newton(self.free.mean_error_n()),
            one_step: self.one_step.fit(),
            persistence: self.persistence.fit(),
            band: (samples > 0).then(|| Coverage { share: inside as f64 / samples as f64, samples }),
            refused: self.refused,
        }
    }
}

/// Evaluates `model` on `run`; `counts` says whether a sample with this stamp is included.
///
/// ```
/// use mr_damper_model::evaluate::evaluate;
/// use mr_damper_model::pipeline::Settings;
/// use mr_damper_model::preset;
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
/// use mr_damper_model::sample::Stamp;
///
/// let run = record(&Experiment::sine(0.01, 2.0, 1.2, 3.0), &Plant::default(), &Channels::default(), 1);
/// let after_one_second = |stamp| stamp >= Stamp::from_nanos(1_000_000_000);
/// let found = evaluate(preset::load(preset::BEST_ARX)?, &run, Settings::default(), after_one_second)?;
/// // An ARX model predicts one step ahead from measured force, and is more accurate than its simulation.
/// let (free_run, one_step) = (found.free_run.expect("there is force"), found.one_step.expect("ARX"));
/// assert!(one_step.rsse_n < 0.5 * free_run.rsse_n, "{} N, {} N", one_step.rsse_n, free_run.rsse_n);
/// assert!(free_run.samples <= 1024, "two seconds at 512 Hz");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// If the run has no force or not the drive that the model needs, or if the settings do not suit the model.
pub fn evaluate(
    model: Model,
    run: &Run,
    settings: Settings,
    counts: impl Fn(Stamp) -> bool,
) -> Result<Evaluation, Error> {
    let mut evaluator = Evaluator::default();
    evaluate_into(&mut evaluator, model, run, settings, counts)?;
    Ok(evaluator.finish())
}

/// As [`evaluate`], but adds to the errors that `evaluator` already has from other runs.
///
/// # Errors
/// As [`evaluate`].
pub fn evaluate_into(
    evaluator: &mut Evaluator,
    model: Model,
    run: &Run,
    settings: Settings,
    counts: impl Fn(Stamp) -> bool,
) -> Result<(), Error> {
    evaluate_and(evaluator, model, run, settings, counts, |_| {})
}

/// As [`evaluate_into`], and passes each event to `also`.
///
/// ```
/// use mr_damper_model::evaluate::{Evaluator, evaluate_and};
/// use mr_damper_model::pipeline::{Event, Settings};
/// use mr_damper_model::preset;
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let run = record(&Experiment::sine(0.01, 2.0, 1.2, 1.0), &Plant::default(), &Channels::default(), 1);
/// let (mut evaluator, mut estimates) = (Evaluator::default(), 0);
/// let count = |event: &Event| estimates += usize::from(matches!(event, Event::Estimate(_)));
/// evaluate_and(&mut evaluator, preset::load(preset::BEST_FUZZY_TANH)?, &run, Settings::default(), |_| true, count)?;
/// assert_eq!(estimates, run.displacement_m.len());
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// As [`evaluate`].
pub fn evaluate_and(
    evaluator: &mut Evaluator,
    model: Model,
    run: &Run,
    settings: Settings,
    counts: impl Fn(Stamp) -> bool,
    mut also: impl FnMut(&Event),
) -> Result<(), Error> {
    require_channels(&model, run)?;
    evaluator.new_run();
    let mut pipeline = Pipeline::new(Models::alone(model), settings)?;
    for sample in run.samples() {
        pipeline.step(&sample, &mut |event| {
            evaluator.take(&event, &counts);
            also(&event);
        });
    }
    Ok(())
}

/// Checks that `run` has the channels that `model` needs, and a measured force.
pub(crate) fn require_channels(model: &Model, run: &Run) -> Result<(), Error> {
    if run.force_n.as_ref().is_none_or(crate::sample::Trace::is_empty) {
        return Err(missing(run, "force_n", "an evaluation"));
    }
    require_inputs(model, run)
}

/// The error for a run without `channel`.
fn missing(run: &Run, channel: &'static str, needed_by: &str) -> Error {
    Error::MissingChannel { run: run.name.clone(), channel, needed_by: needed_by.to_owned() }
}

/// Checks that `run` has the channels that `model` needs to compute a force.
///
/// ```
/// use mr_damper_model::evaluate::require_inputs;
/// use mr_damper_model::preset;
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
/// use mr_damper_model::sample::Run;
///
/// let run = record(&Experiment::sine(0.01, 2.0, 1.2, 1.0), &Plant::default(), &Channels::default(), 1);
/// let model = preset::load(preset::BEST_FUZZY_TANH)?;
/// require_inputs(&model, &Run { force_n: None, ..run.clone() })?;
/// let without_current = require_inputs(&model, &Run { drive: None, ..run }).unwrap_err();
/// assert!(without_current.to_string().contains("has no current_a"));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// [`Error::MissingChannel`] and [`Error::WrongDrive`].
pub fn require_inputs(model: &Model, run: &Run) -> Result<(), Error> {
    let missing = |channel, needed_by: &str| missing(run, channel, needed_by);
    if model.conditioning.velocity == crate::condition::VelocitySource::Measured && run.velocity_m_s.is_none()
    {
        return Err(missing("velocity_m_s", "the model (conditioning.velocity is \"measured\")"));
    }
    if let Some(effect) = model.effects.needing(Need::CaseTemperature)
        && run.case_temp_c.as_ref().is_none_or(crate::sample::Trace::is_empty)
    {
        return Err(missing("case_temp_c", &format!("the effect {effect}")));
    }
    match (model.force.drive(), run.drive_kind()) {
        (Some(needed), None) => Err(missing(needed.name(), "the model")),
        (Some(needed), Some(found)) if needed != found => {
            Err(Error::WrongDrive { run: run.name.clone(), found: found.name(), needed: needed.name() })
        }
        _ => Ok(()),
    }
}
