//! Linear regression of the force on its own lags and the lags of the inputs, by QR in panels and an SVD of
//! the triangle.
//!
//! ```text
//! F_k - z_run = phi_k . a + c_run + e_k,      phi_k = w_1 psi_k, ..., w_C psi_k [, i_k, i_{k-1}, ...]
//! psi_k       = F_{k-1} - z_run, ..., x_k, ..., v_k, ...          w = w(i_k), one for plain ARX
//! ```
//!
//! The constant c is fitted for each run separately. Removing each run's means from F and phi gives the same
//! a as one column of ones per run, and keeps the regression at its 9 or 12 columns; in each run a leading
//! column of ones removes the means. QR folds the rows, panel by panel, into a small triangle; the triangle's
//! SVD then gives the rank and the minimum-norm solution. If v is the backward difference of x, the rank is
//! at most 7 of 9 (10 of 12), because five numbers determine a4..a9.
//!
//! If coefficients depend on the drive, the zero z of a run is its mean force, since otherwise c would depend
//! on the drive too. For a plain ARX model z is 0, because c includes it.
//!
//! Standard errors come from the sandwich formula H^+ B H^+, as for nonlinear fits. H = R'R is the normal matrix. B is the scatter of the
//! gradient over blocks of one second, because the errors of an incomplete model are correlated from sample to sample. If the rank is too
//! low, the rows do not determine every coefficient; the standard errors of those are NaN.
//!
//! Stamps jitter by their rounding. A difference quotient over the stamped step then differs from x_k -
//! x_{k-1} by that jitter, and the regression would take the two for independent signals, with huge,
//! meaningless coefficients. A backward difference is therefore rescaled to the nominal period.

use super::Watch;
use super::dataset::Dataset;
use super::recursive::{FORGETTING, INITIAL_VARIANCE, Recursion};
use super::report::BLOCK_S;
use crate::condition::{ApplyTo, VelocitySource};
use crate::error::{Error, IdentifyError};
use crate::force::Dependence;
use crate::parallel;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;

/// Rows of a panel: large enough for an efficient QR, small enough for the first-level cache.
const PANEL: usize = 128;
/// Rows of one unit of parallel work.
const CHUNK: usize = 2048;
/// Number of panels that are collected before they are folded.
const PANELS: usize = 64;
/// Singular values below this share of the largest are taken as zero. Columns have unit norm.
const RANK_TOLERANCE: f64 = 1e-10;
/// A column whose norm is below this share of its mean's norm is constant.
const ROUNDING: f64 = 1e-11;
/// Largest relative difference between the rates of the runs.
const RATE_TOLERANCE: f64 = 0.01;
/// Largest relative difference between a step and the period (jitter); a larger one means a lost sample.
const STEP_TOLERANCE: f64 = 0.25;
/// A step that is longer than this many times the median step has lost a sample.
const LOST_SAMPLE: f64 = 1.5;
/// Largest share of steps beyond [`STEP_TOLERANCE`]; they are left out. With more of them, hardly any step follows enough others.
const MOST_UNEVEN: f64 = 0.2;
/// Largest share of a coefficient's direction outside the rows for a coefficient that they determine.
const UNDETERMINED: f64 = 1e-8;
/// Smallest number of rows per coefficient.
const ROWS_PER_PARAMETER: usize = 10;

/// The lists of coefficients in a model file, in the order of the regression.
pub(super) const LAG_LISTS: [&str; 3] = ["force_lags", "displacement_lags_n_m", "velocity_lags_n_s_m"];

/// Defines the rows of a regression and their contents.
#[derive(Debug, Clone, Copy)]
pub(super) struct Regression {
    /// Name of the model, for messages.
    pub(super) model: &'static str,
    /// Nominal period, s.
    pub(super) period_s: f64,
    /// Lags of each signal.
    pub(super) lags: usize,
    /// Number of samples by which displacement, velocity and drive enter later; 0 or 1.
    pub(super) delay: usize,
    /// How the coefficients of force, displacement and velocity depend on the drive.
    pub(super) dependence: Dependence,
    /// True when lags of the drive are regressors too.
    pub(super) drive_lags: bool,
}

/// Result of a regression.
pub(super) struct Regressed {
    /// The coefficients of each copy, then the coefficients of the drive's lags.
    pub(super) coefficients: DVector<f64>,
    /// Offset of each run, N.
    pub(super) offsets_n: Vec<f64>,
    /// Rank of the regression; a recursive fit does not compute it.
    pub(super) rank: Option<usize>,
    /// Standard error of each coefficient, NaN if the rows do not determine it; empty after a recursive fit.
    pub(super) standard_errors: Vec<f64>,
}

/// Summary of the rows of one run.
struct Means {
    /// The force that is subtracted from every force, N.
    zero_n: f64,
    rows: usize,
    /// Mean of the regressors, followed by the mean of the force.
    mean: DVector<f64>,
    /// Mean weight of each copy; they give the mean of 1 - a1 - a2 - a3.
    weights: DVector<f64>,
}

impl Regression {
    /// Number of regressors of one copy.
    const fn per_copy(&self) -> usize {
        3 * self.lags
    }

    /// Number of all regressors.
    const fn columns(&self) -> usize {
        self.per_copy() * self.dependence.copies() + if self.drive_lags { self.lags } else { 0 }
    }

    /// Fits the coefficients to `datasets`.
    pub(super) fn fit(&self, datasets: &[Dataset], watch: &Watch) -> Result<Regressed, Error> {
        let n = self.columns();
        let (mut means, mut triangle) = (Vec::with_capacity(datasets.len()), Triangle::new(n + 1));
        for dataset in datasets {
            let (own, centred) = self.centred(dataset);
            means.push(own);
            for row in centred.row_iter() {
                triangle.push(row.iter().copied());
            }
            if watch.is_cancelled() {
                return Err(Error::Cancelled);
            }
        }
        self.check_rows(&means)?;
        // After centring, a constant column holds only rounding errors, no signal.
        let mut rounding = DVector::<f64>::zeros(n);
        for means in &means {
            let root = (means.rows as f64).sqrt();
            rounding += means.mean.rows(0, n).map(|m| ROUNDING * m.abs() * root);
        }
        let Solution { coefficients, rank, inverse, determined } = triangle.solve(&rounding)?;
        let of_run = |index: usize| self.variances(&coefficients, &inverse, &datasets[index], &means[index]);
        let of_runs: Vec<(DVector<f64>, u32)> = parallel::map_indices(datasets.len(), of_run);
        let variances = of_runs.iter().fold(DVector::zeros(n), |sum, (run, _)| sum + run);
        let blocks = of_runs.iter().map(|(_, blocks)| f64::from(*blocks)).sum::<f64>();
        // A block takes part in the fit that its errors belong to.
        let unbiased = if blocks > 1.0 { blocks / (blocks - 1.0) } else { f64::NAN };
        let error = |j: usize| if determined[j] { (unbiased * variances[j]).sqrt() } else { f64::NAN };
        let standard_errors = (0..n).map(error).collect();
        let runs = datasets.iter().zip(&means);
        let offsets_n = runs.map(|(dataset, means)| self.offset_n(&coefficients, dataset, means)).collect();
        Ok(Regressed { coefficients, offsets_n, rank: Some(rank), standard_errors })
    }

    /// The diagonal of H^+ B H^+ for one run, and the number of its blocks. H^+ meets the gradient of each block before the square: of
    /// regressors that are nearly collinear, B itself would hold nothing but rounding errors.
    fn variances(
        &self,
        coefficients: &DVector<f64>,
        inverse: &DMatrix<f64>,
        dataset: &Dataset,
        means: &Means,
    ) -> (DVector<f64>, u32) {
        let n = self.columns();
        let of_block = (BLOCK_S / self.period_s).round().max(1.0) as usize;
        let (mut block, mut filled, mut blocks) = (DVector::<f64>::zeros(n), 0, 0);
        let mut variances = DVector::<f64>::zeros(n);
        let mut centred = DVector::<f64>::zeros(n);
        self.each(dataset, 0..dataset.rows.len(), means.zero_n, |row, _| {
            centred.iter_mut().zip(row).zip(&means.mean).for_each(|((to, value), mean)| *to = value - mean);
            let error = row[n] - means.mean[n] - coefficients.dot(&centred);
            block.axpy(error, &centred, 1.0);
            filled += 1;
            if filled == of_block {
                variances += (inverse * &block).map(|change| change * change);
                block.fill(0.0);
                (filled, blocks) = (0, blocks + 1);
            }
        });
        if filled > 0 {
            variances += (inverse * block).map(|change| change * change);
            blocks += 1;
        }
        (variances, blocks)
    }

    /// Refuses runs with too few rows for the number of coefficients.
    fn check_rows(&self, means: &[Means]) -> Result<(), Error> {
        let n = self.columns();
        let rows: usize = means.iter().map(|means| means.rows).sum();
        if rows < ROWS_PER_PARAMETER * n {
            return Err(IdentifyError::TooFewSamples {
                model: self.model,
                which: Some(format!("that follow {} others", self.lags)),
                samples: rows,
                needed: ROWS_PER_PARAMETER * n,
                count: n,
                parts: "coefficients",
            }
            .into());
        }
        Ok(())
    }

    /// Fits the coefficients to `datasets` sample by sample, run after run; see [`super::recursive`].
    pub(super) fn fit_recursively(&self, datasets: &[Dataset], watch: &Watch) -> Result<Regressed, Error> {
        let n = self.columns();
        let (mut means, mut squares) = (Vec::with_capacity(datasets.len()), vec![0.0; n + 1]);
        for dataset in datasets {
            let (own, centred) = self.centred(dataset);
            for (sum, column) in squares.iter_mut().zip(centred.column_iter()) {
                *sum += column.norm_squared();
            }
            means.push(own);
        }
        self.check_rows(&means)?;
        let rows: usize = means.iter().map(|means| means.rows).sum();
        // A column that is constant in each run has no deviation but the rounding of its mean.
        let deviation = |j: usize| {
            let largest = means.iter().map(|means| means.mean[j].abs()).fold(0.0, f64::max);
            let deviation = (squares[j] / rows as f64).sqrt();
            if deviation > ROUNDING * largest { deviation } else { 0.0 }
        };
        let deviations: Vec<f64> = (0..=n).map(deviation).collect();
        if deviations[n] == 0.0 {
            return Err(IdentifyError::Constant { channel: "force or displacement" }.into());
        }
        let mut recursion = Recursion::new(n + 1, FORGETTING, INITIAL_VARIANCE);
        let mut regressors = vec![0.0; n + 1];
        for (dataset, means) in datasets.iter().zip(&means) {
            if watch.is_cancelled() {
                return Err(Error::Cancelled);
            }
            // The last regressor is the constant of the run.
            recursion.restart(n, INITIAL_VARIANCE);
            self.each(dataset, 0..dataset.rows.len(), means.zero_n, |row, _| {
                for ((to, value), deviation) in regressors.iter_mut().zip(row).zip(&deviations) {
                    *to = if *deviation > 0.0 { value / deviation } else { 0.0 };
                }
                regressors[n] = 1.0;
                recursion.update(&regressors, row[n] / deviations[n]);
            });
        }
        let unscaled = |(value, deviation): (&f64, &f64)| {
            if *deviation > 0.0 { value * deviations[n] / deviation } else { 0.0 }
        };
        let coefficients =
            DVector::from_iterator(n, recursion.coefficients().iter().zip(&deviations).take(n).map(unscaled));
        let runs = datasets.iter().zip(&means);
        let offsets_n = runs.map(|(dataset, means)| self.offset_n(&coefficients, dataset, means)).collect();
        Ok(Regressed { coefficients, offsets_n, rank: None, standard_errors: Vec::new() })
    }

    /// The force offset of a run, N, from its constant c.
    fn offset_n(&self, coefficients: &DVector<f64>, dataset: &Dataset, means: &Means) -> f64 {
        let n = self.columns();
        let lag_sum = |copy: usize| coefficients.rows(copy * self.per_copy(), self.lags).sum();
        let gap = 1.0 - means.weights.iter().enumerate().map(|(c, w)| w * lag_sum(c)).sum::<f64>();
        let constant = means.mean[n] - coefficients.dot(&means.mean.rows(0, n));
        // If 1 - a1 - a2 - a3 is nearly zero, the quotient is meaningless and lies outside the range of the
        // run's forces. The run's mean is used then; the prediction hardly depends on it.
        let mean_n = means.zero_n + means.mean[n];
        let [low, high] = dataset.envelope.force_n.unwrap_or([mean_n; 2]);
        let offset = means.zero_n + constant / gap;
        if (low..=high).contains(&offset) { offset } else { mean_n }
    }

    /// The summary of a run, and the triangle of its rows with their means removed.
    ///
    /// A leading column of ones removes the means. In the triangle of [1 phi F] the first row holds the means
    /// times the root of the number of rows; the remaining block is the triangle of the centred rows.
    fn centred(&self, dataset: &Dataset) -> (Means, DMatrix<f64>) {
        let counted = || dataset.rows.iter().filter(|row| row.counts && row.force_n.is_finite());
        let zero_n = match self.dependence {
            Dependence::None => 0.0,
            _ => counted().map(|row| row.force_n).sum::<f64>() / counted().count().max(1) as f64,
        };
        let (n, copies) = (self.columns(), self.dependence.copies());
        // Parts are cut at fixed row numbers, so the sums do not depend on the number of threads.
        let part = |&from: &usize| {
            let mut triangle = Triangle::new(n + 2);
            let mut weights = DVector::<f64>::zeros(copies);
            let mut rows = 0;
            self.each(dataset, from..(from + CHUNK).min(dataset.rows.len()), zero_n, |row, of_copies| {
                rows += 1;
                triangle.push(std::iter::once(1.0).chain(row.iter().copied()));
                weights.iter_mut().zip(of_copies).for_each(|(sum, weight)| *sum += weight);
            });
            (triangle.finish(), weights, rows)
        };
        let starts: Vec<usize> = (0..dataset.rows.len()).step_by(CHUNK).collect();
        let parts: Vec<(DMatrix<f64>, DVector<f64>, usize)> = parallel::map(&starts, part);
        let (mut all, mut weights, mut rows) = (Triangle::new(n + 2), DVector::<f64>::zeros(copies), 0);
        for (factor, of_part, count) in &parts {
            factor.row_iter().for_each(|row| all.push(row.iter().copied()));
            weights += of_part;
            rows += count;
        }
        let factor = all.finish();
        if rows == 0 {
            let means = Means { zero_n, rows, mean: DVector::zeros(n + 1), weights };
            return (means, DMatrix::zeros(0, n + 1));
        }
        let root = factor[(0, 0)];
        let mean = DVector::from_iterator(n + 1, factor.row(0).iter().skip(1).map(|sum| sum / root));
        let centred = factor.view((1, 1), (factor.nrows() - 1, n + 1)).into_owned();
        (Means { zero_n, rows, mean, weights: weights / rows as f64 }, centred)
    }

    /// Calls `take` for each complete row in `range` with the regressors followed by the force, and the
    /// weights of the copies.
    fn each(
        &self,
        dataset: &Dataset,
        range: Range<usize>,
        zero_n: f64,
        mut take: impl FnMut(&[f64], &[f64]),
    ) {
        let backward = dataset.conditioning.velocity == VelocitySource::Backward;
        let tolerance_s = STEP_TOLERANCE * self.period_s;
        let uniform = |dt_s: f64| (dt_s - self.period_s).abs() <= tolerance_s;
        let (n, lags, per_copy, copies) =
            (self.columns(), self.lags, self.per_copy(), self.dependence.copies());
        let frequency = 1.0 / self.period_s;
        let mut out = vec![0.0; n + 1];
        for k in range {
            if k < lags || !dataset.rows[k].counts {
                continue;
            }
            let rows = &dataset.rows[k - lags..=k];
            // With a delay the inputs of the first row enter too, and so does the step of its velocity.
            if !rows[1 - self.delay..].iter().all(|row| row.dt_s.is_some_and(uniform)) {
                continue;
            }
            let weights = self.dependence.weights(rows[lags].drive);
            for lag in 0..lags {
                let row = &rows[lags - lag - self.delay];
                let stretch = if backward { row.dt_s.unwrap_or(self.period_s) * frequency } else { 1.0 };
                for (copy, weight) in weights[..copies].iter().enumerate() {
                    let own = copy * per_copy + lag;
                    out[own] = weight * (rows[lags - 1 - lag].force_n - zero_n);
                    out[own + lags] = weight * row.displacement_m;
                    out[own + 2 * lags] = weight * (row.velocity_m_s * stretch);
                }
                if self.drive_lags {
                    out[copies * per_copy + lag] = row.drive;
                }
            }
            out[n] = rows[lags].force_n - zero_n;
            if out.iter().all(|v| v.is_finite()) {
                take(&out, &weights[..copies]);
            }
        }
    }
}

/// The common rate of all datasets, for the model named `model`, which is valid for one rate only.
pub(super) fn common_rate(datasets: &[Dataset], model: &'static str) -> Result<f64, Error> {
    let first = &datasets[0];
    if first.conditioning.apply_to == ApplyTo::Output {
        return Err(Error::OutputFilter { model });
    }
    let rates_hz: Vec<f64> = datasets.iter().map(sampling_rate_hz).collect();
    let off = |rate_hz: &f64| (rate_hz / rates_hz[0] - 1.0).abs() > RATE_TOLERANCE;
    if let Some(other) = rates_hz.iter().position(off) {
        return Err(IdentifyError::DifferentRates {
            model,
            runs: [first.name.clone(), datasets[other].name.clone()],
            rates_hz: [rates_hz[0], rates_hz[other]],
        }
        .into());
    }
    for (dataset, rate_hz) in datasets.iter().zip(&rates_hz) {
        let share = uneven_share(dataset, *rate_hz);
        if share > MOST_UNEVEN {
            return Err(IdentifyError::UnevenSampling {
                run: dataset.name.clone(),
                percent: 100.0 * share,
                rate_hz: *rate_hz,
                model,
            }
            .into());
        }
    }
    Ok(rates_hz.iter().sum::<f64>() / rates_hz.len() as f64)
}

/// Rate of the samples of `dataset` that follow each other, Hz: a step with a lost sample does not count. Without lost samples, the mean rate.
fn sampling_rate_hz(dataset: &Dataset) -> f64 {
    let mut steps: Vec<f64> = dataset.rows.iter().filter_map(|row| row.dt_s).collect();
    if steps.is_empty() {
        return dataset.rate_hz;
    }
    let middle = steps.len() / 2;
    let longest_s = LOST_SAMPLE * *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
    let all = steps.len();
    steps.retain(|dt_s| *dt_s < longest_s);
    if steps.len() == all { dataset.rate_hz } else { steps.len() as f64 / steps.iter().sum::<f64>() }
}

/// Share of the steps of `dataset` that differ from the period of `rate_hz` by more than [`STEP_TOLERANCE`].
fn uneven_share(dataset: &Dataset, rate_hz: f64) -> f64 {
    let steps = dataset.rows.iter().filter_map(|row| row.dt_s);
    let (mut uneven, mut all) = (0_usize, 0_usize);
    for dt_s in steps {
        all += 1;
        uneven += usize::from((dt_s * rate_hz - 1.0).abs() > STEP_TOLERANCE);
    }
    uneven as f64 / all.max(1) as f64
}

/// The triangle of a QR decomposition into which rows are folded: first each panel, then the panels'
/// triangles.
pub(super) struct Triangle {
    width: usize,
    factor: DMatrix<f64>,
    /// Rows that are not folded yet, concatenated.
    waiting: Vec<f64>,
}

impl Triangle {
    /// Without rows. Each row will have `width` numbers; the last one is the regressed force.
    pub(super) fn new(width: usize) -> Self {
        Self { width, factor: DMatrix::zeros(0, width), waiting: Vec::new() }
    }

    /// Adds a row.
    pub(super) fn push(&mut self, row: impl IntoIterator<Item = f64>) {
        self.waiting.extend(row);
        if self.waiting.len() >= PANELS * PANEL * self.width {
            self.fold();
        }
    }

    /// Computes the triangle of each waiting panel and then of all of them. Panels are cut at fixed row
    /// numbers, so the result does not depend on the number of threads.
    fn fold(&mut self) {
        let width = self.width;
        if self.waiting.is_empty() {
            return;
        }
        let triangle =
            |panel: &&[f64]| DMatrix::from_row_slice(panel.len() / width, width, panel).qr().unpack_r();
        let panels: Vec<&[f64]> = self.waiting.chunks(PANEL * width).collect();
        let mut parts: Vec<DMatrix<f64>> = parallel::map(&panels, triangle);
        self.waiting.clear();
        parts.push(std::mem::replace(&mut self.factor, DMatrix::zeros(0, width)));
        let mut stacked = DMatrix::zeros(parts.iter().map(DMatrix::nrows).sum(), width);
        let mut from = 0;
        for part in &parts {
            stacked.rows_mut(from, part.nrows()).copy_from(part);
            from += part.nrows();
        }
        self.factor = stacked.qr().unpack_r();
    }

    /// The triangle of all rows. With fewer rows than columns it has as many rows as were pushed.
    fn finish(mut self) -> DMatrix<f64> {
        self.fold();
        self.factor
    }

    /// Minimum-norm least-squares solution. Columns no longer than `rounding` are taken as zero.
    pub(super) fn solve(mut self, rounding: &DVector<f64>) -> Result<Solution, Error> {
        self.fold();
        Solution::of(&self.factor, rounding)
    }
}

/// Minimum-norm least-squares solution of a triangle R.
pub(super) struct Solution {
    pub(super) coefficients: DVector<f64>,
    pub(super) rank: usize,
    /// (R'R)^+.
    inverse: DMatrix<f64>,
    /// Whether the rows determine each coefficient.
    determined: Vec<bool>,
}

impl Solution {
    /// The solution of `triangle`, whose last column is the force. Columns no longer than `rounding` are taken as zero.
    fn of(triangle: &DMatrix<f64>, rounding: &DVector<f64>) -> Result<Self, Error> {
        let n = triangle.ncols() - 1;
        let force = triangle.column(n).into_owned();
        let mut regressors = triangle.columns(0, n).into_owned();
        // Columns get unit norm; otherwise the units of newtons and metres would affect the rank and the norm.
        let norms = regressors.column_iter().map(|column| column.norm());
        let scales: Vec<f64> =
            norms.zip(rounding).map(|(norm, r)| if norm > *r { norm } else { 0.0 }).collect();
        for (mut column, scale) in regressors.column_iter_mut().zip(&scales) {
            if *scale > 0.0 {
                column /= *scale;
            } else {
                column.fill(0.0);
            }
        }
        let constant = IdentifyError::Constant { channel: "force or displacement" };
        let svd = regressors.svd(true, true);
        let largest = svd.singular_values.max();
        let tolerance = RANK_TOLERANCE * largest;
        let rank = svd.rank(tolerance);
        let solution = svd
            .solve(&force, tolerance)
            .ok()
            .filter(|s| rank > 0 && s.iter().all(|v| v.is_finite()))
            .ok_or(constant)?;
        let unscaled = |(value, scale): (&f64, &f64)| if *scale > 0.0 { value / scale } else { 0.0 };
        let mut inverse = DMatrix::zeros(n, n);
        let mut within = vec![0.0; n];
        for (value, direction) in svd.singular_values.iter().zip(svd.v_t.iter().flat_map(DMatrix::row_iter)) {
            if *value > tolerance {
                let direction = direction.transpose();
                within.iter_mut().zip(&direction).for_each(|(sum, part)| *sum += part * part);
                let root = DVector::from_fn(n, |j, _| unscaled((&direction[j], &scales[j])) / value);
                inverse.ger(1.0, &root, &root, 1.0);
            }
        }
        Ok(Self {
            coefficients: DVector::from_iterator(n, solution.iter().zip(&scales).map(unscaled)),
            rank,
            inverse,
            determined: within.iter().map(|within| 1.0 - within < UNDETERMINED).collect(),
        })
    }
}
