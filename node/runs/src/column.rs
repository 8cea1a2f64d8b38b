//! The columns of the run format: the quantity that a header names, and the conversion of its unit to SI.

use crate::extract::Dimension;
use mr_damper_model::units::{M_PER_IN, N_PER_LBF};

/// A quantity that the run format knows, in the order in which columns are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Quantity {
    Displacement,
    Velocity,
    Force,
    Current,
    Command,
    CaseTemperature,
    BodyVelocity,
    ForceRequest,
    AmbientTemperature,
    Setpoint,
}

/// One accepted column name with its conversion to SI.
struct Unit {
    name: &'static str,
    to_si: fn(f64) -> f64,
}

const fn unit(name: &'static str, to_si: fn(f64) -> f64) -> Unit {
    Unit { name, to_si }
}

pub(super) const fn same(value: f64) -> f64 {
    value
}

// A division by 1000 rounds once. A product with 0.001 would round twice, because 0.001 is itself rounded.
pub(super) const fn from_milli(value: f64) -> f64 {
    value / 1000.0
}

pub(super) const fn from_inch(value: f64) -> f64 {
    value * M_PER_IN
}

pub(super) const fn from_fahrenheit(value: f64) -> f64 {
    (value - 32.0) * 5.0 / 9.0
}

impl Quantity {
    pub(super) const ALL: [Self; 10] = [
        Self::Displacement,
        Self::Velocity,
        Self::Force,
        Self::Current,
        Self::Command,
        Self::CaseTemperature,
        Self::BodyVelocity,
        Self::ForceRequest,
        Self::AmbientTemperature,
        Self::Setpoint,
    ];

    /// The accepted names, the SI one first.
    const fn units(self) -> &'static [Unit] {
        match self {
            Self::Displacement => {
                const {
                    &[
                        unit("displacement_m", same),
                        unit("displacement_mm", from_milli),
                        unit("displacement_in", from_inch),
                    ]
                }
            }
            Self::Velocity => {
                const {
                    &[
                        unit("velocity_m_s", same),
                        unit("velocity_mm_s", from_milli),
                        unit("velocity_in_s", from_inch),
                    ]
                }
            }
            Self::Force => {
                const {
                    &[
                        unit("force_n", same),
                        unit("force_lbf", |f| f * N_PER_LBF),
                        unit("force_kn", |f| f * 1000.0),
                    ]
                }
            }
            Self::Current => const { &[unit("current_a", same), unit("current_ma", from_milli)] },
            Self::Command => const { &[unit("command_v", same)] },
            Self::CaseTemperature => {
                const { &[unit("case_temp_c", same), unit("case_temp_f", from_fahrenheit)] }
            }
            Self::BodyVelocity => const { &[unit("body_velocity_m_s", same)] },
            Self::ForceRequest => const { &[unit("force_request_n", same)] },
            Self::AmbientTemperature => {
                const { &[unit("ambient_temp_c", same), unit("ambient_temp_f", from_fahrenheit)] }
            }
            Self::Setpoint => {
                const {
                    &[
                        unit("setpoint_m", same),
                        unit("setpoint_mm", from_milli),
                        unit("setpoint_in", from_inch),
                    ]
                }
            }
        }
    }

    /// The physical dimension.
    pub(super) const fn dimension(self) -> Dimension {
        match self {
            Self::Displacement | Self::Setpoint => Dimension::Length,
            Self::Velocity | Self::BodyVelocity => Dimension::Velocity,
            Self::Force | Self::ForceRequest => Dimension::Force,
            Self::Current => Dimension::Current,
            Self::Command => Dimension::Voltage,
            Self::CaseTemperature | Self::AmbientTemperature => Dimension::Temperature,
        }
    }

    /// The column name with the SI unit, as in [`mr_damper_model::sample::Run::other`] and written files.
    pub(super) fn si_name(self) -> &'static str {
        self.units()[0].name
    }

    /// All accepted column names, for messages.
    pub(super) fn names(self) -> String {
        let names: Vec<_> = self.units().iter().map(|unit| unit.name).collect();
        names.join(", ")
    }

    /// The quantity whose SI column has this name.
    pub(super) fn of_si_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|quantity| quantity.si_name() == name)
    }
}

/// The meaning of a header cell.
pub(super) enum Column {
    /// `time_s`. A time in another unit is [`Self::Other`], because it may stand beside `time_s`.
    Time,
    /// A known quantity, with the conversion of its values to SI.
    Known(Quantity, fn(f64) -> f64),
    /// Any other column: carried through unchanged.
    Other,
}

impl Column {
    /// Parses a header cell, ignoring case: `Force_N` is a force, not an unknown column.
    pub(super) fn of_header(name: &str) -> Self {
        if name.eq_ignore_ascii_case("time_s") {
            return Self::Time;
        }
        for quantity in Quantity::ALL {
            if let Some(unit) = quantity.units().iter().find(|u| u.name.eq_ignore_ascii_case(name)) {
                return Self::Known(quantity, unit.to_si);
            }
        }
        Self::Other
    }

    /// True if a carried column of SI values may have this name: no reader takes it for another quantity or for a quantity
    /// in another unit.
    pub(super) fn is_carried(name: &str) -> bool {
        match Self::of_header(name) {
            Self::Time => false,
            Self::Known(quantity @ (Quantity::AmbientTemperature | Quantity::Setpoint), _) => {
                name == quantity.si_name()
            }
            Self::Known(..) => false,
            // Blanks around a header are ignored when it is read.
            Self::Other => !name.trim().is_empty() && name == name.trim_ascii(),
        }
    }

    /// The quantity that an unknown column seems to mean: its name has no unit (`force`) or an unknown unit (`force_kgf`).
    /// Such a column is carried but not used, so the user gets a note.
    pub(super) fn resembles(name: &str) -> Option<Quantity> {
        let name = name.to_ascii_lowercase();
        Quantity::ALL.into_iter().find(|quantity| {
            // SI names end in `_m`, `_c`, ..., and the name of velocity in `_m_s`.
            let si = quantity.si_name();
            let stem = si.strip_suffix("_m_s").or_else(|| si.rsplit_once('_').map(|(stem, _)| stem));
            let Some(stem) = stem else { return false };
            name.strip_prefix(stem).is_some_and(|rest| match rest.strip_prefix(['_', ' ', '[', '(']) {
                Some(unit) => unit.len() <= 5 && !unit.contains('_'),
                None => rest.is_empty(),
            })
        })
    }
}

/// The columns of the thesis' acquisition files, in order, with their units: inches, pounds-force, amperes, °C.
pub(super) const THESIS_ORDER: [&str; 7] =
    ["time_s", "displacement_in", "force_lbf", "current_a", "ambient_temp_c", "case_temp_c", "setpoint_in"];

#[cfg(test)]
mod tests {
    use super::*;

    fn si(name: &str, value: f64) -> (Quantity, f64) {
        match Column::of_header(name) {
            Column::Known(quantity, to_si) => (quantity, to_si(value)),
            _ => panic!("{name} is not known"),
        }
    }

    #[test]
    fn converts_every_unit() {
        assert_eq!(si("displacement_mm", 25.4), (Quantity::Displacement, 0.0254));
        assert_eq!(si("displacement_in", 1.0), (Quantity::Displacement, 0.0254));
        assert_eq!(si("velocity_in_s", 2.0), (Quantity::Velocity, 0.0508));
        assert_eq!(si("force_lbf", 1.0), (Quantity::Force, 4.448_221_6));
        assert_eq!(si("Force_kN", 1.5), (Quantity::Force, 1500.0));
        assert_eq!(si("current_ma", 250.0), (Quantity::Current, 0.25));
        assert_eq!(si("command_v", 2.25), (Quantity::Command, 2.25));
        assert_eq!(si("case_temp_f", 212.0), (Quantity::CaseTemperature, 100.0));
        assert_eq!(si("ambient_temp_c", 21.0), (Quantity::AmbientTemperature, 21.0));
        assert_eq!(si("setpoint_in", 1.0), (Quantity::Setpoint, 0.0254));
    }

    #[test]
    fn resembles_finds_only_similar_names() {
        assert_eq!(Column::resembles("force"), Some(Quantity::Force));
        assert_eq!(Column::resembles("Force (N)"), Some(Quantity::Force));
        assert_eq!(Column::resembles("velocity_cm_s"), None);
        assert_eq!(Column::resembles("displacement_cm"), Some(Quantity::Displacement));
        assert_eq!(Column::resembles("forced_cooling"), None);
        assert_eq!(Column::resembles("force_setpoint_n"), None);
    }
}
