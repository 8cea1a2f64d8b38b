//! Courses as the diagnosis sees them: conditioned rows, the columns of the criterion, and the scales.

use super::limits::Limits;
use super::plan::Course;
use crate::condition::VelocitySource;
use crate::effect::Augmented;
use crate::error::Error;
use crate::identify::{Dataset, DatasetOptions, walk};
use crate::model::{Envelope, Model};
use crate::sample::{Stamp, Trace};
use std::ops::ControlFlow;

/// Case temperature at the start and rise over a run, °C and K, where an effect needs a temperature: no run tells them in advance.
const CASE_C: f64 = 25.0;
pub(super) const RISE_K: f64 = 5.0;
/// Time between readings of the temperature, s.
const CASE_EVERY_S: f64 = 0.25;

/// Rows of `course` at `rate_hz`, conditioned as `model` is, with a force of zero. The case warms up if `warms`.
pub(super) fn dataset(
    course: &Course,
    model: &Model,
    limits: &Limits,
    rate_hz: f64,
    warms: bool,
    moving_only: bool,
) -> Result<Dataset, Error> {
    let limits = Limits { rate_hz, ..*limits };
    let mut run = course.run("design", &limits, model.force.drive());
    let stamps = run.displacement_m.stamps.clone();
    run.force_n = Some(Trace { values: vec![0.0; stamps.len()], stamps: stamps.clone() });
    if model.conditioning.velocity == VelocitySource::Measured {
        let x = &run.displacement_m.values;
        let last = x.len().saturating_sub(1);
        let velocity = |k: usize| {
            let (before, after) = (k.saturating_sub(1), (k + 1).min(last));
            (x[after] - x[before]) * rate_hz / (after - before).max(1) as f64
        };
        run.velocity_m_s =
            Some(Trace { values: (0..x.len()).map(velocity).collect(), stamps: stamps.clone() });
    }
    if warms {
        let length_s = course.displacement_m.len() as f64 / rate_hz;
        let mut case = Trace::default();
        let every = ((CASE_EVERY_S * rate_hz) as usize).max(1);
        for (k, stamp) in stamps.iter().enumerate().step_by(every) {
            case.stamps.push(*stamp);
            case.values.push(CASE_C + RISE_K * k as f64 / rate_hz / length_s);
        }
        run.case_temp_c = Some(case);
    }
    let options = DatasetOptions { moving_only, ..DatasetOptions::default() };
    Dataset::from_run(&run, &model.conditioning, &options)
}

/// `dataset` with the simulated force of `model`; `None` if the force is not finite.
pub(super) fn with_simulated_force(mut dataset: Dataset, model: &Augmented) -> Option<Dataset> {
    let mut force_n = Vec::with_capacity(dataset.rows.len());
    // The return value is not needed: the check below decides.
    let _ = walk(model, &dataset, |_, said| {
        force_n.push(said.free_run_n);
        ControlFlow::Continue(())
    });
    let mut range = None;
    for (row, force_n) in dataset.rows.iter_mut().zip(force_n) {
        if row.counts && !force_n.is_finite() {
            return None;
        }
        row.force_n = force_n;
        row.raw_force_n = force_n;
        if row.counts {
            Envelope::widen(&mut range, force_n);
        }
    }
    dataset.envelope.force_n = range;
    Some(dataset)
}

/// Marks for each row whether the damper moves near it: the speed is above `limit_m_s` within `margin` rows. A segment (a row without a
/// time step begins one) is taken by itself.
pub(super) fn moving(dataset: &Dataset, limit_m_s: f64, margin: usize) -> Vec<bool> {
    let rows = &dataset.rows;
    let mut near = vec![false; rows.len()];
    let mut since = usize::MAX;
    let mut mark = |k: usize, begins: bool| {
        since = if rows[k].velocity_m_s.abs() > limit_m_s { 0 } else { since.saturating_add(1) };
        near[k] |= since <= margin;
        if begins {
            since = usize::MAX;
        }
    };
    for k in 0..rows.len() {
        let ends = rows.get(k + 1).is_none_or(|next| next.dt_s.is_none());
        mark(k, ends);
    }
    for k in (0..rows.len()).rev() {
        mark(k, rows[k].dt_s.is_none());
    }
    near
}

/// Several datasets as segments of one, at increasing stamps, with the number of the dataset of each row.
pub(super) fn joined(datasets: Vec<Dataset>) -> Option<(Dataset, Vec<usize>)> {
    let mut datasets = datasets.into_iter();
    let mut all = datasets.next()?;
    let mut owner = vec![0; all.rows.len()];
    for (number, dataset) in datasets.enumerate() {
        let after = all.rows.last().map_or(Stamp::from_nanos(0), |row| row.stamp).nanos() + 1_000_000_000;
        owner.resize(owner.len() + dataset.rows.len(), number + 1);
        all.rows.extend(dataset.rows.into_iter().map(|mut row| {
            row.stamp = row.stamp.shifted(after);
            row
        }));
    }
    Some((all, owner))
}
