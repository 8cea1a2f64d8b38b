//! `mr-damper simulate`: runs of the virtual rig.

mod list;
mod manifest;
mod plan;

use crate::command::Surroundings;
use crate::error::NodeError;
use crate::interrupt::Interrupt;
use crate::run::{self, SaveOptions};
use crate::shown;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use manifest::Manifest;
use mr_damper_model::rig;
use plan::{EffectArg, Job, Selection};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// What it teaches at the end of `--help`.
const EXAMPLES: &str = "\
Examples:
  mr-damper simulate --list
      all experiments, and all effects with their units
  mr-damper simulate --experiment all --out runs
      the thesis' eight experiments, 43 runs, 180 MB
  mr-damper simulate --experiment RP-ICPS --replicates 3 --same-pattern --out runs
      three runs that differ in noise and drift alone: a noise floor
  mr-damper simulate --experiment RP3-CS --plain --effect friction=60 --out runs
      a damper with 60 N of friction, but without coil lag and thermal fade
  mr-damper simulate --experiment sine --amplitude 0.02 --frequency 1.5 --current 0.8 --out runs
      a sine: mr-damper identify and evaluate take runs/sine-01.csv";

/// Write runs of the virtual rig, a made-up test bench whose damper is none of the models.
///
/// One file a replicate, rp-icps-01.csv and so on, and simulate.toml, which says what each of them is. A run
/// holds displacement, force, coil current, set point, and temperatures of case and room, at 512 Hz.
///
/// By default each replicate has an excitation of its own, so that cross-validation asks a model something
/// new, and a damper that is not quite as it was the last time: another temperature at the start, force
/// stronger or weaker by about 1 %.
#[derive(Debug, clap::Args)]
#[command(after_long_help = EXAMPLES)]
pub struct Args {
    /// Experiment: a name of --list, or `all` (the thesis' eight), or `paper1` (the first paper's ten).
    #[arg(long, value_name = "NAME", required_unless_present = "list", value_parser = plan::selection)]
    experiment: Option<Selection>,
    /// Directory to write to; made when it is not there.
    #[arg(long, value_name = "DIR", required_unless_present = "list")]
    out: Option<PathBuf>,
    /// List experiments and effects, write nothing.
    #[arg(long)]
    list: bool,
    /// Replicates of each experiment; by default as many as were done.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=9999))]
    replicates: Option<u32>,
    /// Seed: the same seed gives the same runs, another one others.
    #[arg(long, value_name = "S", default_value_t = 0, value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    seed: u64,
    /// Put an effect in, e.g. coil_lag=0.02; size 0 takes it away. May be given several times.
    #[arg(long, value_name = "ID=SIZE", value_parser = plan::effect)]
    effect: Vec<EffectArg>,
    /// Start from a damper without coil lag and without fading when warm; both are there by default.
    #[arg(long)]
    plain: bool,
    /// All replicates of an experiment share the excitation of the first, as the thesis' did.
    #[arg(long)]
    same_pattern: bool,
    /// The same damper in each replicate: no drift of temperature, strength and load cell.
    #[arg(long)]
    steady: bool,
    /// Perfect sensors: no noise, no quantisation, no offset.
    #[arg(long)]
    perfect: bool,
    /// Noise of the load cell, N (standard deviation); by default 3.
    #[arg(long, value_name = "N", conflicts_with = "perfect")]
    force_noise: Option<f64>,
    /// Duration of each run, s; by default the experiment's.
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
    /// Amplitude of the set point in a sine (by default 0.02 m) or a chirp (0.0025 m).
    #[arg(long, value_name = "M")]
    amplitude: Option<f64>,
    /// Frequency of a sine (by default 1.5 Hz), or at the start of a chirp (0.5 Hz).
    #[arg(long, value_name = "HZ")]
    frequency: Option<f64>,
    /// Frequency at the end of a chirp (by default 14.5 Hz).
    #[arg(long, value_name = "HZ")]
    to_frequency: Option<f64>,
    /// Current of an experiment with a constant one (by default 1.2 A).
    #[arg(long, value_name = "A")]
    current: Option<f64>,
    /// How runs are written.
    #[arg(long, value_enum, default_value_t = Format::Csv)]
    format: Format,
    /// Overwrite runs that are there.
    #[arg(long)]
    force: bool,
}

/// How runs are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    /// CSV files.
    Csv,
    /// Rosbag2 directories (MCAP).
    Mcap,
}

/// Simulates and writes.
///
/// # Errors
/// When an argument does not fit the experiment, a run is there already, or a file cannot be written. When
/// interrupted, the runs that are complete stay and are in the manifest.
pub fn run(args: &Args, around: &Surroundings) -> Result<(), NodeError> {
    let (Some(selection), Some(dir), false) = (&args.experiment, &args.out, args.list) else {
        return list::print();
    };
    let jobs = plan::jobs(args, selection)?;
    fs::create_dir_all(dir).map_err(NodeError::io(format!("creating {}", dir.display())))?;
    let mut manifest = Manifest::read(dir)?;
    if let Some(job) = jobs.iter().find(|job| !args.force && dir.join(&job.entry.file).exists()) {
        let path = dir.join(&job.entry.file);
        let message = "is there already: give another --out, or --force to overwrite it".to_owned();
        return Err(NodeError::File { path, message });
    }
    let start = Instant::now();
    let (written, outcome) = work(&jobs, dir, args.force, around);
    // Also after a failure: what stands in the directory shall be told.
    for (job, _) in jobs.iter().zip(&written).filter(|(_, written)| **written) {
        manifest.add(job.entry.clone());
    }
    manifest.write(dir)?;
    outcome?;
    if !around.quiet {
        let damper_s: f64 = jobs.iter().map(|job| job.entry.duration_s).sum();
        let (runs, seconds) = (jobs.len(), start.elapsed().as_secs_f64());
        let text = format!("{runs} runs ({damper_s:.0} s at 512 Hz) in {}, {seconds:.1} s", dir.display());
        eprintln!("{}", shown::line(&text));
    }
    Ok(())
}

/// Does all jobs on as many threads as there are cores. Returns which of them are written, and the first error.
fn work(jobs: &[Job], dir: &Path, force: bool, around: &Surroundings) -> (Vec<bool>, Result<(), NodeError>) {
    let written: Vec<AtomicBool> = jobs.iter().map(|_| AtomicBool::new(false)).collect();
    let failed: Mutex<Option<NodeError>> = Mutex::new(None);
    let done_ms = AtomicU64::new(0);
    // Longest first, so that no thread is left alone with a long one in the end.
    let mut order: Vec<usize> = (0..jobs.len()).collect();
    order.sort_by(|a, b| jobs[*b].entry.duration_s.total_cmp(&jobs[*a].entry.duration_s));
    let next = AtomicUsize::new(0);
    let go_on = || !around.interrupt.is_raised() && failed.lock().is_ok_and(|failed| failed.is_none());
    let worker = || {
        while let Some(&index) = order.get(next.fetch_add(1, Ordering::Relaxed)).filter(|_| go_on()) {
            match simulate(&jobs[index], dir, force, &around.interrupt, &done_ms) {
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
        let bar = Progress::new(total_ms as u64, around.quiet);
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

/// Simulates one run and writes it. What is complete has its own name, what is not has none.
fn simulate(
    job: &Job,
    dir: &Path,
    force: bool,
    interrupt: &Interrupt,
    done_ms: &AtomicU64,
) -> Result<(), NodeError> {
    let mut before = 0;
    let mut go_on = |done_s: f64| {
        let now = (done_s * 1e3) as u64;
        done_ms.fetch_add(now - before, Ordering::Relaxed);
        before = now;
        !interrupt.is_raised()
    };
    let (experiment, seed) = (&job.experiment, job.entry.run_seed);
    let run = rig::record_while(experiment, &job.plant, &job.channels, seed, &mut go_on)
        .filter(|_| !interrupt.is_raised())
        .ok_or(NodeError::Interrupted)?;
    let path = dir.join(&job.entry.file);
    let options = SaveOptions::default();
    if !force || !path.exists() {
        run::save(&run, &path, &options)?;
    } else if path.is_dir() {
        // Only what a bag is: nobody's other directory.
        if !path.join("metadata.yaml").exists() {
            let message = "is a directory, but no bag: it is not overwritten".to_owned();
            return Err(NodeError::File { path, message });
        }
        fs::remove_dir_all(&path).map_err(NodeError::io(format!("replacing {}", path.display())))?;
        run::save(&run, &path, &options)?;
    } else {
        let new = dir.join(format!(".{}.{}.csv", job.entry.file, std::process::id()));
        run::save(&run, &new, &options)?;
        fs::rename(&new, &path).map_err(NodeError::io(format!("replacing {}", path.display())))?;
    }
    done_ms.fetch_add(((job.entry.duration_s * 1e3) as u64).saturating_sub(before), Ordering::Relaxed);
    Ok(())
}

/// A bar that comes up when the work takes longer than two seconds.
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
