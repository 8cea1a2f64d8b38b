//! Models, settings and inverse controller of a pipeline, prepared in advance.
//!
//! Making a setup may take milliseconds and may fail. Switching to it does neither, so a running pipeline can change between two
//! samples on a real-time thread.

use super::Models;
use super::model_channel::{FreeRunChannel, SeededChannel};
use super::settings::Settings;
use crate::error::{Error, PipelineError};
use crate::inverse::{InverseController, Method};

/// Models and settings that have been checked against each other.
///
/// ```
/// use mr_damper_model::pipeline::{Event, Models, Pipeline, PipelineSetup, Settings};
/// use mr_damper_model::preset;
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let models = |name: &str| Ok::<_, mr_damper_model::Error>(Models::alone(preset::load(name)?));
/// let mut pipeline = Pipeline::new(models("thesis/fuzzy-tanh/rp1-cs")?, Settings::default())?;
/// let next = PipelineSetup::new(models("thesis/fuzzy-tanh/rp3-cs")?, Settings::default())?;
///
/// let run = record(&Experiment::sine(0.01, 2.0, 1.2, 2.0), &Plant::default(), &Channels::PERFECT, 1);
/// let mut estimates = Vec::new();
/// let mut emit = |event| {
///     if let Event::Estimate(estimate) = event {
///         estimates.push(estimate);
///     }
/// };
/// let samples: Vec<_> = run.samples().collect();
/// let (before, after) = samples.split_at(samples.len() / 2);
/// before.iter().for_each(|sample| pipeline.step(sample, &mut emit));
/// pipeline.take(next, &mut emit);
/// after.iter().for_each(|sample| pipeline.step(sample, &mut emit));
///
/// // Each displacement has an estimate. The step between the models decays within some multiples of 50 ms.
/// assert_eq!(estimates.len(), run.displacement_m.len());
/// let swapped = estimates.iter().position(|estimate| estimate.smoothing.get() != 0.0).expect("the models differ");
/// assert!((estimates.len() / 2).abs_diff(swapped) < 2);
/// assert!(estimates.last().expect("there are estimates").smoothing.get().abs() < 0.1);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct PipelineSetup {
    pub(super) settings: Settings,
    pub(super) free: FreeRunChannel,
    pub(super) seeded: Option<SeededChannel>,
    pub(super) controller: InverseController,
    /// True if a running pipeline forgets what its model has learned, even if the model is the same.
    pub(super) learns_anew: bool,
}

impl PipelineSetup {
    /// Checks `models` and `settings`, and builds the channels and the inverse controller.
    ///
    /// A model without an inverse is accepted with every control law that does not need one. Force requests are then answered
    /// with the safe current.
    ///
    /// # Errors
    /// When a model or a setting is out of range, or the control law or the inverse method needs something that the model lacks.
    /// The message says which.
    pub fn new(models: Models, settings: Settings) -> Result<Self, Error> {
        settings.validate()?;
        let controller = match InverseController::with_method(&models.free, settings.limits, settings.method)
        {
            Err(why) if settings.law.needs_inverse() => {
                return Err(PipelineError::LawWithoutInverse {
                    law: settings.law.name(),
                    error: Box::new(why),
                }
                .into());
            }
            Err(why) if settings.method != Method::Search => {
                return Err(PipelineError::MethodWithoutInverse {
                    method: settings.method.name(),
                    error: Box::new(why),
                }
                .into());
            }
            Err(_) => InverseController::without_inverse(settings.limits)?,
            Ok(controller) => controller,
        };
        Ok(Self {
            settings,
            free: FreeRunChannel::new(settings.applied_to(models.free), settings.lazy_learning)?,
            seeded: match models.seeded {
                Some(model) => SeededChannel::new(settings.applied_to(model))?,
                None => None,
            },
            controller,
            learns_anew: false,
        })
    }

    /// The same setup for a model that is loaded: a running pipeline then forgets what its model has learned
    /// ([`Settings::lazy_learning`]), even if the loaded model is the running one.
    #[must_use]
    pub fn learning_anew(mut self) -> Self {
        self.learns_anew = true;
        self
    }

    /// The inverse controller, at rest. It has an inverse only if the free-run model does.
    #[must_use]
    pub const fn controller(&self) -> &InverseController {
        &self.controller
    }
}
