//! SI unit types for the crate's public interface.
//!
//! Kernels compute on plain `f64` values in SI units. Values that cross a public interface have a type that
//! names their unit, so that a newton is never read as a pound-force. Each type wraps one `f64` and has no
//! run-time cost. Constants convert the US units that the thesis prints.
//!
//! ```
//! use mr_damper_model::units::{MetrePerSecond, N_M_PER_LBF_IN, Newton};
//!
//! let damping_n_s_m = 10.0 * N_M_PER_LBF_IN; // the thesis prints 10 lbf·s/in
//! let force = Newton(damping_n_s_m * MetrePerSecond(0.1).get());
//! assert_eq!(format!("{force:.1}"), "175.1 N");
//! ```

use serde::{Deserialize, Serialize};

/// Newtons in one pound-force.
pub const N_PER_LBF: f64 = 4.448_221_6;
/// Metres in one inch.
pub const M_PER_IN: f64 = 0.0254;
/// N/m in one lbf/in, and N·s/m in one lbf·s/in.
pub const N_M_PER_LBF_IN: f64 = N_PER_LBF / M_PER_IN;

/// `value` to so many significant digits, for a text.
pub(crate) fn rounded(value: f64, digits: usize) -> f64 {
    format!("{value:.*e}", digits - 1).parse().unwrap_or(value)
}

/// Suffixes of names of numbers with their units. The longest fitting suffix counts, so these are ordered by length.
const UNITS: [(&str, &str); 21] = [
    ("_n_s_m", "N s/m"),
    ("_n_m_s2", "N s^2/m"),
    ("_per_s", "1/s"),
    ("_per_m", "1/m"),
    ("_per_k", "1/K"),
    ("_m_s2", "m/s^2"),
    ("_n_m", "N/m"),
    ("_m_n", "m/N"),
    ("_n_s", "N/s"),
    ("_n_a", "N/A"),
    ("_n_v", "N/V"),
    ("_s_m", "s/m"),
    ("_m_s", "m/s"),
    ("_kg", "kg"),
    ("_hz", "Hz"),
    ("_n", "N"),
    ("_a", "A"),
    ("_v", "V"),
    ("_s", "s"),
    ("_m", "m"),
    ("_c", "C"),
];

/// The unit that the name of a number ends in, such as `stiffness_n_m`; `None` if it ends in none.
///
/// ```
/// use mr_damper_model::units::unit_of_name;
///
/// assert_eq!(unit_of_name("stiffness_n_m").as_deref(), Some("N/m"));
/// assert_eq!(unit_of_name("rising_b6_n_s6_m6").as_deref(), Some("N s^6/m^6"));
/// assert_eq!(unit_of_name("hysteresis_exponent"), None);
/// ```
#[must_use]
pub fn unit_of_name(name: &str) -> Option<String> {
    // N (s/m)^j
    let powers = name.rsplit_once("_n_s").and_then(|(_, powers)| powers.split_once("_m"));
    match powers {
        Some((power, other)) if power == other && power.parse::<u32>().is_ok() => {
            Some(format!("N s^{power}/m^{power}"))
        }
        _ => UNITS.iter().find(|(suffix, _)| name.ends_with(suffix)).map(|(_, unit)| (*unit).to_owned()),
    }
}

macro_rules! unit {
    ($(#[$doc:meta])* $name:ident, $symbol:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $name(
            /// The value in the unit of the type.
            pub f64,
        );

        impl $name {
            /// The unit's symbol.
            pub const SYMBOL: &'static str = $symbol;

            /// The plain number, in the unit of the type.
            #[inline]
            #[must_use]
            pub const fn get(self) -> f64 {
                self.0
            }

            /// True when the value is neither infinite nor NaN.
            #[inline]
            #[must_use]
            pub fn is_finite(self) -> bool {
                self.0.is_finite()
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                std::fmt::Display::fmt(&self.0, f)?;
                f.write_str(concat!(" ", $symbol))
            }
        }
    };
}

unit!(
    /// A length, in metres; positive displacement extends the damper.
    Metre, "m");
unit!(
    /// A velocity, in metres per second; positive velocity extends the damper.
    MetrePerSecond, "m/s");
unit!(
    /// A force, in newtons; positive force is tension on the rod.
    Newton, "N");
unit!(
    /// A current, in amperes.
    Ampere, "A");
unit!(
    /// A voltage, in volts.
    Volt, "V");
unit!(
    /// A duration, in seconds.
    Second, "s");
unit!(
    /// A frequency, in hertz.
    Hertz, "Hz");
unit!(
    /// A temperature, in degrees Celsius.
    Celsius, "°C");

#[cfg(test)]
mod tests {
    use super::unit_of_name;
    use crate::effect::Effect;

    #[test]
    fn the_name_of_each_effect_parameter_ends_in_its_unit() {
        for effect in Effect::ALL {
            for parameter in effect.parameters() {
                // The unit of the drive depends on the model, so it is in no name.
                let symbol = parameter.unit.symbol().unwrap_or_default().replace('²', "^2");
                let unit = unit_of_name(parameter.name).unwrap_or_default();
                assert_eq!(unit, symbol, "{} {}", effect.title(), parameter.name);
            }
        }
    }
}
