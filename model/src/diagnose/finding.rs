//! What a closing of the loop found, in numbers and in words' order: nothing here computes.

use crate::effect::{Effect, EffectModel};
use crate::metrics::Fit;
use crate::model::Model;

/// How the residual was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Measured force minus the base model's free run; the base is refitted beside each effect.
    Absolute,
    /// Force minus that of a healthy reference run with the same excitation; the base stays as it is.
    Paired,
}

impl Mode {
    /// As in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Absolute => "absolute",
            Self::Paired => "paired",
        }
    }
}

/// What a closing comes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The residual is no more than noise.
    NothingToExplain,
    /// Effects were named, and leave little.
    Explained,
    /// Effects were named, and over a fifth of the explainable error is left.
    PartlyExplained,
    /// There is something, and no effect of the library accounts for it.
    Unexplained,
    /// The base model misses so much that a name would mean nothing.
    BaseInadequate,
}

impl Verdict {
    /// As in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::NothingToExplain => "nothing_to_explain",
            Self::Explained => "explained",
            Self::PartlyExplained => "partly_explained",
            Self::Unexplained => "unexplained",
            Self::BaseInadequate => "base_inadequate",
        }
    }
}

/// Where the noise floor comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FloorSource {
    /// Runs of one pattern: half their mean squared difference.
    Replicates,
    /// Said by the user.
    Declared,
    /// From differences of third order of the measured force: white noise alone, so a lower bound.
    Estimated,
}

impl FloorSource {
    /// As in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Replicates => "replicates",
            Self::Declared => "declared",
            Self::Estimated => "estimated",
        }
    }
}

/// The error that no model could mend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseFloor {
    /// Where it comes from.
    pub source: FloorSource,
    /// Root mean square, N.
    pub rsse_n: f64,
    /// Its square over the variance of the measured force.
    pub esr: f64,
}

/// A parameter of an effect, as found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Name with its unit.
    pub name: &'static str,
    /// The value, in that unit.
    pub value: f64,
    /// Interval of 95 %, from block sums of the scores.
    pub ci95: [f64; 2],
    /// The physical range on these data.
    pub range: [f64; 2],
}

/// An effect that was named.
#[derive(Debug, Clone, PartialEq)]
pub struct Named {
    /// The effect, as it stands in the model.
    pub effect: EffectModel,
    /// Ids of all effects that the data cannot tell from it, itself first.
    pub class: Vec<&'static str>,
    /// Its parameters.
    pub parameters: Vec<Found>,
    /// p of the score, corrected for all effects that were tried, in the round in which it was named.
    pub p_adjusted: f64,
    /// Share of the explainable squared error (over the noise floor, of the base alone) that it takes away on the estimate
    /// runs; as the last one in, with the others there.
    pub share_removed: f64,
    /// Share of squared error that it takes away on the confirm runs, as the last one in.
    pub confirmed: f64,
}

/// Why an effect was not named.
#[derive(Debug, Clone, PartialEq)]
pub struct Refused {
    /// The effect.
    pub effect: Effect,
    /// The reason, a clause that can follow a colon.
    pub why: String,
}

/// What the score of one effect said in one round.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// The effect.
    pub effect: Effect,
    /// Round, from 1: how many effects were in the model, and one.
    pub round: usize,
    /// Share of the score that the base and the effects before do not have as well: how identifiable the effect is on this
    /// excitation against this base.
    pub identifiable: f64,
    /// p of the block sums, before and after correction for all effects that were tried.
    pub p: f64,
    /// See [`Candidate::p`].
    pub p_adjusted: f64,
    /// Share of the explainable error that the score, taken as straight, promises to take away.
    pub promises: f64,
    /// The same after a joint refit; `None` where the promise was not worth one.
    pub removes: Option<f64>,
}

/// Two error figures of the same rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// Name of the run.
    pub run: String,
    /// The base alone, refitted, each run's mean error taken out; running free.
    pub before: Fit,
    /// The base with the effects, likewise.
    pub after: Fit,
}

/// What the sealed runs said.
#[derive(Debug, Clone, PartialEq)]
pub struct Sealed {
    /// Over all sealed runs.
    pub before: Fit,
    /// See [`Sealed::before`].
    pub after: Fit,
    /// Squared error after over before.
    pub ratio: f64,
    /// Interval of 95 % of the ratio, by block bootstrap.
    pub ratio_ci95: [f64; 2],
    /// Share of the explainable error that is gone; `None` when there was none.
    pub removed: Option<f64>,
    /// Run by run.
    pub runs: Vec<Change>,
}

/// A signal that the remaining residual goes with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correlation {
    /// The signal: `displacement`, `velocity`, `drive rate`, ...
    pub with: &'static str,
    /// Coefficient, -1 to 1.
    pub coefficient: f64,
}

/// What is left over on the confirm runs.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOver {
    /// Lack of fit: 1 minus noise over squared residual.
    pub lof: f64,
    /// The same of the base alone.
    pub lof_before: f64,
    /// Share of the explainable error of the base alone that is left.
    pub share: f64,
    /// Signals that it goes with, strongest first; those whose correlation no sign-flip of blocks reaches by chance.
    pub correlates_with: Vec<Correlation>,
}

/// The result of a closing.
#[derive(Debug, Clone, PartialEq)]
pub struct Closing {
    /// How the residual was made.
    pub mode: Mode,
    /// The verdict.
    pub verdict: Verdict,
    /// Why the base is at fault, with the verdict [`Verdict::BaseInadequate`].
    pub base_fault: Option<String>,
    /// The error that no model could mend.
    pub noise_floor: NoiseFloor,
    /// Effects that were named, in order of application.
    pub effects: Vec<Named>,
    /// Effects that looked like it and were refused, each with the reason.
    pub refused: Vec<Refused>,
    /// Effects that these runs cannot show or deny, each with the reason and what would.
    pub untestable: Vec<Refused>,
    /// All scores, round by round.
    pub candidates: Vec<Candidate>,
    /// Blocks that sums were taken over on the estimate runs.
    pub blocks: usize,
    /// The confirm runs, before and after.
    pub confirm: Vec<Change>,
    /// The sealed runs; `None` when none were given: then nothing here is proved.
    pub test: Option<Sealed>,
    /// What is left on the estimate runs.
    pub left_over: LeftOver,
    /// The base, refitted on the estimate runs (in paired mode as given).
    pub before: Model,
    /// The base with the effects; the same as `before` when none was named.
    pub after: Model,
}
