//! What the diagnosis says of a case. [`judge`] is the only place that calls it.

use super::cases::{Case, Kind};
use mr_damper_model::Error;
use mr_damper_model::condition::{ApplyTo, Conditioning, VelocitySource};
use mr_damper_model::diagnose::{Runs, Settings, Verdict, close};
use mr_damper_model::identify::{
    Dataset, DatasetOptions, ModelSpec, Options, Placement, Watch, identify_datasets,
};
use mr_damper_model::sample::Run;

/// What came out for a case.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Outcome {
    /// ESR of the base alone, running free, on the sealed run.
    pub(crate) before: f64,
    /// ESR of the augmented model there; `None` when nothing was named.
    pub(crate) after: Option<f64>,
    /// Share of the explainable error that is gone there; `None` when nothing was named.
    pub(crate) removed: Option<f64>,
    /// Mean square error there over the noise floor, N²: of the base alone, and of the augmented model.
    pub(crate) over_noise_n2: [f64; 2],
    /// What was named, in the order of application.
    pub(crate) named: Vec<Named>,
    /// The verdict.
    pub(crate) verdict: Verdict,
}

/// An effect that was named, or a class of effects that the data do not tell apart.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Named {
    /// Ids of the library; the first one is in the model.
    pub(crate) ids: Vec<String>,
    /// Form of the first one, where it has one.
    pub(crate) form: Option<&'static str>,
    /// The first one's first parameter.
    pub(crate) value: f64,
}

/// The conditioning of the base: the force's filter on the prediction, a velocity without delay.
pub(crate) const CONDITIONING: Conditioning = Conditioning {
    apply_to: ApplyTo::Output,
    cutoff_hz: 20.0,
    velocity: VelocitySource::ThreePoint,
    slope_window_s: 0.01,
};

/// Restarts of the base's search.
const RESTARTS: u32 = 5;
/// Standard deviation of the base's sets, of their spacing. With the half of the thesis' sets the base follows the rig's smooth valve
/// in steps, and leaves five times the noise.
const SIGMA: f64 = 0.7;

/// What the diagnosing side has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Bench {
    /// Displacement alone, as a vehicle has it, and a base of seven sets over the current. What a difference quotient and seven sets
    /// miss of the healthy damper is half of its noise.
    Displacement,
    /// A velocity transducer too, and nine sets: next to nothing is missed.
    Velocity,
}

impl Bench {
    const fn conditioning(self) -> Conditioning {
        match self {
            Self::Displacement => CONDITIONING,
            Self::Velocity => Conditioning { velocity: VelocitySource::Measured, ..CONDITIONING },
        }
    }

    /// Sets of the base over the current, 0 to 2.5 A.
    fn placement(self) -> Placement {
        let sets: u8 = match self {
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

/// Judges a case: fuzzy-tanh is identified on the estimate runs (in paired mode on the healthy run of the estimate's motion), and the
/// loop is closed.
///
/// # Errors
/// Those of identification and diagnosis.
pub(crate) fn judge(case: &Case, bench: Bench) -> Result<Outcome, Error> {
    let conditioning = bench.conditioning();
    let rows = |runs: &[Run]| -> Result<Vec<Dataset>, Error> {
        runs.iter().map(|run| Dataset::from_run(run, &conditioning, &DatasetOptions::default())).collect()
    };
    let (estimate, confirm, test) = (rows(&case.estimate)?, rows(&case.confirm)?, rows(&case.test)?);
    let reference = rows(&case.reference)?;
    let healthy = if case.kind == Kind::Paired { &reference[..1] } else { &estimate[..] };
    let options = Options {
        conditioning,
        choose_velocity: false,
        restarts: RESTARTS,
        placement: bench.placement(),
        ..Options::default()
    };
    let base = identify_datasets(ModelSpec::FUZZY_TANH, healthy, &options, &Watch::none())?.model;
    let runs =
        Runs { estimate: &estimate, confirm: &confirm, test: &test, reference: &reference, replicates: &[] };
    let found = close(&base, &runs, &Settings::default(), &Watch::none(), &|_| {})?;
    let sealed =
        found.test.ok_or_else(|| Error::Data { message: format!("{}: no sealed run", case.name) })?;
    let named = |named: &mr_damper_model::diagnose::Named| Named {
        ids: named.class.iter().map(ToString::to_string).collect(),
        form: named.effect.effect().form(),
        value: named.effect.parameters()[0],
    };
    // A name that the sealed run does not bear out is taken back by the verdict.
    let stands = !matches!(found.verdict, Verdict::Unexplained | Verdict::BaseInadequate);
    let effects = if stands { &found.effects[..] } else { &[] };
    let over_noise = |rsse_n: f64| rsse_n.powi(2) - found.noise_floor.rsse_n.powi(2);
    Ok(Outcome {
        before: sealed.before.esr,
        over_noise_n2: [sealed.before.rsse_n, sealed.after.rsse_n].map(over_noise),
        after: (!effects.is_empty()).then_some(sealed.after.esr),
        removed: sealed.removed.filter(|_| !effects.is_empty()),
        named: effects.iter().map(named).collect(),
        verdict: found.verdict,
    })
}
