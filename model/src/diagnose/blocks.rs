//! Blocks of rows, over which the sums of the significance tests run.
//!
//! ```text
//! S_b = sum over block b of g r      block length max(least, 5 correlation times of g r)
//! ```
//!
//! Samples of a residual are not independent; a test that assumes so finds effects in coloured noise every time. Sums over blocks
//! much longer than the correlation time are nearly independent. [`crate::statistics::block_sums`] tests them.

use super::rows::Rows;
use crate::statistics::autocorrelation::{Cutoff, integrated_time};

/// Least length of a block, in correlation times.
const CORRELATION_TIMES: f64 = 5.0;
/// Step of the series that the correlation time is computed from, s.
const COARSE_S: f64 = 0.02;

/// Assignment of rows to blocks.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Blocks {
    /// Block of each row.
    of_row: Vec<usize>,
    count: usize,
}

impl Blocks {
    /// Blocks of about `length_s` within the runs of `rows`. A run shorter than half of that is joined to a neighbouring block. If a run
    /// has cycles, its blocks are whole cycles.
    pub(super) fn new(rows: &Rows, length_s: f64) -> Self {
        let mut of_row = Vec::with_capacity(rows.len());
        let mut count: usize = 0;
        for run in rows.runs() {
            let times = run.times_in_stretches_s();
            if let Some(cycles) = &run.cycles {
                let together = ((length_s / cycles.period_s).round() as usize).max(1);
                let here = (cycles.count / together).max(1);
                let block = |time: &f64| count + (cycles.number(*time).unwrap_or(0) / together).min(here - 1);
                of_row.extend(times.iter().map(block));
                count += here;
                continue;
            }
            let (Some(first), Some(last)) = (times.first(), times.last()) else { continue };
            let span_s = last - first;
            let here = (span_s / length_s).round() as usize;
            if here == 0 {
                count = count.max(1);
                of_row.extend(times.iter().map(|_| count - 1));
                continue;
            }
            let block =
                |time: &f64| count + ((time - first) / span_s * here as f64).min(here as f64 - 1.0) as usize;
            of_row.extend(times.iter().map(block));
            count += here;
        }
        Self { of_row, count }
    }

    /// Blocks of at least `least_s` for the test of an effect, given the `series` that is left after it is removed. They have at least 5
    /// correlation times of it, except where the motion is cyclic. There a change of the damper may grow from cycle to cycle. It stays in
    /// the series unless the effect grows likewise, so no other effect could be tested.
    pub(super) fn of_test(rows: &Rows, series: &[f64], least_s: f64) -> Self {
        match rows.runs().iter().all(|run| run.cycles.is_some()) {
            true => Self::new(rows, least_s),
            false => Self::against(rows, series, least_s),
        }
    }

    /// Blocks of at least `least_s` and at least 5 correlation times of `series`.
    pub(super) fn against(rows: &Rows, series: &[f64], least_s: f64) -> Self {
        Self::new(rows, least_s.max(CORRELATION_TIMES * correlation_time_s(rows, series)))
    }

    /// Drop of the squared error on each block from the errors `before` to those `after`.
    pub(super) fn gains(&self, before: &[f64], after: &[f64]) -> Vec<f64> {
        let [before, after] = [before, after].map(|errors| self.sums(errors, errors));
        before.iter().zip(&after).map(|(before, after)| before - after).collect()
    }

    /// Number of blocks.
    pub(super) const fn count(&self) -> usize {
        self.count
    }

    /// Block of each row.
    pub(super) fn of_row(&self) -> &[usize] {
        &self.of_row
    }

    /// Sums of the products of `a` and `b`, block by block.
    pub(super) fn sums(&self, a: &[f64], b: &[f64]) -> Vec<f64> {
        let mut sums = vec![0.0; self.count];
        for ((a, b), block) in a.iter().zip(b).zip(&self.of_row) {
            sums[*block] += a * b;
        }
        sums
    }
}

/// Integrated autocorrelation time of `series`, the longest over all runs, s. Its reciprocal is the rate of independent values.
fn correlation_time_s(rows: &Rows, series: &[f64]) -> f64 {
    let of_run = |run: &super::rows::RunRows| {
        let coarse = coarse(&run.times_in_stretches_s(), &series[run.range.clone()]);
        integrated_time(&coarse, Cutoff::FIRST_ZERO) * COARSE_S
    };
    rows.runs().iter().map(of_run).fold(0.0, f64::max)
}

/// Means of `values` over steps of [`COARSE_S`]; steps without a row are left out.
fn coarse(times_s: &[f64], values: &[f64]) -> Vec<f64> {
    let mut means = Vec::new();
    let (mut step, mut sum, mut count) = (i64::MIN, 0.0, 0_u32);
    for (time_s, value) in times_s.iter().zip(values) {
        let here = (time_s / COARSE_S) as i64;
        if here != step {
            if count > 0 {
                means.push(sum / f64::from(count));
            }
            (step, sum, count) = (here, 0.0, 0);
        }
        sum += value;
        count += 1;
    }
    if count > 0 {
        means.push(sum / f64::from(count));
    }
    means
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coarse_averages_the_rows_of_each_step() {
        // Four rows in each step, none in the third step, and a last step that ends early.
        let row = |k: usize| COARSE_S * (k as f64 + 0.5) / 4.0;
        let times: Vec<f64> = (0..8).chain(12..14).map(row).collect();
        let values: Vec<f64> = (0..10).map(|k| (k * k) as f64).collect();
        assert_eq!(coarse(&times, &values), [3.5, 31.5, 72.5]);
        assert!(coarse(&[], &[]).is_empty());
    }
}
