//! Errors of the design of a run.

use serde::Serialize;
use thiserror::Error;

/// Source of the noise that a design assumes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum NoiseSource {
    /// Given by the user.
    Given,
    /// The error in simulation that the model file states.
    Model,
    /// 1 % of the force on the road, root mean square.
    Assumed,
}

impl NoiseSource {
    /// Name in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Given => "given",
            Self::Model => "model",
            Self::Assumed => "assumed",
        }
    }

    /// The source in words.
    #[must_use]
    pub const fn in_words(self) -> &'static str {
        match self {
            Self::Given => "as given",
            Self::Model => "the error in simulation that the model file states",
            Self::Assumed => "1 % of the force, because the model file has no error",
        }
    }
}

/// Reasons why no run can be designed.
#[derive(Debug, Clone, PartialEq, Error, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
#[non_exhaustive]
pub enum DesignError {
    /// No effect was given.
    #[error("no effect was given to separate: give two or more of {}, or one to test whether it is there", known.join(", "))]
    NoRival {
        /// The ids of the library.
        known: Vec<&'static str>,
    },
    /// An effect needs the drive, which the model or the run does not have.
    #[error(
        "the effect {effect} acts on the drive, but the {model} model has none, so no run can show it: use a model that was identified \
         with the drive, or leave {effect} out"
    )]
    NoDrive {
        /// Id of the effect.
        effect: &'static str,
        /// Name of the model.
        model: &'static str,
    },
    /// The model has a drive, but no limits of the drive were given.
    #[error(
        "the {model} model is driven by a {drive}, but no limits of it were given: give its smallest and largest value in {unit}"
    )]
    DriveNeeded {
        /// Name of the model.
        model: &'static str,
        /// Kind of the drive, in words.
        drive: &'static str,
        /// Its unit.
        unit: &'static str,
    },
    /// The model has no drive, but limits of a drive were given.
    #[error(
        "the {model} model has no drive, but limits of a drive were given: leave them out, or use a model that was identified with the drive"
    )]
    DriveNotUsed {
        /// Name of the model.
        model: &'static str,
    },
    /// The coefficients of the base cannot be refitted together with an effect.
    #[error(
        "no run can be designed for the {model} model, because its coefficients cannot be refitted together with an effect: use fuzzy-tanh \
         or a force law ({}) as base", laws.join(", ")
    )]
    Base {
        /// Name of the base.
        model: &'static str,
        /// Names of the force laws.
        laws: Vec<&'static str>,
    },
    /// The model has as many effects as it can have.
    #[error(
        "the model has {found} effects beside those to separate, and none can be added: remove one from the model file, or separate one \
         that the model has"
    )]
    TooManyEffects {
        /// Number of effects.
        found: usize,
    },
    /// The simulation of the model is not finite within the limits.
    #[error(
        "the simulation of the {model} model does not stay finite within these limits: lower the speed, the stroke or the drive"
    )]
    Diverges {
        /// Name of the model.
        model: &'static str,
    },
    /// No motion within the limits moves the damper.
    #[error(
        "within these limits the damper cannot move far enough in {duration_s} s: at {acceleration_m_s2} m/s² it reaches {reached_m:.1e} m of a \
         stroke of {stroke_m} m; allow a higher acceleration or a longer run"
    )]
    NoMotion {
        /// Duration of the run, s.
        duration_s: f64,
        /// Limit of the acceleration, m/s².
        acceleration_m_s2: f64,
        /// Largest displacement that a segment reaches, m.
        reached_m: f64,
        /// Limit of the displacement, m.
        stroke_m: f64,
    },
    /// No run within the limits separates the effects.
    #[error(
        "no run of {duration_s} s within these limits separates {truth} from {}: after a refit of the model, their forces differ by {distance_n:.2} N \
         (root mean square), and {needed_n:.2} N are needed at a noise of {noise_n:.2} N ({}){}; what separates {truth}: {excitation}",
        rival.unwrap_or("a model without it"), noise_source.in_words(), helps.map(|helps| format!(". It would help to {helps}")).unwrap_or_default()
    )]
    NotSeparable {
        /// Duration of the run, s.
        duration_s: f64,
        /// Id of the effect that is taken as present.
        truth: &'static str,
        /// Id of the effect that imitates it; `None` for the model without it.
        rival: Option<&'static str>,
        /// Root mean square of the difference of their forces after the refit, N.
        distance_n: f64,
        /// The difference that is needed, N.
        needed_n: f64,
        /// Noise and misfit, root mean square, N.
        noise_n: f64,
        /// Where that comes from.
        noise_source: NoiseSource,
        /// The excitation that separates the effect from others.
        excitation: &'static str,
        /// The change of a limit that helps most; `None` if none helps.
        helps: Option<&'static str>,
    },
}
