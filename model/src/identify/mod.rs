//! Identification of force models from recorded runs.
//!
//! ```text
//! ARX          F_k = phi_k . a + c_run                        linear: QR in panels, SVD, minimum norm
//! fuzzy-tanh   F = sum_j w_j(i) f_j(x, v) + o_run             nonlinear: bounded Levenberg-Marquardt,
//!              f = A1 tanh(A3 u) + A2 u,   u = v + kappa x    restarts drawn from a seed
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
mod fuzzy_tanh;
mod lazy;
pub mod least_squares;
mod levels;
mod network;
mod offsets;
mod report;
mod spec;
mod tanh_problem;
mod unrolled;
mod velocity;

pub use dataset::{Dataset, DatasetOptions, Row};
pub use levels::{MembershipSource, Memberships};
pub use report::{ActiveBound, Identified, RunFit};
pub use spec::{Form, ModelSpec, Structure};
pub use velocity::VelocityTrial;

use crate::condition::Conditioning;
use crate::error::Error;
use crate::force::{ForceModel, LAGS, SAVARESI_LAGS};
use crate::model::{Envelope, Expected, Model};
use crate::sample::{DriveKind, Run};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering};

/// Membership centres and width, when they are given rather than taken from the data.
#[derive(Debug, Clone, PartialEq)]
pub struct GivenMemberships {
    /// Centres in the unit of the runs' drive (A or V), increasing.
    pub centres: Vec<f64>,
    /// Standard deviation of the sets, in the same unit; `None`: half the spacing of the centres.
    pub sigma: Option<f64>,
}

/// Settings of an identification.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// How displacement becomes a model's inputs. It becomes part of the model.
    pub conditioning: Conditioning,
    /// Choose the derivative of a fuzzy-tanh model by what fits the training runs best, in place of
    /// `velocity` and `slope_window_s` of `conditioning`. [`Identified::velocity_trials`] tells what was
    /// tried.
    pub choose_velocity: bool,
    /// How runs become rows: moving rows only, thinning to a rate, gaps.
    pub dataset: DatasetOptions,
    /// Membership functions of a fuzzy-tanh model; `None` takes them from the runs
    /// ([`Memberships::from_drive`]).
    pub memberships: Option<GivenMemberships>,
    /// Restarts of a nonlinear fit; at least one is made.
    pub restarts: u32,
    /// Seed of the restarts. The same seed and runs give the same model, on any number of threads.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            conditioning: Conditioning::default(),
            choose_velocity: true,
            dataset: DatasetOptions::default(),
            memberships: None,
            restarts: 25,
            seed: 0,
        }
    }
}

/// What an identification is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// Runs are being conditioned.
    Conditioning {
        /// Number of runs.
        runs: u32,
    },
    /// A restart has ended.
    Restart {
        /// Restarts that have ended.
        done: u32,
        /// Restarts in all.
        of: u32,
    },
    /// The best restarts are being finished on all rows.
    Polish {
        /// Fits that have ended.
        done: u32,
        /// Fits in all.
        of: u32,
    },
}

/// How the caller follows an identification and ends it early.
#[derive(Clone, Copy, Default)]
pub struct Watch<'a> {
    /// Set it to `true` from anywhere to end the work, within a fraction of a second, with
    /// [`Error::Cancelled`].
    pub cancel: Option<&'a AtomicBool>,
    /// Called now and then, from any thread.
    pub progress: Option<&'a (dyn Fn(Progress) + Sync)>,
}

impl std::fmt::Debug for Watch<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Watch")
            .field("cancel", &self.cancel)
            .field("progress", &self.progress.map(|_| "a function"))
            .finish()
    }
}

impl Watch<'_> {
    /// Neither progress nor an early end.
    #[must_use]
    pub const fn none() -> Self {
        Self { cancel: None, progress: None }
    }

    fn flag(&self) -> &AtomicBool {
        static NEVER: AtomicBool = AtomicBool::new(false);
        self.cancel.unwrap_or(&NEVER)
    }

    fn is_cancelled(&self) -> bool {
        self.flag().load(Ordering::Relaxed)
    }

    fn report(&self, progress: Progress) {
        if let Some(call) = self.progress {
            call(progress);
        }
    }
}

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
    let drive = check_drives(spec, runs)?;
    match (spec.structure(), drive) {
        (Structure::Law(law), _) => {
            Err(Error::Data { message: format!("{}: laws of force are not identified yet", law.name()) })
        }
        (Structure::Boada, drive) => {
            let datasets = datasets(runs, &options.conditioning, options, watch)?;
            let fitted = lazy::fit(&datasets, drive, options.seed, watch)?;
            let details = report::Details {
                restart_rsse_n: fitted.restart_rsse_n,
                converged: true,
                ..Default::default()
            };
            let model = model(ForceModel::Lazy(fitted.model), options.conditioning, &datasets);
            Ok(report::assemble(model, &datasets, &fitted.offsets_n, details))
        }
        (Structure::Network(structure), drive) => {
            let datasets = datasets(runs, &options.conditioning, options, watch)?;
            let restarts = options.restarts.div_ceil(network::RESTARTS_PER_RESTART);
            let fitted = network::fit(&datasets, structure, drive, restarts, options.seed, watch)?;
            let details = report::Details {
                restart_rsse_n: fitted.restart_rsse_n,
                warnings: fitted.warnings,
                converged: true,
                ..Default::default()
            };
            let model = model(ForceModel::Network(fitted.model), options.conditioning, &datasets);
            Ok(report::assemble(model, &datasets, &fitted.offsets_n, details))
        }
        (Structure::FuzzyTanh, Some(kind)) => identify_fuzzy_tanh(kind, runs, options, watch),
        (Structure::Arx | Structure::Savaresi | Structure::FuzzyTanh, drive) => {
            let datasets = datasets(runs, &options.conditioning, options, watch)?;
            let lags = if spec.structure() == Structure::Savaresi { SAVARESI_LAGS } else { LAGS };
            let fitted = arx::fit(&datasets, lags, drive, watch)?;
            let details = report::Details { rank: Some(fitted.rank), converged: true, ..Default::default() };
            let model = model(ForceModel::Arx(fitted.model), options.conditioning, &datasets);
            Ok(report::assemble(model, &datasets, &fitted.offsets_n, details))
        }
    }
}

fn identify_fuzzy_tanh(
    kind: DriveKind,
    runs: &[Run],
    options: &Options,
    watch: &Watch,
) -> Result<Identified, Error> {
    let (conditioning, velocity_trials) = if options.choose_velocity {
        velocity::choose(kind, runs, options, watch)?
    } else {
        (options.conditioning, Vec::new())
    };
    let datasets = datasets(runs, &conditioning, options, watch)?;
    let memberships = memberships(kind, &datasets, options)?;
    let fitted = fuzzy_tanh::fit(&datasets, &memberships, options.restarts, options.seed, watch)?;
    let details = report::Details {
        memberships: Some(memberships),
        velocity_trials,
        restart_rsse_n: fitted.restart_rsse_n,
        active_bounds: fitted.active_bounds,
        converged: fitted.converged,
        rank: None,
        warnings: Vec::new(),
    };
    let model = model(ForceModel::FuzzyTanh(fitted.model), conditioning, &datasets);
    Ok(report::assemble(model, &datasets, &fitted.offsets_n, details))
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
    if let Some(still) = datasets.iter().find(|d| d.counted() == 0) {
        return Err(Error::Data {
            message: format!(
                "run {}: no sample counts: it is too short for the filter to settle, or force and \
                 displacement do not overlap in time",
                still.name
            ),
        });
    }
    Ok(datasets)
}

/// Membership functions as given, or from the drive of the rows that count.
fn memberships(kind: DriveKind, datasets: &[Dataset], options: &Options) -> Result<Memberships, Error> {
    match &options.memberships {
        Some(given) => Memberships::given(kind, &given.centres, given.sigma),
        None => {
            let counted = datasets.iter().flat_map(|d| &d.rows).filter(|row| row.counts);
            Memberships::from_drive(kind, counted.map(|row| row.drive))
        }
    }
}

/// The model with what the rows say about it.
fn model(force: ForceModel, conditioning: Conditioning, datasets: &[Dataset]) -> Model {
    let envelope = datasets.iter().fold(Envelope::default(), |all, d| dataset::union(&all, &d.envelope));
    Model {
        force,
        conditioning,
        rate_hz: datasets.iter().map(|d| d.rate_hz).fold(f64::INFINITY, f64::min),
        envelope: Envelope { drive: envelope.drive.filter(|_| force.drive().is_some()), ..envelope },
        expected: Expected::default(),
    }
}

/// The kind of drive that the model gets from the runs; `None` for a passive model.
fn check_drives(spec: ModelSpec, runs: &[Run]) -> Result<Option<DriveKind>, Error> {
    let Some(first) = runs.first() else {
        return Err(Error::Data { message: "there are no runs to identify from".to_owned() });
    };
    if !spec.wants_drive() {
        return Ok(None);
    }
    let missing = |run: &Run| Error::MissingChannel {
        run: run.name.clone(),
        channel: "current_a or command_v",
        needed_by: "the model".to_owned(),
    };
    let wanted = first.drive_kind().ok_or_else(|| missing(first))?;
    for run in runs {
        let found = run.drive_kind().ok_or_else(|| missing(run))?;
        if found != wanted {
            return Err(Error::WrongDrive {
                run: run.name.clone(),
                found: found.name(),
                wanted: wanted.name(),
            });
        }
    }
    Ok(Some(wanted))
}

/// Mean of the runs' offsets, weighted by the rows that count, N.
fn mean_offset(datasets: &[Dataset], offsets_n: &[f64]) -> f64 {
    let weights = datasets.iter().map(|d| d.counted() as f64);
    let (sum, weight) =
        weights.zip(offsets_n).fold((0.0, 0.0), |(sum, weight), (w, offset)| (sum + w * offset, weight + w));
    if weight > 0.0 { sum / weight } else { 0.0 }
}
