//! Errors of the inverse controller.

use serde::Serialize;
use thiserror::Error;

/// A model has no inverse.
#[derive(Debug, Clone, PartialEq, Error, Serialize)]
#[error("no inverse of the {model} model: it {why}")]
pub struct InverseError {
    /// Name of the model.
    pub model: &'static str,
    /// The reason.
    #[serde(flatten)]
    pub why: NoInverse,
}

/// Reasons why a model has no inverse, each with what to do. The sentence continues "the model ...".
#[derive(Debug, Clone, PartialEq, Error, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
#[non_exhaustive]
pub enum NoInverse {
    /// The drive of the model is a voltage.
    #[error("is driven by a voltage, not a current; identify it on runs with current_a")]
    DrivenByVoltage,
    /// The model has no drive.
    #[error("has no current input; use a model with one")]
    NoCurrentInput,
    /// The model has too few finite forces.
    #[error(
        "has a finite force at only {finite} of {points} points of its own envelope, so no current can be computed; check it with \
         `mr-damper evaluate`, or use another model"
    )]
    FewFiniteForces {
        /// Number of points with a finite force.
        finite: usize,
        /// Number of points.
        points: usize,
    },
    /// The model file has no learned inverse of this kind.
    #[error(
        "{}; identify it with the model: `mr-damper identify --inverse {method} --model NAME RUN... --out MODEL.toml`, or use {}",
        match held {
            None => format!("has no inverse model {method} in its file"),
            Some(held) => format!("has the inverse model {held} in its file, not {method}"),
        },
        held.unwrap_or("search"),
    )]
    NotLearned {
        /// Name of the method.
        method: &'static str,
        /// The learned inverse that the file has.
        held: Option<&'static str>,
    },
    /// The learned inverse belongs to another sample rate.
    #[error(
        "has an inverse model {method} for {learned_hz:.6} Hz, but its own rate is {rate_hz:.6} Hz; identify both from the same runs"
    )]
    OtherRate {
        /// Name of the method.
        method: &'static str,
        /// Sample rate of the learned inverse, Hz.
        learned_hz: f64,
        /// Sample rate of the model, Hz.
        rate_hz: f64,
    },
    /// The model does not determine the coefficients of the inverse.
    #[error("does not determine its {method} inverse; use search")]
    Undetermined {
        /// Name of the method.
        method: &'static str,
    },
    /// The input of the model includes force.
    #[error(
        "is autoregressive in force, and a current acts only samples later; it has no {method} inverse: use search"
    )]
    Autoregressive {
        /// Name of the method.
        method: &'static str,
    },
    /// The force falls with more current.
    #[error(
        "gives one force at several currents (the force turns back by {fall_n:.1} N above {current_a:.2} A), so the {method} method does not apply: \
         use search"
    )]
    NotUnique {
        /// Name of the method.
        method: &'static str,
        /// Largest fall of the force, N.
        fall_n: f64,
        /// Current above which the force falls, A.
        current_a: f64,
    },
    /// An effect of the model is not a force that is added.
    #[error("has {effect}, which does more than add a force; it has no {method} inverse: use search")]
    NotAForce {
        /// Name of the method.
        method: &'static str,
        /// Id of the effect, with its form if there are several.
        effect: String,
    },
}
