//! Errors of the set-up of a pipeline.

use super::Error;
use crate::sample::DriveKind;
use serde::Serialize;
use thiserror::Error as ThisError;

/// Reasons why models and settings do not make a pipeline.
#[derive(Debug, Clone, PartialEq, ThisError, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
#[non_exhaustive]
pub enum PipelineError {
    /// The seeded model is not autoregressive in force.
    #[error("arx_model is a {model} model, which cannot be seeded with measured force; give an arx model")]
    NotSeedable {
        /// Name of the model.
        model: &'static str,
    },
    /// The seeded model has effects.
    #[error(
        "arx_model has effects, but measured force already contains them; remove them from its file, or give the file as model"
    )]
    SeededWithEffects,
    /// The two models have different drives.
    #[error("arx_model needs {seeded}, but model needs {free}; use the same drive")]
    DifferentDrives {
        /// Drive of the free-run model.
        free: DriveKind,
        /// Drive of the seeded model.
        seeded: DriveKind,
    },
    /// Live learning was requested of a model that cannot learn.
    #[error(
        "boada.learn: a {model} model does not learn while it runs; give a boada model, or set boada.learn to false"
    )]
    CannotLearn {
        /// Name of the model.
        model: &'static str,
    },
    /// Live learning was requested of a model with effects.
    #[error(
        "boada.learn: measured force already contains the model's effects; remove them from its file, or set boada.learn to false"
    )]
    LearningWithEffects,
    /// Live learning was requested without measured force.
    #[error(
        "boada.learn needs measured force, but use_measured_force is never; set it to auto or observer, or set boada.learn to false"
    )]
    LearningWithoutForce,
    /// A mode that lasts for a limited time was requested as the only one.
    #[error("mode {mode} is temporary and cannot be the only one; use arx, model or fault")]
    TemporaryMode {
        /// Name of the mode.
        mode: &'static str,
    },
    /// A control law needs an inverse, and there is none.
    #[error("law {law}: {error}")]
    LawWithoutInverse {
        /// Name of the control law.
        law: &'static str,
        /// The reason for the missing inverse.
        error: Box<Error>,
    },
    /// The requested method gives no inverse.
    #[error("inverse.method {method}: {error}")]
    MethodWithoutInverse {
        /// Name of the method.
        method: &'static str,
        /// The reason for the missing inverse.
        error: Box<Error>,
    },
}
