//! What is said of a case. [`judge`] is the only place that calls the diagnosis.

use super::cases::Case;
use mr_damper_model::Error;
use mr_damper_model::condition::{ApplyTo, Conditioning, VelocitySource};
use mr_damper_model::evaluate::evaluate;
use mr_damper_model::identify::{ModelSpec, Options, Watch, identify};
use mr_damper_model::pipeline::Settings;
use mr_damper_model::sample::Run;

/// What came out for a case.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Outcome {
    /// ESR of the base alone, running free, on estimate, confirm and test.
    pub(crate) before: [f64; 3],
    /// ESR of the augmented model on the test; `None` when nothing was named.
    pub(crate) after: Option<f64>,
    /// What was named, in the order of naming.
    pub(crate) named: Vec<Named>,
    /// The verdict, in a word or two.
    pub(crate) verdict: String,
}

/// An effect that was named, or a class of effects that the data do not tell apart.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Named {
    /// Ids of the library; the first one is in the model.
    pub(crate) ids: Vec<String>,
    /// The first one's first parameter.
    pub(crate) value: f64,
}

/// The conditioning of the base: no filter, velocity from the transducer.
pub(crate) const MEASURED: Conditioning = Conditioning {
    apply_to: ApplyTo::None,
    cutoff_hz: 20.0,
    velocity: VelocitySource::Measured,
    slope_window_s: 0.01,
};

/// Judges a case.
///
/// TO BE FILLED IN: identifies and scores the base alone, and names nothing, until there is a diagnosis to call.
///
/// # Errors
/// Those of identification and evaluation.
pub(crate) fn judge(case: &Case, conditioning: Conditioning) -> Result<Outcome, Error> {
    let options = Options { conditioning, choose_velocity: false, restarts: 5, ..Options::default() };
    let base = identify(ModelSpec::FUZZY_TANH, &case.estimate, &options, &Watch::none())?.model;
    let esr = |runs: &[Run]| -> Result<f64, Error> {
        let run = runs.first().ok_or_else(|| Error::Data { message: format!("{}: no run", case.name) })?;
        let scored = evaluate(base, run, Settings::default(), |_| true)?;
        Ok(scored.free_run.map_or(f64::NAN, |fit| fit.esr))
    };
    Ok(Outcome {
        before: [esr(&case.estimate)?, esr(&case.confirm)?, esr(&case.test)?],
        verdict: "not judged".to_owned(),
        ..Outcome::default()
    })
}
