//! Errors of the crate. Each names the field or parameter, the value, and what to do.

use thiserror::Error;

/// What can be wrong with a model, a model file, a setting or a run handed to this crate.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Error {
    /// A number lies outside the range in which it means anything.
    #[error("{name} is {value}, but must be {expected}")]
    OutOfRange {
        /// The parameter or field, with its unit suffix.
        name: String,
        /// The offending value.
        value: f64,
        /// The range, in words.
        expected: &'static str,
    },
    /// Lists that belong together differ in length.
    #[error("{name} has {found} values, but {expected} are needed")]
    Length {
        /// The list.
        name: String,
        /// How many values it has.
        found: usize,
        /// How many it should have, in words.
        expected: String,
    },
    /// A model file cannot be read.
    #[error("model file: {message}")]
    ModelFile {
        /// What is wrong, where (line, key), and what to do.
        message: String,
    },
    /// A `.fis` file cannot be read.
    #[error("line {line}: {message}")]
    Fis {
        /// The line, from 1.
        line: usize,
        /// What is wrong, and what would do.
        message: String,
    },
    /// A preset name is not known.
    #[error("there is no preset \"{name}\"; the nearest is \"{nearest}\" (`mr-damper presets` lists all)")]
    UnknownPreset {
        /// The name that was asked for.
        name: String,
        /// The known name closest to it.
        nearest: String,
    },
    /// A run lacks a channel that the work needs.
    #[error("run {run}: has no {channel}, which {needed_by} needs")]
    MissingChannel {
        /// The run's name.
        run: String,
        /// The missing channel, as its CSV column.
        channel: &'static str,
        /// Who needs it.
        needed_by: String,
    },
    /// A run was driven by the other kind of input than the model wants.
    #[error("run {run}: is driven by {found}, but the model wants {wanted}")]
    WrongDrive {
        /// The run's name.
        run: String,
        /// What the run has.
        found: &'static str,
        /// What the model wants.
        wanted: &'static str,
    },
    /// The caller ended the work before it was done.
    #[error("cancelled before it was done")]
    Cancelled,
    /// There is too little data, or it does not excite the model.
    #[error("{message}")]
    Data {
        /// What is missing and what to do.
        message: String,
    },
}

impl Error {
    /// A model that feeds on force cannot have a filter behind it.
    pub(crate) fn output_filter_on_force_fed(model: &str) -> Self {
        Self::Data {
            message: format!(
                "the {model} model takes filter.apply_to = inputs or none, not output: its own output is its input"
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
