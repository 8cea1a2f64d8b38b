//! The types of a diagnosis result.

use super::alignment::Alignment;
use super::discover::Discovery;
use super::paired::MeanShift;
use super::refusal::{BaseFault, Refusal};
use super::stretches::Searched;
use crate::effect::{Augmented, Effect, EffectModel};
use crate::error::Error;
use crate::identify::{Dataset, SweptRange, sweep};
use crate::metrics::Fit;
use crate::model::Model;
use crate::statistics::error_ratio::NoInterval;

/// How the residual was computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DiagnosisMode {
    /// Measured force minus the simulation (free run) of the base; the base is refitted together with each effect.
    Absolute,
    /// Measured force minus the force of a healthy reference run with the same excitation; the base is not refitted.
    Paired,
}

impl DiagnosisMode {
    /// Name in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Absolute => "absolute",
            Self::Paired => "paired",
        }
    }
}

/// Verdict of a diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The residual is not above the noise floor.
    NothingToExplain,
    /// Effects were named; at most a fifth of the reducible error is left.
    Explained,
    /// Effects were named; more than a fifth of the reducible error is left.
    PartlyExplained,
    /// There is reducible error, but no effect of the library was accepted, or the test runs do not support those found.
    Unexplained,
    /// The structure of the base does not fit, so a named effect would mean nothing.
    BaseInadequate,
}

impl Verdict {
    /// Name in JSON.
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

/// Source of the noise floor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FloorSource {
    /// Runs of one pattern: half their mean squared difference.
    Replicates,
    /// Declared by the user.
    Declared,
    /// From differences of the measured force over 1, 2 and 4 samples: sees white noise only, and only the part that a signal without
    /// noise could not cause, so it is a lower bound.
    Estimated,
    /// Paired mode on a cyclic motion: the scatter from one cycle to the next.
    Cycles,
    /// A single run does not show it: the force changes too fast for its sample rate. No part of the error counts as noise.
    Unknown,
}

impl FloorSource {
    /// Name in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Replicates => "replicates",
            Self::Declared => "declared",
            Self::Estimated => "estimated",
            Self::Cycles => "cycles",
            Self::Unknown => "unknown",
        }
    }
}

/// The error that no model can remove.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseFloor {
    /// Its source.
    pub source: FloorSource,
    /// RMSE (the thesis calls it RSSE), N; 0 if unknown.
    pub rsse_n: f64,
    /// NMSE (the thesis calls it ESR): `rsse_n` squared over the variance of the measured force; 0 if unknown.
    pub esr: f64,
}

impl NoiseFloor {
    /// The floor of runs that do not show it.
    pub(super) const UNKNOWN: Self = Self { source: FloorSource::Unknown, rsse_n: 0.0, esr: 0.0 };

    /// True if the floor is known.
    #[must_use]
    pub fn is_known(&self) -> bool {
        self.source != FloorSource::Unknown
    }
}

/// A parameter of an effect, as found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoundParameter {
    /// Name, which ends in the unit.
    pub name: &'static str,
    /// The value, in that unit.
    pub value: f64,
    /// 95 % interval, from block sums of the scores.
    pub ci95: [f64; 2],
    /// The physical range, with the scales of these data.
    pub range: [f64; 2],
}

impl FoundParameter {
    /// True if both values differ by at most `share` of the larger one.
    pub(super) fn is_close_to(&self, other: &Self, share: f64) -> bool {
        (self.value - other.value).abs() <= share * self.value.abs().max(other.value.abs())
    }

    /// A time constant with an interval of `half_width` to either side.
    #[cfg(test)]
    pub(super) fn tau_s(value: f64, half_width: f64) -> Self {
        Self { name: "tau_s", value, ci95: [value - half_width, value + half_width], range: [0.0, 1.0] }
    }
}

/// How an effect has changed since the healthy runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// The healthy damper does not have it.
    New,
    /// The healthy damper has it with another amount.
    Amount,
    /// The healthy damper has it too.
    None,
    /// The healthy runs cannot show it.
    Unknown,
}

impl Change {
    /// Name in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::New => "new",
            Self::Amount => "amount",
            Self::None => "none",
            Self::Unknown => "unknown",
        }
    }
}

/// An effect on the healthy runs, and its change since then.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SinceHealthy {
    /// Its first parameter on the healthy runs.
    pub amount: FoundParameter,
    /// The change since then.
    pub change: Change,
}

/// An effect that was named.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedEffect {
    /// The effect with its parameters in the model.
    pub effect: EffectModel,
    /// Ids of all effects that the data cannot tell from it; its own id first.
    pub class: Vec<&'static str>,
    /// Its parameters.
    pub parameters: Vec<FoundParameter>,
    /// p of the score in the round in which it was named, corrected for all effects tested.
    pub p_adjusted: f64,
    /// Share of the base's reducible error (squared error above the noise floor) that it removes on the training runs when it is added
    /// last, to a model that has the other effects.
    pub share_removed: f64,
    /// Share of the squared error that it removes on the validation runs when it is added last.
    pub confirmed: f64,
    /// Its amount on the healthy runs; `None` without them, or if the model diverges on them.
    pub since_healthy: Option<SinceHealthy>,
}

/// An effect that was not named, with the reason.
#[derive(Debug, Clone, PartialEq)]
pub struct RefusedEffect {
    /// The effect.
    pub effect: Effect,
    /// The reason.
    pub why: Refusal,
}

/// The score of one effect in one round.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// The effect.
    pub effect: Effect,
    /// Number of the round, from 1.
    pub round: usize,
    /// Share of the score that remains after projecting off the base and the effects already in the model: how identifiable the effect
    /// is on this excitation against this base.
    pub identifiable: f64,
    /// p of the block sums.
    pub p: f64,
    /// p corrected for all effects tested in the round.
    pub p_adjusted: f64,
    /// Share of the reducible error that the score predicts to remove, by a linear model.
    pub promises: f64,
    /// Share of the reducible error that a joint refit removes; `None` if the candidate was not refitted.
    pub removes: Option<f64>,
}

/// Error of one run before and after augmentation.
#[derive(Debug, Clone, PartialEq)]
pub struct RunErrors {
    /// Name of the run.
    pub run: String,
    /// Simulation error of the refitted base alone, with the run's mean error removed.
    pub before: Fit,
    /// Simulation error of the base with the effects, likewise.
    pub after: Fit,
}

/// Result on the test runs.
#[derive(Debug, Clone, PartialEq)]
pub struct TestResult {
    /// Error of the base alone, over all test runs.
    pub before: Fit,
    /// Error of the base with the effects, over all test runs.
    pub after: Fit,
    /// Squared error after, divided by squared error before.
    pub ratio: f64,
    /// 95 % interval of the ratio, by a t test on block sums; or why there is none.
    pub ratio_ci95: Result<[f64; 2], NoInterval>,
    /// Number of blocks.
    pub blocks: usize,
    /// Mean length of a block, s.
    pub block_s: f64,
    /// Share of the reducible error that the effects remove; `None` if there was no reducible error.
    pub removed: Option<f64>,
    /// Run by run.
    pub runs: Vec<RunErrors>,
}

impl TestResult {
    /// True if the test runs prove that the effects reduce the error: the interval of the ratio is below one.
    #[must_use]
    pub fn proves(&self) -> bool {
        self.ratio_ci95.is_ok_and(|[_, high]| high < 1.0)
    }
}

/// A signal that the remaining residual correlates with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correlation {
    /// The signal: `displacement`, `velocity`, `drive rate`, ...
    pub with: &'static str,
    /// Correlation coefficient, -1 to 1.
    pub coefficient: f64,
}

/// The remaining error on the validation runs.
#[derive(Debug, Clone, PartialEq)]
pub struct RemainingError {
    /// Lack of fit: 1 minus the squared error of the noise over the squared residual.
    pub lof: f64,
    /// Lack of fit of the base alone.
    pub lof_before: f64,
    /// Share of the base's reducible error that is left.
    pub share: f64,
    /// Signals that the residual correlates with significantly, by a test on block sums; strongest first.
    pub correlates_with: Vec<Correlation>,
}

/// A structure of the base that was tried, if the diagnosis chose it.
#[derive(Debug, Clone, PartialEq)]
pub struct StructureRow {
    /// Name of the structure.
    pub structure: &'static str,
    /// True for the base that was given, false for a structure that was identified on the training runs.
    pub given: bool,
    /// How it fits; or why it could not be identified or simulated.
    pub outcome: Result<StructureFit, Error>,
}

/// How a structure fits.
#[derive(Debug, Clone, PartialEq)]
pub struct StructureFit {
    /// RMSE on the validation runs without any effect, N.
    pub alone_rsse_n: f64,
    /// RMSE on the validation runs with the effects found under this structure, N.
    pub rsse_n: f64,
    /// Ids of these effects.
    pub effects: Vec<&'static str>,
    /// Random starting points of its identification; 0 for the given base.
    pub restarts: u32,
    /// The verdict under this structure.
    pub verdict: Verdict,
    /// True if it fits the validation runs about as well as the best structure.
    pub fits_as_well: bool,
    /// True for the structure that became the base.
    pub chosen: bool,
}

/// The result of a diagnosis.
#[derive(Debug, Clone, PartialEq)]
pub struct DiagnosisResult {
    /// How the residual was computed.
    pub mode: DiagnosisMode,
    /// The verdict.
    pub verdict: Verdict,
    /// Why the base is inadequate; `Some` only with the verdict [`Verdict::BaseInadequate`].
    pub base_fault: Option<BaseFault>,
    /// The error that no model can remove.
    pub noise_floor: NoiseFloor,
    /// Effects that were named, in order of application.
    pub effects: Vec<NamedEffect>,
    /// Effects that were significant but rejected, each with the reason.
    pub refused: Vec<RefusedEffect>,
    /// Effects that these runs can neither show nor exclude, each with the reason and where possible the excitation that is needed.
    pub untestable: Vec<RefusedEffect>,
    /// All scores, round by round.
    pub candidates: Vec<Candidate>,
    /// The part of the training runs on which effects and terms were searched; `None` if it was all of it.
    pub searched: Option<Searched>,
    /// Number of blocks of the training runs, at the least block length.
    pub blocks: usize,
    /// The validation runs, before and after.
    pub confirm: Vec<RunErrors>,
    /// The test runs; `None` if none were given, and then the result is not tested on independent data.
    pub test: Option<TestResult>,
    /// The remaining error on the validation runs.
    pub remaining: RemainingError,
    /// The base, refitted on the training runs (in paired mode as given).
    pub before: Model,
    /// The base with the effects and terms; the same as `before` if none was found.
    pub after: Model,
    /// Terms that were discovered in what the effects leave.
    pub discovery: Discovery,
    /// The structures that were tried as base, in order; empty if only the given base was diagnosed.
    pub structures: Vec<StructureRow>,
    /// How each run was placed on its reference; empty in absolute mode.
    pub alignments: Vec<Alignment>,
    /// Change of the mean force since the references; `None` in absolute mode, or if the runs are too short.
    pub mean_shift: Option<MeanShift>,
    /// The damper's force of `after` on sines over the whole range of the training runs; `None` for a model that uses measured force, or if
    /// the runs have no motion.
    pub swept: Option<SweptRange>,
}

impl DiagnosisResult {
    /// The result with the sweep of its augmented model over the range of `runs`.
    pub(super) fn with_sweep(self, runs: &[Dataset]) -> Result<Self, Error> {
        Ok(Self { swept: swept(&self.after, runs)?, ..self })
    }

    /// True if `after` has an effect or a term that `before` lacks.
    #[must_use]
    pub fn is_augmented(&self) -> bool {
        !self.effects.is_empty() || !self.discovery.terms.is_empty()
    }

    /// Possible causes of the change of the mean force since the references; empty if no change is proved. A gas that pushes the rod out
    /// with more force is also a stiffer spring: if such a spring was named, only the gas is left.
    #[must_use]
    pub fn causes_of_mean_shift(&self) -> &'static [&'static str] {
        let Some(shift) = self.mean_shift.filter(MeanShift::is_proved) else { return &[] };
        let spring = self.effects.iter().find(|named| named.effect.effect() == Effect::GasSpring);
        match spring {
            Some(spring) if spring.effect.parameters()[0] * shift.force_n < 0.0 => &["gas_pressure"],
            _ => &["gas_pressure", "load_cell_zero"],
        }
    }

    /// The structure that became the base, with how it fits; `None` if only the given base was diagnosed.
    #[must_use]
    pub fn chosen(&self) -> Option<(&StructureRow, &StructureFit)> {
        self.structures
            .iter()
            .filter_map(|row| Some((row, row.outcome.as_ref().ok()?)))
            .find(|(_, fit)| fit.chosen)
    }
}

/// The damper's force of `model` on sines over the whole range of `runs`. Effects of the load cell are left out: they change the reading, and
/// a late reading gives energy to the motion.
fn swept(model: &Model, runs: &[Dataset]) -> Result<Option<SweptRange>, Error> {
    let model = model.augmented();
    if model.feeds_on_force() {
        return Ok(None);
    }
    Ok(sweep(&Augmented::new(*model.force(), model.effects().of_damper())?, runs))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effect::Effects;
    use crate::identify::DatasetOptions;
    use crate::preset;
    use crate::rig::{Channels, Experiment, Plant, record};

    #[test]
    fn the_sweep_is_of_the_damper_and_not_of_the_load_cell() {
        let base = preset::load(preset::BEST_FUZZY_TANH).expect("a preset");
        let experiment = Experiment::thesis("RP-ICPS").expect("of the thesis").with_duration_s(20.0);
        let run = record(&experiment, &Plant::default(), &Channels::default(), 1);
        let data = [Dataset::from_run(&run, &base.conditioning, &DatasetOptions::default()).expect("rows")];
        let with = |effect: Effect, value| {
            let effects = Effects::new(&[EffectModel::new(effect, &[value]).expect("allowed")]).expect("one");
            Model { effects, ..base }
        };
        let swept = |model: &Model| swept(model, &data).expect("swept").expect("a motion");
        let late = with(Effect::SensorDelay, 0.01);
        assert_eq!(swept(&late), swept(&base), "a late reading does not change the damper");
        assert_ne!(sweep(&late.augmented(), &data), Some(swept(&base)), "but it changes the reading");
        assert!(swept(&base).faults.is_empty(), "{:?}", swept(&base).faults);
    }
}
