//! The result of the diagnosis for a case. Only [`Prepared::diagnose`] calls the diagnosis.

use super::cases::Case;
use mr_damper_model::Error;
use mr_damper_model::condition::{ApplyTo, Conditioning, VelocitySource};
use mr_damper_model::diagnose::{
    Bases, Change, DiagnosisResult, NamedEffect, Runs, Settings, Verdict, close, close_any,
    default_structures,
};
use mr_damper_model::identify::{
    Dataset, DatasetOptions, ModelSpec, Options, Placement, Watch, identify_datasets,
};
use mr_damper_model::model::Model;
use mr_damper_model::sample::Run;

/// Result for a case.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Outcome {
    /// NMSE (thesis: ESR) of the base alone, in simulation, on the test run.
    pub(crate) before: f64,
    /// NMSE of the augmented model on the test run; `None` if no effect was named.
    pub(crate) after: Option<f64>,
    /// Share of the reducible error that was removed on the test run; `None` if no effect was named.
    pub(crate) removed: Option<f64>,
    /// Mean square error on the test run above the noise floor, N²: of the base alone, and of the augmented model.
    pub(crate) over_noise_n2: [f64; 2],
    /// The effects named, in the order of application.
    pub(crate) named: Vec<Named>,
    /// The verdict.
    pub(crate) verdict: Verdict,
}

/// A named effect, or a class of effects that the data cannot tell apart.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Named {
    /// Ids in the library; the first one is in the model.
    pub(crate) ids: Vec<String>,
    /// Form of the first effect, if it has one.
    pub(crate) form: Option<&'static str>,
    /// First parameter of the first effect.
    pub(crate) value: f64,
    /// Its change since the healthy runs; `None` without these.
    pub(crate) change: Option<Change>,
}

/// The conditioning of the base: the filter of the force applied to the prediction, and a velocity without delay.
pub(crate) const CONDITIONING: Conditioning = Conditioning {
    apply_to: ApplyTo::Output,
    cutoff_hz: 20.0,
    velocity: VelocitySource::ThreePoint,
    slope_window_s: 0.01,
};

/// Restarts of the search for the base.
const RESTARTS: u32 = 5;
/// Standard deviation of the base's fuzzy sets, as a multiple of their spacing. With half the spacing, as in the thesis, the base follows
/// the rig's smooth valve in steps, and its error is five times the noise.
const SIGMA: f64 = 0.7;

/// Measurements and base available to the diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Instrumentation {
    /// Displacement alone, as in a vehicle, and a base with seven sets over the current. The misfit of the healthy damper by the finite
    /// difference and the seven sets is half of the noise.
    Displacement,
    /// A velocity transducer too, and a base with nine sets. The misfit of the healthy damper is negligible.
    Velocity,
    /// Displacement alone, and the base that `close --base auto` chooses with its default settings.
    Auto,
}

impl Instrumentation {
    const fn conditioning(self) -> Conditioning {
        match self {
            Self::Displacement | Self::Auto => CONDITIONING,
            Self::Velocity => Conditioning { velocity: VelocitySource::Measured, ..CONDITIONING },
        }
    }

    /// Restarts of the search for the base.
    fn restarts(self) -> u32 {
        match self {
            Self::Displacement | Self::Velocity => RESTARTS,
            Self::Auto => Options::default().restarts,
        }
    }

    /// Fuzzy sets of the base over the current, 0 to 2.5 A.
    fn placement(self) -> Placement {
        let sets: u8 = match self {
            Self::Auto => return Placement::FromRuns,
            Self::Displacement => 7,
            Self::Velocity => 9,
        };
        let spacing_a = 2.5 / f64::from(sets - 1);
        Placement::Given {
            centres: (0..sets).map(|k| spacing_a * f64::from(k)).collect(),
            sigma: Some(SIGMA * spacing_a),
        }
    }
}

/// Diagnoses a case with the base fuzzy-tanh, identified on the training runs or, in paired mode, on the healthy run with the training
/// excitation. `healthy` are further runs of the healthy damper. With [`Instrumentation::Auto`], which has no paired mode, the base is chosen.
///
/// # Errors
/// As identification and diagnosis.
pub(crate) fn diagnose(
    case: &Case,
    healthy: &[Run],
    instrumentation: Instrumentation,
) -> Result<Outcome, Error> {
    // Terms have their own cases. With them each case takes several times as long, so only the shipped defaults include them.
    let most_terms =
        if instrumentation == Instrumentation::Auto { Settings::default().most_terms } else { 0 };
    let prepared = Prepared::new(case, healthy, instrumentation)?;
    let found = prepared.diagnose(&Settings { most_terms, ..Settings::default() })?;
    Ok(outcome(&found, &case.name))
}

/// A case ready for a diagnosis: the rows of its runs, and its base.
pub(crate) struct Prepared {
    estimate: Vec<Dataset>,
    confirm: Vec<Dataset>,
    test: Vec<Dataset>,
    reference: Vec<Dataset>,
    healthy: Vec<Dataset>,
    options: Options,
    /// `None` if the diagnosis chooses it.
    base: Option<Model>,
}

impl Prepared {
    /// Reads the runs of `case` and `healthy` runs of its damper, and identifies the base.
    ///
    /// # Errors
    /// As identification.
    pub(crate) fn new(case: &Case, healthy: &[Run], instrumentation: Instrumentation) -> Result<Self, Error> {
        let conditioning = instrumentation.conditioning();
        let rows = |runs: &[Run]| -> Result<Vec<Dataset>, Error> {
            let rows = |run| Dataset::from_run(run, &conditioning, &DatasetOptions::default());
            runs.iter().map(rows).collect()
        };
        let (estimate, reference) = (rows(&case.estimate)?, rows(&case.reference)?);
        let options = Options {
            conditioning,
            choose_velocity: false,
            restarts: instrumentation.restarts(),
            placement: instrumentation.placement(),
            ..Options::default()
        };
        let (confirm, test, healthy) = (rows(&case.confirm)?, rows(&case.test)?, rows(healthy)?);
        let chosen = Self { estimate, confirm, test, reference, healthy, options, base: None };
        if instrumentation == Instrumentation::Auto { Ok(chosen) } else { chosen.with_fuzzy_tanh() }
    }

    /// The case with the base fuzzy-tanh, identified on the training runs or, with references, on the first of these.
    ///
    /// # Errors
    /// As identification.
    pub(crate) fn with_fuzzy_tanh(self) -> Result<Self, Error> {
        let runs = self.reference.get(..1).unwrap_or(&self.estimate);
        let base = identify_datasets(ModelSpec::FUZZY_TANH, runs, &self.options, &Watch::none())?.model;
        Ok(Self { base: Some(base), ..self })
    }

    /// Diagnoses the case.
    ///
    /// # Errors
    /// As the diagnosis.
    pub(crate) fn diagnose(&self, settings: &Settings) -> Result<DiagnosisResult, Error> {
        let runs = Runs {
            estimate: &self.estimate,
            confirm: &self.confirm,
            test: &self.test,
            reference: &self.reference,
            healthy: &self.healthy,
            ..Runs::default()
        };
        let (watch, stage) = (Watch::none(), |_| {});
        if let Some(base) = &self.base {
            return close(base, &runs, settings, &watch, &stage);
        }
        let bases = Bases { given: None, structures: &default_structures(true)?, options: &self.options };
        close_any(&bases, &runs, settings, &watch, &stage)
    }
}

/// Ids of the effects that were named, in order of application.
pub(crate) fn names(found: &DiagnosisResult) -> Vec<&'static str> {
    found.effects.iter().map(|named| named.effect.effect().id()).collect()
}

/// What `found` says about the case called `name`, which has a test run.
pub(crate) fn outcome(found: &DiagnosisResult, name: &str) -> Outcome {
    let test = found.test.as_ref().unwrap_or_else(|| panic!("{name}: there was a test run"));
    let named = |named: &NamedEffect| Named {
        ids: named.class.iter().map(ToString::to_string).collect(),
        form: named.effect.effect().form(),
        value: named.effect.parameters()[0],
        change: named.since_healthy.map(|since| since.change),
    };
    // The verdict withdraws an effect that the test run does not support.
    let stands = !matches!(found.verdict, Verdict::Unexplained | Verdict::BaseInadequate);
    let effects = if stands { &found.effects[..] } else { &[] };
    let over_noise = |rsse_n: f64| rsse_n.powi(2) - found.noise_floor.rsse_n.powi(2);
    Outcome {
        before: test.before.esr,
        over_noise_n2: [test.before.rsse_n, test.after.rsse_n].map(over_noise),
        after: (!effects.is_empty()).then_some(test.after.esr),
        removed: test.removed.filter(|_| !effects.is_empty()),
        named: effects.iter().map(named).collect(),
        verdict: found.verdict,
    }
}
