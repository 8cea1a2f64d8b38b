//! Units in which a channel may be recorded, for each physical dimension.

use super::column::{Quantity, from_fahrenheit, from_inch, from_milli, same};
use crate::extract::Dimension;
use mr_damper_model::units::N_PER_LBF;

/// A unit and its conversion to SI (temperatures: °C).
#[derive(Debug, Clone, Copy)]
pub(super) struct Unit {
    /// Its name in messages and maps, such as `mm/s`.
    pub(super) name: &'static str,
    /// Other spellings, as in the names of columns; case is ignored.
    also: &'static [&'static str],
    pub(super) to_si: fn(f64) -> f64,
}

impl PartialEq for Unit {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

const fn unit(name: &'static str, also: &'static [&'static str], to_si: fn(f64) -> f64) -> Unit {
    Unit { name, also, to_si }
}

const LENGTH: &[Unit] = &[
    unit("m", &[], same),
    unit("cm", &[], |v| v / 100.0),
    unit("mm", &[], from_milli),
    unit("um", &["µm", "μm"], |v| v / 1e6),
    unit("in", &["inch"], from_inch),
];
const VELOCITY: &[Unit] = &[
    unit("m/s", &["m_s", "mps"], same),
    unit("cm/s", &["cm_s"], |v| v / 100.0),
    unit("mm/s", &["mm_s"], from_milli),
    unit("in/s", &["in_s"], from_inch),
];
const FORCE: &[Unit] = &[
    unit("N", &[], same),
    unit("kN", &[], |v| v * 1000.0),
    unit("lbf", &["lb"], |v| v * N_PER_LBF),
    unit("kgf", &["kp"], |v| v * 9.80665),
];
const CURRENT: &[Unit] = &[unit("A", &[], same), unit("mA", &[], from_milli)];
const VOLTAGE: &[Unit] = &[unit("V", &[], same), unit("mV", &[], from_milli)];
const TEMPERATURE: &[Unit] = &[
    unit("C", &["°C", "degC"], same),
    unit("F", &["°F", "degF"], from_fahrenheit),
    unit("K", &["kelvin"], |v| v - 273.15),
];

/// A unit of time, as a power of ten of a second.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TimeUnit {
    pub(super) name: &'static str,
    /// The unit is 10 to this power seconds.
    pub(super) exponent: i32,
}

/// The units of time, the second first.
pub(super) const TIME: &[TimeUnit] = &[
    TimeUnit { name: "s", exponent: 0 },
    TimeUnit { name: "ms", exponent: -3 },
    TimeUnit { name: "us", exponent: -6 },
    TimeUnit { name: "ns", exponent: -9 },
];

/// All names of the run format, for messages.
pub(super) fn all_names() -> String {
    let times = TIME.iter().map(|unit| format!("time_{}", unit.name));
    let names: Vec<String> = times.chain(Quantity::ALL.into_iter().map(Quantity::names)).collect();
    names.join(", ")
}

/// The units of a quantity, the SI one first.
pub(super) const fn of(dimension: Dimension) -> &'static [Unit] {
    match dimension {
        Dimension::Length => LENGTH,
        Dimension::Velocity => VELOCITY,
        Dimension::Force => FORCE,
        Dimension::Current => CURRENT,
        Dimension::Voltage => VOLTAGE,
        Dimension::Temperature => TEMPERATURE,
    }
}

impl Unit {
    fn spellings(&self) -> impl Iterator<Item = &'static str> {
        std::iter::once(self.name).chain(self.also.iter().copied())
    }

    /// The unit with this name, ignoring case.
    pub(super) fn named(dimension: Dimension, name: &str) -> Option<Self> {
        let is_it = |unit: &&Self| unit.spellings().any(|spelling| spelling.eq_ignore_ascii_case(name));
        of(dimension).iter().find(is_it).copied()
    }

    /// The unit in the name of a column: `pos_mm`, `pos [mm]`, `pos (mm)`.
    pub(super) fn in_column(dimension: Dimension, column: &str) -> Option<Self> {
        let length = |unit: &Self| unit.spellings().filter_map(|it| name_ends_in(column, it)).max();
        // Several spellings may match the end of a name; the longest is the intended one.
        of(dimension)
            .iter()
            .filter_map(|unit| Some((length(unit)?, unit)))
            .max_by_key(|it| it.0)
            .map(|it| *it.1)
    }

    /// True if the name of a column ends in a unit of any dimension.
    pub(super) fn is_in_column(column: &str) -> bool {
        Dimension::ALL.into_iter().any(|dimension| Self::in_column(dimension, column).is_some())
    }
}

impl TimeUnit {
    /// The unit with this name, ignoring case.
    pub(super) fn named(name: &str) -> Option<Self> {
        TIME.iter().find(|unit| unit.name.eq_ignore_ascii_case(name)).copied()
    }

    /// The unit of a time in the run format: `time_s`, `time_ms`, ..., ignoring case.
    pub(super) fn of_name(name: &str) -> Option<Self> {
        let (stem, unit) = name.split_once('_')?;
        Self::named(unit).filter(|_| stem.eq_ignore_ascii_case("time"))
    }

    /// The unit in the name of a column.
    pub(super) fn in_column(column: &str) -> Option<Self> {
        TIME.iter().find(|unit| name_ends_in(column, unit.name).is_some()).copied()
    }
}

/// The length of `unit` if `column` ends in it, after `_` or in brackets.
fn name_ends_in(column: &str, unit: &str) -> Option<usize> {
    let (column, unit) = (column.to_lowercase(), unit.to_lowercase());
    let column = column.trim_end();
    let ends = |open: &str, close: &str| {
        column
            .strip_suffix(close)
            .and_then(|rest| rest.strip_suffix(&*unit))
            .is_some_and(|rest| rest.ends_with(open))
    };
    (ends("_", "") || ends("[", "]") || ends("(", ")")).then_some(unit.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_is_found_at_the_end_of_a_column_name() {
        let found = |of, column| Unit::in_column(of, column).map(|unit| unit.name);
        for (of, column, unit) in [
            (Dimension::Length, "susp_pos_mm", Some("mm")),
            (Dimension::Length, "Stroke [MM]", Some("mm")),
            (Dimension::Length, "stroke (in)", Some("in")),
            (Dimension::Length, "position", None),
            (Dimension::Length, "pos_kn", None),
            (Dimension::Velocity, "v_mm_s", Some("mm/s")),
            (Dimension::Velocity, "v [mm/s]", Some("mm/s")),
            (Dimension::Velocity, "v_m_s", Some("m/s")),
            (Dimension::Force, "load_kN", Some("kN")),
            (Dimension::Temperature, "oil [°C]", Some("C")),
        ] {
            assert_eq!(found(of, column), unit, "{column}");
        }
        assert_eq!(TimeUnit::in_column("t_ms").map(|unit| unit.exponent), Some(-3));
        assert_eq!(TimeUnit::in_column("Time [s]").map(|unit| unit.exponent), Some(0));
        assert_eq!(TimeUnit::in_column("Time"), None);
    }

    #[test]
    fn units_are_converted_to_si() {
        let si = |of, name: &str, value: f64| (Unit::named(of, name).expect("known").to_si)(value);
        for (of, name, value, expected) in [
            (Dimension::Length, "mm", 25.4, 0.0254),
            (Dimension::Length, "cm", 2.0, 0.02),
            (Dimension::Length, "um", 500.0, 5e-4),
            (Dimension::Length, "IN", 1.0, 0.0254),
            (Dimension::Velocity, "mm_s", 250.0, 0.25),
            (Dimension::Velocity, "in/s", 2.0, 0.0508),
            (Dimension::Force, "kn", 1.5, 1500.0),
            (Dimension::Force, "lbf", 1.0, 4.448_221_6),
            (Dimension::Force, "kgf", 2.0, 19.6133),
            (Dimension::Current, "mA", 250.0, 0.25),
            (Dimension::Voltage, "mV", 250.0, 0.25),
            (Dimension::Temperature, "degF", 212.0, 100.0),
            (Dimension::Temperature, "K", 300.0, 300.0 - 273.15),
        ] {
            assert_eq!(si(of, name, value), expected, "{name}");
        }
        assert!(Unit::named(Dimension::Length, "deg").is_none());
    }
}
