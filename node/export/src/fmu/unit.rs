//! Units of an FMU: symbols as Modelica writes them, with their SI base units.
//!
//! ```text
//! N s^2/m  →  N.s2/m, and N = kg m s^-2, so its base unit is kg: the exponents of the factors add
//! ```

use crate::error::ExportError;
use std::fmt::Write as _;

/// SI base units, in the order of the standard's attributes.
const BASES: [&str; 5] = ["kg", "m", "s", "A", "K"];

/// Known units with their exponents of [`BASES`], and the offset to the base unit.
const KNOWN: [(&str, [i32; 5], f64); 12] = [
    ("1", [0, 0, 0, 0, 0], 0.0),
    ("kg", [1, 0, 0, 0, 0], 0.0),
    ("m", [0, 1, 0, 0, 0], 0.0),
    ("s", [0, 0, 1, 0, 0], 0.0),
    ("A", [0, 0, 0, 1, 0], 0.0),
    ("K", [0, 0, 0, 0, 1], 0.0),
    ("degC", [0, 0, 0, 0, 1], 273.15),
    ("Hz", [0, 0, -1, 0, 0], 0.0),
    ("N", [1, 1, -2, 0, 0], 0.0),
    ("J", [1, 2, -2, 0, 0], 0.0),
    ("W", [1, 2, -3, 0, 0], 0.0),
    ("V", [1, 2, -3, -1, 0], 0.0),
];

/// A unit that an FMU defines.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FmuUnit {
    /// Its name, in the syntax of Modelica.
    pub(super) name: String,
    exponents: [i32; 5],
    offset: f64,
}

impl FmuUnit {
    /// The unit that `symbol` is, as parameters have it: factors with exponents, and at most one `/`.
    ///
    /// # Errors
    /// [`ExportError::Unit`] for a symbol that is not known.
    pub(super) fn of(symbol: &str) -> Result<Self, ExportError> {
        let unknown = || ExportError::Unit { symbol: symbol.to_owned() };
        let plain = match symbol {
            "C" | "°C" | "degrees Celsius" => "degC".to_owned(),
            other => other.replace('²', "2").replace('^', ""),
        };
        let mut own = Self { name: plain.replace(' ', "."), exponents: [0; 5], offset: 0.0 };
        let (over, under) = plain.split_once('/').unwrap_or((&plain, ""));
        for (side, sign) in [(over, 1), (under, -1)] {
            for factor in side.split_whitespace() {
                let letters = factor.trim_end_matches(|c: char| c.is_ascii_digit());
                let (name, power) = match (letters, &factor[letters.len()..]) {
                    ("", one) => (one, 1),
                    (name, "") => (name, 1),
                    (name, power) => (name, power.parse().map_err(|_| unknown())?),
                };
                let (_, exponents, offset) =
                    KNOWN.iter().find(|(known, ..)| *known == name).ok_or_else(unknown)?;
                // A temperature has an offset only if it stands alone.
                if *offset != 0.0 && plain != name {
                    return Err(unknown());
                }
                own.offset = *offset;
                for (sum, exponent) in own.exponents.iter_mut().zip(exponents) {
                    *sum += sign * power * exponent;
                }
            }
        }
        Ok(own)
    }

    /// Its definition in a model description.
    pub(super) fn definition(&self) -> String {
        let mut base = String::new();
        for (name, exponent) in BASES.iter().zip(self.exponents) {
            if exponent != 0 {
                let _ = write!(base, " {name}=\"{exponent}\"");
            }
        }
        if self.offset != 0.0 {
            let _ = write!(base, " offset=\"{}\"", self.offset);
        }
        format!("    <Unit name=\"{}\"><BaseUnit{base}/></Unit>\n", self.name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Exponents of kg, m, s, A and K after the SI brochure, 9th edition, tables 4 to 6.
    #[test]
    fn units_have_the_base_units_of_the_si_brochure() {
        for (symbol, name, exponents) in [
            ("N s/m", "N.s/m", [1, 0, -1, 0, 0]),
            ("N s^2/m", "N.s2/m", [1, 0, 0, 0, 0]),
            ("N s²/m²", "N.s2/m2", [1, -1, 0, 0, 0]),
            ("N s^6/m^6", "N.s6/m6", [1, -5, 4, 0, 0]),
            ("N/V", "N/V", [0, -1, 1, 1, 0]),
            ("1/K", "1/K", [0, 0, 0, 0, -1]),
            ("m/N", "m/N", [-1, 0, 2, 0, 0]),
            ("m/s²", "m/s2", [0, 1, -2, 0, 0]),
            ("Hz", "Hz", [0, 0, -1, 0, 0]),
            ("J", "J", [1, 2, -2, 0, 0]),
        ] {
            let unit = FmuUnit::of(symbol).expect("known");
            assert_eq!((unit.name.as_str(), unit.exponents, unit.offset), (name, exponents, 0.0), "{symbol}");
        }
        for celsius in ["C", "°C", "degrees Celsius"] {
            let definition = FmuUnit::of(celsius).expect("known").definition();
            assert_eq!(definition.trim(), r#"<Unit name="degC"><BaseUnit K="1" offset="273.15"/></Unit>"#);
        }
    }

    #[test]
    fn an_unknown_unit_is_refused_by_its_symbol() {
        for symbol in ["lbf", "N furlong", "C/m", "N/lb"] {
            let error = FmuUnit::of(symbol).expect_err("unknown").to_string();
            assert!(symbol == "C/m" || error.contains(symbol), "{error}");
        }
    }
}
