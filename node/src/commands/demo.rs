//! `mr-damper demo`: runs the real service, over real DDS, on a virtual damper that has changed, and diagnoses the change.
//!
//! ```text
//! virtual rig, healthy ─→ identify ─→ models
//! virtual rig with an effect ─→ run ─→ player ─ DDS ─→ service ─ DDS ─→ listener ─┐
//!      │                        │                        └─ events ─→ collector ──┴→ summary ─→ screen or lines
//!      │                        └─→ the same pipeline without ROS ──→ compared ─→ summary, report.html
//!      └─→ fresh runs ─→ diagnosis, with the service's history ─→ model+.toml ─→ loaded, then another run is played
//! ```
//!
//! Everything runs in this process, in its own ROS domain and on the loopback interface only.

use crate::commands::context::CliContext;
use crate::estimation::models;
use crate::estimation::wire::ModelNames;
use crate::ros2::participant;
use crate::settings::config::{Config, RosArgs};
use crate::settings::error::NodeError;
use mr_damper_base::provenance::TOOL;
use mr_damper_base::shown;
use mr_damper_model::condition::ApplyTo;
use mr_damper_model::evaluate::{Evaluation, evaluate};
use mr_damper_model::force::ForceModel;
use mr_damper_model::metrics::Fit;
use mr_damper_model::pipeline::{Cause, Models, Pipeline, Settings};
use mr_damper_model::sample::{Run, Trace};
use mr_damper_reports::demo::{self as report, WITHOUT_FORCE};
use mr_damper_reports::demo_diagnosis::{DemoDiagnosis, ModelSwap, NoDiagnosis};
use mr_damper_reports::{Agreement, DemoOutcome, Figure, Recording, summary};
use mr_damper_runs::write_text;
use mr_damper_views::live::RunInfo;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::Instant;

mod damper;
mod diagnosis;
mod error;
mod live_node;

use damper::Purpose;
use diagnosis::FreshRuns;
use error::DemoError;
use live_node::{LiveNode, RunObservations};

/// Default ROS domain of the demo: one that real dampers are unlikely to use.
const DOMAIN: i64 = 77;
/// Start and end of the interval without measured force, as shares of the run.
const AWAY: (f64, f64) = (0.4, 0.6);
/// Mean time between false alarms, s. It is shorter than the service's default of a day, so that the alarm comes sooner.
const FALSE_ALARM_INTERVAL_S: f64 = 3600.0;
/// Largest relative difference at which live and offline figures count as equal.
const SAME: f64 = 1e-9;
/// Largest relative difference that is accepted when samples were lost or late.
const NEAR: f64 = 0.05;

/// Show the service on a virtual damper that has changed, from the alarm to the corrected model.
///
/// The demo needs no other program. It identifies models on a virtual rig with a healthy damper. Then it plays a run with an
/// effect that the models do not include onto the service's input topics, over DDS (loopback only, in its own ROS domain),
/// and withholds measured force for a while. After the residual alarm, a diagnosis names the missing effect and adds it to
/// the model, the running service loads that model, and the demo prints the error before and after. It also compares the
/// live figures with an evaluation without ROS, and writes a report.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct Args {
    /// Length of the run before the diagnosis, s; the run after it takes a third of that, but 4 to 10 s.
    #[arg(long, value_name = "S", default_value_t = Args::SECONDS, value_parser = parse_seconds)]
    pub seconds: f64,
    /// Seed of the runs: roads, currents and sensor noise.
    #[arg(long, value_name = "N", default_value_t = Args::SEED)]
    pub seed: u64,
    /// Print one line per second instead of the live screen.
    #[arg(long)]
    pub no_screen: bool,
    /// Directory for report, models and run; default: mr-damper-demo in the directory target, or without that in the
    /// system's temporary directory.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// ROS domain; by default ROS_DOMAIN_ID, else 77.
    #[arg(long, value_name = "ID", value_parser = clap::value_parser!(i64).range(0..=232))]
    pub domain_id: Option<i64>,
}

impl Args {
    const SECONDS: f64 = 30.0;
    const SEED: u64 = 1;
}

impl Default for Args {
    fn default() -> Self {
        Self { seconds: Self::SECONDS, seed: Self::SEED, no_screen: false, out: None, domain_id: None }
    }
}

/// The length of the demo is not valid.
#[derive(Debug, Clone, Copy, thiserror::Error)]
#[error("give a number of seconds from 3 to 3600")]
struct WrongLength;

fn parse_seconds(text: &str) -> Result<f64, WrongLength> {
    text.parse().ok().filter(|seconds| (3.0..=3600.0).contains(seconds)).ok_or(WrongLength)
}

/// Runs the demo.
///
/// # Errors
/// When a model cannot be identified, the service does not start or one of its threads dies, the live figures differ from
/// an evaluation without ROS, or a file cannot be written.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    run_demo(args, context).map(drop)
}

/// Runs the demo and returns its outcome.
fn run_demo(args: &Args, context: &CliContext) -> Result<DemoOutcome, NodeError> {
    let act = Demo::prepare(args, context)?;
    println!("{}", shown::lines(&act.introduction()?));
    let fresh = FreshRuns::begin(args)?;
    let live = LiveNode::start(&act.config, args, context)?;
    let shown = act.perform(&live, fresh, args, context);
    let ended = live.stop();
    let outcome = act.outcome(shown?, args)?;
    ended?;
    println!("\n{}", shown::lines(&summary::text(&outcome)));
    let path = write_report(&act.dir, &act.played, &outcome)?;
    println!("report: {}", shown::line(&path.display().to_string()));
    match outcome.agreement {
        Some(agreement @ Agreement::Differs(_)) => {
            let Args { seed, seconds, .. } = *args;
            Err(DemoError::FiguresDiffer { agreement, seed, seconds }.into())
        }
        _ => Ok(outcome),
    }
}

/// The run that the demo plays, and the models and settings of the service.
struct Demo {
    config: Config,
    models: Models,
    names: ModelNames,
    settings: Settings,
    /// Directory for all files.
    dir: PathBuf,
    /// The run without the withheld force samples.
    played: Run,
    /// The withheld force samples: s since the first sample, N.
    withheld: Vec<(f64, f64)>,
    away_s: (f64, f64),
}

/// The observations of all runs.
struct DemoRuns {
    before: RunObservations,
    /// The diagnosis, or the reason why there was none.
    diagnosis: Result<DemoDiagnosis, NoDiagnosis>,
    /// The run with the new model: what was observed, and the same run stepped without ROS.
    after: Option<(RunObservations, Recording)>,
}

impl Demo {
    fn prepare(args: &Args, context: &CliContext) -> Result<Self, NodeError> {
        let dir = directory(args)?;
        let (free, seeded) = (dir.join("model.toml"), dir.join("arx.toml"));
        let started = Instant::now();
        damper::identify_models(args.seed, context, &free, &seeded)?;
        println!(
            "identified fuzzy-tanh and arx on {:.0} s of the healthy damper, in {:.1} s\n",
            damper::BENCH_S,
            started.elapsed().as_secs_f64()
        );
        let config = configuration(args, &context.ros_args, &free, &seeded)?;
        let (models, names) = models::from_config(&config)?;
        let settings = config.pipeline_settings(models.free.conditioning.cutoff_hz);
        let mut played = damper::lagging(Purpose::Played, args.seconds, args.seed)?;
        let away_s = (AWAY.0 * args.seconds, AWAY.1 * args.seconds);
        let withheld = withhold(&mut played, away_s);
        Ok(Self { config, models, names, settings, dir, played, withheld, away_s })
    }

    fn introduction(&self) -> Result<String, NodeError> {
        let Self { names, away_s, settings, .. } = self;
        Ok(format!(
            "run     {}, {:.0} s at 512 Hz, of a virtual rig. Its damper has a structure that no model has, and it\n        \
             has changed since the models were identified: they do not include the change\n\
             force   measured force is published too, but withheld from {:.0} s to {:.0} s\n\
             models  {} simulates from displacement and current; {} is seeded with measured force\n\
             alarm   raised when the simulation's residual stays above {} times the expected error; one false\n        \
             alarm in {:.0} min on average (the service's default is one in a day)\n\
             ROS 2   {}; topics displacement, coil_current, measured_force → force_estimate, force_residual\n\
             Zenoh   {}, keys mr_damper/**",
            self.played.name,
            self.played.duration().get(),
            away_s.0,
            away_s.1,
            names.free,
            self.seeded_name(),
            settings.alarm_ratio,
            settings.false_alarm_interval_s / 60.0,
            participant::reach(&self.config)?,
            self.config.zenoh.listen.join(", "),
        ))
    }

    /// Plays the run, diagnoses the change, and plays another run with the new model.
    fn perform(
        &self,
        live: &LiveNode<'_>,
        fresh: JoinHandle<Result<FreshRuns, NodeError>>,
        args: &Args,
        context: &CliContext,
    ) -> Result<DemoRuns, NodeError> {
        let before = live.play(&self.played, self.info(&self.played, &self.names.free)?)?;
        let fresh = fresh.join().map_err(|_| DemoError::RigThreadDied)??;
        if before.ended_early {
            return Ok(DemoRuns { before, diagnosis: Err(NoDiagnosis::EndedEarly), after: None });
        }
        println!("\ndiagnosis: which effect does the model lack?");
        let path = self.dir.join("model+.toml");
        let found = diagnosis::run(&self.models.free, &live.history(), &fresh, args, context, &path)?;
        let mut diagnosis = DemoDiagnosis {
            drive: self.played.drive_kind(),
            seconds: found.seconds,
            runs: found.runs,
            truth: format!(
                "The effect that the demo put into the rig: {}, {} s.",
                damper::EFFECT,
                damper::LAG_S
            ),
            result: found.result,
            swap: None,
        };
        let Some(model) = found.model else {
            println!("  no effect was found, so the model stays as it is");
            return Ok(DemoRuns { before, diagnosis: Ok(diagnosis), after: None });
        };
        let name = model.display().to_string();
        let alarms = live.load_model(&name)?;
        let shown_name = shown::line(&name);
        println!("  the running service has loaded {shown_name}; another run is played\n");
        let shown = live.play(&fresh.after, self.info(&fresh.after, &name)?)?;
        let with = Models { free: models::load(&name)?, ..self.models };
        diagnosis.swap = Some(ModelSwap {
            model,
            before: (before.recording.evaluation().free_run, before.recording.length_s()),
            after: shown.recording.clone(),
            without: self.offline(self.models, &fresh.after)?,
            ended_alarm: alarms.iter().any(|change| !change.raised),
        });
        let offline = self.offline(with, &fresh.after)?;
        Ok(DemoRuns { before, diagnosis: Ok(diagnosis), after: Some((shown, offline)) })
    }

    fn seeded_name(&self) -> &str {
        self.names.seeded.as_deref().unwrap_or("no model")
    }

    fn info(&self, run: &Run, free_model: &str) -> Result<RunInfo, NodeError> {
        Ok(RunInfo {
            title: format!("mr-damper demo · {}", run.name),
            free_model: free_model.to_owned(),
            seeded_model: self.names.seeded.clone().unwrap_or_default(),
            reach: participant::reach(&self.config)?,
            zenoh: self.config.zenoh.listen.join(", "),
            length_s: run.duration().get(),
        })
    }

    /// Steps `run` through the service's pipeline with `models`, without ROS.
    fn offline(&self, models: Models, run: &Run) -> Result<Recording, NodeError> {
        let settings = self.config.pipeline_settings(models.free.conditioning.cutoff_hz);
        let mut pipeline = Pipeline::new(models, settings)?;
        let mut recording = Recording::default();
        for sample in run.samples() {
            pipeline.step(&sample, &mut |event| recording.take(&event));
        }
        Ok(recording)
    }

    fn outcome(&self, runs: DemoRuns, args: &Args) -> Result<DemoOutcome, NodeError> {
        let DemoRuns { before: shown, diagnosis, after } = runs;
        let mut figures = self.figures(&shown.recording, &self.offline(self.models, &self.played)?);
        let mut disturbed = is_disturbed(&shown);
        let mut ended_early = shown.ended_early;
        let mut counts = shown.traffic();
        if let Some((after, offline)) = &after {
            figures.push(Figure {
                name: "simulation with the effect, after the swap".to_owned(),
                live: after.recording.evaluation().free_run,
                offline: offline.evaluation().free_run,
            });
            disturbed |= is_disturbed(after);
            ended_early |= after.ended_early;
            counts.extend(
                after.traffic().into_iter().take(2).map(|(name, n)| (format!("{name} after the swap"), n)),
            );
        }
        let agreement = if ended_early { Agreement::NotCompared } else { agreement(&figures, disturbed) };
        let mut notes = Vec::new();
        if let Some(ForceModel::Arx(arx)) = self.models.seeded.map(|model| model.force) {
            notes.push(self.note_on_free_arx(arx.dc_is_meaningful())?);
        }
        Ok(DemoOutcome {
            what: format!(
                "{}, {:.1} s. The run is from a virtual rig and not a measurement. The rig's damper has a structure that no \
                 model has, and it has changed since the models were identified. {} simulated the force from displacement \
                 and current; {} was seeded with measured force, which was withheld from {:.0} s to {:.0} s.",
                self.played.name,
                shown.recording.length_s(),
                self.names.free,
                self.seeded_name(),
                self.away_s.0,
                self.away_s.1
            ),
            withheld: self.withheld.clone(),
            figures,
            agreement: Some(agreement),
            diagnosis: Some(diagnosis),
            notes,
            counts,
            settings: self.settings_in_words()?,
            provenance: self.provenance(args),
            recording: shown.recording,
        })
    }

    fn figures(&self, live: &Recording, offline: &Recording) -> Vec<Figure> {
        let (here, there) = (live.evaluation(), offline.evaluation());
        let figure = |name: String, pick: fn(&Evaluation) -> Option<Fit>| Figure {
            name,
            live: pick(&here),
            offline: pick(&there),
        };
        vec![
            figure(format!("simulation, {}", self.names.free), |e| e.free_run),
            figure("the same without its mean error".to_owned(), |e| e.free_run_without_offset),
            figure(format!("one step ahead, {}", self.seeded_name()), |e| e.one_step),
            figure("persistence (one step ahead)".to_owned(), |e| e.persistence),
            Figure {
                name: WITHOUT_FORCE.to_owned(),
                live: live.fit_to(&self.withheld),
                offline: offline.fit_to(&self.withheld),
            },
        ]
    }

    fn note_on_free_arx(&self, dc_is_meaningful: bool) -> Result<String, NodeError> {
        let Some(model) = self.models.seeded else { return Ok(String::new()) };
        let found = evaluate(model, &self.played, self.settings, |_| true)?;
        let caution = if dc_is_meaningful { "" } else { ", but its static gain is not meaningful" };
        Ok(match found.free_run {
            Some(fit) => format!(
                "In simulation, without measured force, {} has an NMSE of {:.3} on this run (offline){caution}.",
                self.seeded_name(),
                fit.esr
            ),
            None => format!("{} could not simulate this run.", self.seeded_name()),
        })
    }

    fn settings_in_words(&self) -> Result<Vec<(String, String)>, NodeError> {
        let mut rows = Vec::new();
        for name in [
            "model",
            "arx_model",
            "force_timeout_s",
            "coast_s",
            "bumpless_tau_s",
            "residual.window_s",
            "residual.alarm_ratio",
            "residual.false_alarm_interval_s",
        ] {
            rows.push((name.to_owned(), self.config.get(name)?.to_string()));
        }
        let conditioning = self.models.free.conditioning;
        rows.push((
            "low-pass of the simulating model".to_owned(),
            match conditioning.apply_to {
                ApplyTo::None => "none".to_owned(),
                ApplyTo::Inputs => format!("{} Hz, on its inputs", conditioning.cutoff_hz),
                ApplyTo::Output => format!("{} Hz, on its force", conditioning.cutoff_hz),
            },
        ));
        rows.push(("ROS 2".to_owned(), participant::reach(&self.config)?));
        rows.push(("Zenoh".to_owned(), self.config.zenoh.listen.join(", ")));
        Ok(rows)
    }

    fn provenance(&self, args: &Args) -> Vec<(String, String)> {
        let row = |name: &str, value: String| (name.to_owned(), value);
        vec![
            row("made by", TOOL.to_owned()),
            row("repeated by", format!("mr-damper demo --seconds {} --seed {}", args.seconds, args.seed)),
            row("run", self.played.name.clone()),
            row("models (SHA-256)", self.names.hash.clone()),
        ]
    }
}

/// The service's configuration: the defaults, then the demo's own settings, then `--ros-args`. Later ones win.
fn configuration(args: &Args, ros_args: &RosArgs, free: &Path, seeded: &Path) -> Result<Config, NodeError> {
    let from_environment = std::env::var("ROS_DOMAIN_ID").is_ok_and(|id| !id.is_empty());
    let mut config = Config {
        model: free.display().to_string(),
        arx_model: seeded.display().to_string(),
        discovery_range: "localhost".to_owned(),
        domain_id: args.domain_id.unwrap_or(if from_environment { -1 } else { DOMAIN }),
        ..Config::default()
    };
    config.settings.false_alarm_interval_s = FALSE_ALARM_INTERVAL_S;
    config.zenoh.listen = vec![format!("tcp/127.0.0.1:{}", free_port()?)];
    ros_args.apply(&mut config)?;
    Ok(config)
}

/// A port of the loopback interface that is free at present.
fn free_port() -> Result<u16, NodeError> {
    std::net::TcpListener::bind((std::net::Ipv4Addr::LOCALHOST, 0))
        .and_then(|listener| listener.local_addr())
        .map(|address| address.port())
        .map_err(NodeError::io("looking for a free port on the loopback interface"))
}

/// Removes the force samples within `away_s` from `run` and returns them: s since the first sample, N.
fn withhold(run: &mut Run, away_s: (f64, f64)) -> Vec<(f64, f64)> {
    let Some(force) = run.force_n.take() else { return Vec::new() };
    let zero = run.displacement_m.stamps.first().copied().unwrap_or_default();
    let mut kept = Trace::default();
    let mut withheld = Vec::new();
    for (stamp, value) in force.stamps.into_iter().zip(force.values) {
        let at_s = stamp.since(zero).get();
        if at_s >= away_s.0 && at_s < away_s.1 {
            withheld.push((at_s, value));
        } else {
            kept.stamps.push(stamp);
            kept.values.push(value);
        }
    }
    run.force_n = Some(kept);
    withheld
}

/// Compares live and offline figures. A figure that only one side has counts as a difference.
fn agreement(figures: &[Figure], disturbed: bool) -> Agreement {
    let differs = |live: f64, offline: f64| ((live - offline) / offline).abs();
    let worst = figures
        .iter()
        .map(|figure| match (figure.live, figure.offline) {
            (Some(live), Some(offline)) => {
                differs(live.rsse_n, offline.rsse_n).max(differs(live.esr, offline.esr))
            }
            (None, None) => 0.0,
            _ => f64::INFINITY,
        })
        .fold(0.0, f64::max);
    match worst {
        by if by <= SAME => Agreement::Same(by),
        by if disturbed && by <= NEAR => Agreement::Disturbed(by),
        by => Agreement::Differs(by),
    }
}

/// True when a sample was lost, refused or late.
fn is_disturbed(shown: &RunObservations) -> bool {
    // One incomplete sample is expected: the service waits for the first withheld force, which never arrives.
    shown.counts.taken != shown.counts.sent
        || shown.counts.incomplete > 1
        || shown.counts.refused > 0
        || shown.recording.transitions.iter().any(|t| t.cause == Cause::DisplacementLost)
}

/// The directory for all files; creates it if it does not exist.
fn directory(args: &Args) -> Result<PathBuf, NodeError> {
    let dir = args.out.clone().unwrap_or_else(|| {
        let target = Path::new("target");
        if target.is_dir() { target.to_owned() } else { std::env::temp_dir() }.join("mr-damper-demo")
    });
    std::fs::create_dir_all(&dir).map_err(NodeError::io(format!("creating {}", dir.display())))?;
    Ok(dir)
}

/// Writes the report and the run; returns the path of the report.
fn write_report(dir: &Path, run: &Run, outcome: &DemoOutcome) -> Result<PathBuf, NodeError> {
    let path = dir.join("report.html");
    write_text(&path, &report::html(outcome))?;
    let csv = dir.join("run.csv");
    match std::fs::remove_file(&csv) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            return Err(NodeError::io(format!("replacing {}", csv.display()))(error));
        }
        _ => mr_damper_runs::save(run, &csv, &mr_damper_runs::SaveOptions::default())?,
    }
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::interrupt::Interrupt;
    use clap::Parser;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        args: Args,
    }

    #[test]
    fn default_arguments_equal_those_of_the_command_line() {
        assert_eq!(Line::parse_from(["demo"]).args, Args::default());
        for bad in ["--seconds=0", "--seconds=nan", "--domain-id=300", "--seed=-1"] {
            assert!(Line::try_parse_from(["demo", bad]).is_err(), "{bad}");
        }
    }

    /// The whole demo, on a stack like that of a program's main thread: a thread of a test has a quarter of it.
    #[test]
    fn the_demo_names_the_coil_lag_and_the_live_error_falls() {
        let demo = std::thread::Builder::new().stack_size(8 << 20).spawn(short_demo).expect("a thread");
        demo.join().expect("the demo succeeds");
    }

    /// A demo with a live run of 6 s; fresh runs supply the rest of the data for the diagnosis.
    fn short_demo() {
        let dir = tempfile::tempdir().expect("a directory");
        let args = Args {
            seconds: 6.0,
            no_screen: true,
            out: Some(dir.path().to_owned()),
            domain_id: Some(94),
            ..Args::default()
        };
        let context = CliContext {
            interrupt: Interrupt::manual(),
            quiet: true,
            ros_args: RosArgs::default(),
            progress: None,
        };
        let outcome = run_demo(&args, &context).expect("the demo succeeds");

        let raised = outcome.recording.alarms.iter().filter(|change| change.raised).count();
        assert_eq!(raised, 1, "{:?}", outcome.recording.alarms);
        let diagnosis = outcome.diagnosis.expect("a result of the diagnosis").expect("a complete diagnosis");
        let [named] = &diagnosis.result.effects[..] else { panic!("{:?}", diagnosis.result.effects) };
        assert_eq!(named.effect.effect().id(), damper::EFFECT);
        assert!((named.parameters[0].value / damper::LAG_S - 1.0).abs() < 0.1, "{:?}", named.parameters);

        let swap = diagnosis.swap.expect("the new model was loaded");
        let rsse_n = |recording: &Recording| recording.evaluation().free_run.expect("a free run").rsse_n;
        assert!(swap.ended_alarm && swap.after.alarms.is_empty(), "{:?}", swap.after.alarms);
        assert!(rsse_n(&swap.after) < 0.5 * rsse_n(&outcome.recording), "live, before and after");
        assert!(rsse_n(&swap.after) < 0.5 * rsse_n(&swap.without), "on the same run");
        let augmented = models::load(&swap.command()["mr-damper node --model ".len()..]).expect("a model");
        assert_eq!(augmented.effects.as_slice(), [named.effect]);
        assert!(dir.path().join("report.html").is_file() && dir.path().join("run.csv").is_file());
    }

    #[test]
    fn withheld_force_is_removed_from_the_run_and_returned() {
        let whole = damper::healthy(Purpose::Played, 4.0, 1).expect("a known experiment");
        let mut played = whole.clone();
        let withheld = withhold(&mut played, (1.0, 2.0));
        let force = whole.force_n.expect("a rig measures force");
        let kept = played.force_n.expect("some is left");
        assert_eq!((withheld.len(), kept.len() + withheld.len()), (512, force.len()));
        assert_eq!(withheld[0], (1.0, force.values[512]));
        assert!(kept.stamps.is_sorted());
    }

    #[test]
    fn agreement_is_strict_unless_the_run_was_disturbed() {
        let fit = |esr: f64| Some(Fit { rsse_n: esr.sqrt(), esr, samples: 10 });
        let figures = |live, offline| vec![Figure { name: String::new(), live, offline }];
        assert_eq!(agreement(&figures(fit(0.1), fit(0.1)), false), Agreement::Same(0.0));
        assert!(matches!(agreement(&figures(fit(0.1), fit(0.101)), false), Agreement::Differs(_)));
        assert!(matches!(agreement(&figures(fit(0.1), fit(0.101)), true), Agreement::Disturbed(_)));
        assert!(matches!(agreement(&figures(fit(0.1), fit(0.2)), true), Agreement::Differs(_)));
        assert!(matches!(agreement(&figures(None, fit(0.2)), true), Agreement::Differs(_)));
    }
}
