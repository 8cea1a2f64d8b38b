//! `mr-damper simulate`: writes runs of the virtual rig.

mod list;
mod manifest;
mod plan;

use crate::commands::compare::work::{in_parallel, threads};
use crate::commands::context::CliContext;
use crate::settings::error::NodeError;
use crate::settings::interrupt::Interrupt;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use manifest::Manifest;
use mr_damper_base::shown;
use mr_damper_model::sample::Run;
use mr_damper_runs::SaveOptions;
use plan::EffectArg;
pub(super) use plan::{Job, Selection};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Examples at the end of `--help`.
const EXAMPLES: &str = "\
Examples:
  mr-damper simulate --list
      all experiments, and all effects with their units
  mr-damper simulate --experiment all --out runs
      the thesis' eight experiments, 43 runs, 180 MB
  mr-damper simulate --experiment RP-ICPS --replicates 3 --same-pattern --out runs
      three runs that differ only in noise and drift, for a noise floor
  mr-damper simulate --experiment RP3-CS --plain --effect friction=60 --out runs
      a damper with 60 N of friction, but without coil lag and thermal fade
  mr-damper simulate --experiment sine --amplitude 0.02 --frequency 1.5 --current 0.8 --out runs
      a sine run, runs/sine-01.csv, for mr-damper identify and evaluate";

/// Write runs of the virtual rig, a simulated test bench whose damper has a structure that no model has.
///
/// The command writes one file per replicate (rp-icps-01.csv, ...) and simulate.toml, which describes each run. A
/// run holds displacement, force, coil current, set point, case temperature and ambient temperature, at 512 Hz.
///
/// By default each replicate has its own excitation, so that cross-validation tests a model on new data. The
/// damper also differs a little between replicates: in its temperature at the start, and by about 1 % in force.
#[derive(Debug, clap::Args)]
#[command(after_long_help = EXAMPLES)]
pub struct Args {
    /// Experiment: a name from --list, `all` (the eight of the thesis) or `paper1` (the ten of the first paper).
    #[arg(long, value_name = "NAME", required_unless_present = "list", value_parser = plan::selection)]
    experiment: Option<Selection>,
    /// Directory to write to; created if it does not exist.
    #[arg(long, value_name = "DIR", required_unless_present = "list")]
    out: Option<PathBuf>,
    /// List experiments and effects, and write nothing.
    #[arg(long)]
    list: bool,
    /// Replicates of each experiment; by default as many as in the original experiment.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=9999))]
    replicates: Option<u32>,
    /// Seed of the runs: the same seed gives the same runs.
    #[arg(long, value_name = "S", default_value_t = 0, value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: u64,
    /// Add an effect to the damper, e.g. coil_lag=0.02; size 0 removes it. May be given several times.
    #[arg(long, value_name = "ID=SIZE", value_parser = plan::effect)]
    effect: Vec<EffectArg>,
    /// Start from a damper without coil lag and without thermal fade; the default damper has both.
    #[arg(long)]
    plain: bool,
    /// Use the excitation of the first replicate for all replicates of an experiment, as in the thesis.
    #[arg(long)]
    same_pattern: bool,
    /// Use the same damper in each replicate: no drift of temperature, strength and load cell.
    #[arg(long)]
    steady: bool,
    /// Use perfect sensors: no noise, no quantisation, no offset.
    #[arg(long)]
    perfect: bool,
    /// Noise of the load cell, N (standard deviation); by default 3.
    #[arg(long, value_name = "N", conflicts_with = "perfect")]
    force_noise: Option<f64>,
    /// Duration of each run, s; by default that is a property of the experiment.
    #[arg(long, value_name = "S", allow_hyphen_values = true, value_parser = crate::commands::number::seconds)]
    duration: Option<f64>,
    /// Amplitude of the set point of a sine (by default 0.02 m) or a chirp (by default 0.0025 m).
    #[arg(long, value_name = "M")]
    amplitude: Option<f64>,
    /// Frequency of a sine (by default 1.5 Hz), or at the start of a chirp (by default 0.5 Hz).
    #[arg(long, value_name = "HZ")]
    frequency: Option<f64>,
    /// Frequency at the end of a chirp (by default 14.5 Hz).
    #[arg(long, value_name = "HZ")]
    to_frequency: Option<f64>,
    /// Current of an experiment with a constant current (by default 1.2 A; the replicates of paper1-6 to paper1-10 have seven
    /// currents by default).
    #[arg(long, value_name = "A")]
    current: Option<f64>,
    /// File format of the runs.
    #[arg(long, value_enum, default_value_t = Format::Csv)]
    format: Format,
    /// Overwrite existing runs.
    #[arg(long)]
    force: bool,
}

/// File format of the runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    /// CSV files.
    Csv,
    /// Rosbag2 directories (MCAP).
    Mcap,
}

/// The runs of the experiments of `selection` as `simulate` plans them by default, with the rig's `seed`, and with another duration in
/// seconds if it is given.
///
/// # Errors
/// When the duration is not valid.
pub(super) fn rig_jobs(
    selection: &Selection,
    seed: u64,
    duration_s: Option<f64>,
) -> Result<Vec<Job>, NodeError> {
    let args = Args {
        experiment: Some(selection.clone()),
        out: None,
        list: false,
        replicates: None,
        seed,
        effect: Vec::new(),
        plain: false,
        same_pattern: false,
        steady: false,
        perfect: false,
        force_noise: None,
        duration: duration_s,
        amplitude: None,
        frequency: None,
        to_frequency: None,
        current: None,
        format: Format::Csv,
        force: false,
    };
    plan::jobs(&args, selection)
}

/// Simulates the runs that `args` ask for, in the order of their files, and writes nothing. Each run has the name of its file without
/// the extension.
///
/// # Errors
/// When no experiment is given, or an argument does not fit it; [`NodeError::Interrupted`].
pub fn runs(args: &Args, interrupt: &Interrupt) -> Result<Vec<Run>, NodeError> {
    let Some(selection) = &args.experiment else {
        return Err(NodeError::Usage(
            "no experiment is given; `mr-damper simulate --list` lists them".to_owned(),
        ));
    };
    let jobs = plan::jobs(args, selection)?;
    let recorded = in_parallel(jobs.len(), threads(), |index| {
        let job = &jobs[index];
        let run = job.record(interrupt, &mut |_| {}).ok_or(NodeError::Interrupted)?;
        let name = Path::new(&job.entry.file).with_extension("").display().to_string();
        Ok(Run { name, ..run })
    });
    recorded.into_iter().collect()
}

/// Simulates the runs and writes them.
///
/// # Errors
/// When an argument does not fit the experiment, a run exists already, or a file cannot be written. When
/// interrupted, the complete runs are kept and are listed in the manifest.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    let (Some(selection), Some(dir), false) = (&args.experiment, &args.out, args.list) else {
        return list::print();
    };
    let jobs = plan::jobs(args, selection)?;
    fs::create_dir_all(dir).map_err(NodeError::io(format!("creating {}", dir.display())))?;
    let mut manifest = Manifest::read(dir)?;
    if let Some(job) = jobs.iter().find(|job| !args.force && dir.join(&job.entry.file).exists()) {
        let path = dir.join(&job.entry.file);
        let message = "exists already: give another --out, or --force to overwrite it".to_owned();
        return Err(NodeError::File { path, message });
    }
    let start = Instant::now();
    let (written, outcome) = work(&jobs, dir, args.force, context);
    // Also after a failure: the manifest must list every run in the directory.
    for (job, _) in jobs.iter().zip(&written).filter(|(_, written)| **written) {
        manifest.add(job.entry.clone());
    }
    manifest.write(dir)?;
    outcome?;
    if !context.quiet {
        let damper_s: f64 = jobs.iter().map(|job| job.entry.duration_s).sum();
        let (runs, seconds) = (jobs.len(), start.elapsed().as_secs_f64());
        let text = format!(
            "{} ({damper_s:.0} s at 512 Hz) in {}, {seconds:.1} s",
            shown::count(runs, "run"),
            dir.display()
        );
        eprintln!("{}", shown::line(&text));
    }
    Ok(())
}

/// Does all jobs, on as many threads as there are cores. Returns which of them were written, and the first error.
fn work(jobs: &[Job], dir: &Path, force: bool, context: &CliContext) -> (Vec<bool>, Result<(), NodeError>) {
    let written: Vec<AtomicBool> = jobs.iter().map(|_| AtomicBool::new(false)).collect();
    let failed: Mutex<Option<NodeError>> = Mutex::new(None);
    let done_ms = AtomicU64::new(0);
    // The longest jobs come first, so that at the end no thread is still busy with a long one.
    let mut order: Vec<usize> = (0..jobs.len()).collect();
    order.sort_by(|a, b| jobs[*b].entry.duration_s.total_cmp(&jobs[*a].entry.duration_s));
    let next = AtomicUsize::new(0);
    let go_on = || !context.interrupt.is_raised() && failed.lock().is_ok_and(|failed| failed.is_none());
    let worker = || {
        while let Some(&index) = order.get(next.fetch_add(1, Ordering::Relaxed)).filter(|_| go_on()) {
            match simulate(&jobs[index], dir, force, &context.interrupt, &done_ms) {
                Ok(()) => written[index].store(true, Ordering::Relaxed),
                Err(error) => {
                    if let Ok(mut failed) = failed.lock() {
                        failed.get_or_insert(error);
                    }
                }
            }
        }
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from).min(jobs.len());
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..cores).map(|_| scope.spawn(worker)).collect();
        let total_ms: f64 = jobs.iter().map(|job| job.entry.duration_s * 1e3).sum();
        let bar = Progress::new(total_ms as u64, context.quiet);
        while !workers.iter().all(|worker| worker.is_finished()) {
            bar.show(done_ms.load(Ordering::Relaxed));
            std::thread::sleep(Duration::from_millis(20));
        }
        bar.0.finish_and_clear();
    });
    let written = written.into_iter().map(AtomicBool::into_inner).collect::<Vec<bool>>();
    let failed = failed.into_inner().unwrap_or_default();
    let outcome = match failed {
        Some(error) => Err(error),
        None if written.iter().all(|written| *written) => Ok(()),
        None => Err(NodeError::Interrupted),
    };
    (written, outcome)
}

/// Simulates one run and writes it. A file gets its final name only when it is complete.
fn simulate(
    job: &Job,
    dir: &Path,
    force: bool,
    interrupt: &Interrupt,
    done_ms: &AtomicU64,
) -> Result<(), NodeError> {
    let mut before = 0;
    let mut progress = |done_s: f64| {
        let now = (done_s * 1e3) as u64;
        done_ms.fetch_add(now - before, Ordering::Relaxed);
        before = now;
    };
    let run = job.record(interrupt, &mut progress).ok_or(NodeError::Interrupted)?;
    let path = dir.join(&job.entry.file);
    let options = SaveOptions::default();
    if !force || !path.exists() {
        mr_damper_runs::save(&run, &path, &options)?;
    } else if path.is_dir() {
        // Delete only a bag, never another directory.
        if !path.join("metadata.yaml").exists() {
            let message = "is a directory but not a bag, so it is not overwritten".to_owned();
            return Err(NodeError::File { path, message });
        }
        fs::remove_dir_all(&path).map_err(NodeError::io(format!("replacing {}", path.display())))?;
        mr_damper_runs::save(&run, &path, &options)?;
    } else {
        let new = dir.join(format!(".{}.{}.csv", job.entry.file, std::process::id()));
        mr_damper_runs::save(&run, &new, &options)?;
        fs::rename(&new, &path).map_err(NodeError::io(format!("replacing {}", path.display())))?;
    }
    done_ms.fetch_add(((job.entry.duration_s * 1e3) as u64).saturating_sub(before), Ordering::Relaxed);
    Ok(())
}

/// A progress bar that appears when the work takes longer than two seconds.
struct Progress(ProgressBar, Instant);

impl Progress {
    fn new(total_ms: u64, quiet: bool) -> Self {
        let bar = ProgressBar::with_draw_target(Some(total_ms), ProgressDrawTarget::hidden());
        let style = ProgressStyle::with_template("simulating [{bar:40}] {percent} %, {eta} left");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        let never = Instant::now() + Duration::from_secs(1 << 30);
        Self(bar, if quiet { never } else { Instant::now() + Duration::from_secs(2) })
    }

    fn show(&self, done_ms: u64) {
        if self.0.is_hidden() && Instant::now() >= self.1 {
            self.0.set_draw_target(ProgressDrawTarget::stderr());
        }
        self.0.set_position(done_ms);
    }
}
