//! Values of the running model's effects, from measured force: published on `effect_values`, reported on `/diagnostics` and in the log, and
//! taken by the model if the parameter `effects.adapt` allows it.
//!
//! ```text
//! v <- v + (estimate - v) / 3      if v lies outside the estimate's 95 % interval; at most effects.adapt_share from the loaded value
//! ```
//!
//! An adapted model has the loaded base and terms. It exists in memory alone: `load_model` and a restart bring back the values of the
//! file.

use crate::estimation::control::Control;
use crate::estimation::frame::Frame;
use crate::estimation::wire;
use crate::ros2::participant::{Output, Ros};
use crate::settings::config::{Config, EffectSettings, RosArgs};
use crate::settings::error::NodeError;
use crate::watchdogs::diagnostics::{StatusContext, effect_status};
use mr_damper_model::effect::{Effect, EffectModel, Effects};
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{Cause, Event, Settings};
use mr_damper_model::tracking::{EffectTracker, EffectValue, Quantity};
use mr_damper_msgs::standard::DiagnosticStatus;
use std::sync::Arc;

/// Share of the difference between a value and its estimate that one window removes.
const GAIN: f64 = 1.0 / 3.0;

/// Follows the values of the effects of the running model.
pub struct EffectWatch {
    publisher: Output<mr_damper_msgs::EffectValue>,
    control: Arc<Control>,
    frame: Frame,
    /// `None` while nothing is tracked.
    tracked: Option<Tracked>,
    /// The values of the last window.
    latest: Vec<EffectValue>,
}

/// The model whose values are tracked.
struct Tracked {
    tracker: EffectTracker,
    model: Box<Model>,
    /// Its effects as they were loaded.
    loaded: Effects,
    /// Hash of the model as it was loaded; an adapted model has another one.
    loaded_hash: String,
    settings: Settings,
    effects: EffectSettings,
}

/// The values of a window.
pub(crate) struct WindowValues<'a> {
    pub(crate) values: &'a [EffectValue],
    /// Length of the window, s.
    pub(crate) window_s: f64,
    /// Hash of the model as it was loaded.
    pub(crate) model_hash: &'a str,
}

impl EffectWatch {
    /// Creates the publisher.
    ///
    /// # Errors
    /// When the topic cannot be published.
    pub fn offer(
        ros: &mut Ros,
        args: &RosArgs,
        control: &Arc<Control>,
        frame: Frame,
    ) -> Result<Self, NodeError> {
        let publisher = ros.publish_seldom(&args.topic("effect_values"))?;
        Ok(Self { publisher, control: Arc::clone(control), frame, tracked: None, latest: Vec::new() })
    }

    /// Follows the running model and the parameters. Call it about once per second: the tracker runs pipelines of its own, so it need not
    /// change at the same sample.
    pub fn refresh(&mut self, config: &Config) {
        let model = self.control.models().filter(|_| config.effects.track);
        let Some(model) = model.map(|models| Box::new(models.free)) else {
            self.tracked = None;
            self.latest.clear();
            return;
        };
        let settings = config.pipeline_settings(model.conditioning.cutoff_hz);
        let effects = config.effects;
        let before = self.tracked.take();
        let tracker = match &before {
            Some(tracked) if tracked.model == model => {
                if (tracked.settings, tracked.effects) == (settings, effects) {
                    self.tracked = before;
                    return;
                }
                tracked.tracker.moved_to(&model, &settings, &effects.tracking)
            }
            _ => {
                self.latest.clear();
                EffectTracker::new(&model, &settings, &effects.tracking)
            }
        };
        match tracker {
            Ok(tracker) => {
                let same = before.filter(|tracked| tracked.model == model);
                let (loaded, loaded_hash) = same.map_or_else(
                    || (model.effects, self.control.models_names().hash),
                    |tracked| (tracked.loaded, tracked.loaded_hash),
                );
                self.tracked = Some(Tracked { tracker, model, loaded, loaded_hash, settings, effects });
            }
            // The running pipeline has accepted the same model and settings, with values next to these.
            Err(error) => tracing::warn!("the values of the effects are not tracked: {error}"),
        }
    }

    /// Takes an event of the running pipeline. Returns the values of the window that it completed.
    pub(crate) fn take(&mut self, event: &Event) -> Option<WindowValues<'_>> {
        let tracked = self.tracked.as_mut()?;
        let mut found = Vec::new();
        match event {
            Event::Input(sample) => tracked.tracker.step(sample, &mut |value| found.push(value)),
            Event::Transition(transition) if transition.cause == Cause::Reset => tracked.tracker.reset(),
            _ => {}
        }
        if found.is_empty() {
            return None;
        }
        self.report(found);
        let Tracked { effects, loaded_hash, .. } = self.tracked.as_ref()?;
        let window_s = effects.tracking.window_s;
        Some(WindowValues { values: &self.latest, window_s, model_hash: loaded_hash })
    }

    /// The status for `/diagnostics`; `None` while nothing is tracked.
    #[must_use]
    pub fn status(&self, context: &StatusContext<'_>) -> Option<DiagnosticStatus> {
        self.tracked.as_ref().map(|_| effect_status(&self.latest, context))
    }

    fn report(&mut self, found: Vec<EffectValue>) {
        let Some(tracked) = &self.tracked else { return };
        let frame = self.frame.get();
        for value in &found {
            let message = wire::effect_value(value, tracked.effects.tracking.window_s, &frame);
            if let Err(error) = self.publisher.publish(message) {
                tracing::warn!("cannot publish effect_values: {error}");
            }
            let was_changed = self.latest.iter().any(|last| last.quantity == value.quantity && last.changed);
            if value.changed && !was_changed {
                tracing::warn!(
                    effect = value.quantity.effect().map(Effect::id),
                    parameter = value.quantity.name(),
                    value = value.value,
                    running = value.running,
                    stamp_ns = value.stamp.nanos(),
                    "the force or an effect has changed; compare it with a healthy damper, or diagnose the damper with close_loop"
                );
            }
        }
        if tracked.effects.adapt
            && let Some(adapted) =
                adapted(&tracked.model, &tracked.loaded, &found, tracked.effects.adapt_share)
        {
            self.adapt(adapted);
        }
        self.latest = found;
    }

    /// Lets the running model take `effects`.
    fn adapt(&mut self, effects: Effects) {
        let Some(tracked) = &mut self.tracked else { return };
        if let Err(error) = self.control.move_effects(effects, &tracked.model) {
            // The next refresh finds the model that runs.
            tracing::debug!("the values of the effects stay: {error}");
            return;
        }
        let model = Box::new(Model { effects, ..*tracked.model });
        match tracked.tracker.moved_to(&model, &tracked.settings, &tracked.effects.tracking) {
            Ok(tracker) => (tracked.tracker, tracked.model) = (tracker, model),
            Err(error) => tracing::warn!("the values of the effects are not tracked: {error}"),
        }
    }
}

/// The effects of `model` with values closer to the estimates; `None` if none of them moves.
fn adapted(model: &Model, loaded: &Effects, found: &[EffectValue], share: f64) -> Option<Effects> {
    let mut effects = model.effects.as_slice().to_vec();
    for (effect, loaded) in effects.iter_mut().zip(loaded.as_slice()) {
        let mut values = effect.parameters().to_vec();
        for estimate in found.iter().filter(|it| it.value.is_finite()) {
            let Quantity::Effect { effect: of, parameter } = estimate.quantity else { continue };
            if of != effect.effect() {
                continue;
            }
            let [low, high] = estimate.ci95;
            let (value, loaded) = (&mut values[parameter], loaded.parameters()[parameter]);
            if !(low..=high).contains(value) {
                let most = share * loaded.abs();
                // The base may force an estimate out of the range of the effect.
                let [least, largest] = of.parameters()[parameter].allowed();
                let moved = *value + GAIN * (estimate.value - *value);
                *value = moved.clamp(loaded - most, loaded + most).clamp(least, largest);
            }
        }
        // Values between two allowed ones are allowed.
        *effect = EffectModel::new(effect.effect(), &values).ok()?;
    }
    let moved = Effects::new(&effects).ok()?.with_terms(*model.effects.terms());
    (moved != model.effects).then_some(moved)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_model::preset;
    use mr_damper_model::sample::Stamp;

    fn estimate(effect: Effect, value: f64, half: f64) -> EffectValue {
        EffectValue {
            stamp: Stamp::from_nanos(0),
            quantity: Quantity::Effect { effect, parameter: 0 },
            running: 0.012,
            value,
            ci95: [value - half, value + half],
            windows: 1,
            excitation: [-5.0, -2.0, 0.5],
            changed: false,
        }
    }

    #[test]
    fn values_move_towards_their_estimates_within_bounds() {
        let [lag, friction] = [Effect::CoilLag, Effect::Friction].map(Effect::example);
        let loaded = Effects::new(&[lag, friction]).expect("two effects");
        let base = preset::load(preset::BEST_FUZZY_TANH).expect("a preset");
        let mut model = Model { effects: loaded, ..base };
        let [tau_s, force_n] = [lag.parameters()[0], friction.parameters()[0]];
        // Inside of its interval nothing moves, and neither does a value that the window does not determine.
        let near = [estimate(Effect::CoilLag, tau_s + 1e-4, 2e-4), estimate(Effect::Friction, f64::NAN, 0.0)];
        assert_eq!(adapted(&model, &loaded, &near, 0.2), None);

        let far =
            [estimate(Effect::CoilLag, 2.0 * tau_s, 1e-4), estimate(Effect::Friction, 1.03 * force_n, 0.1)];
        let mut taus_s = Vec::new();
        while let Some(moved) = adapted(&model, &loaded, &far, 0.5) {
            model.effects = moved;
            taus_s.push(moved.as_slice()[0].parameters()[0]);
        }
        assert!((taus_s[0] / tau_s - 4.0 / 3.0).abs() < 1e-12 && taus_s.is_sorted(), "{taus_s:?}");
        assert!((taus_s[taus_s.len() - 1] / tau_s - 1.5).abs() < 1e-12, "the bound");
        let ended_n = model.effects.as_slice()[1].parameters()[0];
        assert!((ended_n / force_n - 1.03).abs() < 0.002, "{ended_n}");
    }
}
