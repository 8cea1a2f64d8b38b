//! The figures of a model on a run, of `mr-damper evaluate` and of replays.

mod refusals;

pub use refusals::Refusals;

use mr_damper_model::Error;
use mr_damper_model::evaluate::{Coverage, evaluate};
use mr_damper_model::metrics::Fit;
use mr_damper_model::model::Model;
use mr_damper_model::pipeline::{Event, Models, Pipeline, Settings};
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
    let found = evaluate(model, run, Settings::default(), |_| true)?;
    Ok(RunReport {
        run: name,
        free_run: found.free_run,
        free_run_without_offset: found.free_run_without_offset,
        offset_n: found.offset.get(),
        one_step: found.one_step,
        persistence: found.persistence,
        band: found.band,
        refused: found.refused,
        refusals: if found.refused > 0 { refusals(model, run)? } else { Refusals::default() },
    })
}

/// The samples of `run` that the pipeline refuses. An evaluation only counts them, so this runs the pipeline again.
fn refusals(model: Model, run: &Run) -> Result<Refusals, Error> {
    let mut pipeline = Pipeline::new(Models::alone(model), Settings::default())?;
    let mut refusals = Refusals::default();
    for sample in run.samples() {
        pipeline.step(&sample, &mut |event| {
            if let Event::Refusal(refusal) = event {
                refusals.take(&refusal, run);
            }
        });
    }
    Ok(refusals)
}
