//! Other readings of the same recorded inputs, and the change of the simulated force under each.
//!
//! A recorded channel says nothing about the time between its samples, and it contains noise. So a model that steps over the samples has an
//! error of its own. It is the same on every run, and no scatter between blocks shows it. Each variant changes one such assumption, and
//! the interval of a parameter ([`super::interval`]) contains an unknown share of each change.
//!
//! | variant | change | share that may be real |
//! |---|---|---|
//! | finer steps | each step is divided into four, with displacement, velocity, acceleration, drive and temperature straight between samples | 0.7 to 1.7 |
//! | held drive | the same, but the drive has its new value from the first part on | -1.33 to 1.33 |
//! | steady drive | the median of five drives, which keeps steps and removes noise; a drive that is further from it than noise is, such as a short pulse, stays | 0.4 to 2.4 |
//! | steady motion | displacement from a parabola through five displacements | 1 to 3 |
//! | other derivative | velocity and acceleration from a parabola through five displacements | -0.5 to 1.5 |
//! | even stamps ([`even_stamps`]) | the same, with even steps in place of the recorded ones, where these differ | 0 to 1.2 |
//!
//! A quarter of the step leaves 1/4 of an error of first order and 1/16 of one of second order, so the whole error is 4/3 or 16/15 of the
//! change. A held drive comes half a step earlier or later than a straight one, which is 4/3 of the change to either side. Noise in an input shifts a parameter
//! by its variance; the median of five leaves 0.29 of the variance and the parabola 0.49, so the whole shift is 1.4 and 2 times the change.
//! The three-point derivative and the parabola err in opposite directions, so the truth lies between them or near one.
//! If stamps jitter, either the samples were taken at these instants, or they were taken at even ones and stamped late. Derivatives
//! contain as much noise as the velocity then, so the shift is computed with derivatives on the changed rows. Each share has a margin, because
//! the variants are coarse.

use super::rows::Rows;
use crate::effect::Augmented;
use crate::identify::{Dataset, Row};
use crate::parallel;
use crate::statistics::parabola;

/// Rows to either side of a row that the parabola and the median use.
const REACH: usize = 2;
/// Parts of a step where steps are finer.
const PARTS: usize = 4;
/// Largest relative difference between the steps of a parabola.
const EVEN: f64 = 0.1;
/// Rows to either side of a row whose mean step is the even step.
const EVEN_REACH: usize = 8;
/// Largest relative difference between a step and the even step; beyond it a sample is missing.
const JITTER: f64 = 0.6;

/// Share of the change by [`even_stamps`] that is most likely real, and its margin.
pub(super) const EVEN_STAMPS: [f64; 2] = [0.6, 0.6];

/// A variant, with the share of its change that may be real.
struct Variant {
    change: fn(&Dataset) -> Dataset,
    /// Variant that the change is counted from; `None` for the rows as they are.
    from: Option<usize>,
    share: f64,
    margin: f64,
}

const VARIANTS: [Variant; 5] = [
    Variant { change: finer, from: None, share: 1.2, margin: 0.5 },
    Variant { change: held, from: Some(0), share: 0.0, margin: 4.0 / 3.0 },
    Variant { change: steady_drive, from: None, share: 1.4, margin: 1.0 },
    Variant { change: steady_motion, from: None, share: 2.0, margin: 1.0 },
    Variant { change: other_derivative, from: None, share: 0.5, margin: 1.0 },
];

/// The change of the simulated force under one variant.
pub(super) struct Change {
    /// At each row, each run's mean removed, N.
    pub(super) force_n: Vec<f64>,
    /// Share of the change that is most likely real.
    pub(super) share: f64,
    /// The real share lies within `share` plus or minus this, with 95 % probability.
    pub(super) margin: f64,
}

/// The changes of the force of `model`, simulated as `predicted_n` on `rows`. Variants that change nothing, or under which the simulation is
/// not finite, are left out.
pub(super) fn changes(rows: &Rows, model: &Augmented, predicted_n: &[f64]) -> Vec<Change> {
    let forces: Vec<Option<Vec<f64>>> =
        parallel::map(&VARIANTS, |variant| rows.predict_changed(model, variant.change));
    let change = |(variant, force_n): (&Variant, &Option<Vec<f64>>)| {
        let from = match variant.from {
            None => predicted_n,
            Some(index) => forces[index].as_ref()?,
        };
        let mut force_n: Vec<f64> = force_n.as_ref()?.iter().zip(from).map(|(a, b)| a - b).collect();
        rows.centre(&mut force_n);
        let moves = force_n.iter().any(|change| *change != 0.0);
        moves.then_some(Change { force_n, share: variant.share, margin: variant.margin })
    };
    VARIANTS.iter().zip(&forces).filter_map(change).collect()
}

/// Each step in [`PARTS`] equal parts; the drive at the rows in between is `drive(before, after, share)`, given the share of the step.
fn divided(dataset: &Dataset, drive: fn(f64, f64, f64) -> f64) -> Dataset {
    let mut rows: Vec<Row> = Vec::with_capacity(PARTS * dataset.rows.len());
    for row in &dataset.rows {
        let (Some(dt_s), Some(before)) = (row.dt_s, rows.last().copied()) else {
            rows.push(*row);
            continue;
        };
        let part_s = Some(dt_s / PARTS as f64);
        // The first row of a segment has no acceleration.
        let before_m_s2 =
            Some(before.acceleration_m_s2).filter(|a| a.is_finite()).unwrap_or(row.acceleration_m_s2);
        for part in 1..PARTS {
            let share = part as f64 / PARTS as f64;
            rows.push(Row {
                dt_s: part_s,
                displacement_m: straight(before.displacement_m, row.displacement_m, share),
                velocity_m_s: straight(before.velocity_m_s, row.velocity_m_s, share),
                acceleration_m_s2: straight(before_m_s2, row.acceleration_m_s2, share),
                drive: drive(before.drive, row.drive, share),
                case_temp_c: straight(before.case_temp_c, row.case_temp_c, share),
                counts: false,
                ..*row
            });
        }
        rows.push(Row { dt_s: part_s, ..*row });
    }
    dataset.with_rows(rows)
}

fn straight(before: f64, after: f64, share: f64) -> f64 {
    before + share * (after - before)
}

/// True if all rows but the first come one step after the row before, up to [`EVEN`].
fn even(rows: &[Row]) -> bool {
    let Some(step_s) = rows.last().and_then(|row| row.dt_s) else { return false };
    rows[1..].iter().all(|row| row.dt_s.is_some_and(|dt_s| (dt_s - step_s).abs() <= EVEN * step_s))
}

fn finer(dataset: &Dataset) -> Dataset {
    divided(dataset, straight)
}

fn held(dataset: &Dataset) -> Dataset {
    divided(dataset, |_, after, _| after)
}

/// `dataset` with each row that has enough neighbours at even distance replaced by `with(neighbours, step in s)`.
fn smoothed(dataset: &Dataset, with: impl Fn(&[Row; 2 * REACH + 1], f64) -> Row) -> Dataset {
    let mut rows = dataset.rows.clone();
    for (row, near) in rows.iter_mut().skip(REACH).zip(dataset.rows.array_windows()) {
        if let Some(step_s) = row.dt_s.filter(|_| even(near)) {
            *row = with(near, step_s);
        }
    }
    dataset.with_rows(rows)
}

fn steady_drive(dataset: &Dataset) -> Dataset {
    let noise = drive_noise(&dataset.rows);
    smoothed(dataset, |near, _| {
        let (drive, median) = (near[REACH].drive, median_drive(near));
        Row { drive: if (drive - median).abs() > noise { drive } else { median }, ..near[REACH] }
    })
}

fn median_drive(near: &[Row; 2 * REACH + 1]) -> f64 {
    let mut drives = near.map(|row| row.drive);
    drives.sort_by(f64::total_cmp);
    drives[REACH]
}

/// Largest distance of a drive from the median of five that noise gives. Nine of ten are nearer than a third of it.
fn drive_noise(rows: &[Row]) -> f64 {
    let mut apart: Vec<f64> =
        rows.array_windows().map(|near| (near[REACH].drive - median_drive(near)).abs()).collect();
    let at = apart.len() * 9 / 10;
    if apart.is_empty() { 0.0 } else { 3.0 * *apart.select_nth_unstable_by(at, f64::total_cmp).1 }
}

/// Displacement, velocity and acceleration from a parabola through five displacements.
fn motion(near: &[Row; 2 * REACH + 1], step_s: f64) -> [f64; 3] {
    parabola::fit(&near.map(|row| row.displacement_m), step_s)
}

fn steady_motion(dataset: &Dataset) -> Dataset {
    smoothed(dataset, |near, step_s| {
        let [displacement_m, _, _] = motion(near, step_s);
        Row { displacement_m, ..near[REACH] }
    })
}

fn other_derivative(dataset: &Dataset) -> Dataset {
    smoothed(dataset, |near, step_s| {
        let [_, velocity_m_s, acceleration_m_s2] = motion(near, step_s);
        Row { velocity_m_s, acceleration_m_s2, ..near[REACH] }
    })
}

/// `dataset` with even steps in place of the recorded ones where these differ but no sample is missing, and with velocity and acceleration
/// from a parabola through five displacements there. `None` if no row changes.
pub(super) fn even_stamps(dataset: &Dataset) -> Option<Dataset> {
    const WINDOW: usize = 2 * EVEN_REACH + 1;
    let mut rows: Option<Vec<Row>> = None;
    for (k, near) in (EVEN_REACH..).zip(dataset.rows.array_windows::<WINDOW>()) {
        let step_s = near[WINDOW - 1].stamp.since(near[0].stamp).get() / (WINDOW - 1) as f64;
        let differs = |row: &Row| row.dt_s.map_or(f64::INFINITY, |dt_s| (dt_s - step_s).abs() / step_s);
        let most = near[1..].iter().map(differs).fold(0.0, f64::max);
        let Some(nearest) = near[EVEN_REACH - REACH..].first_chunk() else { continue };
        if most > EVEN && most < JITTER {
            let [_, velocity_m_s, acceleration_m_s2] = motion(nearest, step_s);
            let row = Row { velocity_m_s, acceleration_m_s2, dt_s: Some(step_s), ..near[EVEN_REACH] };
            rows.get_or_insert_with(|| dataset.rows.clone())[k] = row;
        }
    }
    rows.map(|rows| dataset.with_rows(rows))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::condition::{ApplyTo, Conditioning};
    use crate::identify::DatasetOptions;
    use crate::sample::{DriveKind, Run, Stamp, Trace};

    const STEP_S: f64 = 0.002;

    /// A run of 200 samples with these displacements and currents.
    fn dataset(displacement_m: fn(f64) -> f64, current_a: fn(usize) -> f64) -> Dataset {
        let times: Vec<f64> = (0..200).map(|k| k as f64 * STEP_S).collect();
        let stamps: Vec<Stamp> = times.iter().map(|t| Stamp::from_seconds(*t).expect("a time")).collect();
        let trace = |values: Vec<f64>| Trace { stamps: stamps.clone(), values };
        let run = Run {
            displacement_m: trace(times.iter().map(|t| displacement_m(*t)).collect()),
            drive: Some((DriveKind::CoilCurrent, trace((0..200).map(current_a).collect()))),
            force_n: Some(trace(vec![0.0; 200])),
            ..Run::default()
        };
        // The displacement stays as it is.
        let conditioning = Conditioning { apply_to: ApplyTo::Output, ..Conditioning::default() };
        Dataset::from_run(&run, &conditioning, &DatasetOptions::default()).expect("a dataset")
    }

    #[test]
    fn finer_rows_keep_stamps_and_times_and_held_drives_come_early() {
        let all = dataset(|t| 0.01 * (20.0 * t).sin(), |k| (k / 20) as f64 * 0.1);
        let (finer, held) = (finer(&all), held(&all));
        assert_eq!(finer.rows.len(), PARTS * (all.rows.len() - 1) + 1);
        let time_s = |rows: &[Row]| rows.iter().filter_map(|row| row.dt_s).sum::<f64>();
        assert!((time_s(&finer.rows) - time_s(&all.rows)).abs() < 1e-12);
        let recorded = finer.rows.iter().step_by(PARTS);
        assert!(recorded.zip(&all.rows).all(|(a, b)| a.drive == b.drive));
        let [before, after] = [all.rows[100], all.rows[101]].map(|row| row.acceleration_m_s2);
        let middle = finer.rows[PARTS * 100 + PARTS / 2].acceleration_m_s2;
        assert!((middle - f64::midpoint(before, after)).abs() < 1e-12);
        assert!(finer.rows[1].acceleration_m_s2.is_finite(), "although the first row lacks one");
        let earlier = held.rows.iter().zip(&finer.rows).filter(|(h, f)| h.drive > f.drive).count();
        assert_eq!(earlier, 9 * (PARTS - 1), "all added rows at each step of the current");
    }

    #[test]
    fn even_stamps_undo_jitter_and_keep_even_rows() {
        let even = dataset(|t| 0.3 * t * t, |_| 1.0);
        assert!(even_stamps(&even).is_none(), "nothing to change");
        // Stamps that are early and late in turn, by an eighth of the step.
        let late_s = |k: usize| if k.is_multiple_of(2) { 0.125 * STEP_S } else { -0.125 * STEP_S };
        let mut rows = even.rows.clone();
        for (k, row) in rows.iter_mut().enumerate() {
            row.stamp = row.stamp.shifted((1e9 * late_s(k)) as i64);
            row.dt_s = row.dt_s.map(|dt_s| dt_s + late_s(k) - late_s(k + 1));
            row.velocity_m_s += 0.01;
        }
        let jittered = even.with_rows(rows);
        let found = even_stamps(&jittered).expect("rows change").rows[100];
        let at_s = even.rows[100].stamp.nanos() as f64 * 1e-9;
        assert!((found.velocity_m_s - 0.6 * at_s).abs() < 1e-9, "{found:?}");
        assert!(found.dt_s.is_some_and(|dt_s| (dt_s - STEP_S).abs() < 1e-9), "{found:?}");
    }

    /// A step of 0.5 A, and a pulse of two samples.
    fn clean_a(k: usize) -> f64 {
        if (40..42).contains(&k) { 2.0 } else { 0.5 + 0.5 * (k / 100) as f64 }
    }

    #[test]
    fn a_steady_drive_has_less_noise_and_the_same_steps_and_pulses() {
        // One sample of three is 1 mA lower than the others.
        let all = dataset(|_| 0.0, |k| clean_a(k) + 1e-3 * ((k * k) % 3) as f64);
        let steady = steady_drive(&all);
        // The first sample has no velocity, and gives no row.
        let off_a = |(k, row): (usize, &Row)| row.drive - clean_a(k + 1);
        assert!(steady.rows.iter().enumerate().map(off_a).all(|off| (-1e-9..1.001e-3).contains(&off)));
        let changes = |rows: &[Row]| rows.array_windows().filter(|[a, b]| a.drive != b.drive).count();
        assert!(changes(&all.rows) > 120 && changes(&steady.rows) < 20, "{}", changes(&steady.rows));
    }

    #[test]
    fn a_parabola_is_kept() {
        let all = dataset(|t| 0.3 * t * t, |_| 1.0);
        for (row, was) in steady_motion(&all).rows.iter().zip(&all.rows) {
            assert!((row.displacement_m - was.displacement_m).abs() < 1e-12);
        }
        let row = other_derivative(&all).rows[50];
        let velocity_m_s = 0.6 * row.stamp.nanos() as f64 * 1e-9;
        assert!((row.velocity_m_s - velocity_m_s).abs() < 1e-9, "{row:?} {velocity_m_s} {:?}", all.rows[50]);
        assert!((row.acceleration_m_s2 - 0.6).abs() < 1e-6, "{row:?}");
    }
}
