//! The parameters' structure of an export: of the force model, then of effects, terms, conditioning, checks and ranges.

use super::{CExport, Level};
use crate::forces::Force;
use crate::parameter::CParameter;
use crate::terms::TermCode;
use mr_damper_model::condition::{ApplyTo, VelocitySource};
use mr_damper_model::effect::Need;
use mr_damper_model::sample::DriveKind;

impl CExport<'_> {
    /// The parameters in the order of the structure, without those of an inverse.
    pub(super) fn parameters(
        &self,
        force: &Force,
        levels: &[Level<'_>],
        terms: Option<&TermCode>,
    ) -> Vec<CParameter> {
        let (model, settings) = (self.model, &self.settings);
        let mut all = force.parameters.clone();
        for level in levels {
            let effect = level.effect;
            for ((known, value), field) in
                effect.effect().parameters().iter().zip(effect.parameters()).zip(&level.fields)
            {
                let unit =
                    known.unit.symbol().or(model.force.drive().map(DriveKind::unit)).unwrap_or_default();
                let [low, high] = known.allowed();
                let about = format!("effect {}: {}", effect.effect().title(), known.label());
                let parameter = CParameter::scalar(field, unit, about, *value);
                let range = (low.is_finite() && high.is_finite()).then_some([low, high]);
                all.push(CParameter { range, ..parameter });
            }
        }
        all.extend(terms.iter().flat_map(|terms| terms.parameters.clone()));
        let conditioning = &model.conditioning;
        if conditioning.apply_to != ApplyTo::None {
            let of = if conditioning.apply_to == ApplyTo::Inputs { "displacement" } else { "force" };
            let about = format!("corner frequency of the low-pass of {of}");
            all.push(
                CParameter::scalar("cutoff_hz", "Hz", about, conditioning.cutoff_hz).within([0.1, 10_000.0]),
            );
        }
        if conditioning.velocity == VelocitySource::Slope {
            let about = "window of the slope that is the velocity";
            all.push(
                CParameter::scalar("slope_window_s", "s", about, conditioning.slope_window_s)
                    .within([1e-4, 1.0]),
            );
        }
        all.extend([
            CParameter::scalar(
                "gap_s",
                "s",
                "longest time between displacements without a restart",
                settings.gap_s,
            ),
            CParameter::scalar(
                "displacement_max_m",
                "m",
                "displacements beyond it are refused",
                settings.plausible.displacement_max_m,
            ),
            CParameter::scalar(
                "speed_max_m_s",
                "m/s",
                "largest speed of the rod",
                settings.plausible.speed_max_m_s,
            ),
        ]);
        let (envelope, drive) = (&model.envelope, model.force.drive());
        if drive.is_some() {
            let about = "age of the drive beyond which it is stale";
            all.push(CParameter::scalar("input_timeout_s", "s", about, settings.input_timeout_s));
        }
        let mut range = |name: String, unit: &str, what: &str, range: Option<[f64; 2]>| {
            if let Some(range) = range {
                all.push(CParameter::array(
                    name,
                    unit,
                    format!("{what} of the training data, low and high"),
                    &range,
                ));
            }
        };
        range("displacement_range_m".to_owned(), "m", "displacements", envelope.displacement_m);
        range("velocity_range_m_s".to_owned(), "m/s", "velocities", envelope.velocity_m_s);
        if let Some(kind) = drive {
            range(format!("drive_range_{}", kind.unit_suffix()), kind.unit(), "drives", envelope.drive);
        }
        if model.effects.need(Need::CaseTemperature) {
            range(
                "case_temp_range_c".to_owned(),
                "degrees Celsius",
                "case temperatures",
                envelope.case_temp_c,
            );
        }
        range("force_range_n".to_owned(), "N", "forces", envelope.force_n);
        all
    }
}
