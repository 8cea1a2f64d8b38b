//! Features of a model on which exported code depends: the conditions `#if MRD_...` of the fragments.

use mr_damper_model::condition::{ApplyTo, VelocitySource};
use mr_damper_model::effect::Need;
use mr_damper_model::model::Model;
use std::collections::BTreeMap;

/// Values of the conditions.
#[derive(Debug, Clone, Default)]
pub(crate) struct Features {
    values: BTreeMap<&'static str, bool>,
}

impl Features {
    pub(crate) fn of(model: &Model) -> Self {
        let (conditioning, envelope) = (&model.conditioning, &model.envelope);
        let has_drive = model.force.drive().is_some();
        let needs_temperature = model.effects.need(Need::CaseTemperature);
        let filters = conditioning.apply_to != ApplyTo::None;
        let by_slope = conditioning.velocity == VelocitySource::Slope;
        let is_measured = conditioning.velocity == VelocitySource::Measured;
        let mut features = Self::default();
        for (name, value) in [
            ("HAS_DRIVE", has_drive),
            ("NEEDS_TEMPERATURE", needs_temperature),
            ("HAS_HELD", has_drive || needs_temperature || is_measured),
            (
                "HAS_RANGES",
                envelope.force_n.is_some()
                    || envelope.displacement_m.is_some()
                    || envelope.velocity_m_s.is_some()
                    || (has_drive && envelope.drive.is_some())
                    || (needs_temperature && envelope.case_temp_c.is_some()),
            ),
            ("FILTERS", filters),
            ("SETTLES", filters || by_slope),
            ("APPLY_TO_INPUTS", conditioning.apply_to == ApplyTo::Inputs),
            ("APPLY_TO_OUTPUT", conditioning.apply_to == ApplyTo::Output),
            ("VELOCITY_MEASURED", is_measured),
            ("VELOCITY_SLOPE", by_slope),
            ("HAS_DERIVATIVE", !is_measured),
            ("HAS_LOAD_CELL", model.effects.include_load_cell()),
            ("HAS_TERMS", !model.effects.terms().is_empty()),
            ("HAS_FORCE_RANGE", envelope.force_n.is_some()),
            ("HAS_DISPLACEMENT_RANGE", envelope.displacement_m.is_some()),
            ("HAS_VELOCITY_RANGE", envelope.velocity_m_s.is_some()),
            ("HAS_DRIVE_RANGE", has_drive && envelope.drive.is_some()),
            ("HAS_TEMPERATURE_RANGE", needs_temperature && envelope.case_temp_c.is_some()),
        ] {
            features.set(name, value);
        }
        features
    }

    pub(crate) fn set(&mut self, name: &'static str, value: bool) {
        self.values.insert(name, value);
    }

    /// The value of `MRD_name`; `None` if there is no such feature.
    pub(crate) fn get(&self, name: &str) -> Option<bool> {
        self.values.get(name).copied()
    }
}
