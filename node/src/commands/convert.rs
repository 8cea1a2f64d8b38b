//! `mr-damper convert`: converts runs between CSV and rosbag2, between the formats of rosbag2, and from logs of a bus, and models of fuzzy
//! rules between model files and MATLAB's FIS files.

use crate::commands::bag_args::BagArgs;
use crate::commands::context::CliContext;
use crate::commands::fis::{self, ScaleArgs};
use crate::commands::run_args::{RunArgs, log_notes};
use crate::settings::error::NodeError;
use mr_damper_base::shown;
use mr_damper_runs::{RunSection, SaveOptions, write_text};
use std::path::{Path, PathBuf};

/// Convert a run between CSV and rosbag2 (MCAP, sqlite3), or from a log of a CAN bus; or a model of fuzzy rules to and from MATLAB's .fis.
///
/// Runs: a target that ends in .csv, .mcap or .db3 is written as such a file, any other target as a rosbag2 directory,
/// without loss. With --start and --duration only a part of the run is written, for example one half for identification
/// and one for tests; --cycles and --whole-cycles cut at the same phase of the motion. --resample writes samples at an even rate.
///
/// Models: if OUT ends in .fis, IN is a model file or preset of fuzzy rules (anfis, tsk-...). If IN ends in .fis, OUT is a
/// model file that ends in .toml, and --like or --rate gives what the FIS file does not hold. `mr-damper fis` converts
/// several files at once, and its --help says what a FIS file can hold.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// CSV file, rosbag2 directory, or .mcap or .db3 file; bags may be compressed, damaged, or without metadata. Or a log of a
    /// CAN bus (.mf4, .asc, .blf, candump's .log), with --dbc and --map. Or a .fis file, or for a .fis target a model file or
    /// preset.
    #[arg(value_name = "IN")]
    pub input: PathBuf,
    /// Target; must not exist.
    #[arg(value_name = "OUT")]
    pub output: PathBuf,
    /// Namespace of the topics in the written bag, e.g. /front_left.
    #[arg(long, value_name = "NS", default_value = "")]
    pub namespace: String,
    /// Start this many seconds into the run.
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    pub start: f64,
    /// Write this many seconds; by default to the end.
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Write these cycles, both included, counted from 1. A cycle begins where displacement rises through the middle of its
    /// range. --start and --duration then count within them.
    #[arg(long, value_name = "FIRST:LAST", value_parser = cycles)]
    pub cycles: Option<(u32, u32)>,
    /// Cut at the same phase of the motion: move the start to the next start of a cycle, and the end to the one before.
    #[arg(long)]
    pub whole_cycles: bool,
    /// Resample all channels to this rate by linear interpolation, before the run is cut. Models that use force need samples at
    /// an even rate. The channels are not filtered, so the rate must be above twice the highest frequency of the motion.
    #[arg(long, value_name = "HZ")]
    pub resample: Option<f64>,
    /// How bags are written.
    #[command(flatten)]
    pub bag: BagArgs,
    /// How runs are read.
    #[command(flatten)]
    pub load: RunArgs,
    /// What a FIS file does not hold.
    #[command(flatten, next_help_heading = "Reading FIS files")]
    pub scale: ScaleArgs,
}

/// Converts the run or the model.
///
/// # Errors
/// When the source does not load, or the target exists, cannot hold it or cannot be written; when an argument does not
/// apply to the source or the target.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    let (from_fis, to_fis) = (fis::is_fis(&args.input), fis::is_fis(&args.output));
    if !from_fis {
        args.refuse(
            "is for a FIS file as IN",
            &[("--like", args.scale.like.is_some()), ("--rate", args.scale.rate.is_some())],
        )?;
    }
    if !from_fis && !to_fis {
        return convert_run(args, context);
    }
    args.refuse(
        "is for runs, but this is a conversion of a model",
        &[
            ("--namespace", !args.namespace.is_empty()),
            ("--start", args.start != 0.0),
            ("--duration", args.duration.is_some()),
            ("--cycles", args.cycles.is_some()),
            ("--whole-cycles", args.whole_cycles),
            ("--resample", args.resample.is_some()),
        ],
    )?;
    let given = args.bag.given().or(args.load.given());
    args.refuse(
        "is for runs, but this is a conversion of a model",
        &[(given.unwrap_or_default(), given.is_some())],
    )?;
    convert_model(&args.input, &args.output, &args.scale, context)
}

impl Args {
    /// Refuses the first of the `arguments` that is given.
    fn refuse(&self, why: &str, arguments: &[(&str, bool)]) -> Result<(), NodeError> {
        match arguments.iter().find(|(_, given)| *given) {
            Some((argument, _)) => Err(NodeError::Usage(format!(
                "{argument} {why}: {} to {}",
                self.input.display(),
                self.output.display()
            ))),
            None => Ok(()),
        }
    }
}

/// Converts a model of fuzzy rules to or from a FIS file.
fn convert_model(
    input: &Path,
    output: &Path,
    scale: &ScaleArgs,
    context: &CliContext,
) -> Result<(), NodeError> {
    let to_toml = output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
    let text = match (fis::is_fis(input), fis::is_fis(output)) {
        (true, _) if to_toml => fis::model_text(input, scale)?,
        (false, true) => fis::fis_text(&input.to_string_lossy())?,
        _ => {
            return Err(NodeError::Usage(format!(
                "{}: a FIS file becomes a model file, whose name ends in .toml; give such a name in place of {}",
                input.display(),
                output.display()
            )));
        }
    };
    if output.exists() {
        let message = "exists; give another target".to_owned();
        return Err(NodeError::File { path: output.to_owned(), message });
    }
    write_text(output, &text)?;
    if !context.quiet {
        let text = format!("{}: written to {}", input.display(), output.display());
        eprintln!("{}", shown::line(&text));
    }
    Ok(())
}

/// Parses `--cycles`.
fn cycles(text: &str) -> Result<(u32, u32), &'static str> {
    let numbers = text.split_once(':').map(|(first, last)| (first.parse::<u32>(), last.parse::<u32>()));
    match numbers {
        Some((Ok(first), Ok(last))) if first >= 1 && first <= last => Ok((first, last)),
        _ => Err("give the first and the last cycle, counted from 1, as in 10:40"),
    }
}

/// Converts a run.
fn convert_run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    args.bag.check(&args.output)?;
    let part = RunSection {
        start_s: args.start,
        duration_s: args.duration,
        cycles: args.cycles,
        whole_cycles: args.whole_cycles,
    };
    let save = SaveOptions {
        namespace: args.namespace.clone(),
        part,
        bag: args.bag.options(),
        resample_hz: args.resample,
    };
    let converted = mr_damper_runs::convert(&args.input, &args.output, &args.load.options()?, &save)?;
    log_notes(&args.input, &converted.read.notes);
    if !context.quiet {
        let text = format!("{}: {converted}, written to {}", args.input.display(), args.output.display());
        eprintln!("{}", shown::line(&text));
    }
    Ok(())
}
