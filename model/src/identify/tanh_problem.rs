//! The fuzzy-tanh model's sums over rows, for the least-squares solver.
//!
//! ```text
//! r   = LP[ sum_j w_j (A1_j t_j + A2_j u_j) ] + o_run - F,      t = tanh(A3 u),  u = v + kappa x
//! dr/dA1 = LP[ w t ]      dr/d ln A3 = LP[ w A1 A3 u (1 - t^2) ]
//! dr/dA2 = LP[ w u ]      dr/d kappa = LP[ w (A1 A3 (1 - t^2) + A2) x ]
//! ```
//!
//! LP is the low-pass when the conditioning filters the output, else nothing. The offset o of a run is linear
//! and belongs to no other run: it is eliminated by centring each run's residuals and columns, so that the
//! solver sees four parameters a function, however many runs there are. Weights w do not depend on what is
//! sought and are computed once. A3 enters by its logarithm: it is positive, and steps in it are ratios.

use super::dataset::{Dataset, Row};
use super::least_squares::{Normal, Problem};
use super::levels::Memberships;
use crate::condition::{ApplyTo, LowPass, LowPassState};
use crate::error::Error;
use crate::force::FuzzySets;
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};

/// Parameters of one function: A1, A2, ln A3, kappa.
pub(super) const PER_FUNCTION: usize = 4;
/// Rows whose outer products are summed at once.
const GROUP: usize = 4;
/// Rows of one unit of parallel work. Fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 2048;
/// Weights below this share add less than any load cell resolves and are taken as zero.
const LEAST_WEIGHT: f64 = 1e-7;

/// The rows of one run, column by column.
#[derive(Debug, Clone, Default, PartialEq)]
struct Rows {
    /// Mean of the force that counts, N, taken out of `force_n` so that sums keep their digits.
    mean_force_n: f64,
    displacement_m: Vec<f64>,
    velocity_m_s: Vec<f64>,
    force_n: Vec<f64>,
    /// Weights of the functions, row after row.
    weights: Vec<f64>,
    counts: Vec<bool>,
    /// Step since the row before; NaN where the filter starts anew. Only used with a filtered output.
    dt_s: Vec<f64>,
}

impl Rows {
    fn push(&mut self, row: [f64; 4], counts: bool, weights: &[f64]) {
        self.displacement_m.push(row[0]);
        self.velocity_m_s.push(row[1]);
        self.force_n.push(row[2]);
        self.dt_s.push(row[3]);
        self.counts.push(counts);
        self.weights.extend_from_slice(weights);
    }
}

/// Measured rows and all that is fixed while the parameters are sought.
pub(super) struct TanhProblem<'a> {
    runs: Vec<Rows>,
    functions: usize,
    /// The low-pass on the output, where there is one.
    filter: Option<LowPass>,
    /// Rows in parallel; off while restarts are.
    parallel: bool,
    cancel: &'a AtomicBool,
}

/// Sums over some rows of one run. `columns` of the Jacobian, and the residual as one more column behind
/// them.
struct Sums {
    count: f64,
    linear: Vec<f64>,
    /// Upper triangle of the products, row after row of a square matrix.
    products: Vec<f64>,
}

impl<'a> TanhProblem<'a> {
    /// Takes the rows that matter from `datasets`: all that count, and with a filtered output all others too,
    /// because its memory runs through them.
    pub(super) fn new(
        datasets: &[Dataset],
        memberships: &Memberships,
        cancel: &'a AtomicBool,
    ) -> Result<Self, Error> {
        let filter = datasets
            .first()
            .filter(|d| d.conditioning.apply_to == ApplyTo::Output)
            .map(|d| d.conditioning.low_pass());
        let sets = memberships.sets()?;
        let runs =
            datasets.par_iter().map(|d| gather(d, &sets, filter.is_some(), |row| row.force_n)).collect();
        Ok(Self { runs, functions: memberships.centres.len(), filter, parallel: true, cancel })
    }

    /// A smaller problem of about `target` counted rows, for the restarts: one row at random from every so
    /// many, because a fixed stride could fall in step with a sine. A filter on the output, whose memory
    /// needs all rows, is left out on both sides, model and measurement: that moves the minimum little and
    /// costs a tenth.
    pub(super) fn sample(
        datasets: &[Dataset],
        memberships: &Memberships,
        target: usize,
        seed: u64,
        cancel: &'a AtomicBool,
    ) -> Result<Self, Error> {
        let sets = memberships.sets()?;
        let functions = memberships.centres.len();
        let stride = datasets.iter().map(Dataset::counted).sum::<usize>().div_ceil(target).max(1);
        let one = |(index, dataset): (usize, &Dataset)| {
            let mut random =
                Pcg64Mcg::seed_from_u64(seed ^ (index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
            let rows = gather(dataset, &sets, false, |row| row.raw_force_n);
            // A short run among long ones keeps enough rows to have its say.
            let stride = stride.min((rows.counts.len() / 200).max(1));
            pick(&rows, functions, stride, || random.random::<f64>())
        };
        let runs = datasets.par_iter().enumerate().map(one).collect();
        Ok(Self { runs, functions, filter: None, parallel: false, cancel })
    }

    /// Rows that count.
    pub(super) fn counted(&self) -> usize {
        self.runs.iter().map(|rows| rows.counts.iter().filter(|c| **c).count()).sum()
    }

    /// Rows that count in each set's favour: sums of their weights.
    pub(super) fn support(&self) -> Vec<f64> {
        let mut support = vec![0.0; self.functions];
        for rows in &self.runs {
            for (weights, _) in rows.weights.chunks(self.functions).zip(&rows.counts).filter(|(_, c)| **c) {
                support.iter_mut().zip(weights).for_each(|(s, w)| *s += w);
            }
        }
        support
    }

    /// Mean over the runs of error power over force variance, each run with its best offset.
    pub(super) fn mean_esr(&self, parameters: &[f64]) -> f64 {
        let parameters = natural(parameters);
        let esr = |rows: &Rows| {
            let sums = self.sums(rows, 0..rows.counts.len(), &parameters);
            let squares: f64 =
                rows.force_n.iter().zip(&rows.counts).filter(|(_, c)| **c).map(|(f, _)| f * f).sum();
            let mean: f64 = rows.force_n.iter().zip(&rows.counts).filter(|(_, c)| **c).map(|(f, _)| *f).sum();
            let last = sums.linear.len() - 1;
            let error = sums.products[last * (last + 2)] - sums.linear[last].powi(2) / sums.count.max(1.0);
            error / (squares - mean * mean / sums.count.max(1.0)).max(f64::MIN_POSITIVE)
        };
        let each: Vec<f64> = self.runs.par_iter().map(esr).collect();
        each.iter().sum::<f64>() / each.len().max(1) as f64
    }

    /// Sums over the rows `range` of one run.
    fn sums(&self, rows: &Rows, range: std::ops::Range<usize>, parameters: &[f64]) -> Sums {
        let width = PER_FUNCTION * self.functions + 1;
        let mut sums = Sums { count: 0.0, linear: vec![0.0; width], products: vec![0.0; width * width] };
        let mut filters = vec![LowPassState::default(); if self.filter.is_some() { width } else { 0 }];
        let mut group = vec![0.0; GROUP * width];
        let mut filled = 0;
        for k in range {
            let columns = &mut group[filled * width..(filled + 1) * width];
            columns.fill(0.0);
            let force = self.columns(rows, k, parameters, columns);
            if let Some(filter) = &self.filter {
                // The last slot holds the model's force until the measured one is taken off.
                columns[width - 1] = force;
                let dt_s = Some(rows.dt_s[k]).filter(|dt| dt.is_finite());
                for (state, value) in filters.iter_mut().zip(columns.iter_mut()) {
                    *value = filter.step(state, dt_s, *value);
                }
                columns[width - 1] -= rows.force_n[k];
            } else {
                columns[width - 1] = force - rows.force_n[k];
            }
            if !rows.counts[k] {
                continue;
            }
            filled += 1;
            sums.count += 1.0;
            if filled == GROUP {
                sums.add(&group);
                filled = 0;
            }
        }
        group[filled * width..].fill(0.0);
        sums.add(&group);
        sums
    }

    /// Writes the Jacobian's columns of row `k` and returns the model's force.
    #[inline]
    fn columns(&self, rows: &Rows, k: usize, parameters: &[f64], columns: &mut [f64]) -> f64 {
        let (x, v) = (rows.displacement_m[k], rows.velocity_m_s[k]);
        let weights = &rows.weights[k * self.functions..(k + 1) * self.functions];
        let mut force = 0.0;
        let functions = columns.chunks_exact_mut(PER_FUNCTION).zip(parameters.chunks_exact(PER_FUNCTION));
        for ((column, p), &w) in functions.zip(weights) {
            if w == 0.0 {
                continue;
            }
            let (a1, a2, a3, kappa) = (p[0], p[1], p[2], p[3]);
            let u = v + kappa * x;
            let t = tanh(a3 * u);
            let slope = a1 * a3 * (1.0 - t * t);
            force += w * (a1 * t + a2 * u);
            column[0] = w * t;
            column[1] = w * u;
            column[2] = w * slope * u;
            column[3] = w * (slope + a2) * x;
        }
        force
    }

    /// Mean residual (measured less model) of each run's counted rows, N: the offset that fits best.
    pub(super) fn offsets_n(&self, parameters: &[f64]) -> Vec<f64> {
        let parameters = natural(parameters);
        let width = PER_FUNCTION * self.functions + 1;
        let offset = |rows: &Rows| {
            let sums = self.sums(rows, 0..rows.counts.len(), &parameters);
            rows.mean_force_n - sums.linear[width - 1] / sums.count.max(1.0)
        };
        self.runs.par_iter().map(offset).collect()
    }
}

impl Problem for TanhProblem<'_> {
    fn normal(&self, parameters: &[f64]) -> Option<Normal> {
        let parameters = natural(parameters);
        // A filter's memory runs through a whole run; else a run may be cut anywhere.
        let chunk = if self.filter.is_some() { usize::MAX } else { CHUNK };
        let mut work: Vec<(usize, std::ops::Range<usize>)> = Vec::new();
        for (index, rows) in self.runs.iter().enumerate() {
            let len = rows.counts.len();
            work.extend(
                (0..len).step_by(chunk).map(|from| (index, from..from.saturating_add(chunk).min(len))),
            );
        }
        let one = |(index, range): &(usize, std::ops::Range<usize>)| {
            if self.cancel.load(Ordering::Relaxed) {
                return None;
            }
            Some((*index, self.sums(&self.runs[*index], range.clone(), &parameters)))
        };
        let parts: Option<Vec<(usize, Sums)>> =
            if self.parallel { work.par_iter().map(one).collect() } else { work.iter().map(one).collect() };
        Some(centred(&parts?, PER_FUNCTION * self.functions))
    }
}

/// Adds up the parts run by run, takes each run's means out (which eliminates its offset), and adds up the
/// runs.
fn centred(parts: &[(usize, Sums)], n: usize) -> Normal {
    let width = n + 1;
    let mut normal = Normal { cost: 0.0, square: DMatrix::zeros(n, n), gradient: DVector::zeros(n) };
    for run in parts.chunk_by(|a, b| a.0 == b.0) {
        let count: f64 = run.iter().map(|(_, sums)| sums.count).sum();
        if count == 0.0 {
            continue;
        }
        let total = |get: &dyn Fn(&Sums) -> f64| run.iter().map(|(_, sums)| get(sums)).sum::<f64>();
        let linear: Vec<f64> = (0..width).map(|i| total(&|s| s.linear[i])).collect();
        for i in 0..width {
            for j in i..width {
                let value = total(&|s| s.products[i * width + j]) - linear[i] * linear[j] / count;
                match (i == n, j == n) {
                    (true, _) => normal.cost += value,
                    (false, true) => normal.gradient[i] += value,
                    (false, false) => normal.square[(j, i)] += value,
                }
            }
        }
    }
    normal.square.fill_upper_triangle_with_lower_triangle();
    normal
}

impl Sums {
    /// Adds the products of a group of rows; unused rows of the group are zero.
    #[inline]
    fn add(&mut self, group: &[f64]) {
        let width = self.linear.len();
        let (r0, rest) = group.split_at(width);
        let (r1, rest) = rest.split_at(width);
        let (r2, r3) = rest.split_at(width);
        for i in 0..width {
            let (a, b, c, d) = (r0[i], r1[i], r2[i], r3[i]);
            // Sets far from the drive of these rows have nothing but zeros.
            if a == 0.0 && b == 0.0 && c == 0.0 && d == 0.0 {
                continue;
            }
            self.linear[i] += (a + b) + (c + d);
            let products = &mut self.products[i * width + i..(i + 1) * width];
            let columns = r0[i..].iter().zip(&r1[i..]).zip(&r2[i..]).zip(&r3[i..]);
            for (product, (((w, x), y), z)) in products.iter_mut().zip(columns) {
                *product += (a * w + b * x) + (c * y + d * z);
            }
        }
    }
}

/// Parameters as the model has them: A3 in place of its logarithm.
fn natural(parameters: &[f64]) -> Vec<f64> {
    let value = |(j, p): (usize, &f64)| if j % PER_FUNCTION == 2 { p.exp() } else { *p };
    parameters.iter().enumerate().map(value).collect()
}

/// tanh by one exponential: a third of the library's time, and within 2e-16 of it.
#[inline]
fn tanh(z: f64) -> f64 {
    1.0 - 2.0 / ((2.0 * z).exp() + 1.0)
}

/// The rows of a dataset that matter, with `force` as what is measured. Without a filter those are the ones
/// that count.
fn gather(dataset: &Dataset, sets: &FuzzySets, filtered: bool, force: fn(&Row) -> f64) -> Rows {
    let counted = || dataset.rows.iter().filter(|row| row.counts);
    let mean = counted().map(force).sum::<f64>() / counted().count().max(1) as f64;
    let mut rows = Rows { mean_force_n: mean, ..Rows::default() };
    let mut broken = true;
    let mut since_s = 0.0;
    for row in &dataset.rows {
        broken |= row.dt_s.is_none();
        since_s += row.dt_s.unwrap_or(0.0);
        // Like the pipeline, the filter skips what the model cannot predict.
        if !row.drive.is_finite() || !(filtered || row.counts) {
            continue;
        }
        let mut weights = sets.weights(row.drive);
        weights.iter_mut().for_each(|w| *w = if *w < LEAST_WEIGHT { 0.0 } else { *w });
        let dt_s = if broken { f64::NAN } else { since_s };
        let force_n = force(row) - mean;
        rows.push([row.displacement_m, row.velocity_m_s, force_n, dt_s], row.counts, &weights[..sets.len()]);
        (broken, since_s) = (false, 0.0);
    }
    rows
}

/// One row of every `stride`, chosen by `random` from [0, 1).
fn pick(rows: &Rows, functions: usize, stride: usize, mut random: impl FnMut() -> f64) -> Rows {
    let mut picked = Rows { mean_force_n: rows.mean_force_n, ..Rows::default() };
    let len = rows.counts.len();
    for from in (0..len).step_by(stride) {
        let k = from + (random() * stride.min(len - from) as f64) as usize;
        let row = [rows.displacement_m[k], rows.velocity_m_s[k], rows.force_n[k], rows.dt_s[k]];
        picked.push(row, rows.counts[k], &rows.weights[k * functions..(k + 1) * functions]);
    }
    picked
}

#[cfg(test)]
mod tests;
