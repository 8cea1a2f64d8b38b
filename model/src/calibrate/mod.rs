//! Calibration: computes the table of [`crate::uncertainty`] from residuals on held-out runs. The equations are there.

mod rows;

use crate::error::{CalibrationError, Error};
use crate::model::{Envelope, Model};
use crate::sample::Run;
use crate::statistics::autocorrelation::{Cutoff, integrated_time};
use crate::uncertainty::{Bands, DRIVES, Edges, Growth, OneStep, SPEEDS, TIMES, Uncertainty, Width};
use rows::{AWAY_S, Row, Rows, gather};

/// Nominal coverage of the band.
const COVERAGE: f64 = 0.9;
/// Smallest number of runs that show the variation between runs.
const RUNS: usize = 3;
/// Smallest number of effective samples for a quantile: its coverage then has a standard deviation of 2 %.
const EFFECTIVE: f64 = 200.0;
/// Smallest number of rows near a time of a growth.
const ROWS_AT_TIME: usize = 100;
/// Rows within this share of a time are assigned to it.
const ABOUT: f64 = 0.125;
/// Longest calibrated coasting time, s.
const COAST_S: f64 = 0.25;
/// Calibrated ages of the drive, s.
const AGES_S: [f64; 5] = [0.025, 0.05, 0.1, 0.2, 0.3];
/// A run moves its drive if its range exceeds this share of the range of all runs.
const MOVES: f64 = 0.1;

const _: () = assert!(COAST_S * (1.0 + ABOUT) < AWAY_S && AGES_S[4] * (1.0 + ABOUT) < AWAY_S);

/// The uncertainty of `model`, from runs that it was not identified from: at least three, similar to those it
/// will be used on. See [`crate::uncertainty`].
///
/// # Errors
/// [`CalibrationError`] if there are too few runs or too few rows; the errors of
/// [`evaluate`](crate::evaluate::evaluate) if a run lacks a channel that the model needs.
pub fn calibrate(model: &Model, held_out: &[Run]) -> Result<Uncertainty, Error> {
    let mut calibrator = Calibrator::new(*model);
    for run in held_out {
        calibrator.add(run)?;
    }
    calibrator.finish()
}

/// Collects residuals run by run, for callers that do not hold all runs at once, or that may stop in between.
///
/// ```
/// use mr_damper_model::calibrate::Calibrator;
/// use mr_damper_model::preset;
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
/// use mr_damper_model::uncertainty::Predictor;
///
/// let experiment = Experiment::thesis("RP-ICPS").expect("an experiment of the thesis").with_duration_s(20.0);
/// let mut calibrator = Calibrator::new(preset::load(preset::BEST_FUZZY_TANH)?);
/// for seed in 1..=3 {
///     assert!(calibrator.finish().is_err(), "two runs do not show how runs differ");
///     calibrator.add(&record(&experiment, &Plant::default(), &Channels::default(), seed))?;
/// }
/// let uncertainty = calibrator.finish()?;
/// assert!(uncertainty.covers(Predictor::FreeRun) && !uncertainty.covers(Predictor::OneStep));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Calibrator {
    model: Model,
    runs: usize,
    free_run: Rows,
    one_step: Rows,
}

impl Calibrator {
    /// A calibration of `model` without any runs yet.
    #[must_use]
    pub fn new(model: Model) -> Self {
        Self { model, runs: 0, free_run: Rows::default(), one_step: Rows::default() }
    }

    /// Runs the model over a held-out run: once with all inputs, and several times with force or drive
    /// removed.
    ///
    /// # Errors
    /// If the run lacks a channel that the model needs.
    pub fn add(&mut self, run: &Run) -> Result<(), Error> {
        gather(&self.model, run, self.runs, &mut self.free_run, &mut self.one_step)?;
        self.runs += 1;
        Ok(())
    }

    /// The uncertainty from all added runs. A predictor with too little data is omitted; see
    /// [`Uncertainty::covers`].
    ///
    /// # Errors
    /// [`CalibrationError`] if there is too little data for every predictor.
    pub fn finish(&self) -> Result<Uncertainty, Error> {
        let has_drive = self.model.force.drive().is_some();
        let free_run = bands(&self.free_run, self.runs, has_drive, "in simulation");
        let period = self.model.force.force_fed_period().filter(|_| self.model.feeds_on_force());
        let one_step = match period {
            None => None,
            Some(period) => self.one_step(has_drive, period.get()),
        };
        match (free_run, one_step) {
            (Err(error), None) => Err(error),
            (free_run, one_step) => Ok(Uncertainty { free_run: free_run.ok(), one_step }),
        }
    }

    fn one_step(&self, has_drive: bool, period_s: f64) -> Option<OneStep> {
        let bands = bands(&self.one_step, self.runs, has_drive, "in one-step-ahead prediction").ok()?;
        let coasting = coasting(&self.one_step.coasting, self.runs, &bands, period_s)?;
        Some(OneStep { bands, coasting })
    }
}

/// Calibration table of one predictor.
fn bands(rows: &Rows, runs: usize, has_drive: bool, predictor: &'static str) -> Result<Bands, Error> {
    if runs < RUNS {
        return Err(CalibrationError::TooFewRuns { runs, needed: RUNS }.into());
    }
    let effective = effective_shares(&rows.base, runs);
    let in_all: f64 = rows.base.iter().map(|row| effective[row.run]).sum();
    if in_all < EFFECTIVE || !spans(&rows.base) {
        return Err(CalibrationError::TooFewResiduals {
            predictor,
            runs,
            residuals: rows.base.len(),
            independent: in_all,
            needed: EFFECTIVE,
            needed_runs: RUNS,
        }
        .into());
    }
    let groups = Groups::new(&rows.base, &effective, has_drive);
    let level = level(&groups.strata(), runs);
    let mut bands = Bands {
        speed_edges_m_s: groups.speed_edges_m_s,
        drive_edges: groups.drive_edges,
        width_n: [[Width::default(); DRIVES]; SPEEDS],
        drive_held: None,
    };
    for (speed, drive) in groups.cells() {
        bands.width_n[speed][drive] =
            width(groups.rows_for(speed, drive).iter().map(|row| row.error_n), level);
    }
    if has_drive {
        bands.drive_held = held(rows, runs, &bands);
    }
    Ok(bands)
}

fn spans(rows: &[Row]) -> bool {
    let mut runs: Vec<usize> = rows.iter().map(|row| row.run).collect();
    runs.sort_unstable();
    runs.dedup();
    runs.len() >= RUNS
}

/// Root mean square and quantile of non-negative `scores`.
fn width(scores: impl Iterator<Item = f64>, level: f64) -> Width {
    let mut scores: Vec<f64> = scores.collect();
    scores.sort_unstable_by(f64::total_cmp);
    let squares: f64 = scores.iter().map(|score| score * score).sum();
    Width { std_dev: (squares / scores.len().max(1) as f64).sqrt(), half_band: quantile(&scores, level) }
}

/// The ceil((n + 1) level)-th smallest value, or the largest.
fn quantile(sorted: &[f64], level: f64) -> f64 {
    let rank = ((sorted.len() + 1) as f64 * level).ceil() as usize;
    sorted.get(rank.clamp(1, sorted.len().max(1)) - 1).copied().unwrap_or(0.0)
}

/// Number of independent rows per row, for each run: the inverse of the integrated autocorrelation time of |r|.
fn effective_shares(rows: &[Row], runs: usize) -> Vec<f64> {
    let share = |run: usize| {
        let errors: Vec<f64> = rows.iter().filter(|row| row.run == run).map(|row| row.error_n).collect();
        1.0 / integrated_time(&errors, Cutoff::FIRST_NOISE)
    };
    (0..runs).map(share).collect()
}

/// Base rows by region, and the source of each region's width.
struct Groups {
    speed_edges_m_s: Edges<{ SPEEDS - 1 }>,
    drive_edges: Edges<{ DRIVES - 1 }>,
    cells: [[Vec<Row>; DRIVES]; SPEEDS],
    speeds: [Vec<Row>; SPEEDS],
    all: Vec<Row>,
    source: [[Source; DRIVES]; SPEEDS],
}

/// Source of a region's width.
#[derive(Clone, Copy, PartialEq)]
enum Source {
    Own,
    Speed,
    All,
}

impl Groups {
    fn new(rows: &[Row], effective: &[f64], has_drive: bool) -> Self {
        let speed_edges_m_s = quantile_edges(rows.iter().map(|row| row.speed_m_s));
        let drives = rows.iter().map(|row| row.drive).filter(|_| has_drive);
        let drive_edges = quantile_edges(drives);
        let mut groups = Self {
            speed_edges_m_s,
            drive_edges,
            cells: Default::default(),
            speeds: Default::default(),
            all: rows.to_vec(),
            source: [[Source::All; DRIVES]; SPEEDS],
        };
        for row in rows {
            let speed = speed_edges_m_s.region(row.speed_m_s);
            groups.cells[speed][drive_edges.region(row.drive)].push(*row);
            groups.speeds[speed].push(*row);
        }
        let enough =
            |rows: &[Row]| rows.iter().map(|row| effective[row.run]).sum::<f64>() >= EFFECTIVE && spans(rows);
        for (speed, drive) in groups.cells().collect::<Vec<_>>() {
            groups.source[speed][drive] = match () {
                () if enough(&groups.cells[speed][drive]) => Source::Own,
                () if enough(&groups.speeds[speed]) => Source::Speed,
                () => Source::All,
            };
        }
        groups
    }
    /// Indices of the existing regions: speed and drive.
    fn cells(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let (speeds, drives) = (self.speed_edges_m_s.len + 1, self.drive_edges.len + 1);
        (0..speeds).flat_map(move |speed| (0..drives).map(move |drive| (speed, drive)))
    }

    /// The rows that determine the width of a region.
    fn rows_for(&self, speed: usize, drive: usize) -> &[Row] {
        match self.source[speed][drive] {
            Source::Own => &self.cells[speed][drive],
            Source::Speed => &self.speeds[speed],
            Source::All => &self.all,
        }
    }

    /// The errors of each region, and the errors that determine its width.
    fn strata(&self) -> Vec<Stratum> {
        fn scores(rows: &[Row]) -> Vec<(usize, f64)> {
            rows.iter().map(|row| (row.run, row.error_n)).collect()
        }
        let stratum = |(speed, drive): (usize, usize)| Stratum {
            own: scores(&self.cells[speed][drive]),
            source: scores(self.rows_for(speed, drive)),
        };
        self.cells().map(stratum).collect()
    }
}

/// Scores, each with its run, that share one width.
struct Stratum {
    /// Scores to be covered.
    own: Vec<(usize, f64)>,
    /// Scores whose quantile is the width.
    source: Vec<(usize, f64)>,
}

/// The quantile level at which left-out runs reach the nominal coverage, on average over their scores.
fn level(strata: &[Stratum], runs: usize) -> f64 {
    /// Number of steps from the level for independent rows to the highest level.
    const STEPS: usize = 36;
    let levels: Vec<f64> = (0..=STEPS).map(|k| COVERAGE + 0.0025 * k as f64).collect();
    let mut covered = vec![0_usize; levels.len()];
    let sorted = |scores: &[(usize, f64)], which: &dyn Fn(usize) -> bool| {
        let mut scores: Vec<f64> = scores.iter().filter(|(run, _)| which(*run)).map(|(_, s)| *s).collect();
        scores.sort_unstable_by(f64::total_cmp);
        scores
    };
    for run in 0..runs {
        for stratum in strata {
            let left_out = sorted(&stratum.own, &|of| of == run);
            if left_out.is_empty() {
                continue;
            }
            let others = sorted(&stratum.source, &|of| of != run);
            for (covered, level) in covered.iter_mut().zip(&levels) {
                let half_band = quantile(&others, *level);
                *covered += left_out.partition_point(|score| *score <= half_band);
            }
        }
    }
    let all: usize = strata.iter().map(|stratum| stratum.own.len()).sum();
    let enough = covered.iter().position(|covered| *covered as f64 >= COVERAGE * all as f64);
    levels[enough.unwrap_or(STEPS)]
}

/// Edges that divide `values` into N + 1 regions of about equal size; fewer edges if values are few and
/// repeat. An edge lies halfway between two values, so that no level of a stepped drive lies on it.
fn quantile_edges<const N: usize>(values: impl Iterator<Item = f64>) -> Edges<N> {
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    values.sort_unstable_by(f64::total_cmp);
    let mut edges = Edges { len: 0, at: [0.0; N] };
    for part in 1..=N {
        let Some(below) = values.get(values.len() * part / (N + 1)) else { continue };
        let Some(above) = values.get(values.partition_point(|value| value <= below)) else { continue };
        let edge = 0.5 * (below + above);
        if edges.as_slice().last().is_none_or(|last| *last < edge) {
            edges.at[edges.len] = edge;
            edges.len += 1;
        }
    }
    edges
}

/// Factors on the widths of `bands` over the time coasted; `None` with too few rows.
fn coasting(rows: &[Row], runs: usize, bands: &Bands, period_s: f64) -> Option<Growth> {
    let samples = (COAST_S / period_s).max(2.0);
    // Each time is twice the previous one, or more if that would give too many times.
    let ratio = (samples / 2.0).powf(1.0 / (TIMES - 2) as f64).max(2.0);
    let mut times: Vec<f64> =
        (0..TIMES - 1).map(|k| (2.0 * ratio.powi(k as i32)).min(samples) * period_s).collect();
    times.dedup();
    let region = |row: &Row| bands.width_at(row.speed_m_s, row.drive);
    let std_dev = |rows: &[Row]| {
        let squares: f64 = rows.iter().map(|row| (row.error_n / region(row).std_dev).powi(2)).sum();
        (squares / rows.len() as f64).sqrt()
    };
    let score = |row: &Row| row.error_n / region(row).half_band;
    let first = (period_s, Width { std_dev: 1.0, half_band: 1.0 });
    Growth::new(&grown(rows, runs, &times, first, std_dev, score)).filter(|growth| growth.len > 1)
}

/// Width that a held drive adds, over its age. If too few runs move their drive, only the usual age of the
/// drive is calibrated.
fn held(rows: &Rows, runs: usize, bands: &Bands) -> Option<Growth> {
    let mut ages: Vec<f64> = rows.base.iter().map(|row| row.time_s).collect();
    ages.sort_unstable_by(f64::total_cmp);
    let fresh_s = ages[(ages.len() - 1) * 99 / 100];
    let fresh = (fresh_s, Width::default());
    let times: Vec<f64> = AGES_S.into_iter().filter(|age| *age > 1.5 * fresh_s).collect();
    let moving = moving(&rows.base);
    let of_moving: Vec<Row> = rows.held.iter().filter(|row| moving[row.run]).copied().collect();
    if !spans(&of_moving) {
        return Growth::new(&[fresh]);
    }
    let region = |row: &Row| bands.width_at(row.speed_m_s, row.drive);
    let std_dev = |rows: &[Row]| {
        let excess: f64 = rows.iter().map(|row| row.error_n.powi(2) - region(row).std_dev.powi(2)).sum();
        (excess / rows.len() as f64).max(0.0).sqrt()
    };
    let score = |row: &Row| (row.error_n.powi(2) - region(row).half_band.powi(2)).max(0.0).sqrt();
    Growth::new(&grown(&of_moving, runs, &times, fresh, std_dev, score))
}

/// For each run number, whether the run moves its drive.
fn moving(rows: &[Row]) -> Vec<bool> {
    let mut ranges: Vec<Option<[f64; 2]>> = Vec::new();
    let mut all = None;
    for row in rows {
        ranges.resize(ranges.len().max(row.run + 1), None);
        Envelope::widen(&mut ranges[row.run], row.drive);
        Envelope::widen(&mut all, row.drive);
    }
    let span = |range: Option<[f64; 2]>| range.map_or(0.0, |[low, high]| high - low);
    ranges.into_iter().map(|range| span(range) > MOVES * span(all)).collect()
}

/// Widths at `times` from the rows near each time, never less than at the previous time; `first` is the time
/// without growth. Times with too few rows are omitted.
fn grown(
    rows: &[Row],
    runs: usize,
    times: &[f64],
    first: (f64, Width),
    std_dev: impl Fn(&[Row]) -> f64,
    score: impl Fn(&Row) -> f64,
) -> Vec<(f64, Width)> {
    let about = |time_s: f64| -> Vec<Row> {
        rows.iter().filter(|row| (row.time_s / time_s - 1.0).abs() <= ABOUT).copied().collect()
    };
    let near = times.iter().map(|time_s| (*time_s, about(*time_s)));
    let near: Vec<(f64, Vec<Row>)> = near.filter(|(_, rows)| rows.len() >= ROWS_AT_TIME).collect();
    let strata: Vec<Stratum> = near
        .iter()
        .map(|(_, rows)| {
            let scores: Vec<(usize, f64)> = rows.iter().map(|row| (row.run, score(row))).collect();
            Stratum { own: scores.clone(), source: scores }
        })
        .collect();
    let level = level(&strata, runs);
    let mut nodes = vec![first];
    for ((time_s, rows), stratum) in near.iter().zip(&strata) {
        let mut scores: Vec<f64> = stratum.own.iter().map(|(_, score)| *score).collect();
        scores.sort_unstable_by(f64::total_cmp);
        let here = Width { std_dev: std_dev(rows), half_band: quantile(&scores, level) };
        let (_, before) = nodes[nodes.len() - 1];
        nodes.push((*time_s, before.max(here)));
    }
    nodes
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    /// `count` independent rows per run, with speeds up to 1 m/s, drives up to 3, and errors of `size(row,
    /// random)`.
    fn rows(runs: usize, count: usize, size: impl Fn(&Row, f64) -> f64) -> Vec<Row> {
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let mut rows = Vec::new();
        for run in 0..runs {
            for _ in 0..count {
                let [speed_m_s, drive, share]: [f64; 3] = random.random();
                let row = Row { run, speed_m_s, drive: 3.0 * drive, time_s: 0.0, error_n: 0.0 };
                rows.push(Row { error_n: size(&row, share), ..row });
            }
        }
        rows
    }

    fn of(base: Vec<Row>) -> Rows {
        Rows { base, ..Rows::default() }
    }

    #[test]
    fn the_rank_matches_split_conformal_prediction() {
        let sorted: Vec<f64> = (1..=99).map(f64::from).collect();
        assert_eq!(quantile(&sorted, 0.9), 90.0);
        assert_eq!(
            quantile(&sorted[..8], 0.9),
            8.0,
            "ceil(9 * .9) exceeds the number of values: the largest"
        );
        assert_eq!(quantile(&sorted[..9], 0.9), 9.0);
    }

    #[test]
    fn a_known_quantile_is_found_in_every_region() {
        // Errors are uniform from 0 to 10 N, and from 0 to 30 N in the upper half of the speeds.
        let size = |row: &Row, share: f64| share * if row.speed_m_s < 0.5 { 10.0 } else { 30.0 };
        let bands = bands(&of(rows(5, 20_000, size)), 5, true, "").expect("enough");
        assert_eq!((bands.speed_edges_m_s.len, bands.drive_edges.len), (3, 2));
        for (edges, expected) in [
            (bands.speed_edges_m_s.as_slice(), [0.25, 0.5, 0.75].as_slice()),
            (bands.drive_edges.as_slice(), &[1.0, 2.0]),
        ] {
            assert!(edges.iter().zip(expected).all(|(e, x)| (e - x).abs() < 0.02), "{edges:?}");
        }
        for (speed, drives) in bands.width_n.iter().enumerate() {
            let most = if speed < 2 { 10.0 } else { 30.0 };
            for width in drives {
                assert!((width.half_band / most - 0.9).abs() < 0.03, "{speed} {width:?}");
                assert!((width.std_dev / most - 1.0 / 3.0_f64.sqrt()).abs() < 0.03, "{speed} {width:?}");
            }
        }
        assert_eq!(bands.drive_held.map(|held| held.len), Some(1), "no drive was held");
    }

    /// Each run has its own error size, so the plain quantile of eight runs covers less than 90 % of a ninth.
    #[test]
    fn differences_between_runs_raise_the_level() {
        let size = |row: &Row, share: f64| share * (1.0 + row.run as f64);
        let of_runs = |size: &dyn Fn(&Row, f64) -> f64| {
            let scores: Vec<(usize, f64)> = rows(8, 4000, size).iter().map(|r| (r.run, r.error_n)).collect();
            level(&[Stratum { own: scores.clone(), source: scores }], 8)
        };
        let (alike, differ) = (of_runs(&|_, share| share), of_runs(&size));
        assert!((alike - 0.9).abs() < 0.004 && differ > 0.915, "{alike} {differ}");
    }

    #[test]
    fn a_region_with_few_rows_takes_the_width_of_its_speed_or_of_all_rows() {
        let size = |_: &Row, share: f64| share;
        // 12 regions of 130 rows, 4 speeds of 390; then 4 speeds of 120.
        for (count, own) in [(520, 4), (160, 1)] {
            let bands = bands(&of(rows(3, count, size)), 3, true, "").expect("enough");
            let mut widths: Vec<u64> =
                bands.width_n.iter().flatten().map(|width| width.half_band.to_bits()).collect();
            widths.sort_unstable();
            widths.dedup();
            assert_eq!(widths.len(), own, "{bands:?}");
        }
    }

    #[test]
    fn repeated_rows_do_not_add_effective_samples() {
        let mut repeated = rows(3, 300, |_, share| share);
        let independent: f64 = effective_shares(&repeated, 3).iter().map(|share| 300.0 * share).sum();
        assert!((500.0..=900.0).contains(&independent), "{independent}");
        repeated = repeated.iter().flat_map(|row| [*row; 50]).collect();
        let still: f64 = effective_shares(&repeated, 3).iter().map(|share| 15_000.0 * share).sum();
        assert!((400.0..=1000.0).contains(&still), "{still}");
    }

    #[test]
    fn too_little_data_is_an_error_that_says_what_to_do() {
        let enough =
            |runs, count| bands(&of(rows(runs, count, |_, share| share)), runs, true, "in simulation");
        for (runs, count, said) in [(2, 9000, "uncertainty: 2 of 3"), (3, 40, "of the 200 that are needed")] {
            let message = enough(runs, count).expect_err("too little").to_string();
            assert!(message.contains(said) && message.contains("hold out at least 3 runs"), "{message}");
        }
        assert!(enough(3, 200).is_ok());
    }

    #[test]
    fn the_width_added_by_a_held_drive_is_found_if_runs_move_their_drive() {
        // Fresh drive: uniform up to 10 N. Held for .1 s: uniform up to 50 N.
        let mut all = of(rows(4, 4000, |_, share| 10.0 * share));
        all.held = rows(4, 4000, |_, share| 50.0 * share);
        all.held.iter_mut().for_each(|row| row.time_s = 0.1);
        let moved = bands(&all, 4, true, "").expect("enough");
        let held = moved.drive_held.expect("a drive");
        assert_eq!((held.len, held.first_s(), held.last_s()), (2, 0.0, 0.1));
        let (whole, least) = (held.at(0.1), held.at(0.05));
        assert!((9.0_f64.hypot(whole.half_band) / 45.0 - 1.0).abs() < 0.03, "{whole:?}");
        assert!((whole.std_dev.powi(2) / ((2500.0 - 100.0) / 3.0) - 1.0).abs() < 0.05, "{whole:?}");
        assert!((least.std_dev - 0.5 * whole.std_dev).abs() < 1e-9);
        for row in all.base.iter_mut().chain(&mut all.held) {
            row.drive = row.run as f64;
        }
        let constant = bands(&all, 4, true, "").expect("enough");
        assert_eq!(constant.drive_held.map(|held| held.len), Some(1));
    }
}
