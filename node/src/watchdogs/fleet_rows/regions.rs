//! The residual in each region of velocity and drive.
//!
//! The velocity at a stamp is the difference of the displacements 10 ms after and before it, so a residual waits for the displacement that
//! follows. The drive is held from sample to sample.

use super::cell;
use mr_damper_model::pipeline::Residual;
use mr_damper_model::sample::{Reading, Sample, Stamp};
use std::collections::VecDeque;

// Borders of the regions, as in `mr_damper.fleet.evaluate`: m/s, and A or V.
const VELOCITIES: [f64; 4] = [-0.15, -0.05, 0.05, 0.15];
const DRIVES: [f64; 4] = [0.5, 1.0, 1.5, 2.0];
const COLUMNS: usize = DRIVES.len() + 1;
const REGIONS: usize = (VELOCITIES.len() + 1) * COLUMNS;

/// Time to each side of a stamp, s.
const SIDE_S: f64 = 0.01;
/// Readings that are kept: 10 ms to each side at 100 kHz. A residual that waits longer is left out.
const MOST: usize = 2048;

/// Sums over the residuals of a region.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    samples: u64,
    sum_n: f64,
    squares_n2: f64,
}

/// The regions of an hour.
#[derive(Debug)]
pub(super) struct Regions {
    sums: [Sums; REGIONS],
    /// Stamps and displacements in m, the oldest first.
    displacements: VecDeque<(Stamp, f64)>,
    /// Stamps and drives, the oldest first.
    drives: VecDeque<(Stamp, f64)>,
    /// Stamps and residuals in N that wait for a displacement.
    waiting: VecDeque<(Stamp, f64)>,
}

impl Default for Regions {
    fn default() -> Self {
        Self {
            sums: [Sums::default(); REGIONS],
            displacements: VecDeque::new(),
            drives: VecDeque::new(),
            waiting: VecDeque::new(),
        }
    }
}

impl Regions {
    pub(super) fn input(&mut self, sample: &Sample) {
        match sample.reading {
            Reading::Displacement(x) => {
                push(&mut self.displacements, sample.stamp, x.get());
                self.settle();
            }
            Reading::Drive(drive) => push(&mut self.drives, sample.stamp, drive.get()),
            _ => {}
        }
    }

    pub(super) fn residual(&mut self, residual: &Residual) {
        push(&mut self.waiting, residual.stamp, residual.residual.get());
        self.settle();
    }

    /// The rows of the regions that have residuals; the next hour begins without.
    pub(super) fn take(&mut self) -> Vec<String> {
        let sums = std::mem::replace(&mut self.sums, [Sums::default(); REGIONS]);
        let edges = |borders: &[f64], at: usize| {
            let text = |edge: Option<&f64>, infinite: &str| {
                edge.map_or_else(|| infinite.to_owned(), ToString::to_string)
            };
            format!(
                "{},{}",
                text(at.checked_sub(1).map(|below| &borders[below]), "-inf"),
                text(borders.get(at), "inf")
            )
        };
        let row = |(at, sums): (usize, &Sums)| {
            let count = sums.samples as f64;
            let velocity = edges(&VELOCITIES, at / COLUMNS);
            let drive = edges(&DRIVES, at % COLUMNS);
            let (mean_n, rmse_n) = (sums.sum_n / count, (sums.squares_n2 / count).sqrt());
            format!("{velocity},{drive},{},{},{}", sums.samples, cell(mean_n), cell(rmse_n))
        };
        sums.iter().enumerate().filter(|(_, sums)| sums.samples > 0).map(row).collect()
    }

    /// Counts the residuals whose velocity is known.
    fn settle(&mut self) {
        while let Some(&(stamp, residual_n)) = self.waiting.front() {
            let after = self.displacements.back().map(|(last, _)| last.since(stamp).get());
            if after.is_none_or(|after_s| after_s < SIDE_S) {
                return;
            }
            self.waiting.pop_front();
            let sides = [-SIDE_S, SIDE_S].map(|side_s| at(&self.displacements, stamp, side_s));
            let [Some(before_m), Some(after_m)] = sides else { continue };
            let velocity_m_s = (after_m - before_m) / (2.0 * SIDE_S);
            let drive =
                self.drives.iter().rev().find(|(at, _)| *at <= stamp).map_or(0.0, |(_, drive)| *drive);
            let region = VELOCITIES.partition_point(|edge| *edge <= velocity_m_s) * COLUMNS
                + DRIVES.partition_point(|edge| *edge <= drive);
            let sums = &mut self.sums[region];
            sums.samples += 1;
            sums.sum_n += residual_n;
            sums.squares_n2 += residual_n * residual_n;
        }
    }
}

/// Appends a reading; a stamp that goes back begins a new series.
fn push(readings: &mut VecDeque<(Stamp, f64)>, stamp: Stamp, value: f64) {
    if readings.back().is_some_and(|(last, _)| *last >= stamp) {
        readings.clear();
    }
    if readings.len() == MOST {
        readings.pop_front();
    }
    readings.push_back((stamp, value));
}

/// The displacement `side_s` after `stamp`, interpolated between its neighbours; `None` before the first one and after the last.
fn at(displacements: &VecDeque<(Stamp, f64)>, stamp: Stamp, side_s: f64) -> Option<f64> {
    let from_s = |at: Stamp| at.since(stamp).get() - side_s;
    let next = displacements.partition_point(|(at, _)| from_s(*at) < 0.0);
    let (after, after_m) = displacements.get(next)?;
    let after_s = from_s(*after);
    if after_s == 0.0 {
        return Some(*after_m);
    }
    let (before, before_m) = displacements.get(next.checked_sub(1)?)?;
    let before_s = from_s(*before);
    Some(before_m + (after_m - before_m) * before_s / (before_s - after_s))
}
