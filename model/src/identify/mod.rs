//! Identification of force models from recorded runs.
//!
//! ```text
//! ARX          F_k = phi_k . a + c_run                        linear: QR in panels, SVD, minimum norm
//! fuzzy-tanh   F = sum_j w_j(i) f_j(x, v) + o_run             nonlinear: bounded Levenberg-Marquardt,
//!              f = A1 tanh(A3 u) + A2 u,   u = v + kappa x    seeded random restarts
//! maxwell-slip F = sum_j w_j(i) p_j . s_j + o_run             linear: normal equations, some p_j not negative
//! TSK          F = sum_r w_r(x, v, a, i) f_r + o_run          hybrid learning: linear least squares for the
//!                                                             conclusions, gradient steps for the memberships
//! ```
//!
//! Several runs are fitted together, each with its own force offset: gas preload and load cell zero differ by
//! tens of newtons between sessions. All runs must have the same kind of drive. The fuzzy-tanh model has no
//! memory, so its runs may differ in rate; an ARX model is valid for one rate only. Rows come from
//! [`Dataset`], which conditions runs as the live pipeline does. All counted rows have equal weight, so the
//! fit minimises the RMSE over all of them.
//!
//! ARX is fitted to its one-step-ahead prediction and fuzzy-tanh to its simulation (free run), as each is
//! used. Simulation errors are reported for both. One-step-ahead errors are reported together with the error
//! of persistence, for comparison.
//!
//! ```
//! use mr_damper_model::identify::{ModelSpec, Options, Watch, identify};
//! # use mr_damper_model::sample::{DriveKind, Run, Stamp, Trace};
//! # let trace = |f: fn(f64) -> f64| Trace {
//! #     stamps: (0..2000).map(|k| Stamp::from_nanos(k * 2_000_000)).collect(),
//! #     values: (0..2000).map(|k| f(k as f64 * 0.002)).collect(),
//! # };
//! # let run = Run {
//! #     name: "sine".into(),
//! #     displacement_m: trace(|t| 0.01 * (6.0 * t).sin()),
//! #     force_n: Some(trace(|t| 300.0 * (40.0 * 0.06 * (6.0 * t).cos()).tanh())),
//! #     drive: Some((DriveKind::CoilCurrent, trace(|_| 0.5))),
//! #     ..Run::default()
//! # };
//! let found = identify(ModelSpec::FUZZY_TANH, &[run], &Options::default(), &Watch::none())?;
//! assert!(found.free_run.expect("a fuzzy-tanh model can be simulated").esr < 1e-4);
//! # Ok::<(), mr_damper_model::Error>(())
//! ```

mod arx;
mod dataset;
mod fit;
mod free_sets;
mod fuzzy_tanh;
mod inverse;
mod law;
mod lazy;
pub mod least_squares;
mod levels;
mod lpv;
mod maxwell_slip;
mod network;
mod nonnegative;
mod offsets;
mod options;
mod phase;
mod prior;
mod recursive;
mod regression;
mod report;
mod row_problem;
mod scales;
mod score;
mod search;
mod spec;
mod swarm;
mod swept;
mod tanh_columns;
mod tsk;
mod unrolled;
mod velocity;
mod watch;

pub use crate::force::Form;
pub use dataset::{Dataset, DatasetOptions, Row};
pub use inverse::{CurrentFit, IdentifiedInverse, identify_inverse, score_inverse};
pub(crate) use inverse::{identify_inverse_datasets, shows_current, simulate_inverse};
pub use levels::{MembershipSource, Memberships};
pub use options::{Loss, Options, Placement};
pub use phase::{IdentifiedPhase, PhaseOptions, explained_n, identify_phase, score_phase};
pub use report::{ActiveBound, Identified, ParameterValue, RunFit, WithoutPrior};
pub(crate) use scales::Scales;
pub(crate) use score::check as check_runs;
pub use score::{Predicted, Scores, persistence, score, sum_of_free_run, walk};
pub use spec::{ModelSpec, Structure, Variant};
pub(crate) use swept::sweep;
pub use swept::{SweptFault, SweptFaultKind, SweptRange, SweptResponse, SweptSine};
pub use tsk::{Algorithm, BackPropagation, Evolution, FittedTsk, Learning, TskOptions, fit_tsk};
pub use velocity::VelocityTrial;
pub use watch::{Progress, Watch};

use crate::condition::Conditioning;
use crate::error::{Error, IdentifyError};
use crate::force::MAX_DEGREE;
use crate::parallel;
use crate::sample::{DriveKind, Run};

/// Identifies a model from `runs`.
///
/// # Errors
/// [`Error::MissingChannel`] for a run without force, or without the required drive or velocity.
/// [`Error::WrongDrive`] if the runs differ in their kind of drive; [`Error::Identify`] for too little data,
/// constant data, or incompatible rates; [`Error::OutOfRange`] and [`Error::Length`] for invalid options;
/// [`Error::Cancelled`].
pub fn identify(
    spec: ModelSpec,
    runs: &[Run],
    options: &Options,
    watch: &Watch,
) -> Result<Identified, Error> {
    watch.report(Progress::Conditioning { runs: runs.len() as u32 });
    check_options(spec, options)?;
    let drive = check_drives(spec, runs.iter().map(|run| (run.name.as_str(), run.drive_kind())))?;
    let (conditioning, velocity_trials) = if options.choose_velocity && !spec.feeds_on_force() {
        velocity::choose(runs, options, watch, |datasets| {
            fit::sample_esr(spec, drive, datasets, options, watch)
        })?
    } else {
        (options.conditioning, Vec::new())
    };
    let datasets = datasets(runs, &conditioning, options, watch)?;
    let found = fit::fit(spec, drive, &datasets, options, watch)?;
    Ok(Identified { velocity_trials, ..found })
}

/// Identifies a model from conditioned runs, so that many models can share them. All runs must have the same
/// conditioning. `conditioning`, `choose_velocity` and `dataset` of `options` are ignored.
///
/// ```
/// use mr_damper_model::condition::Conditioning;
/// use mr_damper_model::identify::{Dataset, DatasetOptions, ModelSpec, Options, Watch, identify_datasets, persistence};
/// use mr_damper_model::rig::{Channels, Experiment, Plant, record};
///
/// let experiment = Experiment::thesis("RP-ICPS").expect("an experiment of the thesis").with_duration_s(8.0);
/// let run = record(&experiment, &Plant::default(), &Channels::default(), 1);
/// let data = [Dataset::from_run(&run, &Conditioning::default(), &DatasetOptions::default())?];
///
/// // Least-squares fits to the same rows: the drive terms reduce the error of the one-step-ahead prediction.
/// let rsse_n = |spec| {
///     let found = identify_datasets(spec, &data, &Options::default(), &Watch::none())?;
///     Ok::<f64, mr_damper_model::Error>(found.one_step.expect("ARX predicts from force").rsse_n)
/// };
/// let (passive_n, semi_active_n) = (rsse_n(ModelSpec::ARX_PASSIVE)?, rsse_n(ModelSpec::ARX_SEMI_ACTIVE)?);
/// let persistence_n = persistence(&data[0]).expect("there are rows").rsse_n;
/// assert!(semi_active_n < passive_n && passive_n < persistence_n, "{semi_active_n} {passive_n} {persistence_n}");
/// # Ok::<(), mr_damper_model::Error>(())
/// ```
///
/// # Errors
/// As [`identify`]; also [`IdentifyError::DifferentConditioning`].
pub fn identify_datasets(
    spec: ModelSpec,
    datasets: &[Dataset],
    options: &Options,
    watch: &Watch,
) -> Result<Identified, Error> {
    check_options(spec, options)?;
    let drive = check_drives(spec, datasets.iter().map(|d| (d.name.as_str(), d.drive)))?;
    check_rows(datasets)?;
    if let Some(other) = datasets.iter().find(|d| d.conditioning != datasets[0].conditioning) {
        return Err(IdentifyError::DifferentConditioning {
            runs: [datasets[0].name.clone(), other.name.clone()],
        }
        .into());
    }
    fit::fit(spec, drive, datasets, options, watch)
}

/// Refuses settings that are invalid or that the structure would ignore.
fn check_options(spec: ModelSpec, options: &Options) -> Result<(), Error> {
    if !spec.structure().can_run() {
        return Err(fit::cannot_run());
    }
    Error::check("degree", options.degree as f64, "1 to 5", |d| (1.0..=MAX_DEGREE as f64).contains(&d))?;
    if let Loss::Huber { threshold_n } = options.loss {
        Error::check("huber", threshold_n, "positive and finite", |t| t > 0.0)?;
        if !matches!(spec.structure(), Structure::FuzzyTanh | Structure::Law(_)) {
            return Err(IdentifyError::LeastSquaresOnly { model: spec.structure().name() }.into());
        }
    }
    if options.placement != Placement::FromRuns && !spec.has_sets() {
        return Err(IdentifyError::NoSets { model: spec.structure().name(), form: spec.form().name() }.into());
    }
    Ok(())
}

/// Conditions the runs. Each must have counted rows.
fn datasets(
    runs: &[Run],
    conditioning: &Conditioning,
    options: &Options,
    watch: &Watch,
) -> Result<Vec<Dataset>, Error> {
    let one = |run: &Run| {
        if watch.is_cancelled() {
            return Err(Error::Cancelled);
        }
        Dataset::from_run(run, conditioning, &options.dataset)
    };
    // The runs are processed in parallel, but the reported error is always the first run's.
    let results: Vec<Result<Dataset, Error>> = parallel::map(runs, one);
    let datasets = results.into_iter().collect::<Result<Vec<Dataset>, Error>>()?;
    check_rows(&datasets)?;
    Ok(datasets)
}

/// Refuses runs without counted rows, and runs whose force is constant.
fn check_rows(datasets: &[Dataset]) -> Result<(), Error> {
    if let Some(still) = datasets.iter().find(|d| d.counted() == 0) {
        return Err(IdentifyError::NothingCounts { run: still.name.clone() }.into());
    }
    datasets.iter().try_for_each(check_sign)?;
    let varies = |d: &Dataset| d.envelope.force_n.is_some_and(|[low, high]| high > low);
    if datasets.iter().any(varies) {
        return Ok(());
    }
    Err(IdentifyError::ConstantForce {
        force_n: datasets[0].envelope.force_n.map_or(f64::NAN, |[low, _]| low),
    }
    .into())
}

/// Largest correlation of force and velocity of a machine that takes up energy, with the other sign. A spring or a mass alone gives zero.
const REVERSED: f64 = -0.2;

/// Refuses a run whose force has the other sign than its velocity: a load cell or a displacement sensor is reversed, because a damper
/// gives off no energy. A fit to such a run looks good, and its model would push where the damper brakes.
pub(crate) fn check_sign(run: &Dataset) -> Result<(), Error> {
    let rows = || run.rows.iter().filter(|row| row.counts);
    let pairs: Vec<(f64, f64)> = rows().map(|row| (row.force_n, row.velocity_m_s)).collect();
    let correlation = crate::statistics::correlation::pearson(&pairs);
    if correlation > REVERSED || correlation.is_nan() {
        return Ok(());
    }
    let power_w =
        pairs.iter().map(|(force_n, velocity_m_s)| force_n * velocity_m_s).sum::<f64>() / pairs.len() as f64;
    Err(IdentifyError::ReversedForce { run: run.name.clone(), correlation, power_w }.into())
}

/// The kind of drive of all runs, given by name and drive; `None` for a passive model.
fn check_drives<'a>(
    spec: ModelSpec,
    runs: impl Iterator<Item = (&'a str, Option<DriveKind>)>,
) -> Result<Option<DriveKind>, Error> {
    let mut runs = runs.peekable();
    if runs.peek().is_none() {
        return Err(IdentifyError::NoRuns.into());
    }
    if !spec.needs_drive() {
        return Ok(None);
    }
    let mut needed: Option<DriveKind> = None;
    for (name, drive) in runs {
        let found = drive.ok_or_else(|| Error::MissingChannel {
            run: name.to_owned(),
            channel: "current_a or command_v",
            needed_by: "the model".to_owned(),
        })?;
        let needed = *needed.get_or_insert(found);
        if found != needed {
            return Err(Error::WrongDrive {
                run: name.to_owned(),
                found: found.name(),
                needed: needed.name(),
            });
        }
    }
    Ok(needed)
}

/// Mean of the runs' offsets, weighted by counted rows, N.
fn mean_offset(datasets: &[Dataset], offsets_n: &[f64]) -> f64 {
    let weights = datasets.iter().map(|d| d.counted() as f64);
    let (sum, weight) =
        weights.zip(offsets_n).fold((0.0, 0.0), |(sum, weight), (w, offset)| (sum + w * offset, weight + w));
    if weight > 0.0 { sum / weight } else { 0.0 }
}
