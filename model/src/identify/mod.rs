//! Identification of force models from recorded runs.
//!
//! ```text
//! ARX          F_k = phi_k . a + c_run                        linear: QR in panels, SVD, minimum norm
//! fuzzy-tanh   F = sum_j w_j(i) f_j(x, v) + o_run             nonlinear: bounded Levenberg-Marquardt,
//!              f = A1 tanh(A3 u) + A2 u,   u = v + kappa x    restarts drawn from a seed
//! TSK          F = sum_r w_r(x, v, a, i) f_r + o_run          hybrid learning: conclusions by linear least
//!                                                             squares, memberships around them
//! ```
//!
//! Several runs are fitted at once, each with a force offset of its own: sessions differ by tens of newtons
//! in gas preload and load cell zero. Runs of one drive kind only. The fuzzy-tanh model has no memory, so
//! runs may differ in rate; an ARX model holds at one rate. Rows come from [`Dataset`], which conditions runs
//! as the live pipeline does; each row that counts weighs the same, so the fit minimises the RSSE of the rows
//! together.
//!
//! ARX is fitted one step ahead and fuzzy-tanh running free, which is how each is used. Both are reported
//! running free; one step ahead stands beside persistence, which says what the figure is worth.
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
//! assert!(found.free_run.expect("a fuzzy-tanh model runs free").esr < 1e-4);
//! # Ok::<(), mr_damper_model::Error>(())
//! ```

mod arx;
mod dataset;
mod fit;
mod free_sets;
mod fuzzy_tanh;
mod law;
mod lazy;
pub mod least_squares;
mod levels;
mod lpv;
mod network;
mod offsets;
mod options;
mod phase;
mod regression;
mod report;
mod row_problem;
mod scales;
mod score;
mod search;
mod spec;
mod tanh_columns;
mod tsk;
mod unrolled;
mod velocity;
mod watch;

pub use dataset::{Dataset, DatasetOptions, Row};
pub use levels::{MembershipSource, Memberships};
pub use options::{Loss, Options, Placement};
pub use phase::{IdentifiedPhase, PhaseOptions, identify_phase, score_phase};
pub use report::{ActiveBound, Identified, ParameterValue, RunFit};
pub(crate) use scales::Scales;
pub(crate) use score::check as check_runs;
pub use score::{Predicted, Scores, persistence, score, sum_of_free_run, walk};
pub use spec::{Form, ModelSpec, Structure};
pub use tsk::{Evolution, FittedTsk, Learning, TskOptions, fit_tsk};
pub use velocity::VelocityTrial;
pub use watch::{Progress, Watch};

use crate::condition::Conditioning;
use crate::error::Error;
use crate::sample::{DriveKind, Run};
use rayon::prelude::*;

/// Identifies a model from `runs`.
///
/// # Errors
/// [`Error::MissingChannel`] for a run without force, or without the drive or velocity that is wanted;
/// [`Error::WrongDrive`] when kinds of drive are mixed; [`Error::Data`] for too little data, data that never
/// vary, or rates that do not go together; [`Error::OutOfRange`] and [`Error::Length`] for options that mean
/// nothing; [`Error::Cancelled`].
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

/// Identifies a model from runs that are conditioned already, all alike: rows that many models can share.
/// `conditioning`, `choose_velocity` and `dataset` of `options` have had their say by then.
///
/// # Errors
/// As [`identify`]; also [`Error::Data`] for runs that are conditioned differently.
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
        return Err(Error::Data {
            message: format!(
                "runs {} and {} are conditioned differently: a model holds for one conditioning",
                datasets[0].name, other.name
            ),
        });
    }
    fit::fit(spec, drive, datasets, options, watch)
}

/// Refuses settings that mean nothing, or that the structure would ignore.
fn check_options(spec: ModelSpec, options: &Options) -> Result<(), Error> {
    if !spec.structure().can_run() {
        return Err(fit::cannot_run());
    }
    Error::check("degree", options.degree as f64, "1 to 4", |d| (1.0..=4.0).contains(&d))?;
    if let Loss::Huber { threshold_n } = options.loss {
        Error::check("huber", threshold_n, "positive and finite", |t| t > 0.0)?;
        if !matches!(spec.structure(), Structure::FuzzyTanh | Structure::Law(_)) {
            return Err(Error::Data {
                message: format!(
                    "{} is fitted by squares alone; leave Huber's loss out",
                    spec.structure().name()
                ),
            });
        }
    }
    if options.placement != Placement::FromRuns && !spec.has_sets() {
        return Err(Error::Data {
            message: format!(
                "{} ({}) has no fuzzy sets over the drive to place; leave their centres and number out, or take a fuzzy \
                 form",
                spec.structure().name(),
                spec.form().name()
            ),
        });
    }
    Ok(())
}

/// Conditions the runs. Each must have rows that count.
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
    // In parallel, yet the error that is reported is the first run's.
    let results: Vec<Result<Dataset, Error>> = runs.par_iter().map(one).collect();
    let datasets = results.into_iter().collect::<Result<Vec<Dataset>, Error>>()?;
    check_rows(&datasets)?;
    Ok(datasets)
}

/// Refuses runs without a row that counts, and runs in which the force never varies.
fn check_rows(datasets: &[Dataset]) -> Result<(), Error> {
    if let Some(still) = datasets.iter().find(|d| d.counted() == 0) {
        return Err(Error::Data {
            message: format!(
                "run {}: no sample counts: the damper never moves, the run is too short for the filter to settle, or \
                 force and displacement do not overlap in time",
                still.name
            ),
        });
    }
    let varies = |d: &Dataset| d.envelope.force_n.is_some_and(|[low, high]| high > low);
    if datasets.iter().any(varies) {
        return Ok(());
    }
    Err(Error::Data {
        message: format!(
            "force_n never varies in these runs (it stays at {} N): nothing can be identified from them; look at the \
             load cell",
            datasets[0].envelope.force_n.map_or(f64::NAN, |[low, _]| low)
        ),
    })
}

/// The kind of drive that the model gets from the runs, each by its name and drive; `None` for a passive model.
fn check_drives<'a>(
    spec: ModelSpec,
    runs: impl Iterator<Item = (&'a str, Option<DriveKind>)>,
) -> Result<Option<DriveKind>, Error> {
    let mut runs = runs.peekable();
    if runs.peek().is_none() {
        return Err(Error::Data { message: "there are no runs to identify from".to_owned() });
    }
    if !spec.wants_drive() {
        return Ok(None);
    }
    let mut wanted: Option<DriveKind> = None;
    for (name, drive) in runs {
        let found = drive.ok_or_else(|| Error::MissingChannel {
            run: name.to_owned(),
            channel: "current_a or command_v",
            needed_by: "the model".to_owned(),
        })?;
        let wanted = *wanted.get_or_insert(found);
        if found != wanted {
            return Err(Error::WrongDrive {
                run: name.to_owned(),
                found: found.name(),
                wanted: wanted.name(),
            });
        }
    }
    Ok(wanted)
}

/// Mean of the runs' offsets, weighted by the rows that count, N.
fn mean_offset(datasets: &[Dataset], offsets_n: &[f64]) -> f64 {
    let weights = datasets.iter().map(|d| d.counted() as f64);
    let (sum, weight) =
        weights.zip(offsets_n).fold((0.0, 0.0), |(sum, weight), (w, offset)| (sum + w * offset, weight + w));
    if weight > 0.0 { sum / weight } else { 0.0 }
}
