//! Errors of identification.

use crate::sample::DriveKind;
use serde::Serialize;
use thiserror::Error;

/// Reasons why a model cannot be identified from the runs with the given options.
#[derive(Debug, Clone, PartialEq, Error, Serialize)]
#[serde(tag = "code", rename_all = "snake_case")]
#[non_exhaustive]
pub enum IdentifyError {
    /// No structure has this name.
    #[error("model \"{name}\" is not known; did you mean {nearest}? The models are {}", known.join(", "))]
    UnknownModel {
        /// The requested name.
        name: String,
        /// The most similar name.
        nearest: &'static str,
        /// All names.
        known: Vec<&'static str>,
    },
    /// The structure does not have the requested form.
    #[error("the {model} model has no {form} form; it has {}", known.join(" or "))]
    UnknownForm {
        /// Name of the structure.
        model: &'static str,
        /// The requested form.
        form: &'static str,
        /// The forms that the structure has.
        known: Vec<&'static str>,
    },
    /// The structure has no such variant in this form.
    #[error(
        "{model} has no variant \"{variant}\" in its {form} form; {}",
        match known.is_empty() {
            true => "it has no variants".to_owned(),
            false => format!("it has {}", known.join(", ")),
        }
    )]
    UnknownVariant {
        /// Name of the structure.
        model: &'static str,
        /// The form.
        form: &'static str,
        /// The requested variant.
        variant: &'static str,
        /// The variants that the structure has in this form.
        known: Vec<&'static str>,
    },
    /// P was requested as a model that runs.
    #[error(
        "p cannot be made into a model that runs: it explains the force by the measured force at the same instant, and run forward it \
         diverges (both roots of 1 - p2 s - p3 s^2 lie in the right half plane). `compare` shows how well it holds; the most similar model \
         that runs is sp"
    )]
    CannotRun,
    /// Huber's loss was requested for a structure that is fitted by least squares only.
    #[error("{model} is fitted by least squares only; leave Huber's loss out")]
    LeastSquaresOnly {
        /// Name of the structure.
        model: &'static str,
    },
    /// Centres or a number of sets were given for a structure without sets.
    #[error(
        "{model} ({form}) has no fuzzy sets over the drive; leave out their centres and number, or choose a fuzzy form"
    )]
    NoSets {
        /// Name of the structure.
        model: &'static str,
        /// Its form.
        form: &'static str,
    },
    /// No run was given.
    #[error("no runs to identify from; give at least one")]
    NoRuns,
    /// An experiment has no training run.
    #[error("experiment {experiment}: has no training runs; give at least one")]
    ExperimentWithoutTraining {
        /// Name of the experiment.
        experiment: String,
    },
    /// A run is too short to have a rate.
    #[error("run {run}: has fewer than two displacements; give a longer run")]
    NoRate {
        /// Name of the run.
        run: String,
    },
    /// Force and velocity have opposite signs.
    #[error(
        "run {run}: force and velocity have opposite signs (correlation {correlation:.2}, power {power_w:.3} W), but a damper gives off no energy: \
         its load cell or its displacement sensor is reversed. Turn the sign where this run is read: --map measured_force=NAME,sign=-1 with \
         the column, topic or signal (force_n in a CSV file), or, if the displacement is reversed, --map displacement=NAME,sign=-1"
    )]
    ReversedForce {
        /// Name of the run.
        run: String,
        /// Correlation of force and velocity.
        correlation: f64,
        /// Mean power that the machine takes up, W.
        power_w: f64,
    },
    /// The requested rate cannot be reached by omitting samples.
    #[error(
        "run {run}: its rate is {rate_hz:.6} Hz, not a whole multiple of {requested_hz} Hz; leave the run out, or choose another rate"
    )]
    NotAMultiple {
        /// Name of the run.
        run: String,
        /// Its rate, Hz.
        rate_hz: f64,
        /// The requested rate, Hz.
        requested_hz: f64,
    },
    /// An inverse model was requested for a model without a current input.
    #[error(
        "an inverse model {inverse} needs a force model with the coil current as input, but the input of this {model} model is {}; \
         identify from runs with current_a, without --passive",
        drive.map_or("motion alone", |drive| drive.name())
    )]
    InverseWithoutCurrent {
        /// Name of the inverse model.
        inverse: &'static str,
        /// Name of the force model.
        model: &'static str,
        /// Its drive.
        drive: Option<DriveKind>,
    },
    /// A model that is valid at one rate only was requested for runs at different rates.
    #[error(
        "the {model} model is valid at one rate only, but run {} is at {:.6} Hz and run {} at {:.6} Hz; identify them separately, or \
         request a rate of which both are whole multiples",
        runs[0], rates_hz[0], runs[1], rates_hz[1]
    )]
    DifferentRates {
        /// Name of the structure.
        model: &'static str,
        /// Names of two runs.
        runs: [String; 2],
        /// Their rates, Hz.
        rates_hz: [f64; 2],
    },
    /// The samples of a run are not evenly spaced, but the model needs that.
    #[error(
        "run {run}: {percent:.0} % of the samples do not follow the one before at the mean rate of {rate_hz:.1} Hz, but a model of \
         the kind {model} needs samples at an even rate; resample the run with `mr-damper convert RUN OUT --resample HZ`, or identify \
         a model without force inputs"
    )]
    UnevenSampling {
        /// Name of the run.
        run: String,
        /// Share of these samples, %.
        percent: f64,
        /// Mean rate of the run, Hz.
        rate_hz: f64,
        /// Name of the structure.
        model: &'static str,
    },
    /// Two runs are conditioned differently.
    #[error("runs {} and {} are conditioned differently, but a model is valid for one conditioning only; condition all runs alike", runs[0], runs[1])]
    DifferentConditioning {
        /// Names of the two runs.
        runs: [String; 2],
    },
    /// No sample of a run can be used.
    #[error(
        "run {run}: no sample can be used: the damper never moves, the run is too short for the filter to settle, or force and \
         displacement do not overlap in time"
    )]
    NothingCounts {
        /// Name of the run.
        run: String,
    },
    /// There are too few samples for the size of the model.
    #[error("{samples} samples{} are too few for the {count} {parts} of {model} ({needed} are needed); add runs, use longer ones, or \
             include samples at rest (--all-samples)", which.as_ref().map(|which| format!(" {which}")).unwrap_or_default())]
    TooFewSamples {
        /// Name of the structure.
        model: &'static str,
        /// The counted samples, as a clause after "samples"; `None` for all.
        which: Option<String>,
        /// Number of these samples.
        samples: usize,
        /// Number that is needed.
        needed: usize,
        /// Number of unknowns of the model.
        count: usize,
        /// Name of the unknowns: parameters, weights, points.
        parts: &'static str,
    },
    /// No sample is left for the choice between trained networks.
    #[error(
        "no sample is left to hold back from the training of {model}, so its result cannot be checked; add runs, or use longer ones"
    )]
    NothingHeldBack {
        /// Name of the structure.
        model: &'static str,
    },
    /// Too few samples belong to one set.
    #[error(
        "too few samples near {drive} = {centre:.3}: their total weight is {weight:.1}, but a function needs {needed}; add runs, or choose \
         membership centres within the runs' range"
    )]
    EmptySet {
        /// The drive that the sets divide.
        drive: DriveKind,
        /// Centre of the set, A or V.
        centre: f64,
        /// Total weight of the samples in the set.
        weight: f64,
        /// Weight that is needed.
        needed: f64,
    },
    /// Force, or motion, is the same in all samples.
    #[error(
        "{channel} never varies in these runs, so no model can be identified; give runs in which the damper moves, and check the sensors"
    )]
    Constant {
        /// The channel or channels.
        channel: &'static str,
    },
    /// The force is the same in all samples.
    #[error(
        "force_n never varies in these runs (it stays at {force_n} N), so no model can be identified; check the load cell"
    )]
    ConstantForce {
        /// Its value, N; NaN if it is unknown.
        force_n: f64,
    },
    /// An input of a fuzzy system is the same in all samples.
    #[error("{input} never varies in these runs; add runs where it does, or identify a model without it")]
    ConstantInput {
        /// Name of the input.
        input: &'static str,
    },
    /// The drive is the same in all samples, so its effect on the force is unknown.
    #[error(
        "{drive} is {} throughout these runs, so the dependence of force on it cannot be identified; add runs at other levels, or \
         identify the passive form",
        (value * 1e6).round() / 1e6
    )]
    ConstantDrive {
        /// The drive.
        drive: DriveKind,
        /// Its value, A or V.
        value: f64,
    },
    /// The runs have no value of the drive.
    #[error(
        "memberships cannot be placed: the runs have no {drive} values; record {drive}, or identify the passive form"
    )]
    NoDrive {
        /// The drive.
        drive: DriveKind,
    },
    /// One set cannot be free.
    #[error("one set over {drive} has no centre or width to identify; leave the sets fixed")]
    OneFreeSet {
        /// The drive that the sets divide.
        drive: DriveKind,
    },
    /// The drive has too few levels to determine free sets.
    #[error(
        "the runs hold {levels} levels of {drive}, so {sets} sets cannot be placed, which need more than {sets} levels; add runs in which it \
         varies, request fewer sets, or leave the sets fixed"
    )]
    TooFewLevels {
        /// The drive that the sets divide.
        drive: DriveKind,
        /// Number of its levels.
        levels: usize,
        /// Number of sets.
        sets: usize,
    },
    /// Memberships of a shape that has no training.
    #[error(
        "{model} cannot be trained with {shape} memberships; train gaussian, triangle or bell memberships. A model file or a FIS file \
         with {shape} memberships runs"
    )]
    UntrainedShape {
        /// Name of the structure.
        model: &'static str,
        /// The shape.
        shape: &'static str,
    },
    /// Memberships of a shape that the structure does not have.
    #[error("{model} has no {shape} memberships; leave the shape out, or identify anfis")]
    ForeignShape {
        /// Name of the structure.
        model: &'static str,
        /// The shape.
        shape: &'static str,
    },
    /// The simulation of the identified model does not stay finite over the range of its runs.
    #[error(
        "the identified {model} model is not kept: {sine}, its simulation does not stay finite; add runs with this motion, or identify \
         another model"
    )]
    Diverges {
        /// Name of the structure.
        model: &'static str,
        /// The sine on which it diverges, as text.
        sine: String,
    },
    /// Every start of the search failed.
    #[error("no restart had a finite error; check the runs for extreme values")]
    NoFiniteError,
}
