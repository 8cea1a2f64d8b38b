//! The type of the numbers in exported code.

/// The type of the numbers in exported code.
///
/// ```
/// use mr_damper_export::{CExport, Precision};
/// use mr_damper_model::preset;
///
/// let model = preset::load(preset::BEST_FUZZY_TANH)?;
/// let source = CExport::new("damper", &model).precision(Precision::Single).source().expect("it is exported");
/// assert!(source.header.contains("    float force_n;") && source.source.contains("1.0f"));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Precision {
    /// `double`: the bits of the service.
    #[default]
    Double,
    /// `float`, for a processor whose FPU has single precision only. Results differ from the service's by rounding errors.
    Single,
}

impl Precision {
    /// The type in C.
    #[must_use]
    pub const fn c_type(self) -> &'static str {
        match self {
            Self::Double => "double",
            Self::Single => "float",
        }
    }

    /// Size of a number, bytes.
    #[must_use]
    pub const fn size(self) -> u64 {
        match self {
            Self::Double => 8,
            Self::Single => 4,
        }
    }
}

/// `text`, C code in double precision, in single precision: `float` in the place of `double`, and each number with the suffix `f`. A number
/// that a float cannot hold becomes the nearest one that is neither zero nor infinite. Comments, texts and lines of the preprocessor that
/// include files stay.
pub(crate) fn single(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let length = match first {
            '/' if rest.starts_with("/*") => rest.find("*/").map_or(rest.len(), |end| end + 2),
            '"' => 2 + rest[1..].find('"').map_or(rest.len() - 2, |end| end),
            c if c.is_ascii_alphabetic() || c == '_' => {
                rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(rest.len())
            }
            c if c.is_ascii_digit() => number_length(rest),
            c => c.len_utf8(),
        };
        let (token, after) = rest.split_at(length);
        match token {
            "double" => out.push_str("float"),
            _ if first.is_ascii_digit() => out.push_str(&single_number(token)),
            _ => out.push_str(token),
        }
        rest = after;
    }
    out
}

/// Length of the number at the start of `text`, with its suffix.
fn number_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    let is_hexadecimal = text.starts_with("0x");
    let mut end = 0;
    while let Some(byte) = bytes.get(end) {
        let is_exponents_sign = matches!(byte, b'+' | b'-')
            && !is_hexadecimal
            && matches!(end.checked_sub(1).and_then(|before| bytes.get(before)), Some(b'e' | b'E'));
        if !(byte.is_ascii_alphanumeric() || *byte == b'.' || is_exponents_sign) {
            break;
        }
        end += 1;
    }
    end
}

fn single_number(token: &str) -> String {
    // A hexadecimal number, or one with a suffix, does not parse, and stays.
    match token.parse::<f64>() {
        Ok(value) if token.contains(['.', 'e']) => {
            let nearest = value as f32;
            if value != 0.0 && nearest.abs() < f32::MIN_POSITIVE {
                "1.17549435e-38f".to_owned()
            } else if nearest.is_infinite() {
                "3.40282347e+38f".to_owned()
            } else {
                format!("{token}f")
            }
        }
        _ => token.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_and_numbers_change_and_all_else_stays() {
        let code = "static double mrd_x(double doubled, int k) { /* double 1.0 */ return (double)k * 1.5e-3 + a[2].x - 0x1F / 3U; }";
        assert_eq!(
            single(code),
            "static float mrd_x(float doubled, int k) { /* double 1.0 */ return (float)k * 1.5e-3f + a[2].x - 0x1F / 3U; }"
        );
        assert_eq!(
            single("#error \"not 1.0 of double\"\n1.0f; 62.0;"),
            "#error \"not 1.0 of double\"\n1.0f; 62.0f;"
        );
        assert_eq!(
            single("UINT64_C(0x7ff0000000000000) 1e9 10 x1.y"),
            "UINT64_C(0x7ff0000000000000) 1e9f 10 x1.y"
        );
    }

    #[test]
    fn numbers_beyond_a_float_become_its_ends() {
        assert_eq!(single("1e-200, 1e200, 0.0"), "1.17549435e-38f, 3.40282347e+38f, 0.0f");
    }
}
