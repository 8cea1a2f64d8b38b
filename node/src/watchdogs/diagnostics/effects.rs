//! Status of the force ratio and of the values of the running model's effects.

use super::{StatusContext, value};
use mr_damper_model::tracking::EffectValue;
use mr_damper_msgs::standard::DiagnosticStatus;

/// The status of the values of the last window.
#[must_use]
pub fn effect_status(latest: &[EffectValue], context: &StatusContext<'_>) -> DiagnosticStatus {
    let changed: Vec<&EffectValue> = latest.iter().filter(|it| it.changed).collect();
    let (level, message) = if latest.is_empty() {
        let message =
            "no window is complete yet: it needs measured_force at the stamps of displacement, and motion";
        (DiagnosticStatus::STALE, message.to_owned())
    } else if changed.is_empty() {
        (DiagnosticStatus::OK, "no value has changed".to_owned())
    } else {
        let names: Vec<String> = changed.iter().map(|it| key(it)).collect();
        let message = format!(
            "the value has changed: {}; compare it with a healthy damper, or diagnose the damper with close_loop",
            names.join(", ")
        );
        (DiagnosticStatus::WARN, message)
    };
    let values = latest.iter().flat_map(|it| {
        let [low, high] = it.ci95;
        [
            value(&key(it), format_args!("{:.4e}", it.value)),
            value(&format!("{}.ci95", key(it)), format_args!("{low:.4e} to {high:.4e}")),
            value(&format!("{}.running", key(it)), format_args!("{:.4e}", it.running)),
        ]
    });
    DiagnosticStatus {
        level,
        name: format!("{}: effects", context.node),
        message,
        hardware_id: context.damper.to_owned(),
        values: values.collect(),
    }
}

/// A value as in model files: the effect's id and the parameter's name.
fn key(value: &EffectValue) -> String {
    let name = value.quantity.name();
    value.quantity.effect().map_or_else(|| name.to_owned(), |effect| format!("{}.{name}", effect.id()))
}

#[cfg(test)]
mod tests {
    use super::super::context;
    use super::*;
    use crate::estimation::wire::ModelNames;
    use mr_damper_model::effect::Effect;
    use mr_damper_model::sample::Stamp;
    use mr_damper_model::tracking::Quantity;

    #[test]
    fn a_changed_value_is_a_warning() {
        let names = ModelNames::default();
        let context = context(&names);
        let status = |latest: &[EffectValue]| effect_status(latest, &context);
        assert_eq!(status(&[]).level, DiagnosticStatus::STALE);
        let stamp = Stamp::from_nanos(1_700_000_000_250_000_000);
        let quantity = Quantity::Effect { effect: Effect::CoilLag, parameter: 0 };
        let lag = EffectValue {
            stamp,
            quantity,
            running: 0.012,
            value: 0.0143,
            ci95: [0.0142, 0.0144],
            windows: 12,
            excitation: [-5.0, -2.0, 0.5],
            changed: false,
        };
        assert_eq!(status(&[lag]).level, DiagnosticStatus::OK);
        insta::assert_debug_snapshot!(status(&[EffectValue { changed: true, ..lag }]));
    }
}
