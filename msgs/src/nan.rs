//! NaN in JSON.
//!
//! JSON has no NaN and no infinity: serde_json writes `null` for both. Reading takes `null` back as NaN, so
//! that a message with an unknown figure survives the JSON mirror. Binary formats are untouched.

use serde::{Deserialize, Deserializer};

/// Reads an `f64`; `null` is NaN in text formats. For `#[serde(deserialize_with)]`.
pub(crate) fn or_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    if deserializer.is_human_readable() {
        Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
    } else {
        f64::deserialize(deserializer)
    }
}

/// The same for an `f32`.
pub(crate) fn or_null_f32<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f32, D::Error> {
    if deserializer.is_human_readable() {
        Ok(Option::deserialize(deserializer)?.unwrap_or(f32::NAN))
    } else {
        f32::deserialize(deserializer)
    }
}
