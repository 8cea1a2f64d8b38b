//! How well a model predicts a recorded run: the pipeline is run over it, and its errors are gathered.
//!
//! Two figures, never mixed: **free run**, the model on displacement and drive alone, and **one step**, ARX
//! fed with the measured force of the samples before. One step stands beside **persistence** (the force stays
//! what it was), because on smooth data even that has a tiny error.

use crate::effect::Need;
use crate::error::Error;
use crate::metrics::{ErrorSum, Fit};
use crate::model::Model;
use crate::pipeline::{Estimate, Event, Mode, Models, Pipeline, Settings};
use crate::sample::{Run, Stamp};
use crate::units::Newton;
use serde::Serialize;
use std::collections::VecDeque;

/// What an evaluation found.
#[derive(Debug, Clone, PartialEq)]
pub struct Evaluation {
    /// The model running free.
    pub free_run: Option<Fit>,
    /// The same after its mean error (the session's force offset) is taken out.
    pub free_run_without_offset: Option<Fit>,
    /// The mean error that was taken out: measured minus predicted.
    pub offset: Newton,
    /// ARX one step ahead; `None` for models that do not feed on force.
    pub one_step: Option<Fit>,
    /// Persistence on the samples of `one_step` or `free_run`.
    pub persistence: Option<Fit>,
    /// How often the measured force lay within the calibrated 90 % band of its estimate; `None` for a model without one.
    pub band: Option<Coverage>,
    /// Samples of the run that the pipeline refused.
    pub refused: u64,
}

/// How often the measured force lay within the band.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Coverage {
    /// Share of the samples, 1.
    pub share: f64,
    /// Estimates with a calibrated band whose force was measured.
    pub samples: u64,
}

/// Gathers an evaluation from the events of a pipeline, live or replayed.
#[derive(Debug, Clone, Default)]
pub struct Evaluator {
    free: ErrorSum,
    one_step: ErrorSum,
    persistence: ErrorSum,
    waiting: VecDeque<Estimate>,
    /// Measured forces within a calibrated band, and all of them.
    banded: [u64; 2],
    last_measured: Option<(Stamp, f64)>,
    refused: u64,
}

impl Evaluator {
    /// Longest step over which persistence counts as one step, s.
    const STEP_S: f64 = 0.1;
    /// Estimates that may wait for their measurement.
    const WAITING: usize = 512;

    /// Takes an event. `counts` says whether a residual's stamp counts.
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
                        let [low, high] = estimate.band;
                        self.banded[0] += u64::from((low.get()..=high.get()).contains(&measured_n));
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

    /// Forgets what waits from a run before, and keeps the figures: the next event is another run's.
    pub fn new_run(&mut self) {
        self.waiting.clear();
        self.last_measured = None;
    }

    /// What was found so far.
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

/// Evaluates `model` on `run`; `counts` says whether a sample's stamp counts.
///
/// # Errors
/// When the run lacks force, or the drive that the model wants, or the settings do not go with the model.
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

/// The same, adding to what `evaluator` has gathered of other runs.
///
/// # Errors
/// Those of [`evaluate`].
pub fn evaluate_into(
    evaluator: &mut Evaluator,
    model: Model,
    run: &Run,
    settings: Settings,
    counts: impl Fn(Stamp) -> bool,
) -> Result<(), Error> {
    require_channels(&model, run)?;
    evaluator.new_run();
    let mut pipeline = Pipeline::new(Models::alone(model), settings)?;
    for sample in run.samples() {
        pipeline.step(&sample, &mut |event| evaluator.take(&event, &counts));
    }
    Ok(())
}

/// Checks that `run` has what `model` feeds on, and a force to compare with.
pub(crate) fn require_channels(model: &Model, run: &Run) -> Result<(), Error> {
    let missing = |channel, needed_by: &str| Error::MissingChannel {
        run: run.name.clone(),
        channel,
        needed_by: needed_by.to_owned(),
    };
    if run.force_n.as_ref().is_none_or(crate::sample::Trace::is_empty) {
        return Err(missing("force_n", "an evaluation"));
    }
    if model.conditioning.velocity == crate::condition::VelocitySource::Measured && run.velocity_m_s.is_none()
    {
        return Err(missing("velocity_m_s", "the model (conditioning.velocity is \"measured\")"));
    }
    if let Some(effect) = model.effects.needing(Need::CaseTemperature)
        && run.case_temp_c.as_ref().is_none_or(crate::sample::Trace::is_empty)
    {
        return Err(missing("case_temp_c", &format!("the effect {}", effect.id())));
    }
    match (model.force.drive(), run.drive_kind()) {
        (Some(wanted), None) => Err(missing(wanted.name(), "the model")),
        (Some(wanted), Some(found)) if wanted != found => {
            Err(Error::WrongDrive { run: run.name.clone(), found: found.name(), wanted: wanted.name() })
        }
        _ => Ok(()),
    }
}
