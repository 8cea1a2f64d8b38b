//! The inverse methods of a comparison: the current that each finds for a measured force, against the recorded one.

use super::state::{CellKeys, FinishedLine, State};
use super::work::in_parallel;
use super::{Args, ComparisonPlan, bar};
use crate::commands::context::CliContext;
use crate::settings::error::NodeError;
use mr_damper_model::compare::{self, Experiment, FinishedInverse};
use mr_damper_model::identify::Watch;
use mr_damper_model::inverse::Method;
use mr_damper_model::sample::DriveKind;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// The finished inverses of one training experiment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct FinishedInverses {
    key: String,
    seconds: f64,
    inverses: Vec<FinishedInverse>,
}

impl FinishedLine for FinishedInverses {
    fn key(&self) -> &str {
        &self.key
    }
}

/// The inverse methods to compare: what `--inverse` names; by default all, in a comparison of all models whose drive is a coil current.
pub(super) fn methods(args: &Args, experiments: &[Experiment]) -> Vec<Method> {
    if !args.inverse.is_empty() {
        return args.inverse.clone();
    }
    let mut runs = experiments.iter().flat_map(|experiment| &experiment.replicates);
    let is_default = args.models.is_empty()
        && !args.passive_only
        && runs.all(|run| run.data.drive == Some(DriveKind::CoilCurrent));
    if is_default { Method::ALL.to_vec() } else { Vec::new() }
}

/// Identifies and tests the inverse methods on each training experiment, or takes the results from `state`. They come in the order of
/// the experiments.
///
/// # Errors
/// When the state cannot be written; when interrupted.
pub(super) fn compute(
    work: &ComparisonPlan,
    state: &State<FinishedInverses>,
    context: &CliContext,
) -> Result<Vec<FinishedInverse>, NodeError> {
    if work.inverses.is_empty() {
        return Ok(Vec::new());
    }
    let keys = CellKeys::new(&work.options, &work.sources);
    let places: Vec<usize> =
        (0..work.experiments.len()).filter(|place| work.experiments[*place].is_trained_on()).collect();
    let bar = bar(context, places.len(), "inverse methods [{bar:40}] {pos}/{len}");
    if bar.is_hidden() && !context.quiet {
        tracing::info!(
            "comparing: inverse methods on {}",
            mr_damper_base::shown::count(places.len(), "experiment")
        );
    }
    let one = |index: usize| -> Result<Vec<FinishedInverse>, NodeError> {
        let place = places[index];
        let key = keys.inverse_key(&work.inverses, &work.experiments[place].name);
        if let Some(line) = state.get(&key) {
            bar.inc(1);
            return Ok(line.inverses.clone());
        }
        let watch = Watch { cancel: Some(context.interrupt.flag()), progress: None };
        let start = Instant::now();
        let inverses = compare::run_inverse(place, &work.inverses, &work.experiments, &work.options, &watch)?;
        let line = FinishedInverses { key, seconds: start.elapsed().as_secs_f64(), inverses };
        state.add(&line)?;
        bar.inc(1);
        Ok(line.inverses)
    };
    let found: Result<Vec<_>, _> = in_parallel(places.len(), work.threads, one).into_iter().collect();
    bar.finish_and_clear();
    Ok(found?.concat())
}
