//! Errors of the parts of a model: force models and effects.

use serde::Serialize;
use thiserror::Error;

/// Reasons why parts do not make a model.
#[derive(Debug, Clone, PartialEq, Error, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
#[non_exhaustive]
pub enum ForceError {
    /// An LPV model was requested without a drive.
    #[error("an lpv model needs a drive; without one, use the passive arx")]
    LpvWithoutDrive,
    /// The sets of one input of a fuzzy system have different shapes.
    #[error("{input}_sets[{index}] has another shape than {input}_sets[0]; use one shape")]
    MixedShapes {
        /// Name of the input.
        input: String,
        /// Number of the set that differs, from 0.
        index: usize,
    },
    /// Two inputs of a fuzzy system are the same signal.
    #[error("inputs[{index}] repeats {signal}; use each signal once")]
    RepeatedInput {
        /// Number of the second input, from 0.
        index: usize,
        /// Name of the signal.
        signal: &'static str,
    },
    /// A fuzzy system has a name that belongs to another structure.
    #[error(
        "the inputs, memberships and conclusions do not match {name}; a grid of another structure must be called \"anfis\""
    )]
    OtherStructure {
        /// The given name.
        name: &'static str,
    },
    /// A parameter of an effect lies outside its range.
    #[error("effect {effect}: {parameter} is {value}, but must be {}", range(*allowed))]
    EffectParameter {
        /// Id of the effect, with its form if there are several.
        effect: String,
        /// Name of the parameter, with its unit.
        parameter: &'static str,
        /// The invalid value.
        value: f64,
        /// Lowest and highest allowed value; infinite without a limit.
        allowed: [f64; 2],
    },
    /// An effect that changes the damper's force comes after an effect of the load cell.
    #[error(
        "effect {effect} comes after {load_cell}, but {load_cell} changes the reading of the load cell and {effect} the damper's force: \
         put the effects of the load cell last"
    )]
    EffectAfterLoadCell {
        /// Id of the effect, with its form if there are several.
        effect: String,
        /// Id of the first effect of the load cell.
        load_cell: String,
    },
    /// An effect acts on the drive, which the model lacks.
    #[error(
        "effect {effect} acts on the drive, but the {model} model has none: remove the effect, or use a model that depends on the drive"
    )]
    EffectWithoutDrive {
        /// Id of the effect.
        effect: &'static str,
        /// Name of the model.
        model: &'static str,
    },
    /// A term is not valid.
    #[error("effect term: {why}")]
    Term {
        /// The reason.
        why: &'static str,
    },
}

fn range([low, high]: [f64; 2]) -> String {
    match (low.is_finite(), high.is_finite()) {
        (true, true) => format!("{low} to {high}"),
        (true, false) => format!("finite and at least {low}"),
        _ => "finite".to_owned(),
    }
}
