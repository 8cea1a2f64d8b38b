//! Residuals of a held-out run, computed by the live pipeline: with all inputs, with lost force, and with a
//! held drive.

use crate::error::Error;
use crate::evaluate::require_channels;
use crate::model::Model;
use crate::pipeline::{BEYOND_CALIBRATION, Event, Mode, Models, Pipeline, Reasons, Settings};
use crate::sample::{Channel, Run, Sample, Stamp};
use crate::uncertainty::{Operating, Predictor, Uncertainty};

/// A residual and its operating point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub(super) run: usize,
    pub(super) speed_m_s: f64,
    pub(super) drive: f64,
    /// Time coasted, or age of the drive, s; unused in a base row.
    pub(super) time_s: f64,
    /// Magnitude of the residual, N.
    pub(super) error_n: f64,
}

/// The rows of one predictor.
#[derive(Debug, Clone, Default)]
pub(super) struct Rows {
    /// Rows with fresh inputs, run by run in the order of time. `time_s` is the age of the drive.
    pub(super) base: Vec<Row>,
    /// Rows whose force has been lost for `time_s`.
    pub(super) coasting: Vec<Row>,
    /// Drive held for `time_s`.
    pub(super) held: Vec<Row>,
}

/// Longest time that an input is removed, s.
pub(super) const AWAY_S: f64 = 0.35;
/// Shortest time that the input is present before the next removal, s, and as a number of samples, so that
/// all lags are filled.
const THERE_S: f64 = 0.15;
const THERE_SAMPLES: f64 = 16.0;
/// Number of passes over each run, with the removed stretches at different places.
const SHIFTS: u32 = 3;

/// An estimate, and the operating points of the free-run and seeded channels.
struct Made {
    stamp: Stamp,
    force_n: f64,
    mode: Mode,
    counts: bool,
    free_run: Option<Operating>,
    one_step: Option<Operating>,
}

/// The measured force, comparable with the model, and the force of the simulation.
struct Residual {
    stamp: Stamp,
    measured_n: f64,
    predicted_n: f64,
}

/// Results of a pass over a run, in the order of stamps.
#[derive(Default)]
struct Tape {
    made: Vec<Made>,
    residuals: Vec<Residual>,
}

impl Tape {
    /// Runs the pipeline over `run` with only those samples for which `keep` returns true.
    fn record(model: &Model, run: &Run, keep: impl Fn(&Sample) -> bool) -> Result<Self, Error> {
        // The smoothing at a mode change is not an error of the model, and coasting must last for the whole
        // stretch.
        let settings = Settings { bumpless_tau_s: 0.0, coast_s: 2.0 * AWAY_S, ..Settings::default() };
        let mut pipeline = Pipeline::new(Models::alone(*model), settings)?;
        let mut tape = Self::default();
        for sample in run.samples().filter(keep) {
            let mut estimate = None;
            pipeline.step(&sample, &mut |event| match event {
                Event::Estimate(e) => estimate = Some(e),
                Event::Residual(r) => tape.residuals.push(Residual {
                    stamp: r.stamp,
                    measured_n: r.measured.get(),
                    predicted_n: r.predicted.get(),
                }),
                _ => {}
            });
            if let Some(estimate) = estimate {
                tape.made.push(Made {
                    stamp: estimate.stamp,
                    force_n: estimate.force.get(),
                    mode: estimate.mode,
                    counts: !estimate.reasons.any(BEYOND_CALIBRATION | Reasons::DRIVE_STALE),
                    free_run: pipeline.operating(Predictor::FreeRun),
                    one_step: pipeline.operating(Predictor::OneStep),
                });
            }
        }
        Ok(tape)
    }

    /// Every counted estimate, with the residual of the same stamp in `residuals`.
    fn with<'a>(&'a self, residuals: &'a [Residual]) -> impl Iterator<Item = (&'a Made, &'a Residual)> {
        let mut next = 0;
        self.made.iter().filter(|made| made.counts).filter_map(move |made| {
            next += residuals[next..].partition_point(|r| r.stamp < made.stamp);
            residuals.get(next).filter(|r| r.stamp == made.stamp).map(|r| (made, r))
        })
    }
}

fn row(run: usize, at: &Operating, time_s: f64, error_n: f64) -> Option<Row> {
    let row = Row { run, speed_m_s: at.velocity_m_s.abs(), drive: at.drive, time_s, error_n: error_n.abs() };
    (row.error_n.is_finite() && row.speed_m_s.is_finite()).then_some(row)
}

/// Adds the rows of `run` number `number` to the rows of both predictors.
pub(super) fn gather(
    model: &Model,
    run: &Run,
    number: usize,
    free_run: &mut Rows,
    one_step: &mut Rows,
) -> Result<(), Error> {
    require_channels(model, run)?;
    let all = Tape::record(model, run, |_| true)?;
    let truth = &all.residuals;
    free_run.base.extend(free_rows(&all, truth, number));
    one_step.base.extend(one_step_rows(model, &all, truth, number));
    for shift in 0..SHIFTS {
        if model.feeds_on_force() {
            let tape = Tape::record(model, run, without(model, run, Channel::Force, shift))?;
            one_step.coasting.extend(coasting_rows(model, &tape, truth, number));
        }
        if model.force.drive().is_some() {
            let tape = Tape::record(model, run, without(model, run, Channel::Drive, shift))?;
            free_run.held.extend(free_rows(&tape, &tape.residuals, number));
            one_step.held.extend(one_step_rows(model, &tape, truth, number));
        }
    }
    Ok(())
}

/// Returns a filter that removes the samples of `channel` in regular stretches.
fn without(model: &Model, run: &Run, channel: Channel, shift: u32) -> impl Fn(&Sample) -> bool {
    let first = run.displacement_m.stamps.first().copied().unwrap_or_default();
    let there_s = THERE_S.max(THERE_SAMPLES / model.rate_hz);
    let cycle_s = there_s + AWAY_S;
    let begin_s = cycle_s * f64::from(shift) / f64::from(SHIFTS);
    move |sample| {
        let time_s = sample.stamp.since(first).get() + begin_s;
        sample.reading.channel() != channel || time_s.rem_euclid(cycle_s) < there_s
    }
}

fn free_rows(tape: &Tape, residuals: &[Residual], run: usize) -> Vec<Row> {
    let rows = tape.with(residuals).filter_map(|(made, residual)| {
        let at = made.free_run?;
        row(run, &at, at.drive_age_s, residual.measured_n - residual.predicted_n)
    });
    rows.collect()
}

fn one_step_rows(model: &Model, tape: &Tape, truth: &[Residual], run: usize) -> Vec<Row> {
    let rows = tape.with(truth).filter_map(|(made, residual)| {
        let at = made.one_step.filter(|at| made.mode == Mode::Arx && is_one_step(model, at))?;
        row(run, &at, at.drive_age_s, residual.measured_n - made.force_n)
    });
    rows.collect()
}

fn coasting_rows(model: &Model, tape: &Tape, truth: &[Residual], run: usize) -> Vec<Row> {
    let rows = tape.with(truth).filter_map(|(made, residual)| {
        let is_arx = matches!(made.mode, Mode::Arx | Mode::ArxCoast);
        let at = made.one_step.filter(|at| is_arx && !is_one_step(model, at))?;
        row(run, &at, at.coast_s, residual.measured_n - made.force_n)
    });
    rows.collect()
}

fn is_one_step(model: &Model, at: &Operating) -> bool {
    model.force.force_fed_period().is_some_and(|period| at.coast_s <= Uncertainty::ONE_STEP * period.get())
}
