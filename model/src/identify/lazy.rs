//! Identification of the lazy learner: the stored points, the distance metric and the number of neighbours.
//!
//! ```text
//! points      k-means: m centres of the rows, seeded as in k-means++; a point is the mean of its rows and their force
//! metric      s_x = sd(x) / w_x,  s_v = sd(v),  s_i = sd(i) / w_i;     w and the neighbours from a grid
//! ```
//!
//! The mean of neighbouring rows has less noise than a single row. There are thousands of rows for 256
//! points, so each point of a local regression represents dozens of rows.
//!
//! Every fifth stretch of rows is held back at first. The metric and range of neighbours are chosen that
//! predict the held-back rows best from points of the other rows. The points are then computed again from all
//! rows. Each metric has its own random numbers, and sums are added in a fixed order, so results do not
//! depend on the number of threads.
//!
//! Each run has a force offset, first estimated by a rough model ([`session_offsets_n`]) and finally
//! corrected by the mean error.
//!
//! Source: `[boada2008]`, `[bontempi]` and `[k-means]` in the bibliography (node/docs/guide/bibliography.md).

use super::dataset::Dataset;
use super::network::{is_constant, normalisation};
use super::offsets::session_offsets_n;
use super::{Progress, Watch};
use crate::error::{Error, IdentifyError};
use crate::force::{Lazy, LazyMetric, LazyPoint, MAX_POINTS};
use crate::parallel;
use crate::sample::DriveKind;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Weights of displacement and of drive relative to velocity.
const DISPLACEMENT_WEIGHTS: [f64; 3] = [0.15, 0.4, 1.0];
const DRIVE_WEIGHTS: [f64; 3] = [0.5, 1.0, 2.0];
/// Ranges of the number of neighbours.
const NEIGHBOURS: [[usize; 2]; 3] = [[5, 8], [6, 12], [8, 16]];
/// Rows of a stretch; every fifth stretch is held back.
const STRETCH: usize = 512;
/// Average number of rows per point, at least; fewer rows give fewer points.
const ROWS_PER_POINT: usize = 8;
/// Smallest number of points for a model.
const LEAST_POINTS: usize = 32;
/// Number of rows for the points of the grid search, and number of rows for its test.
const GRID_ROWS: [usize; 2] = [8192, 1024];
/// Iterations of k-means: in the grid search, and for the final model.
const ROUNDS: [usize; 2] = [4, 12];
/// Rows per unit of parallel work. Fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 2048;

/// Result of the fit.
#[derive(Debug, Clone)]
pub(super) struct Fitted {
    /// The model; its offset is the mean of the runs' offsets.
    pub(super) model: Lazy,
    /// Offset of each run, N.
    pub(super) offsets_n: Vec<f64>,
    /// RMSE on the held-back rows for each metric and range of neighbours, N, lowest first.
    pub(super) restart_rsse_n: Vec<f64>,
}

/// Fits a passive (`drive` is `None`) or semi-active lazy learner to `datasets`.
pub(super) fn fit(
    datasets: &[Dataset],
    drive: Option<DriveKind>,
    seed: u64,
    watch: &Watch,
) -> Result<Fitted, Error> {
    let rough_n = session_offsets_n(datasets, drive.is_some());
    let rows = rows(datasets, drive.is_some(), &rough_n);
    if rows.len() < LEAST_POINTS * ROWS_PER_POINT {
        return Err(IdentifyError::TooFewSamples {
            model: "boada",
            which: None,
            samples: rows.len(),
            needed: LEAST_POINTS * ROWS_PER_POINT,
            count: LEAST_POINTS,
            parts: "points",
        }
        .into());
    }
    let deviations = Deviations::of(datasets, drive)?;
    let (metric, neighbours, restart_rsse_n) = choose(&rows, &deviations, seed, watch)?;
    watch.report(Progress::Polish { done: 0, of: 1 });
    let points = memory(&rows, &metric, MAX_POINTS.min(rows.len() / ROWS_PER_POINT), ROUNDS[1], seed, watch);
    let points = points.ok_or(Error::Cancelled)?;
    watch.report(Progress::Polish { done: 1, of: 1 });

    let model = Lazy::new(metric, neighbours, &points, 0.0)?;
    let error = |run: usize| {
        let counted = datasets[run].rows.iter().filter(|row| row.counts);
        let errors = counted
            .map(|row| {
                row.force_n - rough_n[run] - model.force_n(row.displacement_m, row.velocity_m_s, row.drive)
            })
            .filter(|e| e.is_finite());
        let (sum, count) = errors.fold((0.0, 0.0), |(sum, count), e| (sum + e, count + 1.0));
        if count > 0.0 { sum / count } else { 0.0 }
    };
    let errors_n: Vec<f64> = parallel::map_indices(datasets.len(), error);
    let offsets_n: Vec<f64> = rough_n.iter().zip(errors_n).map(|(mean, error)| mean + error).collect();
    let model = model.with_force_offset_n(super::mean_offset(datasets, &offsets_n));
    Ok(Fitted { model, offsets_n, restart_rsse_n })
}

/// The counted rows, with the offset of their run subtracted.
fn rows(datasets: &[Dataset], driven: bool, rough_n: &[f64]) -> Vec<LazyPoint> {
    let all = datasets.iter().zip(rough_n).flat_map(|(d, mean)| d.rows.iter().map(move |row| (row, mean)));
    let counted = all.filter(|(row, _)| row.counts && (!driven || row.drive.is_finite()));
    let point = |(row, mean): (&super::Row, &f64)| LazyPoint {
        displacement_m: row.displacement_m,
        velocity_m_s: row.velocity_m_s,
        drive: if driven { row.drive } else { 0.0 },
        force_n: row.force_n - mean,
    };
    counted.map(point).collect()
}

/// Standard deviations of the inputs.
struct Deviations {
    displacement_m: f64,
    velocity_m_s: f64,
    drive: Option<(DriveKind, f64)>,
}

impl Deviations {
    fn of(datasets: &[Dataset], drive: Option<DriveKind>) -> Result<Self, Error> {
        let displacement = normalisation(datasets, |_, row| row.displacement_m);
        let velocity = normalisation(datasets, |_, row| row.velocity_m_s);
        let force = normalisation(datasets, |_, row| row.force_n);
        if [&displacement, &velocity, &force].into_iter().any(is_constant) {
            return Err(IdentifyError::Constant { channel: "force or displacement" }.into());
        }
        let drive = drive.map(|kind| (kind, normalisation(datasets, |_, row| row.drive)));
        if let Some((kind, n)) = drive
            && is_constant(&n)
        {
            return Err(IdentifyError::ConstantDrive { drive: kind, value: n.mean }.into());
        }
        Ok(Self {
            displacement_m: displacement.deviation,
            velocity_m_s: velocity.deviation,
            drive: drive.map(|(kind, n)| (kind, n.deviation)),
        })
    }

    fn metric(&self, displacement_weight: f64, drive_weight: f64) -> LazyMetric {
        LazyMetric {
            displacement_scale_m: self.displacement_m / displacement_weight,
            velocity_scale_m_s: self.velocity_m_s,
            drive_scale: self.drive.map(|(kind, deviation)| (kind, deviation / drive_weight)),
        }
    }

    /// All metrics of the grid.
    fn metrics(&self) -> Vec<LazyMetric> {
        let drive_weights = if self.drive.is_some() { &DRIVE_WEIGHTS[..] } else { &[1.0] };
        let of = |x: f64| drive_weights.iter().map(move |i| self.metric(x, *i));
        DISPLACEMENT_WEIGHTS.into_iter().flat_map(of).collect()
    }
}

/// The metric and the range of neighbours that predict held-back rows best, and the errors of all, lowest
/// first.
fn choose(
    rows: &[LazyPoint],
    deviations: &Deviations,
    seed: u64,
    watch: &Watch,
) -> Result<(LazyMetric, [usize; 2], Vec<f64>), Error> {
    let held_back = |k: usize| (k / STRETCH.min(rows.len() / 5)) % 5 == 3;
    let thinned = |held: bool, most: usize| {
        let these: Vec<LazyPoint> =
            (0..rows.len()).filter(|k| held_back(*k) == held).map(|k| rows[k]).collect();
        let every = these.len().div_ceil(most).max(1);
        these.into_iter().step_by(every).collect::<Vec<_>>()
    };
    let (training, test) = (thinned(false, GRID_ROWS[0]), thinned(true, GRID_ROWS[1]));
    let count = MAX_POINTS.min(training.len() / ROWS_PER_POINT).max(NEIGHBOURS[NEIGHBOURS.len() - 1][1]);
    let metrics = deviations.metrics();
    let done = AtomicUsize::new(0);
    let of = metrics.len() as u32;
    let one = |metric: &LazyMetric| {
        let points = memory(&training, metric, count, ROUNDS[0], seed, watch)?;
        let mut outcomes = Vec::new();
        for neighbours in NEIGHBOURS {
            let model = Lazy::new(*metric, neighbours, &points, 0.0).ok()?;
            let error = |p: &LazyPoint| p.force_n - model.force_n(p.displacement_m, p.velocity_m_s, p.drive);
            let mean = test.iter().map(|p| error(p).powi(2)).sum::<f64>() / test.len().max(1) as f64;
            outcomes.push((mean.sqrt(), *metric, neighbours));
        }
        watch.report(Progress::Restart { done: done.fetch_add(1, Ordering::Relaxed) as u32 + 1, of });
        Some(outcomes)
    };
    let outcomes: Option<Vec<_>> = parallel::map(&metrics, one).into_iter().collect();
    let mut outcomes: Vec<_> = outcomes.ok_or(Error::Cancelled)?.into_iter().flatten().collect();
    outcomes.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (_, metric, neighbours) = outcomes[0];
    Ok((metric, neighbours, outcomes.iter().map(|(error, _, _)| *error).collect()))
}

/// `count` points that represent `rows`; `None` if cancelled.
fn memory(
    rows: &[LazyPoint],
    metric: &LazyMetric,
    count: usize,
    rounds: usize,
    seed: u64,
    watch: &Watch,
) -> Option<Vec<LazyPoint>> {
    let drive_scale = metric.drive_scale.map_or(1.0, |(_, scale)| scale);
    let scaled = |p: &LazyPoint| {
        [
            p.displacement_m / metric.displacement_scale_m,
            p.velocity_m_s / metric.velocity_scale_m_s,
            p.drive / drive_scale,
        ]
    };
    let places: Vec<[f64; 3]> = rows.iter().map(scaled).collect();
    let mut points: Vec<LazyPoint> = seeds(&places, count, seed).into_iter().map(|k| rows[k]).collect();
    for _ in 0..rounds {
        if watch.is_cancelled() {
            return None;
        }
        let centres: Vec<[f64; 3]> = points.iter().map(scaled).collect();
        let chunks: Vec<_> = rows.chunks(CHUNK).zip(places.chunks(CHUNK)).collect();
        let sums = parallel::map(&chunks, |(rows, places)| sums(rows, places, &centres));
        for (j, point) in points.iter_mut().enumerate() {
            let mut sum = [0.0; 5];
            for chunk in &sums {
                sum.iter_mut().zip(chunk[j]).for_each(|(to, from)| *to += from);
            }
            // A centre without nearest rows stays where it is.
            if sum[4] > 0.0 {
                let [displacement_m, velocity_m_s, drive, force_n] = [0, 1, 2, 3].map(|c| sum[c] / sum[4]);
                *point = LazyPoint { displacement_m, velocity_m_s, drive, force_n };
            }
        }
    }
    Some(points)
}

fn squared_distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)
}

/// Initial rows as in k-means++: each is drawn in proportion to its squared distance to the previous ones.
fn seeds(places: &[[f64; 3]], count: usize, seed: u64) -> Vec<usize> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut found = vec![random.random_range(0..places.len())];
    let mut squares = vec![f64::INFINITY; places.len()];
    while found.len() < count {
        let last = places[found[found.len() - 1]];
        let mut sum = 0.0;
        for (square, place) in squares.iter_mut().zip(places) {
            *square = square.min(squared_distance(place, &last));
            sum += *square;
        }
        let mut left = random.random::<f64>() * sum;
        let drawn = squares.iter().position(|square| {
            left -= square;
            left < 0.0
        });
        // Rounding can leave a remainder at the end; if all rows are equal, nothing is drawn.
        found.push(drawn.unwrap_or(places.len() - 1));
    }
    found
}

/// Sums of x, v, i and F and the number of rows for each centre, over its nearest rows.
fn sums(rows: &[LazyPoint], places: &[[f64; 3]], centres: &[[f64; 3]]) -> Vec<[f64; 5]> {
    let mut sums = vec![[0.0; 5]; centres.len()];
    for (row, place) in rows.iter().zip(places) {
        let (mut nearest, mut least) = (0, f64::INFINITY);
        for (j, centre) in centres.iter().enumerate() {
            let square = squared_distance(place, centre);
            if square < least {
                (nearest, least) = (j, square);
            }
        }
        let values = [row.displacement_m, row.velocity_m_s, row.drive, row.force_n, 1.0];
        sums[nearest].iter_mut().zip(values).for_each(|(to, from)| *to += from);
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::condition::Conditioning;
    use crate::identify::DatasetOptions;
    use crate::rig::{Channels, Experiment, Plant, record};

    #[test]
    fn counted_rows_with_a_drive_are_used_with_the_offset_subtracted() {
        let experiment = Experiment::thesis("RP-APRBS").expect("known").with_duration_s(2.0);
        let run = record(&experiment, &Plant::default(), &Channels::default(), 1);
        let whole = Dataset::from_run(&run, &Conditioning::THESIS, &DatasetOptions::default()).expect("rows");
        let mut gaps = whole.clone();
        gaps.rows[100].drive = f64::NAN;
        gaps.rows[101].counts = false;
        gaps.rows[102].counts = true;
        gaps.rows[102].drive = 1.5;
        let counted = gaps.rows.iter().filter(|row| row.counts).count();
        let of_gaps = |driven: bool| rows(std::slice::from_ref(&gaps), driven, &[20.0]);
        assert_eq!(of_gaps(false).len(), counted);
        assert_eq!(of_gaps(true).len(), counted - usize::from(gaps.rows[100].counts));
        assert!(of_gaps(true).iter().all(|point| point.drive.is_finite()));
        assert!(of_gaps(false).iter().all(|point| point.drive == 0.0));
        let row = &gaps.rows[102];
        let expected = LazyPoint {
            displacement_m: row.displacement_m,
            velocity_m_s: row.velocity_m_s,
            drive: 1.5,
            force_n: row.force_n - 20.0,
        };
        assert!(of_gaps(true).contains(&expected));
        assert_eq!(rows(&[whole.clone(), gaps], false, &[0.0, 20.0]).len(), whole.counted() + counted);
    }
}
