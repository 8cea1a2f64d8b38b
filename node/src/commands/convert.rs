//! `mr-damper convert`: converts runs between CSV and rosbag2, and between the formats of rosbag2.

use crate::commands::bag_args::BagArgs;
use crate::commands::context::CliContext;
use crate::commands::run_args::RunArgs;
use crate::settings::error::NodeError;
use mr_damper_base::shown;
use mr_damper_runs::{RunSection, SaveOptions};
use std::path::PathBuf;

/// Convert a run between CSV and rosbag2 (MCAP, sqlite3), without loss.
///
/// A target that ends in .csv, .mcap or .db3 is written as such a file, any other target as a rosbag2 directory. With
/// --start and --duration only a part of the run is written, for example one half for identification and one for tests.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// CSV file, rosbag2 directory, or .mcap or .db3 file; bags may be compressed, damaged, or without metadata.
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
    /// How bags are written.
    #[command(flatten)]
    pub bag: BagArgs,
    /// How runs are read.
    #[command(flatten)]
    pub load: RunArgs,
}

/// Converts the run.
///
/// # Errors
/// When the run does not load, or the target exists or cannot be written.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    args.bag.check(&args.output)?;
    let part = RunSection { start_s: args.start, duration_s: args.duration };
    let save = SaveOptions { namespace: args.namespace.clone(), part, bag: args.bag.options() };
    let loaded = mr_damper_runs::convert(&args.input, &args.output, &args.load.options()?, &save)?;
    for note in &loaded.notes {
        tracing::warn!(run = %args.input.display(), "{note}");
    }
    if !context.quiet {
        let (run, output) = (&loaded.run, args.output.display());
        let (count, length_s) = (run.displacement_m.len(), run.duration().get());
        let what = if part == RunSection::default() { "written to" } else { "a part of it written to" };
        let input = args.input.display();
        let text = format!("{input}: {count} displacements, {length_s:.1} s, {what} {output}");
        eprintln!("{}", shown::line(&text));
    }
    Ok(())
}
