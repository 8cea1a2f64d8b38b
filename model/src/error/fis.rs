//! Errors of `.fis` files.

use serde::Serialize;
use thiserror::Error;

/// Faults of a line of a `.fis` file.
#[derive(Debug, Clone, PartialEq, Error, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
#[non_exhaustive]
pub enum FisProblem {
    /// A section is missing.
    #[error("section [{section}] is missing")]
    MissingSection {
        /// Name of the section.
        section: String,
    },
    /// A section appears twice.
    #[error("section [{section}] appears twice")]
    RepeatedSection {
        /// Name of the section.
        section: String,
    },
    /// A section is beyond the number of inputs or outputs.
    #[error("section [{section}] does not belong to this system; remove it or correct NumInputs")]
    ForeignSection {
        /// Name of the section.
        section: String,
    },
    /// There is text before the first section.
    #[error("there is text before the first section; begin with [System]")]
    BeforeFirstSection,
    /// A line is neither a section nor a key with a value.
    #[error("\"{text}\" is neither a section nor key=value")]
    NotAKey {
        /// The line.
        text: String,
    },
    /// A key appears twice.
    #[error("{key} appears twice in [{section}]")]
    RepeatedKey {
        /// Name of the section.
        section: String,
        /// The key.
        key: String,
    },
    /// A key is missing.
    #[error("[{section}] has no {key}")]
    MissingKey {
        /// Name of the section.
        section: String,
        /// The key.
        key: String,
    },
    /// A value is not valid.
    #[error("{key} is {value}, but must be {expected}")]
    Value {
        /// The key.
        key: String,
        /// The value, with its quotes.
        value: String,
        /// The valid values, in words.
        expected: String,
    },
    /// The number of rules is not the number of combinations of memberships.
    #[error("NumRules is {found}, but the memberships have {needed} combinations; a full grid is needed")]
    RuleCount {
        /// The number in the file.
        found: usize,
        /// The number of combinations.
        needed: usize,
    },
    /// A membership or conclusion is beyond their number.
    #[error("{key} is beyond NumMFs = {count}")]
    BeyondCount {
        /// The key.
        key: String,
        /// The number in the file.
        count: usize,
    },
    /// A membership or conclusion has a wrong number of numbers.
    #[error("{shape} has {found} numbers, but needs {needed}")]
    NumberCount {
        /// Its shape.
        shape: String,
        /// Number of its numbers.
        found: usize,
        /// The number that the shape needs, with their meaning.
        needed: String,
    },
    /// The shape of a membership or conclusion is not known.
    #[error("{of} '{shape}' is not known; known are {known}")]
    UnknownShape {
        /// The part with this shape: membership or conclusion.
        of: &'static str,
        /// The shape.
        shape: String,
        /// The known shapes, in words.
        known: &'static str,
    },
    /// Memberships of one input have different shapes.
    #[error(
        "membership '{shape}' differs from the first, '{first}'; use one shape for all memberships of an input"
    )]
    MixedMemberships {
        /// Shape of the membership that differs.
        shape: String,
        /// Shape of the first membership.
        first: String,
    },
    /// No membership is above zero in a part of the input's range.
    #[error(
        "no membership is above zero between {from} and {to}, so no rule fires there; widen a membership or narrow Range"
    )]
    Gap {
        /// Lower end, in the units of the file.
        from: f64,
        /// Upper end.
        to: f64,
    },
    /// Conclusions have different forms.
    #[error("conclusion '{form}' differs from the first, '{first}'; use one form for all")]
    MixedConclusions {
        /// Form of the conclusion that differs.
        form: String,
        /// Form of the first conclusion.
        first: String,
    },
    /// Two rules are for the same memberships.
    #[error("there is already a rule for these memberships")]
    RepeatedRule,
    /// A combination of memberships lacks a rule.
    #[error(
        "the rule for the memberships {} is missing; a full grid is needed",
        memberships.iter().map(usize::to_string).collect::<Vec<_>>().join(" ")
    )]
    MissingRule {
        /// Number of the membership of each input, from 1.
        memberships: Vec<usize>,
    },
    /// A rule is not written as it must be.
    #[error("rule \"{rule}\": {problem}")]
    Rule {
        /// The rule.
        rule: String,
        /// Its fault.
        problem: RuleProblem,
    },
    /// A quoted text does not end.
    #[error("{text} has no closing quote")]
    OpenQuote {
        /// The text.
        text: String,
    },
    /// A text contains a quote.
    #[error("{text} contains a quote")]
    InnerQuote {
        /// The text.
        text: String,
    },
    /// A list of numbers has no brackets.
    #[error("{text} is not a list of numbers in brackets")]
    NotAList {
        /// The text.
        text: String,
    },
    /// A number is not finite, or not a number.
    #[error("\"{text}\" is not a finite number")]
    NotFinite {
        /// The text.
        text: String,
    },
}

/// Faults of a rule of a `.fis` file.
#[derive(Debug, Clone, PartialEq, Error, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
#[non_exhaustive]
pub enum RuleProblem {
    /// The comma after the memberships is missing.
    #[error("must be \"sets, conclusion (1) : 1\"")]
    Form,
    /// The weight is missing.
    #[error("has no weight in parentheses")]
    NoWeight,
    /// The parenthesis of the weight is not closed.
    #[error("has no closing parenthesis after the weight")]
    OpenParenthesis,
    /// The weight is not 1.
    #[error("has a weight other than 1, which is not supported")]
    Weight,
    /// The connective is not "and".
    #[error("must end in \": 1\" (and)")]
    Connective,
    /// A number of a membership or conclusion is not valid.
    #[error("{of} is \"{text}\", but must be 1 to {most}")]
    Index {
        /// The part that the number belongs to.
        of: &'static str,
        /// The text of the number.
        text: String,
        /// Largest valid number.
        most: usize,
    },
    /// The number of memberships is not the number of inputs.
    #[error("has {found} memberships, but there are {inputs} inputs")]
    MembershipCount {
        /// Number of memberships.
        found: usize,
        /// Number of inputs.
        inputs: usize,
    },
}
