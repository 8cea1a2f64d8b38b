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
mod fuzzy_tanh;
mod law;
mod lazy;
pub mod least_squares;
mod levels;
mod network;
mod offsets;
mod phase;
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

pub use dataset::{Dataset, DatasetOptions, Row};
pub use levels::{MembershipSource, Memberships};
pub use phase::{IdentifiedPhase, PhaseOptions, identify_phase, score_phase};
pub use report::{ActiveBound, Identified, ParameterValue, RunFit};
pub use score::{Predicted, Scores, persistence, score, sum_of_free_run, walk};
pub use spec::{Form, ModelSpec, Structure};
pub use tsk::{Evolution, FittedTsk, Learning, TskOptions, fit_tsk};
pub use velocity::VelocityTrial;

use crate::condition::Conditioning;
use crate::error::Error;
use crate::force::{Dependence, ForceModel, LAGS, Law, SAVARESI_LAGS};
use crate::model::{Envelope, Expected, Model};
use crate::sample::{DriveKind, Run};
use rayon::prelude::*;
use std::borrow::Cow;
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
    /// Degree of the polynomials over the drive of a law of force, 1 to 4.
    pub degree: usize,
    /// What of the residuals is minimised.
    pub loss: Loss,
    /// Most rows that a nonlinear fit is finished on, and that networks and rules learn from; beyond it a sample of
    /// about that many is taken. `None`: all rows, however many.
    pub most_rows: Option<usize>,
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
            degree: 2,
            loss: Loss::Squares,
            most_rows: None,
            restarts: 25,
            seed: 0,
        }
    }
}

/// What of the residuals a nonlinear fit minimises.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// Their squares: the fit has the least RSSE.
    Squares,
    /// Huber's loss: squares within the threshold, beyond it growing linearly, so that stray samples count for
    /// little.
    Huber {
        /// The threshold in newtons; a few times the load cell's noise.
        threshold_n: f64,
    },
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
    /// An epoch of learning, or a generation of an evolution, has ended.
    Epoch {
        /// Epochs that have ended.
        done: u32,
        /// Epochs at most.
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

    pub(crate) fn is_cancelled(&self) -> bool {
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
    check_options(spec, options)?;
    let drive = check_drives(spec, runs.iter().map(|run| (run.name.as_str(), run.drive_kind())))?;
    let (conditioning, velocity_trials) = if options.choose_velocity && !spec.feeds_on_force() {
        velocity::choose(runs, options, watch, |datasets| sample_esr(spec, drive, datasets, options, watch))?
    } else {
        (options.conditioning, Vec::new())
    };
    let datasets = datasets(runs, &conditioning, options, watch)?;
    let found = fit(spec, drive, &datasets, options, watch)?;
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
    fit(spec, drive, datasets, options, watch)
}

/// Fits a model to conditioned runs.
fn fit(
    spec: ModelSpec,
    drive: Option<DriveKind>,
    datasets: &[Dataset],
    options: &Options,
    watch: &Watch,
) -> Result<Identified, Error> {
    let all = datasets;
    let datasets = &*shortened(spec, all, options);
    let found = match (spec.structure(), drive) {
        (Structure::Phase, _) => return Err(cannot_run()),
        (Structure::FuzzyTanh, Some(kind)) => {
            let memberships = memberships(kind, datasets, options)?;
            let (model, found) = fuzzy_tanh::fit(datasets, &memberships, options, watch)?;
            let details = report::Details::of(&found, &fuzzy_tanh::NAMES).with_memberships(memberships);
            (ForceModel::FuzzyTanh(model), found.offsets_n, details)
        }
        (Structure::Law(law), _) => {
            let (dependence, memberships) = dependence(spec.form(), drive, datasets, options)?;
            if let Some(memberships) = &memberships {
                memberships.check_support(datasets, law.parameters().len())?;
            }
            let (model, found) = law::fit(datasets, law, dependence, options, watch)?;
            let names: Vec<&str> = law.parameters().iter().map(|p| p.name).collect();
            let mut details = report::Details::of(&found, &names);
            if let Dependence::Polynomial { drive, degree } = dependence
                && degree < options.degree
            {
                details.warnings.push(format!(
                    "the runs hold {} levels of {drive}: polynomials over it have degree {degree} in place of {}",
                    degree + 1,
                    options.degree
                ));
            }
            let details = memberships.into_iter().fold(details, report::Details::with_memberships);
            (ForceModel::Law(model), found.offsets_n, details)
        }
        (Structure::Tsk(kind), drive) => {
            let found = fit_tsk(datasets, kind, drive, &TskOptions::of(options), watch)?;
            let details = report::Details { converged: found.converged, ..Default::default() };
            (ForceModel::Tsk(found.model), found.offsets_n, details)
        }
        (Structure::Boada, drive) => {
            let fitted = lazy::fit(datasets, drive, options.seed, watch)?;
            let details = report::Details {
                restart_rsse_n: fitted.restart_rsse_n,
                converged: true,
                ..Default::default()
            };
            (ForceModel::Lazy(fitted.model), fitted.offsets_n, details)
        }
        (Structure::Network(structure), drive) => {
            let restarts = options.restarts.div_ceil(network::RESTARTS_PER_RESTART);
            let fitted = network::fit(datasets, structure, drive, restarts, options.seed, watch)?;
            let details = report::Details {
                restart_rsse_n: fitted.restart_rsse_n,
                warnings: fitted.warnings,
                converged: true,
                ..Default::default()
            };
            (ForceModel::Network(fitted.model), fitted.offsets_n, details)
        }
        (Structure::Arx | Structure::Savaresi | Structure::FuzzyTanh, drive) => {
            let lags = if spec.structure() == Structure::Savaresi { SAVARESI_LAGS } else { LAGS };
            let fitted = arx::fit(datasets, lags, drive, watch)?;
            let details = report::Details { rank: Some(fitted.rank), converged: true, ..Default::default() };
            (ForceModel::Arx(fitted.model), fitted.offsets_n, details)
        }
    };
    let (force, offsets_n, details) = found;
    let model = model(force, all[0].conditioning, all);
    Ok(report::assemble(model, all, &offsets_n, details))
}

/// The datasets that a model learns from: stretches of them where `most_rows` asks for fewer rows. Linear
/// regressions take all rows, and searches draw samples of their own.
fn shortened<'a>(spec: ModelSpec, datasets: &'a [Dataset], options: &Options) -> Cow<'a, [Dataset]> {
    let learns = matches!(spec.structure(), Structure::Tsk(_) | Structure::Boada | Structure::Network(_));
    let rows: usize = datasets.iter().map(Dataset::counted).sum();
    match options.most_rows.filter(|most| learns && rows > *most) {
        Some(most) => {
            let every = rows.div_ceil(most.max(1));
            datasets.iter().map(|dataset| dataset.stretches(every)).collect()
        }
        None => Cow::Borrowed(datasets),
    }
}

/// Why P makes no model.
fn cannot_run() -> Error {
    Error::Data {
            message: "p cannot be made into a model that runs: it explains the force by the measured force itself at the same \
                      instant, and run forward it diverges (both roots of 1 - p2 s - p3 s^2 lie in the right half plane). \
                      `compare` shows how well it holds; sp is the nearest that runs"
                .to_owned(),
        }
}

/// Refuses settings that mean nothing, or that the structure would ignore.
fn check_options(spec: ModelSpec, options: &Options) -> Result<(), Error> {
    if !spec.structure().can_run() {
        return Err(cannot_run());
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
    Ok(())
}

/// How well a model of this kind can do on `datasets`: mean ESR of the runs after a few restarts.
fn sample_esr(
    spec: ModelSpec,
    drive: Option<DriveKind>,
    datasets: &[Dataset],
    options: &Options,
    watch: &Watch,
) -> Result<f64, Error> {
    match (spec.structure(), drive) {
        (Structure::Law(law), _) => {
            let (dependence, _) = dependence(spec.form(), drive, datasets, options)?;
            law::sample_esr(datasets, law, dependence, options.seed, watch)
        }
        (Structure::Tsk(kind), drive) => tsk::grid_esr(datasets, kind, drive, watch),
        (_, Some(kind)) => {
            let memberships = memberships(kind, datasets, options)?;
            fuzzy_tanh::sample_esr(datasets, &memberships, options.seed, watch)
        }
        (_, None) => law::sample_esr(datasets, Law::Sp, Dependence::None, options.seed, watch),
    }
}

/// How a law's parameters follow the drive in `form`; and the memberships, where there are sets.
fn dependence(
    form: Form,
    drive: Option<DriveKind>,
    datasets: &[Dataset],
    options: &Options,
) -> Result<(Dependence, Option<Memberships>), Error> {
    match (form, drive) {
        (Form::SemiActive, Some(drive)) => {
            let degree = usable_degree(drive, datasets, options.degree)?;
            Ok((Dependence::Polynomial { drive, degree }, None))
        }
        (Form::Fuzzy, Some(drive)) => {
            let memberships = memberships(drive, datasets, options)?;
            Ok((Dependence::Fuzzy(memberships.sets()?), Some(memberships)))
        }
        (_, _) => Ok((Dependence::None, None)),
    }
}

/// The highest degree up to `degree` that the levels of the drive determine.
fn usable_degree(drive: DriveKind, datasets: &[Dataset], degree: usize) -> Result<usize, Error> {
    let counted = datasets.iter().flat_map(|d| &d.rows).filter(|row| row.counts);
    let Ok(found) = Memberships::from_drive(drive, counted.map(|row| row.drive)) else { return Ok(degree) };
    match (found.source, found.centres.len()) {
        (MembershipSource::Levels, 1) => Err(Error::Data {
            message: format!(
                "the runs hold one level of {drive}, {:.3}: how force depends on it cannot be told; add runs at other \
                 levels, or take the passive form",
                found.centres[0]
            ),
        }),
        (MembershipSource::Levels, levels) => Ok(degree.min(levels - 1)),
        _ => Ok(degree),
    }
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

/// Refuses runs without a row that counts.
fn check_rows(datasets: &[Dataset]) -> Result<(), Error> {
    match datasets.iter().find(|d| d.counted() == 0) {
        None => Ok(()),
        Some(still) => Err(Error::Data {
            message: format!(
                "run {}: no sample counts: it is too short for the filter to settle, or force and \
                 displacement do not overlap in time",
                still.name
            ),
        }),
    }
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
