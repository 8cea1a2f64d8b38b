//! Errors of model files.

use super::Error;
use crate::sample::DriveKind;
use serde::Serialize;
use thiserror::Error as ThisError;

/// Reasons why a text is not a model file. A key is given with its tables, as in `parameters.force_lags`.
#[derive(Debug, Clone, PartialEq, ThisError, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
#[non_exhaustive]
pub enum ModelFileError {
    /// The text is not TOML, or a key outside the model's own tables is wrong.
    #[error("model file: {message}")]
    Syntax {
        /// The line, from 1; `None` if the parser does not say it.
        line: Option<usize>,
        /// The message of the parser, with an excerpt.
        message: String,
    },
    /// A table of the model has a missing key or a value of a wrong type.
    #[error("model file: [{table}]: {message}")]
    Table {
        /// The table.
        table: String,
        /// The message of the parser.
        message: String,
    },
    /// The model cannot be written as TOML.
    #[error("model file: {message}")]
    Write {
        /// The message of the writer.
        message: String,
    },
    /// The file has a schema that this version does not read.
    #[error("model file: schema is \"{found}\"; this version reads \"{known}\"")]
    Schema {
        /// The schema of the file.
        found: String,
        /// The schema that this version reads.
        known: &'static str,
    },
    /// No model has this name.
    #[error("model file: model is \"{name}\"; known are {}", known.join(", "))]
    UnknownName {
        /// The name in the file.
        name: String,
        /// All names.
        known: Vec<&'static str>,
    },
    /// A key is missing.
    #[error("model file: {key} is missing")]
    MissingKey {
        /// The key.
        key: String,
    },
    /// A key is not known.
    #[error(
        "model file: {key} is unknown; did you mean {nearest}? (the suffix is the unit: _n newtons, _a amperes, _v volts, _s seconds, _m \
         metres; convert the numbers when the unit differs)"
    )]
    UnknownKey {
        /// The key.
        key: String,
        /// The most similar known key.
        nearest: String,
    },
    /// A key belongs to no input of the model.
    #[error("model file: {key} belongs to no input; add the input or remove the key")]
    NoInput {
        /// The key.
        key: String,
    },
    /// A value has the wrong type.
    #[error("model file: {key} is {found}, not {expected}")]
    WrongType {
        /// The key.
        key: String,
        /// The value.
        found: String,
        /// The expected type, in words.
        expected: &'static str,
    },
    /// A value is not one of the known words.
    #[error("model file: {key} is \"{found}\", but must be {expected}")]
    UnknownWord {
        /// The key.
        key: String,
        /// The value.
        found: String,
        /// The known words, in words.
        expected: &'static str,
    },
    /// No signal has the name of an input.
    #[error(
        "model file: parameters.inputs holds \"{input}\", but inputs must be displacement, velocity, acceleration or drive"
    )]
    UnknownInput {
        /// The name in the file.
        input: String,
    },
    /// An input has keys of two shapes.
    #[error(
        "model file: the parameters of {input} contain keys of two shapes of memberships; keep those of one, e.g. {input}_centres and \
         {input}_sigmas for Gaussians"
    )]
    TwoShapes {
        /// Name of the input.
        input: &'static str,
    },
    /// A model lacks the drive that it needs.
    #[error("model file: drive is missing; a {model} model needs \"current_a\" or \"command_v\"")]
    MissingDrive {
        /// Name of the model.
        model: &'static str,
    },
    /// The drive does not match the parameters.
    #[error(
        "model file: drive is {}, so parameters must contain {needed}",
        drive.map_or("absent".to_owned(), |drive| format!("\"{drive}\""))
    )]
    OtherDrive {
        /// The drive of the file.
        drive: Option<DriveKind>,
        /// The parameters that the drive needs.
        needed: String,
    },
    /// A learned inverse needs a current as the drive.
    #[error(
        "model file: inverse_model computes a coil current, so drive must be \"current_a\", but it is {}; remove the table inverse_model",
        drive.map_or("absent".to_owned(), |drive| format!("\"{drive}\""))
    )]
    InverseDrive {
        /// The drive of the file.
        drive: Option<DriveKind>,
    },
    /// No effect has this id.
    #[error("model file: effects[{index}].id is \"{id}\"; did you mean {nearest}? (known are {})", known.join(", "))]
    UnknownEffectId {
        /// Number of the effect in the file, from 0.
        index: usize,
        /// The id in the file.
        id: String,
        /// The most similar id.
        nearest: &'static str,
        /// All ids.
        known: Vec<&'static str>,
    },
    /// A part of a term has an unknown name.
    #[error("model file: {key} is \"{found}\"; did you mean {nearest}? (known are {})", known.join(", "))]
    TermPart {
        /// The key, for example `effects[0].modulator`.
        key: String,
        /// The name in the file.
        found: String,
        /// The most similar name.
        nearest: &'static str,
        /// All names.
        known: Vec<&'static str>,
    },
    /// A number of a term has another unit.
    #[error(
        "model file: {key} is \"{found}\", but the number is in \"{expected}\": convert the number, or leave the unit out"
    )]
    TermUnit {
        /// The key, for example `effects[0].units.at`.
        key: String,
        /// The unit in the file.
        found: String,
        /// The unit of the number.
        expected: String,
    },
    /// The form of an effect is missing, unknown or superfluous.
    #[error("model file: effects[{index}]{}", form_problem(id, found.as_deref(), known, *plain))]
    EffectForm {
        /// Number of the effect in the file, from 0.
        index: usize,
        /// Id of the effect.
        id: &'static str,
        /// The form in the file.
        found: Option<String>,
        /// The named forms of the effect; empty if it has one form only.
        known: Vec<&'static str>,
        /// True if one of its forms has no name.
        plain: bool,
    },
    /// The parameters of an effect are not valid.
    #[error("model file: effects[{index}]: {error}")]
    Effect {
        /// Number of the effect in the file, from 0.
        index: usize,
        /// Why it is not valid.
        error: Box<Error>,
    },
    /// The calibrated uncertainty is not valid.
    #[error("model file: expected.uncertainty.{key} {problem}")]
    Uncertainty {
        /// The key within the table of the uncertainty.
        key: String,
        /// Its fault.
        problem: Box<UncertaintyProblem>,
    },
}

fn form_problem(id: &str, found: Option<&str>, known: &[&str], plain: bool) -> String {
    match (known, found) {
        ([], _) => format!(": {id} has one form only; leave form out"),
        (known, None) => format!(": {id} needs form, one of {}", known.join(", ")),
        (known, Some(form)) if plain => {
            format!(".form is \"{form}\", but {id} has no form, or the form {}", known.join(", "))
        }
        (known, Some(form)) => format!(".form is \"{form}\", but {id} has the forms {}", known.join(", ")),
    }
}

fn counts(least: usize, most: usize) -> String {
    match least {
        0 => format!("at most {most} are allowed"),
        least => format!("must have {least} to {most}"),
    }
}

/// Faults of a key of a calibrated uncertainty. The sentence continues the name of the key.
#[derive(Debug, Clone, PartialEq, ThisError, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
#[non_exhaustive]
pub enum UncertaintyProblem {
    /// The table is not allowed here.
    #[error("must be absent, because only one_step coasts; remove it")]
    Superfluous,
    /// The table is missing.
    #[error("is missing")]
    Missing,
    /// Both predictors are missing.
    #[error("is missing, and so is one_step; remove the empty table")]
    Empty,
    /// The growth with the age of the drive is missing.
    #[error("is missing, but drive_edges are given; add it, or make drive_edges empty")]
    MissingGrowth,
    /// An edge of a speed region is not positive.
    #[error("has {edge_m_s}, but speeds must be above 0")]
    SpeedEdge {
        /// The edge, m/s.
        edge_m_s: f64,
    },
    /// A list has too many values, or none where one is needed.
    #[error("has {found} values, but {}", counts(*least, *most))]
    Count {
        /// Number of values.
        found: usize,
        /// Smallest allowed number.
        least: usize,
        /// Largest allowed number.
        most: usize,
    },
    /// A list does not increase.
    #[error("is {values:?}, but must increase and be finite{}", if *from_zero { ", from 0 or more" } else { "" })]
    NotIncreasing {
        /// The list.
        values: Vec<f64>,
        /// True if it must not be negative.
        from_zero: bool,
    },
    /// The size of a list does not match another key.
    #[error("has {found} {of}, but {other} {needs} {needed}")]
    Size {
        /// Number of values or rows.
        found: usize,
        /// The counted items, in words.
        of: String,
        /// The key that defines the size.
        other: String,
        /// The verb after that key.
        needs: &'static str,
        /// The size that it defines.
        needed: usize,
    },
    /// The first value of a list is not the one at time zero.
    #[error("is {value}, but must be {expected}")]
    First {
        /// The value.
        value: f64,
        /// The value that it must be.
        expected: f64,
    },
    /// A value is too small.
    #[error("is {value}, but must be finite and at least {least}")]
    TooSmall {
        /// The value.
        value: f64,
        /// Smallest allowed value.
        least: f64,
    },
    /// The lists do not make a table.
    #[error("is not a valid table")]
    Invalid,
}
