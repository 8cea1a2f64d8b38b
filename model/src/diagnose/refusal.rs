//! Reasons why an effect was not named, each with its numbers. The sentences are made here and nowhere else.
//!
//! Serialised, a reason is an object with its fields and a stable `code`, the name of the variant in snake case.

use crate::error::Error;
use crate::units::rounded;
use serde::Serialize;

/// Why an effect was not named. As text it is a clause that can follow a colon.
#[derive(Debug, Clone, PartialEq, thiserror::Error, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Refusal {
    /// The settings do not include the effect.
    #[error("excluded by the settings")]
    Excluded,
    /// A run lacks a channel that the test needs.
    #[error("run {run} has no {channel}, which the test needs")]
    MissingChannel {
        /// Name of the run.
        run: String,
        /// The missing channel, as its CSV column.
        channel: &'static str,
    },
    /// The model with the effect is not valid.
    #[error("{error}")]
    Invalid {
        /// The error of the model.
        error: Box<Error>,
    },
    /// The simulation with the effect does not stay finite on the training runs.
    #[error("the simulation with it does not stay finite on the training runs")]
    Diverges,
    /// The simulation with the effect does not stay finite on a validation run.
    #[error("the simulation of a validation run diverges with it")]
    DivergesInValidation,
    /// The training runs do not excite the effect.
    #[error("these runs do not excite it; needed: {excitation}")]
    NotExcited {
        /// Change of the simulated force by a small amount of the effect, root mean square, N.
        change_n: f64,
        /// Change that is needed, N.
        needed_n: f64,
        /// The excitation that separates the effect from others.
        excitation: &'static str,
    },
    /// Other coefficients can produce the same force on the training runs.
    #[error(
        "on these runs other coefficients of the model can produce the same force ({:.1} % of the score is left); needed: {excitation}",
        100.0 * identifiable
    )]
    NotIdentifiable {
        /// Share of the score that remains after projecting off the other coefficients.
        identifiable: f64,
        /// Share that is needed.
        needed: f64,
        /// The excitation that separates the effect from others.
        excitation: &'static str,
    },
    /// The training runs have too few independent blocks for this effect.
    #[error(
        "its change of the force is correlated over so long a time that the training runs have only {blocks} independent blocks, too few to \
         tell it from chance; give longer runs"
    )]
    TooFewBlocks {
        /// Number of independent blocks.
        blocks: usize,
    },
    /// The effect removes too little of the reducible error.
    #[error("removes {:.1} % of the reducible error; at least {:.0} % are required", 100.0 * share, 100.0 * needed)]
    TooSmall {
        /// Share of the reducible error that it removes on the training runs.
        share: f64,
        /// Share that is required.
        needed: f64,
    },
    /// The effect removes less than the base's own misfit.
    #[error(
        "removes {:.0} % of the reducible error, but under {:.1} % of the reducible error of the base alone: the base's own misfit is of \
         that size",
        100.0 * share, 100.0 * needed_of_base
    )]
    WithinMisfit {
        /// Share of the reducible error in this round that it removes.
        share: f64,
        /// Share of the reducible error of the base alone that is required.
        needed_of_base: f64,
    },
    /// The effect changes the force by so little that a base of a slightly different structure could take its place.
    #[error(
        "changes the force by {:.2} % once the base has adapted; under {:.1} %, a structure of the base that is not exactly the damper's \
         looks the same",
        100.0 * of_force, 100.0 * needed
    )]
    WithinStructure {
        /// Root of the drop of squared error on the training runs, as a share of the standard deviation of the force.
        of_force: f64,
        /// Share that is required.
        needed: f64,
    },
    /// Another effect removes more.
    #[error("in its place removes {:.0} % of the error that was left then, where {other} removes {:.0} %", 100.0 * share, 100.0 * other_share)]
    OtherRemovesMore {
        /// Share of the reducible error that it removes.
        share: f64,
        /// Id of the other effect, with its form if there are several.
        other: String,
        /// Share of the reducible error that the other effect removes.
        other_share: f64,
    },
    /// A parameter was found at the end of its physical range, or beyond it.
    #[error(
        "{parameter} is {}, at or beyond the end of its physical range of {} to {}",
        five_digits(*value), five_digits(range[0]), five_digits(range[1])
    )]
    AtEndOfRange {
        /// Name of the parameter, which ends in the unit.
        parameter: &'static str,
        /// The value found.
        value: f64,
        /// The physical range.
        range: [f64; 2],
    },
    /// The interval of a parameter includes the value at which the effect is absent.
    #[error("the 95 % interval of {parameter}, {} to {}, includes zero", five_digits(ci95[0]), five_digits(ci95[1]))]
    IncludesZero {
        /// Name of the parameter, which ends in the unit.
        parameter: &'static str,
        /// The 95 % interval.
        ci95: [f64; 2],
    },
    /// The runs do not determine where the effect acts.
    #[error(
        "these runs do not determine {parameter}: its 95 % interval contains the whole range of {} to {}",
        five_digits(range[0]), five_digits(range[1])
    )]
    ShapeNotDetermined {
        /// Name of the parameter, which ends in the unit.
        parameter: &'static str,
        /// The 95 % interval.
        ci95: [f64; 2],
        /// The physical range.
        range: [f64; 2],
    },
    /// A validation run gets worse.
    #[error("validation run {run} gets worse with it ({:+.1} % squared error)", 100.0 * increase)]
    WorseInValidation {
        /// Name of the run.
        run: String,
        /// Increase of its squared error, as a share.
        increase: f64,
    },
    /// The effect removes too little on the validation runs.
    #[error(
        "removes {:.1} % of the squared error on the validation runs; at least {:.0} % are required",
        100.0 * share, 100.0 * needed
    )]
    TooSmallInValidation {
        /// Share of the squared error that it removes on the validation runs.
        share: f64,
        /// Share that is required.
        needed: f64,
    },
    /// The energy of a cycle contradicts the effect.
    #[error(
        "would take up {} J in each cycle, but the residual has {} J",
        five_digits(*effect_j), five_digits(*residual_j)
    )]
    EnergyContradicts {
        /// Energy that the damper takes up in a cycle by the effect, J.
        effect_j: f64,
        /// Energy of the residual in a cycle, J.
        residual_j: f64,
    },
    /// In paired mode, most of the change since the references is something else.
    #[error(
        "all effects found account for {:.0} % of the change since the reference runs; under {:.0} %, the change is probably something else",
        100.0 * share, 100.0 * needed
    )]
    MostIsSomethingElse {
        /// Share of the reducible error that all effects remove.
        share: f64,
        /// Share that is required.
        needed: f64,
    },
    /// Effects that were named later explain the same error.
    #[error("not needed: effects named after it explain the same error")]
    NotNeeded,
    /// A term that was discovered later explains the same error.
    #[error("not needed: a term that was discovered after it explains the same error")]
    TakenOverByTerm,
    /// Another structure of the base fits the validation runs about as well and does not name the effect.
    #[error("depends on the base: {structure} fits the validation runs about as well, and does not show it")]
    DependsOnBase {
        /// Name of the other structure.
        structure: &'static str,
    },
    /// Another structure of the base fits the validation runs about as well and finds another value.
    #[error(
        "depends on the base: {structure} fits the validation runs about as well, and finds {parameter} {other_value:.4e} in place of \
         {value:.4e}"
    )]
    DiffersBetweenBases {
        /// Name of the other structure.
        structure: &'static str,
        /// Name of the parameter, which ends in the unit.
        parameter: &'static str,
        /// The value under the chosen structure.
        value: f64,
        /// The value under the other structure.
        other_value: f64,
    },
    /// The base is inadequate.
    #[error(transparent)]
    BaseInadequate(BaseFault),
}

/// `value` to five significant digits, without trailing zeros. Numbers that would need many zeros are written as powers of ten.
fn five_digits(value: f64) -> String {
    let rounded = rounded(value, 5);
    if rounded == 0.0 || !rounded.is_finite() || (1e-3..1e5).contains(&rounded.abs()) {
        rounded.to_string()
    } else {
        format!("{rounded:e}")
    }
}

/// Why the base is inadequate: another structure fits better on the validation runs without any effect. Each share is a squared error on
/// the validation runs, divided by the squared error of the base alone.
#[derive(Debug, Clone, PartialEq, thiserror::Error, Serialize)]
#[error(
    "the base is inadequate: on the validation runs, {alternative} without any effect has {:.1} % of the squared error of {base}; {base} \
     with one effect has {:.1} %, with all effects found {:.1} %; use {alternative} as base",
    100.0 * alternative_share, 100.0 * one_effect_share, 100.0 * all_effects_share
)]
pub struct BaseFault {
    /// Name of the base.
    pub base: &'static str,
    /// Name of the other structure.
    pub alternative: &'static str,
    /// Share of the other structure without any effect.
    pub alternative_share: f64,
    /// Share of the base with the best of the effects found.
    pub one_effect_share: f64,
    /// Share of the base with all effects found.
    pub all_effects_share: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_five_digits_and_no_zeros_that_say_nothing() {
        let cases = [
            (0.0, "0"),
            (0.015, "0.015"),
            (-1234.567, "-1234.6"),
            (2e-7, "2e-7"),
            (5e5, "5e5"),
            (0.1 + 0.2, "0.3"),
            (f64::INFINITY, "inf"),
        ];
        for (value, text) in cases {
            assert_eq!(five_digits(value), text);
        }
        let refusal = Refusal::AtEndOfRange { parameter: "tau_s", value: 0.015, range: [0.0, 0.015] };
        assert_eq!(
            refusal.to_string(),
            "tau_s is 0.015, at or beyond the end of its physical range of 0 to 0.015"
        );
    }
}
