//! Errors of a diagnosis as a whole. The reason why one effect is refused is [`crate::diagnose::Refusal`].

use serde::Serialize;
use thiserror::Error;

/// Reasons why a model cannot be diagnosed on the given runs.
#[derive(Debug, Clone, PartialEq, Error, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
#[non_exhaustive]
pub enum DiagnosisError {
    /// A given range is not one that the parameter can have.
    #[error(
        "the range {} to {} of {parameter} of {effect} cannot be used: give two finite values, the smaller one first, within {} to {}",
        range[0], range[1], allowed[0], allowed[1]
    )]
    Range {
        /// The effect.
        effect: String,
        /// Name of the parameter, which ends in the unit.
        parameter: &'static str,
        /// The given range.
        range: [f64; 2],
        /// Values that a model can have.
        allowed: [f64; 2],
    },
    /// The structure of the base cannot be chosen here.
    #[error(
        "the structure of the base cannot be chosen: that needs at least one structure to try, and no reference runs, whose healthy force \
         is the base already; give a model as base"
    )]
    BaseNeeded,
    /// No training run was given.
    #[error("no training runs (--estimate) were given: give the runs to find effects on")]
    NoTrainingRuns,
    /// No validation run was given.
    #[error(
        "no validation run (--confirm) was given: an effect is accepted only if it helps on another run; give at least one that was \
         recorded separately from the training runs"
    )]
    NoValidationRun,
    /// Two runs contain the same data.
    #[error(
        "the {} run {} and the {} run {} contain the same data, but a run may serve one purpose only: remove one of them",
        roles[0], runs[0], roles[1], runs[1]
    )]
    SameRun {
        /// Purposes of the two runs.
        roles: [&'static str; 2],
        /// Names of the two runs.
        runs: [String; 2],
    },
    /// A run is not conditioned as the base is.
    #[error("run {run}: it is not conditioned as the base model is; use the model's conditioning")]
    OtherConditioning {
        /// Name of the run.
        run: String,
    },
    /// No sample of a run can be used.
    #[error(
        "{role} run {run}: no sample can be used, because the damper never moves or no force was recorded; give another run"
    )]
    NothingMoves {
        /// Purpose of the run.
        role: &'static str,
        /// Name of the run.
        run: String,
    },
    /// The training runs are too short to tell an effect from chance.
    #[error(
        "the training runs have {blocks} blocks of {block_s} s in which the damper moves, but {needed_blocks} are needed to tell an effect \
         from chance: give at least {needed_s:.0} s of motion, in one run or several (30 s are a good start)"
    )]
    TooShort {
        /// Number of blocks in the training runs.
        blocks: usize,
        /// Number of blocks that the significance needs.
        needed_blocks: usize,
        /// Length of a block, s.
        block_s: f64,
        /// Length of the needed blocks, s.
        needed_s: f64,
    },
    /// The list of effects that may be named is empty.
    #[error("no effect was given, so none could be named: give at least one of {}", known.join(", "))]
    NoEffect {
        /// The ids of the library.
        known: Vec<&'static str>,
    },
    /// No effect of the library has this id.
    #[error("unknown effect \"{id}\"; the known effects are {}", known.join(", "))]
    UnknownEffect {
        /// The given id.
        id: String,
        /// The ids of the library.
        known: Vec<&'static str>,
    },
    /// The coefficients of the base have no physical meaning, so an effect cannot be separated from them.
    #[error(
        "a diagnosis cannot start from the {model} model, because its coefficients have no physical meaning to separate an effect from: use \
         fuzzy-tanh or a force law ({}) as base, or give reference runs with the same excitation",
        laws.join(", ")
    )]
    BaseNotPhysical {
        /// Name of the base.
        model: &'static str,
        /// Names of the force laws.
        laws: Vec<&'static str>,
    },
    /// The runs do not determine all coefficients of the base, so it cannot be refitted together with an effect.
    #[error(
        "the {model} model cannot be refitted in a diagnosis: it has {coefficients} coefficients, and the offsets of its sets cannot be \
         distinguished from the offsets of the runs. Use fuzzy-tanh or a force law as base, or give reference runs with the same excitation"
    )]
    BaseNotDetermined {
        /// Name of the base.
        model: &'static str,
        /// Number of its coefficients.
        coefficients: usize,
    },
    /// The base cannot be simulated on the training runs.
    #[error(
        "the simulation of the base model does not stay finite on the training runs: identify it on them first"
    )]
    BaseDiverges,
    /// The base cannot be simulated on a run of paired mode.
    #[error(
        "the simulation of the base model does not stay finite on these runs: check that every run is of the same damper, in the same units"
    )]
    BaseDivergesPaired,
    /// A model cannot be simulated on a validation or test run.
    #[error(
        "the simulation of the model does not stay finite on a validation or test run: check that every run is of the same damper, in the \
         same units"
    )]
    ModelDiverges,
    /// The augmented model cannot be simulated over the range of its runs.
    #[error(
        "the simulation of the augmented model does not stay finite {sine}, so no model file is written: add runs with this motion, or choose \
         another base"
    )]
    AugmentedDiverges {
        /// The sine on which it diverges, as text.
        sine: String,
    },
    /// A run of paired mode has no reference run.
    #[error(
        "run {run}: no reference run has the same excitation (displacement within {:.0} % and current within 10 %, aligned by crank angle or \
         time); give a healthy run with the same motion and current for each run, or omit --reference",
        100.0 * most
    )]
    NoReference {
        /// Name of the run.
        run: String,
        /// Largest accepted difference of displacement, root mean square, as a share of the displacement.
        most: f64,
    },
    /// Two runs that should have one pattern have different displacements.
    #[error(
        "the displacements of runs {} and {} differ by more than {:.0} %: give runs of one pattern, with the same excitation from the first \
         sample on",
        runs[0], runs[1], 100.0 * most
    )]
    DifferentMotion {
        /// Names of the two runs.
        runs: [String; 2],
        /// Difference of their displacements, root mean square, as a share of the displacement; NaN if they have no common sample.
        difference: f64,
        /// Largest accepted difference.
        most: f64,
    },
    /// One run was given as a set of replicates.
    #[error("run {run}: one run alone is not a set of replicates; give at least two runs of one pattern")]
    OneReplicate {
        /// Name of the run.
        run: String,
    },
    /// A run has no sample in common with its replicates.
    #[error(
        "run {run}: it has no row in common with its replicates; give runs that were recorded at one rate"
    )]
    NoCommonRow {
        /// Name of the run.
        run: String,
    },
}
