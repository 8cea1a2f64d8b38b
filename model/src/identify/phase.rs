//! Identification of the phase-transition relation P (thesis 4.6, 4.7): linear least squares.
//!
//! ```text
//! F_k = p1 v_k + p2 F'_k + p3 F''_k + p4 F_k^3 + p5 F_k^5 + e_k,      p_j a polynomial in the drive
//! ```
//!
//! F is relative to the mean of its run, which serves as the offset of the session. Derivatives of the
//! measured force are central differences over a few samples to either side, within one segment. They are
//! **not causal**: they use force after the instant. The figures are named `same_instant`, because force is
//! explained by itself. They say how well the relation holds, not how well it predicts, and must not be
//! compared with simulation errors.
//!
//! Noise in F enters the regressors, above all F'', and biases their coefficients towards zero. A longer
//! reach of the differences reduces the noise, but attenuates changes that are faster than the reach.
//!
//! Source: `[wang2006]` in the bibliography (node/docs/guide/bibliography.md), equations 4.6 and 4.7 of the thesis.

use super::regression::{Solution, Triangle};
use super::{Dataset, Watch};
use crate::error::{Error, IdentifyError};
use crate::force::{ForceMotion, MAX_DEGREE, PHASE_PARAMETERS, Phase};
use crate::metrics::{ErrorSum, Fit};
use crate::sample::DriveKind;
use nalgebra::DVector;

/// Smallest number of rows per coefficient.
const ROWS_PER_PARAMETER: usize = 10;

/// Settings of an identification of P.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhaseOptions {
    /// The drive of the polynomials; `None` for the passive form.
    pub drive: Option<DriveKind>,
    /// Degree of the polynomials, 1 to 5; the thesis uses 2. Ignored without a drive.
    pub degree: usize,
    /// Reach of the central differences of force to either side, s; at least one sample.
    pub reach_s: f64,
}

impl Default for PhaseOptions {
    fn default() -> Self {
        Self { drive: None, degree: 2, reach_s: 0.01 }
    }
}

/// Result of an identification of P.
#[derive(Debug, Clone, PartialEq)]
pub struct IdentifiedPhase {
    /// The relation.
    pub phase: Phase,
    /// The mean force of each run, N, which was subtracted.
    pub offsets_n: Vec<f64>,
    /// Error of the relation at the fitted instants. It is not a prediction error.
    pub same_instant: Fit,
    /// Number of independent regressors; less than the number of coefficients if the drive is constant.
    pub rank: usize,
}

/// Fits P to `datasets`.
///
/// ```
/// use mr_damper_model::condition::Conditioning;
/// use mr_damper_model::identify::{Dataset, DatasetOptions, PhaseOptions, Watch, identify_phase, score_phase};
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let experiment = Experiment::thesis("RP-ICPS").expect("an experiment of the thesis").with_duration_s(8.0);
/// let run = record(&experiment, &Plant::default(), &Channels::default(), 1);
/// let data = [Dataset::from_run(&run, &Conditioning::THESIS, &DatasetOptions::default())?];
/// let options = PhaseOptions::default();
/// let found = identify_phase(&data, &options, &Watch::none())?;
/// // The relation explains more than half of the variance of the force at the same instant. It cannot run, because its
/// // differential equation is unstable.
/// assert!(found.same_instant.esr < 0.5, "NMSE {}", found.same_instant.esr);
/// assert!(found.phase.cannot_run(f64::NAN).is_some());
/// assert_eq!(score_phase(&found.phase, &data[0], &options)?, Some(found.same_instant));
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// [`IdentifyError`] without datasets, with too few rows, or with constant force; [`Error::WrongDrive`] if a
/// run does not have `options.drive`; [`Error::OutOfRange`] for invalid options; [`Error::Cancelled`].
pub fn identify_phase(
    datasets: &[Dataset],
    options: &PhaseOptions,
    watch: &Watch,
) -> Result<IdentifiedPhase, Error> {
    Error::check("reach_s", options.reach_s, "positive and finite", |s| s > 0.0)?;
    let copies = match options.drive {
        Some(kind) => {
            Error::check("degree", options.degree as f64, "1 to 5", |d| {
                (1.0..=MAX_DEGREE as f64).contains(&d)
            })?;
            check_drives(datasets, kind)?;
            options.degree + 1
        }
        None => 1,
    };
    let n = PHASE_PARAMETERS * copies;
    let offsets_n: Vec<f64> = datasets.iter().map(mean_force).collect();
    let of_run =
        |(dataset, offset_n): (&Dataset, &f64)| instants(dataset, *offset_n, options.reach_s, copies);
    let instants: Vec<Vec<Instant>> = datasets.iter().zip(&offsets_n).map(of_run).collect();
    let count: usize = instants.iter().map(Vec::len).sum();
    if count < ROWS_PER_PARAMETER * n {
        return Err(IdentifyError::TooFewSamples {
            model: "p",
            which: Some("with force on both sides".to_owned()),
            samples: count,
            needed: ROWS_PER_PARAMETER * n,
            count: n,
            parts: "coefficients",
        }
        .into());
    }
    let mut triangle = Triangle::new(n + 1);
    for run in &instants {
        for instant in run {
            triangle.push(instant.row(copies).iter().copied());
        }
        if watch.is_cancelled() {
            return Err(Error::Cancelled);
        }
    }
    let Solution { coefficients, rank, .. } = triangle.solve(&DVector::zeros(n))?;
    let phase = Phase::new(options.drive, coefficients.as_slice())?;
    let mut sum = ErrorSum::default();
    for at in instants.iter().flatten() {
        sum.add(at.force.force_n, phase.same_instant_n(at.velocity_m_s, &at.force, at.drive));
    }
    let same_instant = sum.fit().ok_or(IdentifyError::Constant { channel: "force" })?;
    Ok(IdentifiedPhase { phase, offsets_n, same_instant, rank })
}

/// How well `phase` holds on `dataset`, with the settings of its identification; not a prediction error.
/// `None` if no row has force on both sides, or if the relation has no finite force.
///
/// # Errors
/// [`Error::MissingChannel`] and [`Error::WrongDrive`] if the run does not have the relation's drive.
pub fn score_phase(phase: &Phase, dataset: &Dataset, options: &PhaseOptions) -> Result<Option<Fit>, Error> {
    if let Some(kind) = options.drive {
        check_drives(std::slice::from_ref(dataset), kind)?;
    }
    let mut sum = ErrorSum::default();
    for at in instants(dataset, mean_force(dataset), options.reach_s, 1) {
        sum.add(at.force.force_n, phase.same_instant_n(at.velocity_m_s, &at.force, at.drive));
    }
    Ok(sum.fit().filter(|fit| fit.rsse_n.is_finite()))
}

/// The force in newtons by which `phase` explains each counted row of `dataset` that has force on both sides, with the index of the row.
/// The mean force of the run, which the relation leaves out, is added. The drive of the run must be that of the relation.
///
/// ```
/// use mr_damper_model::condition::Conditioning;
/// use mr_damper_model::identify::{Dataset, DatasetOptions, PhaseOptions, explained_n, identify_phase, Watch};
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let run = record(&Experiment::sine(0.01, 2.0, 1.2, 4.0), &Plant::default(), &Channels::default(), 1);
/// let data = Dataset::from_run(&run, &Conditioning::THESIS, &DatasetOptions::default())?;
/// let options = PhaseOptions::default();
/// let found = identify_phase(std::slice::from_ref(&data), &options, &Watch::none())?;
/// let forces = explained_n(&found.phase, &data, &options);
/// let squares = forces.iter().map(|(row, force_n)| (data.rows[*row].force_n - force_n).powi(2)).sum::<f64>();
/// let rmse_n = (squares / forces.len() as f64).sqrt();
/// assert!((rmse_n / found.same_instant.rsse_n - 1.0).abs() < 1e-9);
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
#[must_use]
pub fn explained_n(phase: &Phase, dataset: &Dataset, options: &PhaseOptions) -> Vec<(usize, f64)> {
    let mean_n = mean_force(dataset);
    let force_n = |at: &Instant| mean_n + phase.same_instant_n(at.velocity_m_s, &at.force, at.drive);
    instants(dataset, mean_n, options.reach_s, 1).iter().map(|at| (at.index, force_n(at))).collect()
}

/// A row that is used.
struct Instant {
    /// Its place in the dataset.
    index: usize,
    velocity_m_s: f64,
    drive: f64,
    force: ForceMotion,
}

impl Instant {
    /// Regressors of each copy, followed by the force.
    fn row(&self, copies: usize) -> DVector<f64> {
        let f = self.force.force_n;
        let terms = [self.velocity_m_s, self.force.rate_n_s, self.force.curvature_n_s2, f.powi(3), f.powi(5)];
        let mut row = DVector::zeros(PHASE_PARAMETERS * copies + 1);
        let mut power = 1.0;
        for copy in 0..copies {
            for (j, term) in terms.iter().enumerate() {
                row[PHASE_PARAMETERS * copy + j] = term * power;
            }
            power *= self.drive;
        }
        row[PHASE_PARAMETERS * copies] = f;
        row
    }
}

fn check_drives(datasets: &[Dataset], kind: DriveKind) -> Result<(), Error> {
    for dataset in datasets {
        match dataset.drive {
            Some(found) if found == kind => {}
            Some(found) => {
                return Err(Error::WrongDrive {
                    run: dataset.name.clone(),
                    found: found.name(),
                    needed: kind.name(),
                });
            }
            None => {
                return Err(Error::MissingChannel {
                    run: dataset.name.clone(),
                    channel: kind.name(),
                    needed_by: "the semi-active form of p".to_owned(),
                });
            }
        }
    }
    Ok(())
}

/// Mean force of the counted rows, N; zero if there are none.
fn mean_force(dataset: &Dataset) -> f64 {
    let mut sum = ErrorSum::default();
    dataset.rows.iter().filter(|row| row.counts).for_each(|row| sum.add(row.force_n, 0.0));
    sum.mean_error_n()
}

/// Counted rows with force up to `reach_s` on both sides within their segment.
fn instants(dataset: &Dataset, offset_n: f64, reach_s: f64, copies: usize) -> Vec<Instant> {
    let rows = &dataset.rows;
    let apart_s = |a: usize, b: usize| rows[b].stamp.since(rows[a].stamp).get();
    // A small tolerance, so that jitter of the stamps does not change the number of samples.
    let reach_s = reach_s * (1.0 + 1e-6);
    let mut found = Vec::with_capacity(rows.len());
    let (mut first, mut from) = (0, 0);
    for k in 0..rows.len() {
        if rows[k].dt_s.is_none() {
            (first, from) = (k, k);
        }
        while from + 1 < k && apart_s(from, k) > reach_s {
            from += 1;
        }
        if k == first || !rows[k].counts {
            continue;
        }
        // As many samples after as before.
        let from = from.min(k - 1);
        let to = k + (k - from);
        if to >= rows.len() || rows[k + 1..=to].iter().any(|row| row.dt_s.is_none()) {
            continue;
        }
        let (before_s, after_s) = (apart_s(from, k), apart_s(k, to));
        let before = (rows[k].force_n - rows[from].force_n) / before_s;
        let after = (rows[to].force_n - rows[k].force_n) / after_s;
        let span_s = before_s + after_s;
        let force = ForceMotion {
            force_n: rows[k].force_n - offset_n,
            rate_n_s: (before * after_s + after * before_s) / span_s,
            curvature_n_s2: 2.0 * (after - before) / span_s,
        };
        let instant = Instant { index: k, velocity_m_s: rows[k].velocity_m_s, drive: rows[k].drive, force };
        if instant.row(copies).iter().all(|v| v.is_finite()) {
            found.push(instant);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::condition::Conditioning;
    use crate::identify::Row;
    use crate::preset;
    use crate::sample::Stamp;

    const OFFSET_N: f64 = 40.0;

    /// Eight seconds at 2 kHz of a periodic force, and the velocity that `phase` assigns to it.
    fn dataset(phase: &Phase) -> Dataset {
        let parts = [(200.0, 0.5), (120.0, 1.75), (60.0, 3.25)];
        let row = |k: usize| {
            let t = k as f64 * 5e-4;
            let mut force = ForceMotion { force_n: 0.0, rate_n_s: 0.0, curvature_n_s2: 0.0 };
            for (size, hz) in parts {
                let omega = std::f64::consts::TAU * hz;
                force.force_n += size * (omega * t).sin();
                force.rate_n_s += size * omega * (omega * t).cos();
                force.curvature_n_s2 -= size * omega * omega * (omega * t).sin();
            }
            let drive = 1.2 + (0.9 * t).sin();
            Row {
                stamp: Stamp::from_nanos(k as i64 * 500_000),
                dt_s: (k > 0).then_some(5e-4),
                displacement_m: 0.0,
                velocity_m_s: phase.velocity_m_s(&force, drive),
                acceleration_m_s2: f64::NAN,
                drive,
                case_temp_c: f64::NAN,
                force_n: force.force_n + OFFSET_N,
                raw_force_n: force.force_n + OFFSET_N,
                counts: true,
            }
        };
        let rows = (0..16_000).map(row).collect();
        Dataset::from_rows("made", Some(DriveKind::CoilCurrent), Conditioning::default(), 2_000.0, rows)
    }

    #[test]
    fn identification_recovers_the_relation_behind_the_data() {
        for (name, drive) in [
            ("thesis/p-passive/rp-icps", None),
            ("thesis/p-semi-active/rp-icps-l", Some(DriveKind::CoilCurrent)),
        ] {
            let truth = preset::phase(name).expect("a preset");
            let options = PhaseOptions { drive, reach_s: 1e-3, ..PhaseOptions::default() };
            let found = identify_phase(&[dataset(&truth)], &options, &Watch::none()).expect("identified");
            assert_eq!(found.rank, truth.parameter_count());
            assert!((found.offsets_n[0] - OFFSET_N).abs() < 0.01);
            assert!(found.same_instant.esr < 1e-8, "{:?}", found.same_instant);
            for i in [0.4, 1.2, 2.0] {
                let pairs = found.phase.parameters_at(i).into_iter().zip(truth.parameters_at(i));
                for ((one, other), what) in pairs.zip(crate::force::PHASE_NAMES) {
                    assert!((one - other).abs() < 5e-3 * other.abs(), "{name} {what} {i} A: {one}, {other}");
                }
            }
        }
    }

    #[test]
    fn differences_do_not_cross_a_gap() {
        let truth = preset::phase("thesis/p-passive/rp1-cs").expect("a preset");
        let mut with_gap = dataset(&truth);
        // The force of the second segment is unrelated to the first segment's.
        with_gap.rows.truncate(4_000);
        with_gap.rows[2_000].dt_s = None;
        for row in &mut with_gap.rows[..2_000] {
            row.force_n = OFFSET_N;
        }
        let reach_s = 4.0 * 5e-4;
        let found = instants(&with_gap, OFFSET_N, reach_s, 1);
        assert!(found[..1_995].iter().all(|at| at.force.rate_n_s == 0.0 && at.force.curvature_n_s2 == 0.0));
        // The ends of each segment are excluded: one sample at its start, four at its end.
        assert_eq!(found.len(), 4_000 - 2 * (1 + 4));
    }

    #[test]
    fn errors_name_what_is_missing() {
        let truth = preset::phase("thesis/p-passive/rp1-cs").expect("a preset");
        let mut short = dataset(&truth);
        short.rows.truncate(40);
        let error = |data: &Dataset, options: PhaseOptions| {
            identify_phase(std::slice::from_ref(data), &options, &Watch::none())
                .expect_err("refused")
                .to_string()
        };
        assert!(error(&short, PhaseOptions::default()).contains("too few for the 5 coefficients of p"));
        let on_voltage = PhaseOptions { drive: Some(DriveKind::CommandVoltage), ..PhaseOptions::default() };
        assert!(error(&dataset(&truth), on_voltage).contains("current_a"));
        let nowhere = PhaseOptions { reach_s: 0.0, ..PhaseOptions::default() };
        assert!(error(&dataset(&truth), nowhere).contains("reach_s is 0"));
    }
}
