//! `mr-damper design`: designs the run that best tells apart effects that a diagnosis could not.

use crate::commands::context::CliContext;
use crate::commands::number::{hertz, interval, newtons, seconds};
use crate::commands::output;
use crate::commands::progress::Working;
use crate::commands::targets::{self, Target};
use crate::estimation::models;
use crate::settings::error::NodeError;
use mr_damper_base::shown;
use mr_damper_model::diagnose::design::{Limits, Question, Settings, design};
use mr_damper_model::identify::Watch;
use mr_damper_model::model::Model;
use mr_damper_model::sample::DriveKind;
use mr_damper_reports::design::{self as report, DesignOutcome};
use mr_damper_reports::open_questions::OpenQuestions;
use mr_damper_runs::SaveOptions;
use std::path::{Path, PathBuf};

/// Examples at the end of `--help`.
const EXAMPLES: &str = "\
Examples:
  mr-damper design --model damper+.toml --for \"friction|gas_spring\" --stroke 0.02 --speed 0.4 --current 2 --duration 30
      a run of 30 s that tells friction from a gas spring, in design.csv
  mr-damper design --model damper+.toml --for \"friction|gas_spring, inertia\" --stroke 0.02 --speed 0.4 --current 2
      the same run also tests whether there is a mass
  mr-damper design --model damper+.toml --from close.json --stroke 0.02 --speed 0.4 --current 2 --out next.csv
      what the report of mr-damper close left open
  mr-damper replay next.csv
      plays displacement and current onto the topics of a test bench";

/// Design the run that best tells apart effects that a diagnosis could not.
///
/// The run holds displacement and drive, within the limits of stroke, speed, acceleration and drive. The criterion is the
/// distance of the forces that the rivals predict, after a refit of the model and of the rival. The report has the expected
/// discrimination and the seconds that are needed, and the same for a road profile of the same length. If no run within the limits
/// separates any of the effects, no file is written, and the exit code is 1.
///
/// The recorded run serves a diagnosis in two parts: the first two thirds as training run, the last third as validation run.
#[derive(Debug, clap::Args)]
#[command(after_long_help = EXAMPLES)]
pub struct Args {
    /// Model file or preset, as `close` wrote it or took it. Effects of --for that it has are taken out of it.
    #[arg(long, value_name = "MODEL")]
    pub model: String,
    /// Effects to tell apart, with | between them. An id alone: test whether this effect is there. A comma separates questions.
    #[arg(long = "for", value_name = "ID|ID", required_unless_present = "from", value_parser = Question::parse)]
    pub question: Option<Question>,
    /// JSON report of `close`: the run decides what the report left open. --for overrides it.
    #[arg(long, visible_alias = "report", value_name = "CLOSE.json")]
    pub from: Option<PathBuf>,
    /// Largest displacement to either side of the middle, m.
    #[arg(long, value_name = "M", allow_hyphen_values = true)]
    pub stroke: f64,
    /// Largest speed, m/s.
    #[arg(long, value_name = "M/S", allow_hyphen_values = true)]
    pub speed: f64,
    /// Largest acceleration, m/s².
    #[arg(long, value_name = "M/S2", default_value_t = Limits::default().acceleration_m_s2, allow_hyphen_values = true)]
    pub acceleration: f64,
    /// Largest current, A; the smallest is 0. Or both: LOW:HIGH.
    #[arg(long, value_name = "A", conflicts_with = "voltage", allow_hyphen_values = true, value_parser = interval)]
    pub current: Option<[f64; 2]>,
    /// Largest command voltage, V, for a model with this drive; the smallest is 0. Or both: LOW:HIGH.
    #[arg(long, value_name = "V", allow_hyphen_values = true, value_parser = interval)]
    pub voltage: Option<[f64; 2]>,
    /// Duration of the run, s, with its rest at both ends.
    #[arg(long, value_name = "S", default_value_t = Limits::default().duration_s, allow_hyphen_values = true, value_parser = seconds)]
    pub duration: f64,
    /// Rate of the samples, Hz.
    #[arg(long, value_name = "HZ", default_value_t = Limits::default().rate_hz, allow_hyphen_values = true, value_parser = hertz)]
    pub rate: f64,
    /// Noise and misfit of the model, N (root mean square). By default the noise floor of the report (--from); without it, the error in
    /// simulation that the model file states (free_run_rsse_n); without both, 1 % of the force. `identify` states the error on the validation
    /// runs, or without them on the training runs; `close` the error on the test runs, or without them on the validation runs.
    #[arg(long, value_name = "N", allow_hyphen_values = true, value_parser = newtons)]
    pub noise: Option<f64>,
    /// Seed: another one gives another run.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// The run: a CSV file, a bag directory, or .mcap or .db3. It must not exist.
    #[arg(long, value_name = "RUN.csv", default_value = "design.csv")]
    pub out: PathBuf,
    /// Overwrite an existing CSV file.
    #[arg(long)]
    pub force: bool,
    /// Write the figures as JSON to a file; without a file name, or with -, to stdout in place of the text.
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-")]
    pub json: Option<PathBuf>,
}

/// Designs the run, writes it and reports it.
///
/// # Errors
/// When the model or the report does not load, a limit does not fit, no run separates any of the effects, or a file cannot be
/// written; [`NodeError::Interrupted`].
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    let inputs = [Some(Path::new(&args.model)), args.from.as_deref()].into_iter().flatten();
    let run = std::iter::once(Target::run_or_table("--out", &args.out));
    targets::check(inputs, run.chain(targets::json(args.json.as_deref())))?;
    let model = models::load(&args.model)?;
    let limits = args.limits(&model)?;
    if !args.force && args.out.symlink_metadata().is_ok() {
        return Err(NodeError::File {
            path: args.out.clone(),
            message: "exists already; give another --out, or --force for a CSV file".to_owned(),
        });
    }
    let mut open = match (&args.question, &args.from) {
        (Some(question), _) => OpenQuestions::asked(question.clone()),
        (None, Some(path)) => {
            let fault = |message: String| NodeError::in_file(path, message);
            let text = std::fs::read_to_string(path).map_err(|error| fault(error.to_string()))?;
            OpenQuestions::of_report(&text).map_err(|error| fault(error.to_string()))?
        }
        (None, None) => return Err(NodeError::Usage("give --for or --from".to_owned())),
    };
    let noise_n = open.noise(args.noise);
    let OpenQuestions { question, mut notes, .. } = open;
    notes.extend(report::beyond(&model, &limits));
    let working = Working::new(context.quiet);
    working.stage("designing the run");
    let settings = Settings { noise_n, seed: args.seed, ..Settings::default() };
    let watch = Watch { cancel: Some(context.interrupt.flag()), progress: None };
    let designed = design(&model, &question, &limits, &settings, &watch);
    drop(working);
    let designed = designed?;
    write(&designed.run, &args.out, args.force)?;
    let outcome = DesignOutcome {
        model: args.model.clone(),
        drive: model.force.drive(),
        question,
        limits,
        design: designed,
        run: args.out.display().to_string(),
        seed: args.seed,
        notes,
    };
    match &args.json {
        Some(path) => output::json(path, &report::json(&outcome)),
        None => {
            print!("{}", shown::lines(&report::text(&outcome)));
            Ok(())
        }
    }
}

impl Args {
    /// The limits, with those of the drive of `model`.
    fn limits(&self, model: &Model) -> Result<Limits, NodeError> {
        let needs = |kind: DriveKind, needed: &str| {
            format!("the drive of the model is a {}; give its limit with {needed}", kind.in_words())
        };
        let wrong = |given: &str, kind: DriveKind, needed: &str| {
            NodeError::Usage(format!("{given}: {}", needs(kind, needed)))
        };
        match model.force.drive() {
            Some(kind @ DriveKind::CoilCurrent) if self.voltage.is_some() => {
                return Err(wrong("--voltage", kind, "--current"));
            }
            Some(kind @ DriveKind::CommandVoltage) if self.current.is_some() => {
                return Err(wrong("--current", kind, "--voltage"));
            }
            Some(kind) if self.current.is_none() && self.voltage.is_none() => {
                let needed = if kind == DriveKind::CoilCurrent { "--current A" } else { "--voltage V" };
                return Err(NodeError::Usage(needs(kind, needed)));
            }
            _ => {}
        }
        let limits = Limits {
            stroke_m: self.stroke,
            speed_m_s: self.speed,
            acceleration_m_s2: self.acceleration,
            drive: self.current.or(self.voltage),
            duration_s: self.duration,
            rate_hz: self.rate,
        };
        limits.check()?;
        Ok(limits)
    }
}

/// Writes the run. With `force`, an existing CSV file is replaced when the new one is complete.
fn write(run: &mr_damper_model::sample::Run, path: &Path, force: bool) -> Result<(), NodeError> {
    let options = SaveOptions::default();
    if !force || path.symlink_metadata().is_err() {
        return Ok(mr_damper_runs::save(run, path, &options)?);
    }
    if !path.is_file() || path.extension().is_none_or(|extension| extension != "csv") {
        let message = "is not a CSV file, so it is not overwritten; give another --out".to_owned();
        return Err(NodeError::File { path: path.to_owned(), message });
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let new = path.with_file_name(format!(".{name}.{}.csv", std::process::id()));
    mr_damper_runs::save(run, &new, &options)?;
    std::fs::rename(&new, path).map_err(NodeError::io(format!("replacing {}", path.display())))
}
