//! Diagnosis and model augmentation: names the physical effect that a model lacks, adds it to the model, and reports
//! the error before and after. The command is `mr-damper close`.
//!
//! ```text
//! training runs   ─→ refit the base, simulate ─→ residual r above the noise floor?       no → nothing to explain
//!                    │                           scores g = dM/d(effect), projected off dM/d(base)
//!                    │                           block sums of g r, corrected for multiple tests → significant
//!                    │                           joint refit of the best → the largest drop of squared error
//! validation runs ─→ no run worse, better in total? in the physical range? interval excludes zero? → named
//!                    └── up to three effects, then backward: effects that are not needed are removed
//! other structure ─→ does it fit better without any effect?                         yes → base inadequate, no name
//! test runs       ─→ read once: error before and after
//! ```
//!
//! The residual is always measured force minus **simulated** (free-run) force. A one-step-ahead prediction is fed with measured
//! force, which already contains the effect. Scores are computed through the whole simulator, filters included. They are projected
//! because the base could absorb part of the change by other coefficients, and that part is not evidence. They are summed over blocks
//! because neighbouring samples are not independent. An effect is accepted only if it helps on runs that it was not found on. Effects
//! that the data cannot tell apart are reported as one class.
//!
//! The user gives the training, validation and test runs by the flags `--estimate`, `--confirm` and `--test`; fields and
//! types here use those names.
//!
//! The result is deterministic for a given seed, on any number of threads.

mod alignment;
mod alternative;
mod basis;
mod blocks;
mod check;
mod completion;
mod correlation;
mod cycle;
mod derivative_span;
mod derivatives;
pub mod design;
pub mod discover;
mod effect_set;
mod energy;
mod finding;
mod floor;
mod interval;
mod joint;
mod paired;
mod procedure;
mod ranges;
mod refusal;
mod round;
mod rows;
mod score;
mod since_healthy;
mod space;
mod stretches;
mod structures;
mod test_runs;
mod thresholds;
mod variants;

pub use crate::error::DiagnosisError;
pub use crate::statistics::error_ratio::NoInterval;
pub use alignment::Alignment;
pub use effect_set::EffectSet;
pub use finding::{
    Candidate, Change, Correlation, DiagnosisMode, DiagnosisResult, FloorSource, FoundParameter, NamedEffect,
    NoiseFloor, RefusedEffect, RemainingError, RunErrors, SinceHealthy, StructureFit, StructureRow,
    TestResult, Verdict,
};
pub use paired::{MeanShift, reference_force_n};
pub use ranges::Ranges;
pub use refusal::{BaseFault, Refusal};
pub use stretches::Searched;
pub use structures::{Bases, close_any, default_structures};
pub use thresholds::{Part, Scaled, Threshold, Thresholds};

use crate::error::Error;
use crate::identify::{Dataset, Watch};
use crate::model::Model;
use stretches::Stretches;

/// The runs of a diagnosis, by purpose. Each must be conditioned as the base model is. A run may serve one purpose only.
#[derive(Debug, Clone, Copy, Default)]
pub struct Runs<'a> {
    /// Training runs: effects are found on these.
    pub estimate: &'a [Dataset],
    /// Validation runs: these decide whether an effect is accepted. At least one.
    pub confirm: &'a [Dataset],
    /// Test runs: read once, at the end. May be empty; the result is then not tested on independent data.
    pub test: &'a [Dataset],
    /// Runs of the healthy damper for paired mode: for each run of `estimate`, `confirm` and `test`, in this order, one with the same
    /// excitation. They may begin at another instant or crank angle, and have another zero of the displacement.
    pub reference: &'a [Dataset],
    /// Runs of one pattern, for the noise floor.
    pub replicates: &'a [Dataset],
    /// Runs of the same damper when it was healthy, with any excitation. They tell a fault from what the base lacked from the start.
    pub healthy: &'a [Dataset],
}

impl<'a> Runs<'a> {
    /// Training, validation and test runs, each with the number of its first reference.
    const fn with_first_reference(&self) -> [(&'a [Dataset], usize); 3] {
        let (confirm, test) = (self.estimate.len(), self.estimate.len() + self.confirm.len());
        [(self.estimate, 0), (self.confirm, confirm), (self.test, test)]
    }
}

/// Settings of a diagnosis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Noise floor declared by the user, root mean square, N.
    pub noise_floor_n: Option<f64>,
    /// Largest probability of naming any effect by chance when there is none.
    pub significance: f64,
    /// Largest number of effects to name, 1 to 3.
    pub most_effects: usize,
    /// Largest number of terms to discover in what the effects leave, 0 to 3.
    pub most_terms: usize,
    /// Effects that may be named.
    pub effects: EffectSet,
    /// Physical ranges of the effects' parameters.
    pub ranges: Ranges,
    /// Least length of a block, s. `None` stands for 3 s on training and validation runs; in paired mode on a cyclic motion, for one cycle.
    /// On test runs the length follows from the data, and this can only make it longer. On 100 trials with coloured noise and no effect,
    /// blocks of 3 s named no effect, and blocks of 0.25 s named one in one trial of six. Give shorter blocks only if the data are too short
    /// for 3 s, and report it.
    pub block_s: Option<f64>,
    /// Largest number of rows in the sums; with more rows only every n-th is used.
    pub most_rows: usize,
    /// Largest number of samples of the training, validation or healthy runs that the search simulates; of longer runs it uses stretches. The model
    /// found is fitted to all samples. In paired mode all are used.
    pub most_samples: usize,
    /// Seed of the sign flips and of the noise that is added to inputs.
    pub seed: u64,
    /// The thresholds of its decisions.
    pub thresholds: Thresholds,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            noise_floor_n: None,
            significance: 0.05,
            block_s: None,
            most_effects: 3,
            most_terms: 3,
            effects: EffectSet::ALL,
            ranges: Ranges::default(),
            most_rows: 60_000,
            most_samples: Self::DEFAULT_MOST_SAMPLES,
            seed: 0,
            thresholds: Thresholds::default(),
        }
    }
}

impl Settings {
    /// Least length of a block on training and validation runs if [`Settings::block_s`] is `None`, s.
    pub const DEFAULT_BLOCK_S: f64 = 3.0;

    /// Default of [`Settings::most_samples`]: 160 s at 512 Hz.
    pub const DEFAULT_MOST_SAMPLES: usize = 81_920;

    /// Least length of a block on training and validation runs, s.
    #[must_use]
    pub fn training_block_s(&self) -> f64 {
        self.block_s.unwrap_or(Self::DEFAULT_BLOCK_S)
    }
}

/// Stages of a diagnosis, reported to the caller as progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// A structure of the base is identified, if it was not given; its name. All structures are identified at the same time.
    Structure(&'static str),
    /// This round begins with all structures.
    Search(usize),
    /// The base is refitted on the training runs.
    Base,
    /// The scores of this round are computed.
    Scores(usize),
    /// The candidates of this round are refitted together with the base.
    Refits(usize),
    /// Effects that are not needed are searched for and removed.
    Pruning,
    /// An alternative structure is identified, to check whether the given base is adequate.
    Alternative,
    /// The error that the effects leave is searched for this term, from 1.
    Terms(usize),
    /// The model found on stretches of the runs is fitted to all of them.
    Completion,
    /// The test runs are read.
    TestRuns,
}

/// Diagnoses `base` on `runs`: names the effects that it lacks and adds them.
///
/// `stage` is called at the start of each stage.
///
/// ```
/// use mr_damper_model::diagnose::{EffectSet, Runs, Settings, Verdict, close};
/// use mr_damper_model::identify::{Dataset, DatasetOptions, Watch};
/// use mr_damper_model::preset;
/// use mr_damper_model::rig::inject::inject;
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let base = preset::load(preset::BEST_FUZZY_TANH)?;
/// let experiment = Experiment::thesis("RP-ICPS").expect("an experiment of the thesis").with_duration_s(30.0);
/// let run = |plant: &Plant, seed| {
///     let run = record(&experiment, plant, &Channels::default(), seed);
///     Dataset::from_run(&run, &base.conditioning, &DatasetOptions::default())
/// };
/// // The seals of a healthy damper are replaced: they add 80 N of friction.
/// let (healthy, mut damper) = (Plant::default(), Plant::default());
/// inject("friction", 80.0, &mut damper, &mut Channels::default())?;
/// let (estimate, confirm) = ([run(&damper, 1)?], [run(&damper, 2)?]);
/// // Paired mode: each run has a reference of the healthy damper with the same excitation.
/// let reference = [run(&healthy, 1)?, run(&healthy, 2)?];
///
/// let runs = Runs { estimate: &estimate, confirm: &confirm, reference: &reference, ..Runs::default() };
/// let settings = Settings { effects: EffectSet::only(&["friction", "gas_spring"])?, most_effects: 1, ..Settings::default() };
/// let result = close(&base, &runs, &settings, &Watch::none(), &|_| {})?;
/// assert_eq!(result.effects[0].effect.effect().id(), "friction");
/// assert!(result.verdict != Verdict::BaseInadequate && result.after.effects.as_slice().len() == 1);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// - [`Error::Diagnosis`] if runs are missing, too short for the blocks, given twice, or conditioned unlike the base;
///   in paired mode if a run has no reference; in absolute mode if the base has no parameters to project off.
/// - [`Error::Identify`] if force or displacement never varies in the training runs.
/// - [`Error::MissingChannel`] or [`Error::WrongDrive`] if the base cannot be simulated on a run.
/// - [`Error::OutOfRange`] for a setting out of range.
/// - [`Error::Cancelled`] if `watch` cancels the work.
pub fn close(
    base: &Model,
    runs: &Runs,
    settings: &Settings,
    watch: &Watch,
    stage: &dyn Fn(Stage),
) -> Result<DiagnosisResult, Error> {
    if runs.reference.is_empty() {
        check::check(base, runs, settings)?;
        let stretches = Stretches::new(runs, settings.most_samples);
        let searched = stretches.runs();
        let found = procedure::Procedure::new(base, &searched, settings, watch)?.run(stage)?;
        return completed(found, &stretches, runs, settings, watch, stage);
    }
    let [estimate, confirm, test] = runs
        .with_first_reference()
        .map(|(own, first)| paired::on_scales_of((runs.reference, first), own, &settings.thresholds));
    let runs = Runs { estimate: &estimate.runs, confirm: &confirm.runs, test: &test.runs, ..*runs };
    let found = procedure::Procedure::new(base, &runs, settings, watch)?.run(stage)?;
    let alignments = [estimate.alignments, confirm.alignments, test.alignments].concat();
    DiagnosisResult { alignments, ..found }.with_sweep(runs.estimate)
}

/// `found`, whose effects were searched on `stretches` of `runs`: with terms, on all runs, and compared with the healthy damper.
fn completed(
    found: DiagnosisResult,
    stretches: &Stretches,
    runs: &Runs,
    settings: &Settings,
    watch: &Watch,
    stage: &dyn Fn(Stage),
) -> Result<DiagnosisResult, Error> {
    let extended = discover::extend(found, &stretches.runs(), settings, watch, stage)?;
    let on_all = stretches.complete(extended, settings, watch, stage)?;
    since_healthy::compared(on_all, runs, settings, watch)?.with_sweep(runs.estimate)
}
