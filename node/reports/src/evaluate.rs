//! The figures of a model on a run, of `mr-damper evaluate` and of replays.

mod refusals;

pub use refusals::Refusals;

use mr_damper_model::Error;
use mr_damper_model::evaluate::{Coverage, Evaluator, evaluate_and};
use mr_damper_model::metrics::Fit;
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{Event, Settings};
use mr_damper_model::sample::Run;
use serde::Serialize;

/// The figures of one run, as they are written to JSON.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[expect(missing_docs, reason = "the fields are documented in the model's Evaluation")]
pub struct RunReport {
    pub run: String,
    pub free_run: Option<Fit>,
    pub free_run_without_offset: Option<Fit>,
    pub offset_n: f64,
    pub one_step: Option<Fit>,
    pub persistence: Option<Fit>,
    /// Share of samples whose measured force is within the model's calibrated 90 % band.
    pub band: Option<Coverage>,
    pub refused: u64,
    /// The refused samples by channel and reason.
    #[serde(skip_serializing_if = "Refusals::is_empty")]
    pub refusals: Refusals,
}

/// The figures of `model` on `run`, under the name `name`.
///
/// # Errors
/// When model and run do not fit together.
pub fn figures(name: String, model: Model, run: &Run) -> Result<RunReport, Error> {
    let (mut evaluator, mut refusals) = (Evaluator::default(), Refusals::default());
    let note = |event: &Event| {
        if let Event::Refusal(refusal) = event {
            refusals.take(refusal, run);
        }
    };
    evaluate_and(&mut evaluator, model, run, Settings::default(), |_| true, note)?;
    let found = evaluator.finish();
    Ok(RunReport {
        run: name,
        free_run: found.free_run,
        free_run_without_offset: found.free_run_without_offset,
        offset_n: found.offset.get(),
        one_step: found.one_step,
        persistence: found.persistence,
        band: found.band,
        refused: found.refused,
        refusals,
    })
}
