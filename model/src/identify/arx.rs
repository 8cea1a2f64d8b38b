//! Identification of the ARX model: linear least squares by panels of QR, then SVD of what is left.
//!
//! ```text
//! F_k = phi_k . a + c_run + e_k,      c_run = o_run (1 - a1 - a2 - a3)
//! ```
//!
//! The constant c of a run belongs to that run alone. Taking each run's means out of F and phi gives the same
//! a as a column of ones for each run would, and keeps the regression at 9 or 12 columns. Rows are folded
//! into a small triangle by QR, a panel at a time; the triangle's SVD then gives rank and minimum-norm
//! solution. With v the backward difference of x the rank is at most 7 of 9 (10 of 12): a4..a9 share what
//! five numbers determine.
//!
//! Stamps jitter by their rounding. A difference quotient over the stamped step would then differ from
//! x_k - x_{k-1} by that jitter, and the regression would take it for two independent signals with huge,
//! meaningless coefficients. So a backward difference is brought to the nominal period here.

use super::Watch;
use super::dataset::Dataset;
use crate::condition::{ApplyTo, VelocitySource};
use crate::error::Error;
use crate::force::{Arx, SAVARESI_LAGS};
use crate::sample::DriveKind;
use crate::units::Second;
use nalgebra::{DMatrix, DVector};

/// Rows of a panel: large enough to keep QR busy, small enough for the second-level cache.
const PANEL: usize = 1024;
/// Singular values below this share of the largest count as zero. Columns have unit norm.
const RANK_TOLERANCE: f64 = 1e-10;
/// A column whose norm is below this share of its mean's is constant.
const ROUNDING: f64 = 1e-11;
/// Rates of the runs may differ by this share.
const RATE_TOLERANCE: f64 = 0.01;
/// A step may differ from the period by this share (jitter); else a sample was lost.
const STEP_TOLERANCE: f64 = 0.25;
/// Rows that a coefficient wants at least.
const ROWS_PER_PARAMETER: usize = 10;

/// What came out.
pub(super) struct Fitted {
    /// The model, its offset the mean of the runs' offsets.
    pub(super) model: Arx,
    /// Offset of each run, N.
    pub(super) offsets_n: Vec<f64>,
    /// Rank of the regression.
    pub(super) rank: usize,
}

/// Fits a passive (`drive` is `None`) or semi-active ARX of `lags` lags (3, or 2: `savaresi`) to `datasets`.
pub(super) fn fit(
    datasets: &[Dataset],
    lags: usize,
    drive: Option<DriveKind>,
    watch: &Watch,
) -> Result<Fitted, Error> {
    let name = if lags == SAVARESI_LAGS { "savaresi" } else { "arx" };
    let rate_hz = common_rate(datasets, name)?;
    let period_s = 1.0 / rate_hz;
    let regression = Regression { period_s, lags, drive: drive.is_some() };
    let n = regression.columns();
    let means: Vec<(usize, DVector<f64>)> = datasets.iter().map(|d| regression.means(d)).collect();
    let rows: usize = means.iter().map(|(rows, _)| rows).sum();
    if rows < ROWS_PER_PARAMETER * n {
        return Err(Error::Data {
            message: format!(
                "{rows} samples with {lags} before them are too few for {n} ARX coefficients ({} are \
                 needed); add runs, or count samples at rest too",
                ROWS_PER_PARAMETER * n
            ),
        });
    }

    let mut triangle = DMatrix::<f64>::zeros(0, n + 1);
    for (dataset, (_, mean)) in datasets.iter().zip(&means) {
        let mut panel = Vec::with_capacity(PANEL);
        regression.each(dataset, |row| {
            panel.push(row - mean);
            if panel.len() == PANEL {
                fold(&mut triangle, &mut panel);
            }
        });
        fold(&mut triangle, &mut panel);
        if watch.is_cancelled() {
            return Err(Error::Cancelled);
        }
    }
    // What centring leaves of a constant column is rounding, and no signal.
    let mut rounding = DVector::<f64>::zeros(n);
    for (rows, mean) in &means {
        rounding += mean.rows(0, n).map(|m| ROUNDING * m.abs() * (*rows as f64).sqrt());
    }
    let (coefficients, rank) = solve(&triangle, &rounding)?;

    let gap = 1.0 - coefficients.rows(0, lags).sum();
    let offsets_n: Vec<f64> = datasets
        .iter()
        .zip(&means)
        .map(|(dataset, (_, mean))| {
            let constant = mean[n] - coefficients.dot(&mean.rows(0, n));
            // Where 1 - a1 - a2 - a3 is nearly zero the quotient means nothing, and shows it by leaving the
            // forces that the run holds. The run's mean then serves: the prediction hardly depends on it.
            let [low, high] = dataset.envelope.force_n.unwrap_or([mean[n]; 2]);
            let offset = constant / gap;
            if (low..=high).contains(&offset) { offset } else { mean[n] }
        })
        .collect();

    let offset_n = super::mean_offset(datasets, &offsets_n);
    let model = model(&coefficients, lags, drive, Second(period_s), offset_n)?;
    Ok(Fitted { model, offsets_n, rank })
}

/// The model with these coefficients, signal by signal.
fn model(
    coefficients: &DVector<f64>,
    lags: usize,
    drive: Option<DriveKind>,
    period: Second,
    offset_n: f64,
) -> Result<Arx, Error> {
    if lags == SAVARESI_LAGS {
        let of = |signal: usize| std::array::from_fn(|j| coefficients[signal * lags + j]);
        return Arx::savaresi(of(0), of(1), of(2), drive.map(|kind| (kind, of(3))), period, offset_n);
    }
    let of = |signal: usize| std::array::from_fn(|j| coefficients[signal * lags + j]);
    Arx::new(of(0), of(1), of(2), drive.map(|kind| (kind, of(3))), period, offset_n)
}

/// The rate of all datasets, for a model called `model` that holds at one rate.
pub(super) fn common_rate(datasets: &[Dataset], model: &str) -> Result<f64, Error> {
    let first = &datasets[0];
    if first.conditioning.apply_to == ApplyTo::Output {
        return Err(Error::output_filter_on_force_fed(model));
    }
    let off = |d: &&Dataset| (d.rate_hz / first.rate_hz - 1.0).abs() > RATE_TOLERANCE;
    if let Some(other) = datasets.iter().find(off) {
        return Err(Error::Data {
            message: format!(
                "the {model} model holds at one rate, but run {} is at {:.6} Hz and run {} at {:.6} Hz; identify \
                 them apart, or ask for a rate of which both are whole multiples",
                first.name, first.rate_hz, other.name, other.rate_hz
            ),
        });
    }
    Ok(datasets.iter().map(|d| d.rate_hz).sum::<f64>() / datasets.len() as f64)
}

/// Which rows there are, and what is in them.
struct Regression {
    period_s: f64,
    lags: usize,
    drive: bool,
}

impl Regression {
    const fn columns(&self) -> usize {
        if self.drive { 4 * self.lags } else { 3 * self.lags }
    }

    /// Calls `take` with each complete row: the regressors, and the force behind them.
    fn each(&self, dataset: &Dataset, mut take: impl FnMut(DVector<f64>)) {
        let backward = dataset.conditioning.velocity == VelocitySource::Backward;
        let uniform = |dt_s: f64| (dt_s / self.period_s - 1.0).abs() <= STEP_TOLERANCE;
        let (n, lags) = (self.columns(), self.lags);
        for rows in dataset.rows.windows(lags + 1).filter(|rows| rows[lags].counts) {
            if !rows[1..].iter().all(|row| row.dt_s.is_some_and(uniform)) {
                continue;
            }
            let mut out = DVector::zeros(n + 1);
            for lag in 0..lags {
                let row = &rows[lags - lag];
                let stretch = if backward { row.dt_s.unwrap_or(self.period_s) / self.period_s } else { 1.0 };
                out[lag] = rows[lags - 1 - lag].force_n;
                out[lags + lag] = row.displacement_m;
                out[2 * lags + lag] = row.velocity_m_s * stretch;
                if self.drive {
                    out[3 * lags + lag] = row.drive;
                }
            }
            out[n] = rows[lags].force_n;
            if out.iter().all(|v| v.is_finite()) {
                take(out);
            }
        }
    }

    /// Number of complete rows and their mean.
    fn means(&self, dataset: &Dataset) -> (usize, DVector<f64>) {
        let mut mean = DVector::zeros(self.columns() + 1);
        let mut count = 0;
        self.each(dataset, |row| {
            count += 1;
            mean += row;
        });
        (count, mean / (count.max(1) as f64))
    }
}

/// Puts `panel` under the triangle and makes it a triangle again.
pub(super) fn fold(triangle: &mut DMatrix<f64>, panel: &mut Vec<DVector<f64>>) {
    if panel.is_empty() {
        return;
    }
    let (above, width) = (triangle.nrows(), triangle.ncols());
    let stacked = DMatrix::from_fn(above + panel.len(), width, |i, j| {
        if i < above { triangle[(i, j)] } else { panel[i - above][j] }
    });
    *triangle = stacked.qr().unpack_r();
    panel.clear();
}

/// Minimum-norm solution of the triangle's least squares, and the rank. Columns no longer than `rounding` are
/// zero.
pub(super) fn solve(
    triangle: &DMatrix<f64>,
    rounding: &DVector<f64>,
) -> Result<(DVector<f64>, usize), Error> {
    let n = triangle.ncols() - 1;
    let force = triangle.column(n).into_owned();
    let mut regressors = triangle.columns(0, n).into_owned();
    // Columns of unit norm: else newtons would count for more than metres in the rank and in the norm.
    let norms = regressors.column_iter().map(|column| column.norm());
    let scales: Vec<f64> = norms.zip(rounding).map(|(norm, r)| if norm > *r { norm } else { 0.0 }).collect();
    for (mut column, scale) in regressors.column_iter_mut().zip(&scales) {
        if *scale > 0.0 {
            column /= *scale;
        } else {
            column.fill(0.0);
        }
    }
    let svd = regressors.svd(true, true);
    let largest = svd.singular_values.max();
    let tolerance = RANK_TOLERANCE * largest;
    let rank = svd.rank(tolerance);
    let solution = svd
        .solve(&force, tolerance)
        .ok()
        .filter(|s| rank > 0 && s.iter().all(|v| v.is_finite()))
        .ok_or_else(|| Error::Data {
            message: "force and displacement never vary in these runs: nothing can be identified from them"
                .to_owned(),
        })?;
    let unscaled = |(value, scale): (&f64, &f64)| if *scale > 0.0 { value / scale } else { 0.0 };
    Ok((DVector::from_iterator(n, solution.iter().zip(&scales).map(unscaled)), rank))
}
