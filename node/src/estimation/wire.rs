//! Converts the pipeline's events to ROS messages; the names of the running models, which the messages hold.

use mr_damper_model::pipeline::{Estimate, Residual, Slot, StampedCommand, Transition};
use mr_damper_model::sample::Stamp;
use mr_damper_model::tracking::EffectValue;
use mr_damper_msgs::standard::{Header, Time};
use mr_damper_msgs::{CurrentCommand, ForceEstimate, ForceResidual, ModeChange};
use serde::{Deserialize, Serialize};
use std::sync::{Arc, RwLock};

/// Names of the models that a damper runs, for estimates and `meta`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct ModelNames {
    /// The simulated model (free run): name of a preset or file.
    pub free: String,
    /// The model that is seeded with measured force, if any.
    pub seeded: Option<String>,
    /// SHA-256 of the model files, or something else that identifies the coefficients.
    pub hash: String,
}

impl ModelNames {
    /// Name of the model that an estimate comes from.
    #[must_use]
    pub fn of(&self, slot: Slot) -> &str {
        match slot {
            Slot::Free => &self.free,
            Slot::Seeded => self.seeded.as_deref().unwrap_or(&self.free),
        }
    }
}

/// Names of the running models; replaced when the models are.
pub type SharedNames = Arc<RwLock<ModelNames>>;

/// A header with `stamp`. Stamps beyond the message's range saturate.
#[must_use]
pub fn header(stamp: Stamp, frame_id: &str) -> Header {
    Header { stamp: Time::from_nanos_saturating(stamp.nanos()), frame_id: frame_id.to_owned() }
}

/// The frame id of the node in `namespace`: the namespace's parts, joined by `_`.
#[must_use]
pub fn frame_id(namespace: &str) -> String {
    namespace.trim_start_matches('/').replace('/', "_")
}

/// The message of an estimate.
#[must_use]
pub fn force_estimate(estimate: &Estimate, names: &ModelNames, frame_id: &str) -> ForceEstimate {
    ForceEstimate {
        header: header(estimate.stamp, frame_id),
        force: estimate.force.get(),
        std_dev: estimate.std_dev.get(),
        model: names.of(estimate.slot).to_owned(),
        mode: estimate.mode as u8,
        validity: estimate.validity as u8,
        reasons: mr_damper_msgs::Reasons::from_bits(estimate.reasons.0),
        input_age: estimate.input_age.get(),
        band_low: estimate.band[0].get(),
        band_high: estimate.band[1].get(),
        band_calibrated: estimate.calibrated,
    }
}

/// The message of a residual.
#[must_use]
pub fn force_residual(residual: &Residual, frame_id: &str) -> ForceResidual {
    ForceResidual {
        header: header(residual.stamp, frame_id),
        measured: residual.measured.get(),
        predicted: residual.predicted.get(),
        residual: residual.residual.get(),
        normalised: residual.normalised,
        windowed_rsse: residual.windowed_rsse.get(),
        windowed_esr: residual.windowed_esr,
        window: residual.window.get(),
        alarm: residual.alarm,
    }
}

/// The message of a command.
#[must_use]
pub fn current_command(commanded: &StampedCommand, frame_id: &str) -> CurrentCommand {
    let command = &commanded.command;
    CurrentCommand {
        header: header(commanded.stamp, frame_id),
        current: command.current.get(),
        force_requested: command.requested.get(),
        force_expected: command.expected.get(),
        achievable: command.is_achievable,
        dissipative: command.dissipative,
        limited_by: command.limited_by as u8,
        achievable_min: command.achievable[0].get(),
        achievable_max: command.achievable[1].get(),
    }
}

/// The message of a value, from a window of `window_s` seconds.
#[must_use]
pub fn effect_value(value: &EffectValue, window_s: f64, frame_id: &str) -> mr_damper_msgs::EffectValue {
    let [low, high] = value.ci95;
    mr_damper_msgs::EffectValue {
        header: header(value.stamp, frame_id),
        effect: value.quantity.effect_id().to_owned(),
        form: value.quantity.form().to_owned(),
        parameter: value.quantity.name().to_owned(),
        running: value.running,
        value: value.value,
        low,
        high,
        window: window_s,
        windows: value.windows,
        changed: value.changed,
    }
}

/// The message of a change of mode.
#[must_use]
pub fn mode_change(transition: &Transition, frame_id: &str) -> ModeChange {
    ModeChange {
        header: header(transition.stamp, frame_id),
        from_mode: transition.from as u8,
        to_mode: transition.to as u8,
        reason: transition.cause.text().to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use mr_damper_model::inverse::LimitedBy;
    use mr_damper_model::pipeline as model;

    #[test]
    fn numbers_on_the_wire_agree_with_the_interface_package() {
        for (ours, theirs) in [
            (model::Mode::Arx, mr_damper_msgs::Mode::Arx),
            (model::Mode::ArxCoast, mr_damper_msgs::Mode::ArxCoast),
            (model::Mode::Model, mr_damper_msgs::Mode::Model),
            (model::Mode::Hold, mr_damper_msgs::Mode::Hold),
            (model::Mode::Fault, mr_damper_msgs::Mode::Fault),
        ] {
            assert_eq!((ours as u8, ours.name()), (theirs as u8, theirs.name()));
        }
        for (ours, theirs) in [
            (model::Validity::Valid, mr_damper_msgs::Validity::Valid),
            (model::Validity::Degraded, mr_damper_msgs::Validity::Degraded),
            (model::Validity::Extrapolating, mr_damper_msgs::Validity::Extrapolating),
            (model::Validity::Stale, mr_damper_msgs::Validity::Stale),
            (model::Validity::Invalid, mr_damper_msgs::Validity::Invalid),
        ] {
            assert_eq!((ours as u8, ours.name()), (theirs as u8, theirs.name()));
        }
        for (ours, theirs) in [
            (LimitedBy::None, mr_damper_msgs::LimitedBy::None),
            (LimitedBy::CurrentMax, mr_damper_msgs::LimitedBy::CurrentMax),
            (LimitedBy::CurrentMin, mr_damper_msgs::LimitedBy::CurrentMin),
            (LimitedBy::Rate, mr_damper_msgs::LimitedBy::Rate),
            (LimitedBy::Passivity, mr_damper_msgs::LimitedBy::Passivity),
            (LimitedBy::Safe, mr_damper_msgs::LimitedBy::Safe),
            (LimitedBy::NoInverse, mr_damper_msgs::LimitedBy::NoInverse),
        ] {
            assert_eq!((ours as u8, ours.name().to_lowercase().as_str()), (theirs as u8, theirs.name()));
        }
        assert_eq!(model::Reasons::ALL.len(), mr_damper_msgs::Reasons::ALL.len());
        for ((ours, our_name), (their_name, theirs)) in
            model::Reasons::ALL.iter().zip(mr_damper_msgs::Reasons::ALL)
        {
            assert_eq!((ours.0, *our_name), (theirs.bits(), *their_name));
        }
    }
}
