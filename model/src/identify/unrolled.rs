//! Runs as input of an autoregressive network, and the least squares of its errors several steps ahead.
//!
//! ```text
//! y_k = f(u_k, y_{k-1} .. y_{k-r}; w),   y = measured F before the window, the network's own output inside it
//! dy_k/dw = df/dw + sum_j df/dy_{k-j} dy_{k-j}/dw
//! ```
//!
//! A window of one row is the one-step-ahead predictor. In a longer window the network is simulated (free
//! run) from measured force, and its derivatives are propagated with it. Windows are short enough to limit
//! the growth of derivatives while a network is still unstable.

use super::dataset::Dataset;
use super::least_squares::{Normal, Problem};
use crate::force::{DEPTH, MAX_NETWORK_INPUTS, Network};
use crate::lanes::widest;
use crate::parallel;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

/// Largest relative difference between a step and the period (jitter); a larger one means a lost sample.
const STEP_TOLERANCE: f64 = 0.25;
/// Number of rows of the Jacobian that are multiplied together.
const PANEL: usize = 256;
/// Number of columns of J'J that are computed together.
const BLOCK: usize = 64;
/// Number of partial sums of the normal equations, computed in parallel. It is fixed, so that sums do not
/// depend on the number of threads.
const CHUNKS: usize = 4;
/// Number of rows before the first row that a network can predict.
const LEAD: usize = DEPTH;

/// Normalised rows without a gap.
#[derive(Debug)]
struct Segment {
    /// Index of its dataset.
    run: usize,
    /// Inputs without force, row by row in the network's order; the first row is the first one after the
    /// lead.
    given: Vec<f64>,
    /// Measured force minus the run's offset, including the lead.
    force: Vec<f64>,
    /// Whether each row is counted, without the lead.
    counts: Vec<bool>,
    /// Whether each row is held back from training, without the lead.
    held_back: Vec<bool>,
}

/// All rows, and their division into training and held-back stretches.
#[derive(Debug)]
pub(super) struct Table {
    /// Network whose normalisation the rows have; its weights are not used.
    pub(super) network: Network,
    segments: Vec<Segment>,
    /// Stretches for training.
    training: Vec<Stretch>,
}

/// A range of rows in a segment, numbered from the end of the lead.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stretch {
    segment: usize,
    rows: Range<usize>,
}

impl Stretch {
    /// Number of rows.
    pub(super) fn len(&self) -> usize {
        self.rows.len()
    }
}

impl Segment {
    fn len(&self) -> usize {
        self.counts.len()
    }

    /// The inputs of row `k` with the force lags in `forces` (newest first).
    #[inline]
    fn inputs(&self, k: usize, forces: &[f64], into: &mut [f64; MAX_NETWORK_INPUTS]) {
        let width = self.given.len() / self.len();
        into[..width].copy_from_slice(&self.given[k * width..(k + 1) * width]);
        into[width..width + forces.len()].copy_from_slice(forces);
    }

    /// The measured forces before row `k`, newest first.
    fn forces_before(&self, k: usize) -> [f64; DEPTH] {
        std::array::from_fn(|j| self.force[LEAD + k - 1 - j])
    }

    fn measured(&self, k: usize) -> f64 {
        self.force[LEAD + k]
    }
}

impl Table {
    /// The rows of `datasets`, with the normalisation of `network`. Every fifth stretch of `stretch` rows is
    /// held back.
    pub(super) fn new(datasets: &[Dataset], network: &Network, offsets_n: &[f64], stretch: usize) -> Self {
        let mut segments = Vec::new();
        for (run, dataset) in datasets.iter().enumerate() {
            gather(run, dataset, network, offsets_n[run], &mut segments);
        }
        let (mut training, mut count) = (Vec::new(), 0);
        for (segment, rows) in segments.iter_mut().enumerate() {
            let mut from = 0;
            while from < rows.len() {
                // A short remainder is added to the last stretch.
                let end = if rows.len() - from < 2 * stretch { rows.len() } else { from + stretch };
                if count % 5 == 3 {
                    rows.held_back[from..end].fill(true);
                } else {
                    training.push(Stretch { segment, rows: from..end });
                }
                (from, count) = (end, count + 1);
            }
        }
        Self { network: *network, segments, training }
    }

    /// Numbers of counted rows: for training, and held back.
    pub(super) fn counted(&self) -> [usize; 2] {
        let mut counted = [0; 2];
        for segment in &self.segments {
            for (_, held_back) in segment.counts.iter().zip(&segment.held_back).filter(|(counts, _)| **counts)
            {
                counted[usize::from(*held_back)] += 1;
            }
        }
        counted
    }

    /// The training stretches, divided into windows of `horizon` rows.
    pub(super) fn windows(&self, horizon: usize) -> Vec<Stretch> {
        let mut windows = Vec::new();
        for stretch in &self.training {
            for from in stretch.rows.clone().step_by(horizon) {
                let rows = from..(from + horizon).min(stretch.rows.end);
                if self.segments[stretch.segment].counts[rows.clone()].iter().any(|c| *c) {
                    windows.push(Stretch { segment: stretch.segment, rows });
                }
            }
        }
        windows
    }

    /// Calls `take` for each row of `stretch` with the inputs without force, the previous measured forces
    /// (newest first), the measured force, and whether the row is counted.
    #[cfg(test)]
    pub(super) fn rows(&self, stretch: &Stretch, mut take: impl FnMut(&[f64], [f64; DEPTH], f64, bool)) {
        let segment = &self.segments[stretch.segment];
        let width = segment.given.len() / segment.len();
        for k in stretch.rows.clone() {
            let given = &segment.given[k * width..][..width];
            take(given, segment.forces_before(k), segment.measured(k), segment.counts[k]);
        }
    }

    /// Simulates `network` (free run) over all rows, starting from rest as in live use, and calls `take` for
    /// each counted row.
    pub(super) fn free_run(&self, network: &Network, mut take: impl FnMut(FreeRow)) {
        let force_lags = network.structure().force_lags();
        let mut inputs = [0.0; MAX_NETWORK_INPUTS];
        for segment in &self.segments {
            let mut forces = [0.0; DEPTH];
            for k in 0..segment.len() {
                segment.inputs(k, &forces[..force_lags], &mut inputs);
                let predicted = widest(
                    #[inline(always)]
                    || network.forward(&inputs[..network.inputs()]),
                );
                forces.copy_within(..DEPTH - 1, 1);
                forces[0] = predicted;
                if segment.counts[k] {
                    let (measured, held_back) = (segment.measured(k), segment.held_back[k]);
                    take(FreeRow { run: segment.run, held_back, measured, predicted });
                }
            }
        }
    }

    /// The runs' offsets, N, after the mean error of each run's simulation is added.
    pub(super) fn corrected_offsets_n(&self, network: &Network, offsets_n: &[f64]) -> Vec<f64> {
        let mut errors = vec![(0.0, 0.0); offsets_n.len()];
        self.free_run(network, |row| {
            errors[row.run].0 += row.measured - row.predicted;
            errors[row.run].1 += 1.0;
        });
        let deviation_n = network.scaling().force_deviation_n;
        let corrected = |(offset_n, (sum, count)): (&f64, &(f64, f64))| {
            // The error of a diverged simulation says nothing about the offset.
            let mean: f64 = sum / count;
            if mean.abs() < 1.0 { offset_n + deviation_n * mean } else { *offset_n }
        };
        offsets_n.iter().zip(&errors).map(corrected).collect()
    }

    /// Mean squared error of the simulation over the held-back rows; infinite if it is not finite.
    pub(super) fn held_back_error(&self, network: &Network) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        self.free_run(network, |row| {
            if row.held_back {
                sum += (row.measured - row.predicted).powi(2);
                count += 1.0;
            }
        });
        let mean: f64 = sum / count;
        if mean.is_finite() { mean } else { f64::INFINITY }
    }
}

/// A row of a simulation; forces are normalised.
#[derive(Debug, Clone, Copy)]
pub(super) struct FreeRow {
    /// Index of its dataset.
    pub(super) run: usize,
    pub(super) held_back: bool,
    pub(super) measured: f64,
    pub(super) predicted: f64,
}

/// Adds the segments of `dataset` to `segments`.
fn gather(run: usize, dataset: &Dataset, network: &Network, offset_n: f64, segments: &mut Vec<Segment>) {
    let scaling = network.scaling();
    let lags = network.structure().input_lags();
    let period_s = network.sample_period().get();
    let known = |row: &super::Row| {
        row.force_n.is_finite()
            && row.displacement_m.is_finite()
            && row.velocity_m_s.is_finite()
            && (scaling.drive.is_none() || row.drive.is_finite())
    };
    let follows = |row: &super::Row| row.dt_s.is_some_and(|dt| (dt / period_s - 1.0).abs() <= STEP_TOLERANCE);
    let mut from = 0;
    while from < dataset.rows.len() {
        if !known(&dataset.rows[from]) {
            from += 1;
            continue;
        }
        let more = dataset.rows[from + 1..].iter().take_while(|row| known(row) && follows(row)).count();
        let rows = &dataset.rows[from..=from + more];
        from += more + 1;
        if rows.len() <= LEAD || !rows[LEAD..].iter().any(|row| row.counts) {
            continue;
        }
        let mut given = Vec::new();
        for k in LEAD..rows.len() {
            let newest_first = || rows[k + 1 - lags..=k].iter().rev();
            given.extend(newest_first().map(|row| scaling.displacement_m.apply(row.displacement_m)));
            given.extend(newest_first().map(|row| scaling.velocity_m_s.apply(row.velocity_m_s)));
            if let Some((_, drive)) = &scaling.drive {
                given.extend(newest_first().map(|row| drive.apply(row.drive)));
            }
        }
        let force = rows.iter().map(|row| (row.force_n - offset_n) / scaling.force_deviation_n).collect();
        let counts: Vec<bool> = rows[LEAD..].iter().map(|row| row.counts).collect();
        let held_back = vec![false; counts.len()];
        segments.push(Segment { run, given, force, counts, held_back });
    }
}

/// The errors over windows as a function of the weights.
pub(super) struct Unrolled<'a> {
    pub(super) table: &'a Table,
    /// Windows over which the network is simulated; see [`Table::windows`].
    pub(super) windows: Vec<Stretch>,
    /// Only every `stride`-th row enters the sum, because neighbours carry nearly the same information.
    pub(super) stride: usize,
    pub(super) cancel: &'a AtomicBool,
}

impl Problem for Unrolled<'_> {
    fn normal(&self, weights: &[f64]) -> Option<Normal> {
        let network = self.table.network.with_weights(weights);
        let size = self.windows.len().div_ceil(CHUNKS).max(1);
        let windows: Vec<_> = self.windows.chunks(size).collect();
        let sums: Option<Vec<Normal>> =
            parallel::map(&windows, |windows| self.sum(&network, windows)).into_iter().collect();
        sums?.into_iter().reduce(|mut all, one| {
            all.cost += one.cost;
            all.square += one.square;
            all.gradient += one.gradient;
            all
        })
    }
}

impl Table {
    /// Adds the gradient of half the squared errors over `window` to `gradient`, by back-propagation through
    /// time, and returns the sum of squared errors.
    ///
    /// ```text
    /// e_k = residual_k + sum_j e_{k+j} df_{k+j}/dy_k        dS/dw = sum_k e_k df_k/dw
    /// ```
    pub(super) fn back_propagate(
        &self,
        network: &Network,
        window: &Stretch,
        tape: &mut Tape,
        gradient: &mut [f64],
    ) -> f64 {
        let (n, force_lags) = (network.inputs(), network.structure().force_lags());
        let segment = &self.segments[window.segment];
        let mut forces = segment.forces_before(window.rows.start);
        let mut inputs = [0.0; MAX_NETWORK_INPUTS];
        tape.resize(window.rows.len(), gradient.len());
        let mut cost = 0.0;
        for (step, k) in window.rows.clone().enumerate() {
            segment.inputs(k, &forces[..force_lags], &mut inputs);
            let by_weight = &mut tape.by_weight[step * gradient.len()..][..gradient.len()];
            let by_input = &mut tape.by_input[step];
            let predicted = widest(
                #[inline(always)]
                || network.gradient(&inputs[..n], by_weight, by_input),
            );
            let residual = if segment.counts[k] { predicted - segment.measured(k) } else { 0.0 };
            tape.errors[step] = residual;
            cost += residual * residual;
            forces.copy_within(..DEPTH - 1, 1);
            forces[0] = predicted;
        }
        for step in (0..window.rows.len()).rev() {
            let error = tape.errors[step];
            for lag in 1..=force_lags.min(step) {
                tape.errors[step - lag] += error * tape.by_input[step][n - force_lags + lag - 1];
            }
            add_times(gradient, error, &tape.by_weight[step * gradient.len()..]);
        }
        cost
    }
}

/// Adds `factor` times `from` to `to`.
fn add_times(to: &mut [f64], factor: f64, from: &[f64]) {
    widest(
        #[inline(always)]
        || {
            for (to, from) in to.iter_mut().zip(from) {
                *to += factor * from;
            }
        },
    );
}

/// Intermediate results of back-propagation through the steps of a window.
#[derive(Debug, Default)]
pub(super) struct Tape {
    by_weight: Vec<f64>,
    by_input: Vec<[f64; MAX_NETWORK_INPUTS]>,
    errors: Vec<f64>,
}

impl Tape {
    fn resize(&mut self, steps: usize, weights: usize) {
        self.by_weight.resize(steps * weights, 0.0);
        self.by_input.resize(steps, [0.0; MAX_NETWORK_INPUTS]);
        self.errors.resize(steps, 0.0);
    }
}

impl Unrolled<'_> {
    /// The sums over some windows; `None` if the work was cancelled.
    fn sum(&self, network: &Network, windows: &[Stretch]) -> Option<Normal> {
        let (n, parameters) = (network.inputs(), network.parameter_count());
        let force_lags = network.structure().force_lags();
        let mut sums = Sums::new(parameters);
        let (mut inputs, mut by_input) = ([0.0; MAX_NETWORK_INPUTS], [0.0; MAX_NETWORK_INPUTS]);
        // Derivatives of the last outputs, in a ring buffer.
        let mut ring = vec![vec![0.0; parameters]; force_lags + 1];
        for window in windows {
            if self.cancel.load(Ordering::Relaxed) {
                return None;
            }
            let segment = &self.table.segments[window.segment];
            // Rows after the last one that enters the sum have no influence.
            let enters = |k: &usize| k.is_multiple_of(self.stride) && segment.counts[*k];
            let Some(last) = window.rows.clone().rev().find(enters) else { continue };
            let mut forces = segment.forces_before(window.rows.start);
            for (step, k) in (window.rows.start..=last).enumerate() {
                segment.inputs(k, &forces[..force_lags], &mut inputs);
                let mut here = std::mem::take(&mut ring[step % (force_lags + 1)]);
                let predicted = widest(
                    #[inline(always)]
                    || network.gradient(&inputs[..n], &mut here, &mut by_input),
                );
                for lag in 1..=force_lags.min(step) {
                    let factor = by_input[n - force_lags + lag - 1];
                    add_times(&mut here, factor, &ring[(step - lag) % (force_lags + 1)]);
                }
                forces.copy_within(..DEPTH - 1, 1);
                forces[0] = predicted;
                if enters(&k) {
                    sums.add(&here, predicted - segment.measured(k));
                }
                ring[step % (force_lags + 1)] = here;
            }
        }
        Some(sums.finish())
    }
}

/// Collects rows of a Jacobian and multiplies them one panel at a time.
struct Sums {
    normal: Normal,
    panel: DMatrix<f64>,
    residuals: DVector<f64>,
    filled: usize,
}

impl Sums {
    fn new(parameters: usize) -> Self {
        let square = DMatrix::zeros(parameters, parameters);
        let normal = Normal { cost: 0.0, square, gradient: DVector::zeros(parameters) };
        // Each column holds one row of the Jacobian, so that a row is written contiguously.
        Self { normal, panel: DMatrix::zeros(parameters, PANEL), residuals: DVector::zeros(PANEL), filled: 0 }
    }

    fn add(&mut self, by_weight: &[f64], residual: f64) {
        self.panel.column_mut(self.filled).copy_from_slice(by_weight);
        self.residuals[self.filled] = residual;
        self.filled += 1;
        if self.filled == PANEL {
            self.fold();
        }
    }

    fn fold(&mut self) {
        let panel = self.panel.columns(0, self.filled);
        let residuals = self.residuals.rows(0, self.filled);
        self.normal.cost += residuals.norm_squared();
        self.normal.gradient.gemv(1.0, &panel, &residuals, 1.0);
        // J'J is symmetric: only the blocks on and below the diagonal are computed.
        let transposed = panel.transpose();
        let parameters = panel.nrows();
        for from in (0..parameters).step_by(BLOCK) {
            let (rows, columns) = (parameters - from, BLOCK.min(parameters - from));
            let mut block = self.normal.square.view_mut((from, from), (rows, columns));
            block.gemm(1.0, &panel.rows(from, rows), &transposed.columns(from, columns), 1.0);
        }
        self.filled = 0;
    }

    fn finish(mut self) -> Normal {
        self.fold();
        self.normal.square.fill_upper_triangle_with_lower_triangle();
        self.normal
    }
}
