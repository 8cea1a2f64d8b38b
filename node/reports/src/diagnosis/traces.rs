//! The residual of a run before and after augmentation, sample by sample, with the motion at the same time.
//!
//! Velocity, acceleration and the slope of the drive come from parabolas over a centred window. The window needs later
//! samples, so this works on finished runs only, not in the live path.

use super::words;
use mr_damper_model::diagnose::{DiagnosisMode, DiagnosisResult, reference_force_n};
use mr_damper_model::identify::{Dataset, walk};
use mr_damper_model::model::Model;
use mr_damper_model::sample::{DriveKind, Stamp, Trace};
use mr_damper_model::statistics::parabola::parabola;
use std::ops::ControlFlow;

/// Half the window of the parabolas, s: 8 samples at 512 Hz.
const HALF_WINDOW_S: f64 = 1.0 / 64.0;

/// One sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TracePoint {
    /// Time since the start of the run, s.
    pub time_s: f64,
    /// Displacement as the model saw it, m.
    pub displacement_m: f64,
    /// Velocity, m/s.
    pub velocity_m_s: f64,
    /// Acceleration, m/s².
    pub acceleration_m_s2: f64,
    /// The drive, A or V; NaN when there is none.
    pub drive: f64,
    /// Slope of the drive, A/s or V/s.
    pub drive_slope: f64,
    /// Temperature of the case, °C; NaN where it is unknown.
    pub case_temp_c: f64,
    /// Measured force, N.
    pub measured_n: f64,
    /// Residual of the base model, without the run's mean, N.
    pub before_n: f64,
    /// Residual of the base model with the effects, without the run's mean, N.
    pub after_n: f64,
}

/// Residuals of a run before and after augmentation.
#[derive(Debug, Clone, PartialEq)]
pub struct RunTrace {
    /// Its name, without folders.
    pub run: String,
    /// Kind of its drive.
    pub drive: Option<DriveKind>,
    /// Sample rate, Hz.
    pub rate_hz: f64,
    /// The samples that count for the error, in stretches without gaps.
    pub stretches: Vec<Vec<TracePoint>>,
}

impl RunTrace {
    /// The residuals of `result` on `data`. In paired mode the residual before is the difference to the force of the
    /// reference run (one of `references`) with the same motion; the residual after is that difference minus the
    /// simulated contribution of the effects.
    #[must_use]
    pub fn of(result: &DiagnosisResult, data: &Dataset, references: &[Dataset]) -> Self {
        let (before, after) = (free_run(&result.before, data), free_run(&result.after, data));
        let references = if result.mode == DiagnosisMode::Paired { references } else { &[] };
        let healthy = reference_force_n(data, references);
        let residuals = data.rows.iter().enumerate().map(|(k, row)| {
            let (before_n, after_n) = (before[k], after[k]);
            if let Some(healthy) = &healthy {
                let changed_n = row.force_n - healthy[k].unwrap_or(f64::NAN);
                return [changed_n, changed_n - (after_n - before_n)];
            }
            [row.force_n - before_n, row.force_n - after_n]
        });
        let mut stretches = stretches(data, &residuals.collect::<Vec<_>>());
        take_mean_out(&mut stretches);
        Self { run: words::file_name(&data.name), drive: data.drive, rate_hz: data.rate_hz, stretches }
    }

    /// All samples of all stretches.
    pub fn points(&self) -> impl Iterator<Item = &TracePoint> {
        self.stretches.iter().flatten()
    }
}

/// Simulated force (free run) at each row, N; NaN where there is none.
fn free_run(model: &Model, data: &Dataset) -> Vec<f64> {
    let mut forces = Vec::with_capacity(data.rows.len());
    let ended = walk(&model.augmented(), data, |_, predicted| {
        forces.push(predicted.free_run_n);
        ControlFlow::Continue(())
    });
    debug_assert!(ended.is_continue(), "nothing ends the walk early");
    forces
}

/// The rows that count and have motion and both residuals, split wherever a row is missing. Drive and temperature may be
/// NaN.
fn stretches(data: &Dataset, residuals: &[[f64; 2]]) -> Vec<Vec<TracePoint>> {
    let stamps: Vec<Stamp> = data.rows.iter().map(|row| row.stamp).collect();
    let displacement =
        Trace { stamps: stamps.clone(), values: data.rows.iter().map(|row| row.displacement_m).collect() };
    let drive = Trace { stamps, values: data.rows.iter().map(|row| row.drive).collect() };
    let half = ((HALF_WINDOW_S * data.rate_hz).round() as usize).max(2);
    let mut stretches: Vec<Vec<TracePoint>> = Vec::new();
    let mut open = false;
    for (index, (row, [before_n, after_n])) in data.rows.iter().zip(residuals).enumerate() {
        let motion = parabola(&displacement, index, half)
            .filter(|_| row.counts && before_n.is_finite() && after_n.is_finite());
        let Some([displacement_m, velocity_m_s, acceleration_m_s2]) = motion else {
            open = false;
            continue;
        };
        if !open || row.dt_s.is_none() {
            stretches.push(Vec::new());
        }
        open = true;
        let point = TracePoint {
            time_s: row.stamp.since(data.rows[0].stamp).get(),
            displacement_m,
            velocity_m_s,
            acceleration_m_s2,
            drive: row.drive,
            drive_slope: parabola(&drive, index, half).map_or(f64::NAN, |[_, slope, _]| slope),
            case_temp_c: row.case_temp_c,
            measured_n: row.force_n,
            before_n: *before_n,
            after_n: *after_n,
        };
        stretches.last_mut().into_iter().for_each(|stretch| stretch.push(point));
    }
    stretches
}

fn take_mean_out(stretches: &mut [Vec<TracePoint>]) {
    let points = || stretches.iter().flatten();
    let count = points().count().max(1) as f64;
    let before_n = points().map(|point| point.before_n).sum::<f64>() / count;
    let after_n = points().map(|point| point.after_n).sum::<f64>() / count;
    for point in stretches.iter_mut().flatten() {
        point.before_n -= before_n;
        point.after_n -= after_n;
    }
}
