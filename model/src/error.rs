//! Error type of the crate. Each message names the field or parameter and its value, and says what to do.

use thiserror::Error;

/// Reasons why a model, a model file, a setting or a run cannot be used.
#[derive(Debug, Clone, PartialEq, Error)]
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
    /// A model file cannot be read.
    #[error("model file: {message}")]
    ModelFile {
        /// The problem, its place (line, key), and what to do.
        message: String,
    },
    /// A `.fis` file cannot be read.
    #[error("line {line}: {message}")]
    Fis {
        /// The line, from 1.
        line: usize,
        /// The problem, and which values are valid.
        message: String,
    },
    /// A preset name is not known.
    #[error("preset \"{name}\" is not known; the nearest is \"{nearest}\" (`mr-damper presets` lists all)")]
    UnknownPreset {
        /// The requested name.
        name: String,
        /// The known name closest to it.
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
    /// The caller cancelled the work before it was done.
    #[error("the work was cancelled")]
    Cancelled,
    /// There is too little data, or the data does not excite the model.
    #[error("{message}")]
    Data {
        /// The missing data, and what to do.
        message: String,
    },
}

impl Error {
    /// The error for `filter.apply_to = "output"` with a model whose input is force: the filter would sit
    /// inside the feedback loop.
    pub(crate) fn output_filter_on_force_fed(model: &str) -> Self {
        Self::Data {
            message: format!(
                "the {model} model takes filter.apply_to = inputs or none, not output: its input is its own output"
            ),
        }
    }

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
