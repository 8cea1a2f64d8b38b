//! Sums over a model's rows, for the least-squares solver.
//!
//! ```text
//! r = LP[ f(p; row) ] + o_run - F,      dr/dp = LP[ df/dp ]
//! S = sum rho(r),   rho = r^2, or Huber's with weights from the residuals before
//! ```
//!
//! LP is the low-pass if the conditioning filters the output, otherwise the identity. The offset o of a run
//! enters linearly and affects only that run. It is eliminated by centring each run's residuals and columns,
//! so that the solver sees only the model's parameters, however many runs there are. [`Columns`] supplies f
//! and its derivatives.
//!
//! Source: `[huber]` in the bibliography (node/docs/guide/bibliography.md), for Huber's loss.

use super::Loss;
use super::dataset::{Dataset, Row};
use super::least_squares::{Normal, Problem};
use crate::condition::{ApplyTo, LowPass, LowPassState};
use crate::force::Inputs;
use crate::lanes::widest;
use crate::parallel;
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

/// Number of rows whose outer products are summed together.
const GROUP: usize = 4;
/// Rows of one unit of parallel work. Fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 2048;
/// Rows of a contiguous stretch in a sample, for models with memory: the longest with which the sample covers the drive.
const STRETCHES: [usize; 3] = [1024, 512, 256];
/// Largest number of rows at the start of a stretch that are not counted, while the model's memory fills; at most a quarter of the stretch.
const WARM_UP: usize = 128;
/// A sample covers a drive value if it has one that is not further away, as a share of the range of the drive.
const NEAR_DRIVE: f64 = 0.1;
/// Smallest share of the rows whose drive a sample covers.
const COVERED: f64 = 0.9;
/// Places of a stretch within its group differ from run to run by this share (of the golden ratio), because the drives of several runs may
/// change at the same times.
const SHIFT: f64 = 0.618;

/// A model as the solver needs it, row by row.
pub(super) trait Columns: Sync {
    /// State of the model from row to row.
    type Memory;

    /// Number of fitted parameters.
    fn parameters(&self) -> usize;
    /// True when the force of a row depends on previous rows.
    fn has_memory(&self) -> bool;
    /// Number of values of a row that do not depend on the fitted parameters.
    fn basis_len(&self) -> usize;
    /// Appends these values for a row at `drive`.
    fn push_basis(&self, drive: f64, basis: &mut Vec<f64>);
    /// True when a row with this drive can be predicted.
    fn takes(&self, drive: f64) -> bool;
    /// The parameters in the model's own units.
    fn natural(&self, parameters: &[f64]) -> Vec<f64>;
    /// Memory at rest.
    fn at_rest(&self) -> Self::Memory;
    /// Writes the derivatives of the force with respect to the fitted parameters to `columns` (zero before
    /// the call), and returns the force.
    fn row(
        &self,
        memory: &mut Self::Memory,
        inputs: &Inputs,
        basis: &[f64],
        natural: &[f64],
        columns: &mut [f64],
    ) -> f64;
}

/// The rows of one run, stored by column.
#[derive(Debug, Clone, PartialEq)]
struct Rows {
    /// Mean of the counted force, N, subtracted from `force_n` to keep sums accurate.
    mean_force_n: f64,
    displacement_m: Vec<f64>,
    velocity_m_s: Vec<f64>,
    acceleration_m_s2: Vec<f64>,
    drive: Vec<f64>,
    force_n: Vec<f64>,
    /// Result of [`Columns::push_basis`], row after row.
    basis: Vec<f64>,
    counts: Vec<bool>,
    /// Time since the previous row, s; NaN where memory restarts.
    dt_s: Vec<f64>,
    /// Square root of the weight of all rows.
    root_weight: f64,
    /// Square roots of the weights of a robust loss; empty for least squares.
    robust_roots: Vec<f64>,
}

impl Rows {
    /// No rows, of a run whose mean force and weight are known.
    fn none(mean_force_n: f64, root_weight: f64) -> Self {
        Self {
            mean_force_n,
            displacement_m: Vec::new(),
            velocity_m_s: Vec::new(),
            acceleration_m_s2: Vec::new(),
            drive: Vec::new(),
            force_n: Vec::new(),
            basis: Vec::new(),
            counts: Vec::new(),
            dt_s: Vec::new(),
            root_weight,
            robust_roots: Vec::new(),
        }
    }

    /// Square root of the weight of row `k`.
    #[inline]
    fn root(&self, k: usize) -> f64 {
        self.root_weight * self.robust_roots.get(k).copied().unwrap_or(1.0)
    }

    fn len(&self) -> usize {
        self.counts.len()
    }

    fn push(&mut self, row: &Row, force_n: f64, dt_s: f64, counts: bool, columns: &impl Columns) {
        self.displacement_m.push(row.displacement_m);
        self.velocity_m_s.push(row.velocity_m_s);
        self.acceleration_m_s2.push(row.acceleration_m_s2);
        self.drive.push(row.drive);
        self.force_n.push(force_n);
        self.dt_s.push(dt_s);
        self.counts.push(counts);
        columns.push_basis(row.drive, &mut self.basis);
    }

    fn push_of(&mut self, from: &Self, k: usize, basis_len: usize) {
        self.displacement_m.push(from.displacement_m[k]);
        self.velocity_m_s.push(from.velocity_m_s[k]);
        self.acceleration_m_s2.push(from.acceleration_m_s2[k]);
        self.drive.push(from.drive[k]);
        self.force_n.push(from.force_n[k]);
        self.dt_s.push(from.dt_s[k]);
        self.counts.push(from.counts[k]);
        self.basis.extend_from_slice(&from.basis[k * basis_len..(k + 1) * basis_len]);
    }

    #[inline]
    fn inputs(&self, k: usize) -> Inputs {
        Inputs {
            dt_s: Some(self.dt_s[k]).filter(|dt| dt.is_finite()),
            displacement_m: self.displacement_m[k],
            velocity_m_s: self.velocity_m_s[k],
            acceleration_m_s2: self.acceleration_m_s2[k],
            drive: self.drive[k],
            case_temp_c: f64::NAN,
        }
    }

    fn counted(&self) -> usize {
        self.counts.iter().filter(|c| **c).count()
    }
}

/// The rows that a model is fitted to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Training<'a> {
    /// The measured runs.
    pub(super) runs: &'a [Dataset],
    /// Rows that follow from what all dampers have in common, for the range that the runs do not show.
    pub(super) prior: Option<&'a Prior>,
}

impl<'a> From<&'a [Dataset]> for Training<'a> {
    fn from(runs: &'a [Dataset]) -> Self {
        Self { runs, prior: None }
    }
}

/// A run that was not measured.
#[derive(Debug, Clone)]
pub(super) struct Prior {
    /// Its rows.
    pub(super) run: Dataset,
    /// Weight of one of its rows, relative to a measured row.
    pub(super) weight: f64,
}

/// Measured rows, and all other data that is fixed during the search.
pub(super) struct RowProblem<'a, C: Columns> {
    columns: C,
    runs: Vec<Rows>,
    /// The low-pass on the output, if there is one.
    filter: Option<LowPass>,
    /// Whether rows are processed in parallel; off while restarts run in parallel.
    parallel: bool,
    cancel: &'a AtomicBool,
}

/// Sums over some rows of one run. The residual is stored as one more column after the `columns` of the
/// Jacobian.
struct Sums {
    count: f64,
    linear: Vec<f64>,
    /// Upper triangle of the products, row after row of a square matrix.
    products: Vec<f64>,
}

impl<'a, C: Columns> RowProblem<'a, C> {
    /// Takes the needed rows from `training`: all counted rows and, if there is memory (of the model, or of a
    /// filter on the output), also the rows between them.
    pub(super) fn new<'t>(training: impl Into<Training<'t>>, columns: C, cancel: &'a AtomicBool) -> Self {
        let Training { runs, prior } = training.into();
        let filter = runs
            .first()
            .filter(|d| d.conditioning.apply_to == ApplyTo::Output)
            .map(|d| d.conditioning.low_pass());
        let all = filter.is_some() || columns.has_memory();
        let mut runs: Vec<Rows> = parallel::map(runs, |d| gather(d, &columns, all, |row| row.force_n));
        runs.extend(prior.map(|prior| assumed(prior, &columns, 1)));
        Self { columns, runs, filter, parallel: true, cancel }
    }

    /// A smaller problem of about `target` counted rows, for the restarts. Without memory it takes one random
    /// row from each group of rows, because a fixed stride could coincide with the period of a sine; with
    /// memory it takes whole stretches, which cover the drive. A filter on the output would need all rows, so it is omitted for
    /// model and measurement alike: this hardly moves the minimum and takes a tenth of the time.
    pub(super) fn sample<'t>(
        training: impl Into<Training<'t>>,
        columns: C,
        target: usize,
        seed: u64,
        cancel: &'a AtomicBool,
    ) -> Self {
        let Training { runs: datasets, prior } = training.into();
        let stride = datasets.iter().map(Dataset::counted).sum::<usize>().div_ceil(target).max(1);
        let assumed = prior.map(|prior| assumed(prior, &columns, stride));
        let whole =
            |dataset: &Dataset| gather(dataset, &columns, columns.has_memory(), |row| row.raw_force_n);
        if columns.has_memory() {
            let runs: Vec<Rows> = parallel::map(datasets, whole);
            let mut runs = stretches(&runs, columns.basis_len(), stride);
            runs.extend(assumed);
            return Self { columns, runs, filter: None, parallel: false, cancel };
        }
        let one = |index: usize| {
            let mut random =
                Pcg64Mcg::seed_from_u64(seed ^ (index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
            let rows = whole(&datasets[index]);
            // A short run keeps enough rows to have an influence among long runs.
            let stride = stride.min((rows.len() / 200).max(1));
            pick(&rows, columns.basis_len(), stride, || random.random::<f64>())
        };
        let mut runs: Vec<Rows> = parallel::map_indices(datasets.len(), one);
        runs.extend(assumed);
        Self { columns, runs, filter: None, parallel: false, cancel }
    }

    /// The same problem with parallel sums.
    pub(super) fn in_parallel(mut self) -> Self {
        self.parallel = true;
        self
    }

    /// Number of counted rows.
    pub(super) fn counted(&self) -> usize {
        self.runs.iter().map(Rows::counted).sum()
    }

    /// Mean of the runs' NMSE (error power over force variance), each run with its best offset.
    pub(super) fn mean_esr(&self, parameters: &[f64]) -> f64 {
        let natural = self.columns.natural(parameters);
        let esr = |rows: &Rows| {
            let sums = self.sums(rows, 0..rows.len(), &natural);
            let squares: f64 =
                rows.force_n.iter().zip(&rows.counts).filter(|(_, c)| **c).map(|(f, _)| f * f).sum();
            let mean: f64 = rows.force_n.iter().zip(&rows.counts).filter(|(_, c)| **c).map(|(f, _)| *f).sum();
            let last = sums.linear.len() - 1;
            let error = sums.products[last * (last + 2)] - sums.linear[last].powi(2) / sums.count.max(1.0);
            error / (squares - mean * mean / sums.count.max(1.0)).max(f64::MIN_POSITIVE)
        };
        let each: Vec<f64> = parallel::map(&self.runs, esr);
        each.iter().sum::<f64>() / each.len().max(1) as f64
    }

    /// The cost at `parameters`, each run with its best offset; `None` if the work was cancelled.
    pub(super) fn cost(&self, parameters: &[f64], loss: Loss) -> Option<f64> {
        let natural = self.columns.natural(parameters);
        let last = self.columns.parameters();
        let mut residuals = Vec::new();
        let mut cost = 0.0;
        for rows in &self.runs {
            if self.cancel.load(Ordering::Relaxed) {
                return None;
            }
            residuals.clear();
            self.each(rows, 0..rows.len(), &natural, |_, row| residuals.push(row[last]));
            let centre = loss.centre(&residuals);
            cost += residuals.iter().map(|residual| loss.of(residual - centre)).sum::<f64>();
        }
        Some(cost)
    }

    /// Mean residual (measured minus model) of each run's counted rows, N: the best-fitting offset.
    pub(super) fn offsets_n(&self, parameters: &[f64]) -> Vec<f64> {
        let natural = self.columns.natural(parameters);
        let last = self.columns.parameters();
        let offset = |rows: &Rows| {
            let sums = self.sums(rows, 0..rows.len(), &natural);
            rows.mean_force_n - sums.linear[last] / sums.count.max(1.0)
        };
        parallel::map(&self.runs, offset)
    }

    /// Calls `take` for each counted row with its columns, followed by the residual (model minus measured).
    fn each(&self, rows: &Rows, range: Range<usize>, natural: &[f64], mut take: impl FnMut(usize, &[f64])) {
        let width = self.columns.parameters() + 1;
        let basis_len = self.columns.basis_len();
        let mut memory = self.columns.at_rest();
        let mut filters = vec![LowPassState::default(); if self.filter.is_some() { width } else { 0 }];
        let mut row = vec![0.0; width];
        let mut fresh = true;
        for k in range {
            row.fill(0.0);
            let basis = &rows.basis[k * basis_len..(k + 1) * basis_len];
            if rows.dt_s[k].is_nan() && self.columns.has_memory() {
                memory = self.columns.at_rest();
            }
            let columns = &mut row[..width - 1];
            row[width - 1] = self.columns.row(&mut memory, &rows.inputs(k), basis, natural, columns);
            fresh |= rows.dt_s[k].is_nan();
            // A law with acceleration has no force at the first row; the filter must not store a non-finite
            // value.
            if let Some(filter) = self.filter.as_ref().filter(|_| row.iter().all(|value| value.is_finite())) {
                let dt_s = Some(rows.dt_s[k]).filter(|_| !std::mem::take(&mut fresh));
                for (state, value) in filters.iter_mut().zip(row.iter_mut()) {
                    *value = filter.step(state, dt_s, *value);
                }
            }
            row[width - 1] -= rows.force_n[k];
            if rows.counts[k] {
                take(k, &row);
            }
        }
    }

    /// Sums over rows `range` of one run.
    fn sums(&self, rows: &Rows, range: Range<usize>, natural: &[f64]) -> Sums {
        let width = self.columns.parameters() + 1;
        let mut sums = Sums { count: 0.0, linear: vec![0.0; width], products: vec![0.0; width * width] };
        let mut group = vec![0.0; GROUP * width];
        let mut roots = [0.0; GROUP];
        let mut filled = 0;
        self.each(rows, range, natural, |k, row| {
            let root = rows.root(k);
            let slot = &mut group[filled * width..(filled + 1) * width];
            slot.iter_mut().zip(row).for_each(|(slot, value)| *slot = root * value);
            roots[filled] = root;
            filled += 1;
            sums.count += root * root;
            if filled == GROUP {
                sums.add(&group, roots);
                filled = 0;
            }
        });
        group[filled * width..].fill(0.0);
        sums.add(&group, roots);
        sums
    }

    /// The runs, divided into units of parallel work.
    fn work(&self) -> Vec<(usize, Range<usize>)> {
        // With memory a run is one unit; otherwise it may be divided anywhere.
        let whole = self.filter.is_some() || self.columns.has_memory();
        let chunk = if whole { usize::MAX } else { CHUNK };
        let cut = |(index, rows): (usize, &Rows)| {
            let len = rows.len();
            (0..len).step_by(chunk).map(move |from| (index, from..from.saturating_add(chunk).min(len)))
        };
        self.runs.iter().enumerate().flat_map(cut).collect()
    }

    /// Sets the weights of rows by Huber's loss at `parameters`: weight 1 for residuals within `threshold_n`,
    /// and inversely proportional to the residual beyond it.
    pub(super) fn weigh(&mut self, parameters: &[f64], threshold_n: f64) {
        let natural = self.columns.natural(parameters);
        let offsets = self.offsets_n(parameters);
        let weights: Vec<Vec<f64>> = parallel::map_indices(self.runs.len(), |run| {
            let (rows, offset_n) = (&self.runs[run], offsets[run]);
            let mut roots = vec![1.0; rows.len()];
            self.each(rows, 0..rows.len(), &natural, |k, row| {
                let residual = (row[row.len() - 1] + offset_n - rows.mean_force_n).abs();
                roots[k] = (threshold_n / residual).min(1.0).sqrt();
            });
            roots
        });
        for (rows, roots) in self.runs.iter_mut().zip(weights) {
            rows.robust_roots = roots;
        }
    }

    /// Sum of the outer products of each block's gradient, over blocks of `block_s` seconds. It measures the
    /// scatter of correlated residuals.
    pub(super) fn gradient_scatter(&self, parameters: &[f64], block_s: f64) -> DMatrix<f64> {
        let natural = self.columns.natural(parameters);
        let n = self.columns.parameters();
        let scatter = |rows: &Rows| {
            let sums = self.sums(rows, 0..rows.len(), &natural);
            let mean: Vec<f64> = sums.linear.iter().map(|s| s / sums.count.max(1.0)).collect();
            let (mut block, mut since_s) = (DVector::zeros(n), 0.0);
            let mut scatter = DMatrix::zeros(n, n);
            self.each(rows, 0..rows.len(), &natural, |k, row| {
                let weight = rows.root(k).powi(2);
                let residual = weight * (row[n] - mean[n]);
                for ((sum, value), mean) in block.iter_mut().zip(row).zip(&mean) {
                    *sum += residual * (value - mean);
                }
                since_s += if rows.dt_s[k].is_finite() { rows.dt_s[k] } else { 0.0 };
                if since_s >= block_s {
                    scatter.ger(1.0, &block, &block, 1.0);
                    block.fill(0.0);
                    since_s = 0.0;
                }
            });
            scatter.ger(1.0, &block, &block, 1.0);
            scatter
        };
        let each: Vec<DMatrix<f64>> = parallel::map(&self.runs, scatter);
        each.iter().fold(DMatrix::zeros(n, n), |sum, run| sum + run)
    }
}

impl<C: Columns> Problem for RowProblem<'_, C> {
    fn normal(&self, parameters: &[f64]) -> Option<Normal> {
        let natural = self.columns.natural(parameters);
        let one = |(index, range): &(usize, Range<usize>)| {
            if self.cancel.load(Ordering::Relaxed) {
                return None;
            }
            Some((*index, self.sums(&self.runs[*index], range.clone(), &natural)))
        };
        let work = self.work();
        let parts: Option<Vec<(usize, Sums)>> = if self.parallel {
            parallel::map(&work, one).into_iter().collect()
        } else {
            work.iter().map(one).collect()
        };
        Some(centred(&parts?, self.columns.parameters()))
    }
}

/// Adds the parts of each run, removes the run's means (which eliminates its offset), and adds the runs.
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
    /// Adds the products of a group of rows that are scaled by `roots`; unused rows of the group are zero.
    #[inline]
    fn add(&mut self, group: &[f64], roots: [f64; GROUP]) {
        let width = self.linear.len();
        let (r0, rest) = group.split_at(width);
        let (r1, rest) = rest.split_at(width);
        let (r2, r3) = rest.split_at(width);
        widest(
            #[inline(always)]
            || {
                for i in 0..width {
                    let (a, b, c, d) = (r0[i], r1[i], r2[i], r3[i]);
                    // Sets far from the drive of these rows have zero columns.
                    if a == 0.0 && b == 0.0 && c == 0.0 && d == 0.0 {
                        continue;
                    }
                    self.linear[i] += (roots[0] * a + roots[1] * b) + (roots[2] * c + roots[3] * d);
                    let products = &mut self.products[i * width + i..(i + 1) * width];
                    let columns = r0[i..].iter().zip(&r1[i..]).zip(&r2[i..]).zip(&r3[i..]);
                    for (product, (((w, x), y), z)) in products.iter_mut().zip(columns) {
                        *product += (a * w + b * x) + (c * y + d * z);
                    }
                }
            },
        );
    }
}

/// All rows of `prior`, for a problem that has one in `stride` of the measured rows.
fn assumed(prior: &Prior, columns: &impl Columns, stride: usize) -> Rows {
    let rows = gather(&prior.run, columns, true, |row| row.force_n);
    Rows { root_weight: (prior.weight / stride as f64).sqrt(), ..rows }
}

/// The needed rows of a dataset, with `force` as the measured value: the counted rows or, with `all`, every
/// row that can be predicted.
fn gather(dataset: &Dataset, columns: &impl Columns, all: bool, force: fn(&Row) -> f64) -> Rows {
    let counted = || dataset.rows.iter().filter(|row| row.counts && columns.takes(row.drive));
    let mean = counted().map(force).sum::<f64>() / counted().count().max(1) as f64;
    let mut rows = Rows::none(mean, 1.0);
    let mut broken = true;
    let mut since_s = 0.0;
    for row in &dataset.rows {
        broken |= row.dt_s.is_none();
        since_s += row.dt_s.unwrap_or(0.0);
        // As in the pipeline, memory skips rows that the model cannot predict.
        if !columns.takes(row.drive) || !(all || row.counts) {
            continue;
        }
        let dt_s = if broken { f64::NAN } else { since_s };
        rows.push(row, force(row) - mean, dt_s, row.counts, columns);
        (broken, since_s) = (false, 0.0);
    }
    rows
}

/// One row of every `stride`, at the position that `random` (in [0, 1)) gives.
fn pick(rows: &Rows, basis_len: usize, stride: usize, mut random: impl FnMut() -> f64) -> Rows {
    let mut picked = Rows::none(rows.mean_force_n, rows.root_weight);
    let len = rows.len();
    for from in (0..len).step_by(stride) {
        let k = from + (random() * stride.min(len - from) as f64) as usize;
        picked.push_of(rows, k, basis_len);
    }
    picked
}

/// Stretches of each run, as long as they cover the drive: of a drive that is held for seconds, a few long stretches may show one level.
fn stretches(runs: &[Rows], basis_len: usize, stride: usize) -> Vec<Rows> {
    let of_length = |length: usize| -> Vec<Rows> {
        let of_run = |(run, rows): (usize, &Rows)| {
            let place = if length == STRETCHES[0] { 0.5 } else { (0.5 + SHIFT * run as f64).fract() };
            stretches_of(rows, basis_len, stride, length, place)
        };
        runs.iter().enumerate().map(of_run).collect()
    };
    let [longest, shorter @ ..] = STRETCHES;
    let mut sample = of_length(longest);
    for length in shorter {
        if covers_drive(&sample, runs) {
            break;
        }
        sample = of_length(length);
    }
    sample
}

/// True if nearly all rows of `runs` have a drive that a counted row of `sample` has, too.
fn covers_drive(sample: &[Rows], runs: &[Rows]) -> bool {
    let drives = |runs: &[Rows]| -> Vec<f64> {
        let counted = runs.iter().flat_map(|rows| rows.drive.iter().zip(&rows.counts));
        counted.filter(|(drive, counts)| **counts && drive.is_finite()).map(|(drive, _)| *drive).collect()
    };
    let (mut known, all) = (drives(sample), drives(runs));
    known.sort_by(f64::total_cmp);
    let [low, high] = all
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], drive| [low.min(*drive), high.max(*drive)]);
    let near = NEAR_DRIVE * (high - low);
    let is_covered = |drive: &&f64| {
        let next = known.partition_point(|one| one < *drive);
        let neighbours = [next.checked_sub(1), Some(next)].into_iter().flatten();
        neighbours.filter_map(|k| known.get(k)).any(|one| (one - **drive).abs() <= near)
    };
    all.iter().filter(is_covered).count() as f64 >= COVERED * all.len() as f64
}

/// One stretch of `length` rows from each group of `stride` stretches, at `place`: 0 is the beginning of the group and 1 its end. The
/// first rows of a stretch fill the memory and are not counted.
fn stretches_of(rows: &Rows, basis_len: usize, stride: usize, length: usize, place: f64) -> Rows {
    let warm_up = WARM_UP.min(length / 4);
    let mut picked = Rows::none(rows.mean_force_n, rows.root_weight);
    for from in (0..rows.len()).step_by(length * stride) {
        let group = (length * stride).min(rows.len() - from);
        let begin = from + ((group - length.min(group)) as f64 * place) as usize;
        for k in begin..begin + length.min(group) {
            picked.push_of(rows, k, basis_len);
            let last = picked.len() - 1;
            if stride > 1 {
                picked.counts[last] &= k - begin >= warm_up;
            }
            if k == begin {
                picked.dt_s[last] = f64::NAN;
            }
        }
    }
    picked
}

#[cfg(test)]
mod tests;
