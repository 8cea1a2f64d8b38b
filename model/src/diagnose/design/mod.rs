//! The design of the next run: displacement and drive that best tell apart effects that a diagnosis could not.
//!
//! ```text
//! maximise over runs u within the limits:   min over pairs (A, B) of  z_AB
//! z_AB = d_AB sqrt(n) / (2 sigma)            d_AB: distance of the forces with A and with B after a refit, root mean square
//! P    = Phi(z_AB)                           probability that the run prefers A, if A is there
//! T_95 = T (1.645 / z_AB)^2                  time at which P is 95 %
//! ```
//!
//! | symbol | meaning |
//! |---|---|
//! | A, B | the effect that is there, and its rival: another effect, or the model without the effect |
//! | sigma | noise and misfit of the model, root mean square, N |
//! | n | independent samples: ten a second of motion |
//! | T | time in which the damper moves, s |
//!
//! The criterion (`criterion.rs`) is the distance of the predictions, not the precision of a parameter. In the refit, the rival may change
//! its own numbers, the coefficients of the base, the parameters of all effects that the model has, and the force offset. The distance
//! follows from exact derivatives; at the end, true refits of the rivals check it, and the smaller of both counts.
//!
//! The run is a sequence of segments from a library (`segment.rs`): strokes at constant speed, bursts of a sine, sweeps and random motion,
//! around the middle or to a side, each with a course of the drive. All of them start and end at rest. The search (`search.rs`) chooses the
//! segments, and random motion over the whole run competes with them. The run has three parts with the same segments, the second one
//! mirrored. The first two serve a diagnosis as training run and the last one as validation run: see [`Design::split_s`].
//!
//! The diagnosis leaves rows at rest out (under 5 % of the peak speed), and so does the design. It therefore searches three times, within
//! the limit of speed and within 30 and 10 % of it: slow motion counts only in a slow run.
//!
//! Source: `[atkinson1975]` in the bibliography (node/docs/guide/bibliography.md).

mod best;
mod criterion;
mod figures;
mod limits;
mod measured;
mod motion;
mod outcome;
mod plan;
mod question;
mod road;
mod search;
mod segment;
mod task;

pub use crate::error::{DesignError, NoiseSource};
pub use limits::Limits;
pub use outcome::{Design, Pair, PlannedSegment, Reached, Separation};
pub use question::Question;

use crate::error::Error;
use crate::identify::Watch;
use crate::model::Model;
use task::Task;

/// Parts of a run of at least [`LEAST_IN_PARTS_S`].
const PARTS: usize = 3;
/// Shortest run with several parts, s.
const LEAST_IN_PARTS_S: f64 = 9.0;

/// Settings of a design.
///
/// ```
/// use mr_damper_model::diagnose::design::Settings;
///
/// let settings = Settings { noise_n: Some(3.0), ..Settings::default() };
/// assert!(settings.candidates >= 100 && settings.seed == 0);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Noise and misfit, root mean square, N. `None` for the error in simulation that the model states, or without one for 1 % of the
    /// force.
    pub noise_n: Option<f64>,
    /// Number of candidate segments.
    pub candidates: usize,
    /// Seed of the candidates: another one gives another run.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { noise_n: None, candidates: 160, seed: 0 }
    }
}

/// Designs the run that best answers `question` for the damper of `model`. Effects of the question that the model has are taken out of it, and
/// their size is known.
///
/// The work takes some seconds. The result is deterministic for a given seed, on any number of threads.
///
/// ```
/// use mr_damper_model::diagnose::design::{Design, Limits, NoiseSource, Question, Settings, design};
/// use mr_damper_model::identify::Watch;
/// use mr_damper_model::preset;
///
/// let model = preset::load(preset::BEST_FUZZY_TANH)?;
/// let limits = Limits { drive: Some([0.0, 2.0]), duration_s: 12.0, ..Limits::default() };
/// let settings = Settings { noise_n: Some(3.0), candidates: 40, ..Settings::default() };
/// let question = Question::parse("friction|gas_spring")?;
/// let found: Design = design(&model, &question, &limits, &settings, &Watch::none())?;
/// assert_eq!(found.noise_source, NoiseSource::Given);
/// assert!(found.reached.speed_m_s <= 0.4 && found.reached.stroke_m <= 0.02);
/// let least = found.least().expect("there are two pairs");
/// assert!(least.designed.is_enough() && least.designed.discrimination >= least.road.discrimination.min(6.0));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// - [`Error::OutOfRange`] for a limit or setting out of range.
/// - [`Error::Design`] if the model or an effect does not fit, or if no run within the limits separates any pair.
/// - [`Error::Cancelled`] if `watch` cancels the work.
pub fn design(
    model: &Model,
    question: &Question,
    limits: &Limits,
    settings: &Settings,
    watch: &Watch,
) -> Result<Design, Error> {
    let task = Task::new(model, question, limits, settings, watch)?;
    let best = task.best(limits)?;
    let found = task.finish(limits, best)?;
    if found.pairs.iter().any(|pair| pair.designed.is_enough()) {
        return Ok(found);
    }
    let Some(least) = found.pairs.last().copied() else { return Ok(found) };
    Err(task.refusal(limits, &found, &least)?.into())
}

#[cfg(test)]
mod tests;
