//! The result of the diagnosis for a case. Only [`diagnose`] calls the diagnosis.

use super::cases::{Case, Kind};
use mr_damper_model::Error;
use mr_damper_model::condition::{ApplyTo, Conditioning, VelocitySource};
use mr_damper_model::diagnose::{Bases, Runs, Settings, Verdict, close, close_any, default_structures};
use mr_damper_model::identify::{
    Dataset, DatasetOptions, ModelSpec, Options, Placement, Watch, identify_datasets,
};
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
/// excitation. With [`Instrumentation::Auto`], which has no paired mode, the base is chosen.
///
/// # Errors
/// As identification and diagnosis.
pub(crate) fn diagnose(case: &Case, instrumentation: Instrumentation) -> Result<Outcome, Error> {
    let conditioning = instrumentation.conditioning();
    let rows = |runs: &[Run]| -> Result<Vec<Dataset>, Error> {
        runs.iter().map(|run| Dataset::from_run(run, &conditioning, &DatasetOptions::default())).collect()
    };
    let (estimate, confirm, test) = (rows(&case.estimate)?, rows(&case.confirm)?, rows(&case.test)?);
    let reference = rows(&case.reference)?;
    let healthy = if case.kind == Kind::Paired { &reference[..1] } else { &estimate[..] };
    let options = Options {
        conditioning,
        choose_velocity: false,
        restarts: instrumentation.restarts(),
        placement: instrumentation.placement(),
        ..Options::default()
    };
    let runs = Runs {
        estimate: &estimate,
        confirm: &confirm,
        test: &test,
        reference: &reference,
        ..Runs::default()
    };
    // Terms have their own cases. With them each case takes several times as long, so only the shipped defaults include them.
    let most_terms =
        if instrumentation == Instrumentation::Auto { Settings::default().most_terms } else { 0 };
    let (settings, watch) = (Settings { most_terms, ..Settings::default() }, Watch::none());
    let found = if instrumentation == Instrumentation::Auto {
        let bases = Bases { given: None, structures: &default_structures(true)?, options: &options };
        close_any(&bases, &runs, &settings, &watch, &|_| {})?
    } else {
        let base = identify_datasets(ModelSpec::FUZZY_TANH, healthy, &options, &watch)?.model;
        close(&base, &runs, &settings, &watch, &|_| {})?
    };
    let test = found.test.unwrap_or_else(|| panic!("{}: there was a test run", case.name));
    let named = |named: &mr_damper_model::diagnose::NamedEffect| Named {
        ids: named.class.iter().map(ToString::to_string).collect(),
        form: named.effect.effect().form(),
        value: named.effect.parameters()[0],
    };
    // The verdict withdraws an effect that the test run does not support.
    let stands = !matches!(found.verdict, Verdict::Unexplained | Verdict::BaseInadequate);
    let effects = if stands { &found.effects[..] } else { &[] };
    let over_noise = |rsse_n: f64| rsse_n.powi(2) - found.noise_floor.rsse_n.powi(2);
    Ok(Outcome {
        before: test.before.esr,
        over_noise_n2: [test.before.rsse_n, test.after.rsse_n].map(over_noise),
        after: (!effects.is_empty()).then_some(test.after.esr),
        removed: test.removed.filter(|_| !effects.is_empty()),
        named: effects.iter().map(named).collect(),
        verdict: found.verdict,
    })
}
