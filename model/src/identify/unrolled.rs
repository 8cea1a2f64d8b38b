//! Runs as an autoregressive network sees them, and the least squares of its errors some steps ahead.
//!
//! ```text
//! y_k = f(u_k, y_{k-1} .. y_{k-r}; w),   y = F measured before the window, and the network's own in it
//! dy_k/dw = df/dw + sum_j df/dy_{k-j} dy_{k-j}/dw
//! ```
//!
//! A window of one row is the one-step predictor. In a longer one the network runs free from measured force,
//! and its derivatives run along with it. Windows are short enough that those of a network which is not
//! stable (yet) do not grow out of proportion.

use super::dataset::Dataset;
use super::least_squares::{Normal, Problem};
use crate::force::{DEPTH, MAX_NETWORK_INPUTS, Network};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

/// A step may differ from the period by this share (jitter); else a sample was lost.
const STEP_TOLERANCE: f64 = 0.25;
/// Rows of the Jacobian that are multiplied at once.
const PANEL: usize = 256;
/// Sums of the normal equations that run side by side. Their number is fixed, so that sums do not depend on threads.
const CHUNKS: usize = 4;
/// Rows before the first one that a network may predict.
const LEAD: usize = DEPTH;

/// Rows without a gap, normalised.
#[derive(Debug)]
struct Segment {
    /// Index of its dataset.
    run: usize,
    /// The inputs but for force, row by row, in the network's order; the first row is that after the lead.
    given: Vec<f64>,
    /// Measured force less the run's offset; the lead comes first.
    force: Vec<f64>,
    /// Rows that count, without the lead.
    counts: Vec<bool>,
    /// Rows that are not trained on, without the lead.
    held_back: Vec<bool>,
}

/// All rows, and the stretches of them that are trained on and held back.
#[derive(Debug)]
pub(super) struct Table {
    /// What the rows are normalised for; its weights do not matter.
    pub(super) network: Network,
    segments: Vec<Segment>,
    /// Stretches to train on.
    training: Vec<Stretch>,
}

/// Rows of a segment, counted without the lead.
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
    /// The rows of `datasets`, normalised as `network` does. Every fifth stretch of `stretch` rows is held back.
    pub(super) fn new(datasets: &[Dataset], network: &Network, offsets_n: &[f64], stretch: usize) -> Self {
        let mut segments = Vec::new();
        for (run, dataset) in datasets.iter().enumerate() {
            gather(run, dataset, network, offsets_n[run], &mut segments);
        }
        let (mut training, mut count) = (Vec::new(), 0);
        for (segment, rows) in segments.iter_mut().enumerate() {
            let mut from = 0;
            while from < rows.len() {
                // What is left at the end goes with the stretch before it.
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

    /// Rows that count: those to train on, and those that are held back.
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

    /// The stretches to train on, cut into windows of `horizon` rows.
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

    /// Calls `take` with each row of `stretch`: the inputs but for force, the measured forces before (newest first),
    /// the measured force, and whether it counts.
    #[cfg(test)]
    pub(super) fn rows(&self, stretch: &Stretch, mut take: impl FnMut(&[f64], [f64; DEPTH], f64, bool)) {
        let segment = &self.segments[stretch.segment];
        let width = segment.given.len() / segment.len();
        for k in stretch.rows.clone() {
            let given = &segment.given[k * width..][..width];
            take(given, segment.forces_before(k), segment.measured(k), segment.counts[k]);
        }
    }

    /// Runs `network` free over all rows, from rest as it will run live, and calls `take` with each row that counts.
    pub(super) fn free_run(&self, network: &Network, mut take: impl FnMut(FreeRow)) {
        let force_lags = network.structure().force_lags();
        let mut inputs = [0.0; MAX_NETWORK_INPUTS];
        for segment in &self.segments {
            let mut forces = [0.0; DEPTH];
            for k in 0..segment.len() {
                segment.inputs(k, &forces[..force_lags], &mut inputs);
                let (predicted, _) = network.forward(&inputs[..network.inputs()]);
                forces.copy_within(..DEPTH - 1, 1);
                forces[0] = predicted;
                if segment.counts[k] {
                    let (measured, held_back) = (segment.measured(k), segment.held_back[k]);
                    take(FreeRow { run: segment.run, held_back, measured, predicted });
                }
            }
        }
    }

    /// The runs' offsets after the mean error of each run's free run is taken into them, N.
    pub(super) fn corrected_offsets_n(&self, network: &Network, offsets_n: &[f64]) -> Vec<f64> {
        let mut errors = vec![(0.0, 0.0); offsets_n.len()];
        self.free_run(network, |row| {
            errors[row.run].0 += row.measured - row.predicted;
            errors[row.run].1 += 1.0;
        });
        let deviation_n = network.scaling().force_deviation_n;
        let corrected = |(offset_n, (sum, count)): (&f64, &(f64, f64))| {
            // A free run that went astray says nothing of the offset.
            let mean: f64 = sum / count;
            if mean.abs() < 1.0 { offset_n + deviation_n * mean } else { *offset_n }
        };
        offsets_n.iter().zip(&errors).map(corrected).collect()
    }

    /// Mean squared error of the free run over the held-back rows; infinite when it is not finite.
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

/// A row of a free run; forces are normalised.
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
    /// Where the network runs free; see [`Table::windows`].
    pub(super) windows: Vec<Stretch>,
    /// Only every so many-th row is an error: neighbours tell nearly the same.
    pub(super) stride: usize,
    pub(super) cancel: &'a AtomicBool,
}

impl Problem for Unrolled<'_> {
    fn normal(&self, weights: &[f64]) -> Option<Normal> {
        let network = self.table.network.with_weights(weights);
        let size = self.windows.len().div_ceil(CHUNKS).max(1);
        let sums: Option<Vec<Normal>> =
            self.windows.par_chunks(size).map(|windows| self.sum(&network, windows)).collect();
        sums?.into_iter().reduce(|mut all, one| {
            all.cost += one.cost;
            all.square += one.square;
            all.gradient += one.gradient;
            all
        })
    }
}

impl Table {
    /// Adds to `gradient` that of half the squared errors over `window`, by back-propagation through time; returns the
    /// squared errors.
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
            let predicted = network.gradient(&inputs[..n], by_weight, &mut tape.by_input[step]);
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
            let by_weight = &tape.by_weight[step * gradient.len()..];
            for (sum, by_weight) in gradient.iter_mut().zip(by_weight) {
                *sum += error * by_weight;
            }
        }
        cost
    }
}

/// What back-propagation through time remembers of the steps of a window.
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
    /// The sums over some windows; `None` when the work was cancelled.
    fn sum(&self, network: &Network, windows: &[Stretch]) -> Option<Normal> {
        let (n, parameters) = (network.inputs(), network.parameter_count());
        let force_lags = network.structure().force_lags();
        let mut sums = Sums::new(parameters);
        let (mut inputs, mut by_input) = ([0.0; MAX_NETWORK_INPUTS], [0.0; MAX_NETWORK_INPUTS]);
        // The derivatives of the last outputs, a ring.
        let mut ring = vec![vec![0.0; parameters]; force_lags + 1];
        for window in windows {
            if self.cancel.load(Ordering::Relaxed) {
                return None;
            }
            let segment = &self.table.segments[window.segment];
            let mut forces = segment.forces_before(window.rows.start);
            for (step, k) in window.rows.clone().enumerate() {
                segment.inputs(k, &forces[..force_lags], &mut inputs);
                let mut here = std::mem::take(&mut ring[step % (force_lags + 1)]);
                let predicted = network.gradient(&inputs[..n], &mut here, &mut by_input);
                for lag in 1..=force_lags.min(step) {
                    let factor = by_input[n - force_lags + lag - 1];
                    for (to, from) in here.iter_mut().zip(&ring[(step - lag) % (force_lags + 1)]) {
                        *to += factor * from;
                    }
                }
                forces.copy_within(..DEPTH - 1, 1);
                forces[0] = predicted;
                if k % self.stride == 0 && segment.counts[k] {
                    sums.add(&here, predicted - segment.measured(k));
                }
                ring[step % (force_lags + 1)] = here;
            }
        }
        Some(sums.finish())
    }
}

/// Gathers rows of a Jacobian and multiplies them a panel at a time.
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
        // One column a row of the Jacobian, so that a row is written in one piece.
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
        self.normal.square.gemm(1.0, &panel, &panel.transpose(), 1.0);
        self.filled = 0;
    }

    fn finish(mut self) -> Normal {
        self.fold();
        self.normal
    }
}
