//! Errors of the virtual rig.

use serde::Serialize;
use thiserror::Error;

/// Reasons why an effect cannot be injected into the rig.
#[derive(Debug, Clone, PartialEq, Error, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
#[non_exhaustive]
pub enum RigError {
    /// The rig has no effect with this id.
    #[error("the rig has no effect \"{id}\"; it has {}", known.join(", "))]
    UnknownInjection {
        /// The given id.
        id: String,
        /// All ids.
        known: Vec<&'static str>,
    },
    /// The size of the effect lies outside its range.
    #[error("effect {id} is {size} {unit}, but must be {} to {}", range[0], range[1])]
    InjectionSize {
        /// Id of the effect.
        id: &'static str,
        /// The invalid size.
        size: f64,
        /// Its unit.
        unit: &'static str,
        /// Smallest and largest size.
        range: [f64; 2],
    },
}
