//! NaN in JSON.
//!
//! JSON has neither NaN nor infinity: serde_json writes `null` for both. Reading turns `null` into NaN, so
//! that a message with an unknown value survives the JSON mirror. Binary formats are not affected.

use serde::{Deserialize, Deserializer};

/// Reads an `f64`; in text formats `null` is NaN. For `#[serde(deserialize_with)]`.
pub(crate) fn or_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    if deserializer.is_human_readable() {
        Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
    } else {
        f64::deserialize(deserializer)
    }
}

/// Like [`or_null`], for an `f32`.
pub(crate) fn or_null_f32<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f32, D::Error> {
    if deserializer.is_human_readable() {
        Ok(Option::deserialize(deserializer)?.unwrap_or(f32::NAN))
    } else {
        f32::deserialize(deserializer)
    }
}
