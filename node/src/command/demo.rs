//! `mr-damper demo`: the real service on a recorded-style run over real DDS, with one live screen and a report.
//!
//! ```text
//! virtual rig ─→ run ─→ player ─ DDS ─→ service ─ DDS ─→ listener ─┐
//!                 │                        └─ events ─→ collector ─┴→ board ─→ screen or lines
//!                 └─→ the same pipeline without ROS ──→ compared ─→ summary, report.html
//! ```
//!
//! Everything runs in this process, on a ROS domain of its own and on loopback alone.

use crate::command::Surroundings;
use crate::config::{Config, RosArgs};
use crate::error::NodeError;
use crate::live::Headline;
use crate::models;
use crate::report::demo::{self as report, WITHOUT_FORCE};
use crate::report::{Agreement, Figure, Outcome, Recording, summary};
use crate::service;
use crate::wire::ModelNames;
use mr_damper_model::condition::ApplyTo;
use mr_damper_model::evaluate::{Evaluation, evaluate};
use mr_damper_model::force::ForceModel;
use mr_damper_model::metrics::Fit;
use mr_damper_model::pipeline::{Cause, Models, Pipeline, Settings};
use mr_damper_model::preset;
use mr_damper_model::rig::{self, Channels, Experiment, Plant};
use mr_damper_model::sample::{Run, Trace};
use std::path::{Path, PathBuf};

mod stage;

use stage::{Shown, perform};

/// ROS domain of the demo, when nobody asks for another: not the one that real dampers are likely to be on.
const DOMAIN: i64 = 77;
/// Share of the run in which measured force is withheld.
const AWAY: (f64, f64) = (0.4, 0.6);
/// Largest relative difference of figures that count as equal.
const SAME: f64 = 1e-9;
/// The same for a run that was disturbed on its way.
const NEAR: f64 = 0.05;

/// See the service at work on a run of the virtual rig: nothing else is needed.
///
/// Plays a run onto the service's input topics over DDS (on loopback, on a domain of its own), withholds measured
/// force for a while, shows what happens, compares the figures with an evaluation without ROS, and writes a
/// report.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub struct Args {
    /// Length of the run, s.
    #[arg(long, value_name = "S", default_value_t = Args::SECONDS, value_parser = parse_seconds)]
    pub seconds: f64,
    /// Seed of the run: its road, its currents and the noise of its sensors.
    #[arg(long, value_name = "N", default_value_t = Args::SEED)]
    pub seed: u64,
    /// Print a line a second instead of the screen.
    #[arg(long)]
    pub no_screen: bool,
    /// Directory of report and run; by default target/mr-damper-demo, or one in the system's temporary directory.
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

fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (3.0..=3600.0).contains(&seconds) => Ok(seconds),
        _ => Err("give a number of seconds from 3 to 3600".to_owned()),
    }
}

/// Runs the demo.
///
/// # Errors
/// When the service does not start or one of its threads dies, when the live figures are not those of an
/// evaluation without ROS, or when the report cannot be written.
pub fn run(args: &Args, around: &Surroundings) -> Result<(), NodeError> {
    let act = Act::prepare(args, around)?;
    println!("{}", act.introduction()?);
    let shown = perform(&act, args, around)?;
    let outcome = act.outcome(shown, args)?;
    println!("\n{}", summary::text(&outcome));

    // Closing the loop goes here: it takes what is left over of this run (`outcome.recording`) and fresh runs of the
    // same rig, names the effect, adds it to the model, and gives error before and after to summary and report.

    let path = write_report(args, &act.played, &outcome)?;
    println!("report: {}", path.display());
    match outcome.agreement {
        Some(agreement @ Agreement::Differs(_)) => Err(NodeError::Failed(format!(
            "{}; please report it with seed {} and {} s",
            agreement.text(),
            args.seed,
            args.seconds
        ))),
        _ => Ok(()),
    }
}

/// What is played, and by whom.
struct Act {
    config: Config,
    models: Models,
    names: ModelNames,
    settings: Settings,
    /// The run without the force that is withheld.
    played: Run,
    /// The force that is withheld: s since the first sample, N.
    withheld: Vec<(f64, f64)>,
    away_s: (f64, f64),
}

impl Act {
    fn prepare(args: &Args, around: &Surroundings) -> Result<Self, NodeError> {
        let config = configuration(args, &around.ros_args)?;
        let (models, names) = models::from_config(&config)?;
        let settings = config.pipeline_settings(models.free.conditioning.cutoff_hz);
        let experiment = Experiment::thesis("RP-ICPS")
            .ok_or_else(|| NodeError::Failed("the rig has no experiment RP-ICPS".to_owned()))?
            .with_duration_s(args.seconds);
        let mut played = rig::record(&experiment, &Plant::default(), &Channels::default(), args.seed);
        let away_s = (AWAY.0 * args.seconds, AWAY.1 * args.seconds);
        let withheld = withhold(&mut played, away_s);
        Ok(Self { config, models, names, settings, played, withheld, away_s })
    }

    fn introduction(&self) -> Result<String, NodeError> {
        let Self { names, away_s, .. } = self;
        Ok(format!(
            "run     {}, {:.0} s at 512 Hz: a virtual rig whose damper is none of the models\n        \
             and carries an effect that they do not know\n\
             force   measured force is published too, but withheld from {:.0} s to {:.0} s\n\
             models  {} runs free, {} is seeded with measured force\n\
             ROS 2   {}; topics displacement, coil_current, measured_force → force_estimate, force_residual\n\
             Zenoh   {}, keys mr_damper/**",
            self.played.name,
            self.played.duration().get(),
            away_s.0,
            away_s.1,
            names.free,
            self.seeded_name(),
            service::reach(&self.config)?,
            self.config.zenoh.listen.join(", "),
        ))
    }

    fn seeded_name(&self) -> &str {
        self.names.seeded.as_deref().unwrap_or("no model")
    }

    fn headline(&self) -> Result<Headline, NodeError> {
        Ok(Headline {
            title: format!("mr-damper demo · {}", self.played.name),
            free_model: self.names.free.clone(),
            seeded_model: self.names.seeded.clone().unwrap_or_default(),
            reach: service::reach(&self.config)?,
            zenoh: self.config.zenoh.listen.join(", "),
            length_s: self.played.duration().get(),
        })
    }

    /// The same run through the same pipeline, without ROS.
    fn offline(&self) -> Result<Recording, NodeError> {
        let mut pipeline = Pipeline::new(self.models, self.settings)?;
        let mut recording = Recording::default();
        for sample in self.played.samples() {
            pipeline.step(&sample, &mut |event| recording.take(&event));
        }
        Ok(recording)
    }

    fn outcome(&self, shown: Shown, args: &Args) -> Result<Outcome, NodeError> {
        let offline = self.offline()?;
        let figures = self.figures(&shown.recording, &offline);
        // The first of the forces that are withheld is waited for in vain, as it should be.
        let disturbed = shown.counts.taken != shown.counts.sent
            || shown.counts.incomplete > 1
            || shown.counts.refused > 0
            || shown.recording.transitions.iter().any(|t| t.cause == Cause::DisplacementLost);
        let agreement =
            if shown.ended_early { Agreement::NotCompared } else { agreement(&figures, disturbed) };
        let mut notes = Vec::new();
        if let Some(ForceModel::Arx(arx)) = self.models.seeded.map(|model| model.force) {
            notes.push(self.note_on_free_arx(arx.dc_is_meaningful())?);
        }
        Ok(Outcome {
            what: format!(
                "{}, {:.1} s. A virtual rig, not a measurement: its damper is none of the models and carries an \
                 effect that they do not know. {} ran free; {} was seeded with measured force, which was withheld \
                 from {:.0} s to {:.0} s.",
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
            notes,
            counts: shown.traffic(),
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
            figure(format!("free run of {}", self.names.free), |e| e.free_run),
            figure("the same, its mean error taken out".to_owned(), |e| e.free_run_without_offset),
            figure(format!("one step of {}", self.seeded_name()), |e| e.one_step),
            figure("persistence (one step)".to_owned(), |e| e.persistence),
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
                "Running free, without measured force, {} has an ESR of {:.3} on this run (offline){caution}.",
                self.seeded_name(),
                fit.esr
            ),
            None => format!("{} does not run free on this run.", self.seeded_name()),
        })
    }

    fn settings_in_words(&self) -> Result<Vec<(String, String)>, NodeError> {
        let mut rows = Vec::new();
        for name in
            ["model", "arx_model", "force_timeout_s", "coast_s", "bumpless_tau_s", "residual.window_s"]
        {
            rows.push((name.to_owned(), self.config.get(name)?.to_string()));
        }
        let conditioning = self.models.free.conditioning;
        rows.push((
            "low-pass of the free-running model".to_owned(),
            match conditioning.apply_to {
                ApplyTo::None => "none".to_owned(),
                ApplyTo::Inputs => format!("{} Hz, on its inputs", conditioning.cutoff_hz),
                ApplyTo::Output => format!("{} Hz, on its force", conditioning.cutoff_hz),
            },
        ));
        rows.push(("ROS 2".to_owned(), service::reach(&self.config)?));
        rows.push(("Zenoh".to_owned(), self.config.zenoh.listen.join(", ")));
        Ok(rows)
    }

    fn provenance(&self, args: &Args) -> Vec<(String, String)> {
        let row = |name: &str, value: String| (name.to_owned(), value);
        vec![
            row("made by", format!("mr-damper {}", env!("CARGO_PKG_VERSION"))),
            row("made again by", format!("mr-damper demo --seconds {} --seed {}", args.seconds, args.seed)),
            row("run", self.played.name.clone()),
            row("models (SHA-256)", self.names.hash.clone()),
        ]
    }
}

/// The service's defaults, then what the demo needs, then what `--ros-args` said.
fn configuration(args: &Args, ros_args: &RosArgs) -> Result<Config, NodeError> {
    let from_environment = std::env::var("ROS_DOMAIN_ID").is_ok_and(|id| !id.is_empty());
    let mut config = Config {
        model: preset::BEST_FUZZY_TANH.to_owned(),
        discovery_range: "localhost".to_owned(),
        domain_id: args.domain_id.unwrap_or(if from_environment { -1 } else { DOMAIN }),
        ..Config::default()
    };
    config.zenoh.listen = vec![format!("tcp/127.0.0.1:{}", free_port()?)];
    ros_args.apply(&mut config)?;
    Ok(config)
}

/// A port of the loopback interface that nobody listens on at present.
fn free_port() -> Result<u16, NodeError> {
    std::net::TcpListener::bind((std::net::Ipv4Addr::LOCALHOST, 0))
        .and_then(|listener| listener.local_addr())
        .map(|address| address.port())
        .map_err(NodeError::io("looking for a free port on the loopback interface"))
}

/// Takes the force between `away_s` out of `run`, and returns it as points.
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

/// Compares every figure that both have.
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

/// Writes report and run; returns where the report is.
fn write_report(args: &Args, run: &Run, outcome: &Outcome) -> Result<PathBuf, NodeError> {
    let dir = args.out.clone().unwrap_or_else(|| {
        let target = Path::new("target");
        if target.is_dir() { target.to_owned() } else { std::env::temp_dir() }.join("mr-damper-demo")
    });
    std::fs::create_dir_all(&dir).map_err(NodeError::io(format!("creating {}", dir.display())))?;
    let path = dir.join("report.html");
    std::fs::write(&path, report::html(outcome))
        .map_err(NodeError::io(format!("writing {}", path.display())))?;
    let csv = dir.join("run.csv");
    match std::fs::remove_file(&csv) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            return Err(NodeError::io(format!("replacing {}", csv.display()))(error));
        }
        _ => crate::run::save(run, &csv, &crate::run::SaveOptions::default())?,
    }
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        args: Args,
    }

    #[test]
    fn without_a_command_the_defaults_are_the_command_line_s() {
        assert_eq!(Line::parse_from(["demo"]).args, Args::default());
        for bad in ["--seconds=0", "--seconds=nan", "--domain-id=300", "--seed=-1"] {
            assert!(Line::try_parse_from(["demo", bad]).is_err(), "{bad}");
        }
    }

    #[test]
    fn force_is_withheld_from_the_service_alone() {
        let experiment = Experiment::thesis("RP-ICPS").expect("a known experiment").with_duration_s(4.0);
        let whole = rig::record(&experiment, &Plant::default(), &Channels::default(), 1);
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
