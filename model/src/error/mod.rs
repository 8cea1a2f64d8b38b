//! Error types of the crate.
//!
//! Each error is a variant with its numbers; names end in the unit. Its sentence is made here and nowhere else: it names the field or
//! parameter and its value, and says what to do. Serialised, an error is an object with its fields and a stable `code`, the name of the
//! variant in snake case.
//!
//! | error | of |
//! |---|---|
//! | [`IdentifyError`] | [`crate::identify`] |
//! | [`DiagnosisError`] | [`crate::diagnose`] |
//! | [`DesignError`] | [`crate::diagnose::design`] |
//! | [`CalibrationError`] | [`crate::calibrate`] |
//! | [`ForceError`] | [`crate::force`], [`crate::effect`] |
//! | [`InverseError`] | [`crate::inverse`] |
//! | [`PipelineError`] | [`crate::pipeline`] |
//! | [`RigError`] | [`crate::rig`] |
//! | [`ModelFileError`], [`UncertaintyProblem`] | [`crate::model_file`] |
//! | [`FisProblem`], [`RuleProblem`] | [`crate::fis`] |

mod calibration;
mod design;
mod diagnosis;
mod fis;
mod force;
mod identify;
mod inverse;
mod model_file;
mod phase;
mod pipeline;
mod rig;

pub use calibration::CalibrationError;
pub use design::{DesignError, NoiseSource};
pub use diagnosis::DiagnosisError;
pub use fis::{FisProblem, RuleProblem};
pub use force::ForceError;
pub use identify::IdentifyError;
pub use inverse::{InverseError, NoInverse};
pub use model_file::{ModelFileError, UncertaintyProblem};
pub use phase::{CannotRun, Root};
pub use pipeline::PipelineError;
pub use rig::RigError;

use serde::Serialize;
use thiserror::Error;

/// Reasons why a model, a model file, a setting or a run cannot be used.
///
/// ```
/// use mr_damper_model::Error;
/// use mr_damper_model::preset;
///
/// let error = preset::load("thesis/fuzzy-tanh/rp3").unwrap_err();
/// let Error::UnknownPreset { name, nearest } = &error else { panic!("{error}") };
/// assert_eq!((name.as_str(), nearest.as_deref()), ("thesis/fuzzy-tanh/rp3", Some("thesis/fuzzy-tanh/rp3-cs")));
/// assert!(error.to_string().contains("the nearest is \"thesis/fuzzy-tanh/rp3-cs\""));
/// ```
#[derive(Debug, Clone, PartialEq, Error, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Error {
    /// A number lies outside its valid range.
    #[error("{name} is {value}, but must be {expected}")]
    OutOfRange {
        /// The parameter or field, with its unit suffix.
        name: String,
        /// The invalid value.
        value: f64,
        /// The valid range, in words.
        expected: &'static str,
    },
    /// A list has the wrong number of values.
    #[error("{name} has {found} values, but {expected} are needed")]
    Length {
        /// Name of the list.
        name: String,
        /// Number of values in it.
        found: usize,
        /// Required number of values, in words.
        expected: String,
    },
    /// A `.fis` file cannot be read.
    #[error("line {line}: {problem}")]
    Fis {
        /// The line, from 1.
        line: usize,
        /// The problem, with its values.
        problem: FisProblem,
    },
    /// A preset name is not known.
    #[error(
        "preset \"{name}\" is not known{} (`mr-damper presets` lists all)",
        nearest.as_ref().map(|nearest| format!("; the nearest is \"{nearest}\"")).unwrap_or_default()
    )]
    UnknownPreset {
        /// The requested name.
        name: String,
        /// The known name that differs from it in at most a third of the characters; `None` if none does.
        nearest: Option<String>,
    },
    /// A preset is a phase-transition relation, which relates force to motion but cannot run as a model.
    #[error(
        "{name} cannot run as a model: it computes the force from the measured force of the same instant{}. `mr-damper evaluate` \
         and `compare` show how well p holds on runs with measured force; the most similar preset that runs is {nearest}", because(why.as_deref(), *drive)
    )]
    PhaseRelation {
        /// The requested name.
        name: String,
        /// The reason why it cannot be integrated.
        why: Option<Box<CannotRun>>,
        /// The drive at which `why` holds, A; `None` for a relation without a drive.
        drive: Option<f64>,
        /// The most similar preset that can run.
        nearest: String,
    },
    /// A run has no recording of a required channel.
    #[error("run {run}: has no {channel}, which {needed_by} needs")]
    MissingChannel {
        /// The run's name.
        run: String,
        /// The missing channel, as its CSV column.
        channel: &'static str,
        /// The model, effect or task that needs the channel.
        needed_by: String,
    },
    /// The run's drive (coil current or command voltage) is not the kind that the model was identified on.
    #[error("run {run}: the drive is {found}, but the model needs {needed}; use a model of the run's drive")]
    WrongDrive {
        /// The run's name.
        run: String,
        /// The kind that the run recorded.
        found: &'static str,
        /// The kind that the model needs.
        needed: &'static str,
    },
    /// The run's rate is not the one that the model is valid at, because its input includes force.
    #[error(
        "run {run}: its rate is {rate_hz:.6} Hz, but the {model} model is valid at {needed_hz:.6} Hz; convert the run to that rate"
    )]
    WrongRate {
        /// The run's name.
        run: String,
        /// Its rate, Hz.
        rate_hz: f64,
        /// Name of the model.
        model: &'static str,
        /// The rate that the model is valid at, Hz.
        needed_hz: f64,
    },
    /// `filter.apply_to = "output"` with a model whose input is force: the filter would sit inside the feedback loop.
    #[error(
        "the {model} model takes filter.apply_to = inputs or none, not output: its input is its own output"
    )]
    OutputFilter {
        /// Name of the model.
        model: &'static str,
    },
    /// The caller cancelled the work before it was done.
    #[error("the work was cancelled")]
    Cancelled,
    /// A model file cannot be read or written.
    #[error(transparent)]
    #[serde(untagged)]
    ModelFile(#[from] ModelFileError),
    /// A model cannot be identified from the runs.
    #[error(transparent)]
    #[serde(untagged)]
    Identify(#[from] IdentifyError),
    /// A model cannot be diagnosed on the runs.
    #[error(transparent)]
    #[serde(untagged)]
    Diagnosis(#[from] DiagnosisError),
    /// No run can be designed.
    #[error(transparent)]
    #[serde(untagged)]
    Design(#[from] DesignError),
    /// The uncertainty of a model cannot be calibrated on the runs.
    #[error(transparent)]
    #[serde(untagged)]
    Calibration(#[from] CalibrationError),
    /// Parts of a model do not fit together.
    #[error(transparent)]
    #[serde(untagged)]
    Force(#[from] ForceError),
    /// A model has no inverse.
    #[error(transparent)]
    #[serde(untagged)]
    Inverse(#[from] InverseError),
    /// Models and settings of a pipeline do not fit together.
    #[error(transparent)]
    #[serde(untagged)]
    Pipeline(#[from] PipelineError),
    /// An effect cannot be injected into the virtual rig.
    #[error(transparent)]
    #[serde(untagged)]
    Rig(#[from] RigError),
}

/// The part of a sentence that says why a relation cannot run.
fn because(why: Option<&CannotRun>, drive: Option<f64>) -> String {
    let at = drive.map(|drive| format!("at {drive} A, ")).unwrap_or_default();
    why.map(|why| format!("; {at}{why}")).unwrap_or_default()
}

impl Error {
    /// Checks that `value` is finite and satisfies `ok`.
    pub(crate) fn check(
        name: &str,
        value: f64,
        expected: &'static str,
        ok: impl Fn(f64) -> bool,
    ) -> Result<f64, Self> {
        if value.is_finite() && ok(value) {
            Ok(value)
        } else {
            Err(Self::OutOfRange { name: name.to_owned(), value, expected })
        }
    }
}
