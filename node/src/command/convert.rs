//! `mr-damper convert`: between CSV and rosbag2.

use crate::command::Surroundings;
use crate::command::run_args::RunArgs;
use crate::error::NodeError;
use crate::run::{self, SaveOptions};
use std::path::PathBuf;

/// Convert a run between CSV and rosbag2 (MCAP), without loss.
///
/// A target that ends in .csv becomes a CSV file, any other a rosbag2 directory.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// CSV file, rosbag2 directory, or .mcap file.
    #[arg(value_name = "IN")]
    pub input: PathBuf,
    /// Target; must not exist.
    #[arg(value_name = "OUT")]
    pub output: PathBuf,
    /// Namespace of the topics in a bag that is written, e.g. /front_left.
    #[arg(long, value_name = "NS", default_value = "")]
    pub namespace: String,
    /// How runs are read.
    #[command(flatten)]
    pub load: RunArgs,
}

/// Converts.
///
/// # Errors
/// When the run does not load, or the target exists or cannot be written.
pub fn run(args: &Args, around: &Surroundings) -> Result<(), NodeError> {
    let save = SaveOptions { namespace: args.namespace.clone(), ..SaveOptions::default() };
    let loaded = run::convert(&args.input, &args.output, &args.load.options(), &save)?;
    for note in &loaded.notes {
        tracing::warn!(run = %args.input.display(), "{note}");
    }
    if !around.quiet {
        let run = &loaded.run;
        eprintln!(
            "{}: {} displacements, {:.1} s, written to {}",
            args.input.display(),
            run.displacement_m.len(),
            run.duration().get(),
            args.output.display()
        );
    }
    Ok(())
}
