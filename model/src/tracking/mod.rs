//! Values of the model's effects while the damper runs: one estimate for each window, and a test whether they change.
//!
//! ```text
//! sample ─┬→ pipeline with the model ──────────────────────→ residual ──┬→ window → values → change?
//!         └→ one for each value, with that value moved a little ──→ residual k ─┘
//! ```
//!
//! An [`EffectTracker`] takes the samples that a running [`Pipeline`] accepted, in pipelines of its own, so it may run on another thread and be
//! late. It estimates the values of the model's effects, such as the time constant of a coil lag; the base of the model stays as it
//! is. The derivative of the expected reading by a value is the difference of two residuals over the step between their models.
//! `window.rs` turns a window of them into values with 95 % intervals, and `change.rs` compares the windows.
//!
//! It also estimates the ratio of the measured to the expected force, alone: the slope of a line through measured over expected force. It
//! needs no effect, and shows a damper that fades without saying why.
//!
//! An interval contains chance alone. A force that the base of the model lacks moves a value as well, and differently for each excitation. The
//! test for a change allows for that: it compares the values of windows with each other and not with the model, and a value may depend on
//! the excitation, which `excitation.rs` describes.

mod change;
mod excitation;
mod window;

use crate::effect::{Effect, EffectModel, Effects};
use crate::error::Error;
use crate::force::law::Scale;
use crate::inverse::{ControlLaw, Method};
use crate::model::{Envelope, Model};
use crate::pipeline::{Event, Models, Pipeline, Residual, Settings};
use crate::sample::{Sample, Stamp};
use excitation::{COVARIATES, Excitation};
use std::collections::VecDeque;
use window::{Found, Window};

pub use change::{ChangeTest, Observed};

/// Step of a value for its derivative, as a share of the value.
const SHARE: f64 = 0.02;
/// Least step, as a share of the parameter's probe.
const PROBE_SHARE: f64 = 0.05;
/// Sizes of force, N, displacement, m, and velocity, m/s, for a model file without ranges.
const SIZES: [f64; 3] = [1000.0, 0.01, 0.2];

/// How values are estimated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackingSettings {
    /// Length of a window, s. Only time with a residual counts.
    pub window_s: f64,
    /// Lower bound of the mean time between false alarms of all values together, s.
    pub false_alarm_interval_s: f64,
}

impl TrackingSettings {
    /// Least length of a window, s: its blocks have 3 s, several correlation times of a residual.
    pub const LEAST_WINDOW_S: f64 = 3.0 * window::BLOCKS as f64;

    /// Checks the settings.
    ///
    /// # Errors
    /// Names the setting, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        Error::check("effects.window_s", self.window_s, "between 48 and 86400 s", |s| {
            (Self::LEAST_WINDOW_S..=86_400.0).contains(&s)
        })?;
        Error::check(
            "effects.false_alarm_interval_s",
            self.false_alarm_interval_s,
            "between 3600 and 1e10 s",
            |s| (3600.0..=1e10).contains(&s),
        )?;
        Ok(())
    }
}

impl Default for TrackingSettings {
    /// Windows of a minute, and a false alarm in a thousand hours at most.
    fn default() -> Self {
        Self { window_s: 60.0, false_alarm_interval_s: 3.6e6 }
    }
}

/// The kind of a value.
///
/// ```
/// use mr_damper_model::effect::Effect;
/// use mr_damper_model::tracking::Quantity;
///
/// assert_eq!((Quantity::ForceRatio.name(), Quantity::ForceRatio.effect_id()), ("force_ratio", ""));
/// let lag = Quantity::Effect { effect: Effect::CoilLag, parameter: 0 };
/// assert_eq!((lag.effect(), lag.name()), (Some(Effect::CoilLag), "tau_s"));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// The ratio of the measured to the expected force.
    ForceRatio,
    /// A value of an effect of the model.
    Effect {
        /// The effect.
        effect: Effect,
        /// Index among [`Effect::parameters`], which have the name and the unit.
        parameter: usize,
    },
}

impl Quantity {
    /// The effect; `None` for the force ratio.
    #[must_use]
    pub const fn effect(self) -> Option<Effect> {
        match self {
            Self::ForceRatio => None,
            Self::Effect { effect, .. } => Some(effect),
        }
    }

    /// Id of the effect; empty for the force ratio.
    #[must_use]
    pub fn effect_id(self) -> &'static str {
        self.effect().map_or("", Effect::id)
    }

    /// Form of the effect; empty for the force ratio, and if the effect has no forms.
    #[must_use]
    pub fn form(self) -> &'static str {
        self.effect().and_then(Effect::form).unwrap_or_default()
    }

    /// Name of the value: `force_ratio`, which has no unit, or the name of an effect's value, as in model files. It ends in the unit.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::ForceRatio => "force_ratio",
            Self::Effect { effect, parameter } => effect.parameters()[parameter].name,
        }
    }
}

/// A value, from one window.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffectValue {
    /// Stamp of the last residual of the window.
    pub stamp: Stamp,
    /// Kind of the value.
    pub quantity: Quantity,
    /// The value in the model, in the parameter's unit; 1 for the force ratio.
    pub running: f64,
    /// The estimate, in the same unit; NaN if the window does not determine it. It may lie outside of the range that the effect allows, if the
    /// base does not fit.
    pub value: f64,
    /// Its 95 % interval, which contains chance alone; NaN if the window does not determine it.
    pub ci95: [f64; 2],
    /// Number of windows that determined the value, this one included, since the model was loaded or the value changed.
    pub windows: u32,
    /// Excitation of the window: the logarithms of the standard deviation of displacement (m) and of the effective velocity (m/s), and the
    /// mean drive as a share of the largest one in the data of the model. NaN without motion.
    pub excitation: [f64; COVARIATES],
    /// The value has changed since the model was loaded.
    pub changed: bool,
}

/// Estimates the values of a model's effects from the samples that a pipeline accepted.
///
/// ```
/// use mr_damper_model::effect::{Effect, EffectModel, Effects};
/// use mr_damper_model::model::Model;
/// use mr_damper_model::pipeline::Settings;
/// use mr_damper_model::preset;
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
/// use mr_damper_model::tracking::{EffectTracker, TrackingSettings};
///
/// // A model with friction, and a damper with another base.
/// let friction = EffectModel::new(Effect::Friction, &[60.0])?; // N
/// let model = Model { effects: Effects::new(&[friction])?, ..preset::load(preset::BEST_FUZZY_TANH)? };
/// let run = record(&Experiment::sine(0.01, 1.0, 1.2, 50.0), &Plant::default(), &Channels::default(), 1);
///
/// let tracking = TrackingSettings { window_s: 48.0, ..TrackingSettings::default() };
/// let mut tracker = EffectTracker::new(&model, &Settings::default(), &tracking)?;
/// let mut found = Vec::new();
/// for sample in run.samples() {
///     tracker.step(&sample, &mut |value| found.push(value));
/// }
/// let [ratio, value] = found[..] else { panic!("one window") };
/// assert_eq!(ratio.quantity.name(), "force_ratio");
/// assert_eq!((value.quantity.name(), value.running, value.changed), ("friction_n", 60.0, false));
/// // The friction also stands for what the base lacks.
/// assert!(value.ci95[0] < value.value && value.value < value.ci95[1]);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug)]
pub struct EffectTracker {
    /// Runs the model as it is.
    running: Replica,
    ratio: Tracked,
    ratio_window: Window,
    values: Vec<Moved>,
    window: Window,
    excitation: Excitation,
    last: Option<Stamp>,
    gap_s: f64,
}

/// A pipeline, and its residuals until they are compared.
#[derive(Debug)]
struct Replica {
    pipeline: Box<Pipeline>,
    residuals: VecDeque<Residual>,
}

/// A value and the test whether it changes.
#[derive(Debug)]
struct Tracked {
    quantity: Quantity,
    running: f64,
    test: ChangeTest,
}

/// A value of an effect, with the pipeline whose model has it moved.
#[derive(Debug)]
struct Moved {
    value: Tracked,
    step: f64,
    replica: Replica,
}

impl Replica {
    fn new(model: Model, settings: Settings) -> Result<Self, Error> {
        let pipeline = Box::new(Pipeline::new(Models { free: model, seeded: None }, settings)?);
        Ok(Self { pipeline, residuals: VecDeque::new() })
    }

    fn step(&mut self, sample: &Sample) {
        let Self { pipeline, residuals } = self;
        pipeline.step(sample, &mut |event| {
            if let Event::Residual(residual) = event {
                residuals.push_back(residual);
            }
        });
    }

    fn reset(&mut self) {
        self.pipeline.reset(&mut |_| {});
        self.residuals.clear();
    }

    /// The residual at `stamp`, N; drops all older ones.
    fn at(&mut self, stamp: Stamp) -> Option<f64> {
        while self.residuals.front().is_some_and(|residual| residual.stamp < stamp) {
            self.residuals.pop_front();
        }
        self.residuals.front().filter(|residual| residual.stamp == stamp).map(|at| at.residual.get())
    }
}

impl EffectTracker {
    /// A tracker of the effects of `model`, which a pipeline with `settings` runs.
    ///
    /// # Errors
    /// When a setting is out of range, or `model` does not make a pipeline.
    pub fn new(model: &Model, settings: &Settings, tracking: &TrackingSettings) -> Result<Self, Error> {
        tracking.validate()?;
        // Neither a command nor a mode changes the residual.
        let settings =
            Settings { law: ControlLaw::Off, method: Method::Search, only_mode: None, ..*settings };
        let effects = model.effects.as_slice();
        let count: usize = effects.iter().map(|effect| effect.parameters().len()).sum();
        let windows = tracking.false_alarm_interval_s / tracking.window_s;
        let test = || ChangeTest::new(windows * (1 + count) as f64);
        let mut values = Vec::with_capacity(count);
        for (at, effect) in effects.iter().enumerate() {
            for (parameter, &running) in effect.parameters().iter().enumerate() {
                let mut parameters = effect.parameters().to_vec();
                parameters[parameter] += step(&model.envelope, effect, parameter);
                let mut all = effects.to_vec();
                all[at] = EffectModel::new(effect.effect(), &parameters)?;
                let moved = Effects::new(&all)?.with_terms(*model.effects.terms());
                let quantity = Quantity::Effect { effect: effect.effect(), parameter };
                values.push(Moved {
                    value: Tracked { quantity, running, test: test() },
                    // The step as it was rounded.
                    step: parameters[parameter] - running,
                    replica: Replica::new(Model { effects: moved, ..*model }, settings)?,
                });
            }
        }
        let running = Replica::new(*model, settings)?;
        Ok(Self {
            running,
            ratio: Tracked { quantity: Quantity::ForceRatio, running: 1.0, test: test() },
            ratio_window: Window::new(1, tracking.window_s),
            values,
            window: Window::new(count, tracking.window_s),
            excitation: Excitation::new(model.envelope.drive.map(|[low, high]| low.abs().max(high.abs()))),
            last: None,
            gap_s: settings.gap_s,
        })
    }

    /// Takes a sample that the running pipeline accepted. At the end of a window it reports each value through `emit`.
    pub fn step(&mut self, sample: &Sample, emit: &mut impl FnMut(EffectValue)) {
        self.excitation.see(sample, self.gap_s);
        self.running.step(sample);
        self.values.iter_mut().for_each(|value| value.replica.step(sample));
        while let Some(Residual { stamp, residual, predicted, counts, .. }) =
            self.running.residuals.pop_front()
        {
            let residual_n = residual.get();
            // The same measured force is in both residuals.
            let derivatives = self.values.iter_mut().map(|value| {
                let moved_n = value.replica.at(stamp)?;
                Some((residual_n - moved_n) / value.step)
            });
            let derivatives: Option<Vec<f64>> = derivatives.collect();
            let dt_s = self.last.replace(stamp).map_or(0.0, |last| stamp.since(last).get());
            let Some(derivatives) = derivatives.filter(|_| counts && (0.0..=self.gap_s).contains(&dt_s))
            else {
                continue;
            };
            // Both windows end at the same sample.
            let ratio = self.ratio_window.add(dt_s, &[predicted.get()], residual_n);
            let ended = self.window.add(dt_s, &derivatives, residual_n);
            if let Some((ratio, ended)) = ratio.zip(ended) {
                let excitation = self.excitation.take();
                let all =
                    std::iter::once(&mut self.ratio).chain(self.values.iter_mut().map(|it| &mut it.value));
                for (value, found) in all.zip(ratio.into_iter().chain(ended)) {
                    emit(value.report(stamp, found, excitation));
                }
            }
        }
    }

    /// Forgets all samples, as a reset of the running pipeline does. The values of past windows are kept for comparison.
    pub fn reset(&mut self) {
        self.running.reset();
        self.values.iter_mut().for_each(|value| value.replica.reset());
        self.last = None;
    }

    /// The same for `model`, which differs in the values of its effects: the windows so far are kept for comparison.
    ///
    /// # Errors
    /// As for [`EffectTracker::new`].
    pub fn moved_to(
        &self,
        model: &Model,
        settings: &Settings,
        tracking: &TrackingSettings,
    ) -> Result<Self, Error> {
        let mut moved = Self::new(model, settings, tracking)?;
        moved.ratio.test = self.ratio.test.clone();
        for Moved { value, .. } in &mut moved.values {
            if let Some(old) = self.values.iter().find(|old| old.value.quantity == value.quantity) {
                value.test = old.value.test.clone();
            }
        }
        Ok(moved)
    }
}

impl Tracked {
    /// The value from what a window found, if the window determines it.
    fn report(
        &mut self,
        stamp: Stamp,
        found: Option<Found>,
        excitation: Option<[f64; COVARIATES]>,
    ) -> EffectValue {
        let [value, half] =
            found.map_or([f64::NAN; 2], |found| [self.running + found.difference, found.half]);
        if let Some(excitation) = excitation
            && !value.is_nan()
        {
            self.test.see(&Observed { value, half, excitation });
        }
        let ci95 = [value - half, value + half];
        EffectValue {
            stamp,
            quantity: self.quantity,
            running: self.running,
            value,
            ci95,
            windows: self.test.windows(),
            excitation: excitation.unwrap_or([f64::NAN; COVARIATES]),
            changed: self.test.has_changed(),
        }
    }
}

/// Step of a value for its derivative, away from the nearer bound.
fn step(envelope: &Envelope, effect: &EffectModel, parameter: usize) -> f64 {
    let value = effect.parameters()[parameter];
    let parameter = &effect.effect().parameters()[parameter];
    let probe = if parameter.is_shape() { PROBE_SHARE * parameter.neutral } else { parameter.probe };
    let least = (PROBE_SHARE * probe * size(envelope, parameter.scale)).abs();
    let step = least.max(SHARE * value.abs());
    if value + step > parameter.allowed()[1] { -step } else { step }
}

/// Size of a scale in the data that the model comes from.
fn size(envelope: &Envelope, scale: Scale) -> f64 {
    let ranges = [envelope.force_n, envelope.displacement_m, envelope.velocity_m_s];
    let largest = |range: [f64; 2]| range[0].abs().max(range[1].abs());
    let mut sizes = SIZES;
    for (size, range) in sizes.iter_mut().zip(ranges) {
        *size = range.map(largest).filter(|largest| *largest > 0.0).unwrap_or(*size);
    }
    let [force, displacement, velocity] = sizes;
    let acceleration = velocity * velocity / displacement;
    force.powi(scale.force)
        * displacement.powi(scale.displacement)
        * velocity.powi(scale.velocity)
        * acceleration.powi(scale.acceleration)
}

#[cfg(test)]
mod tests;
