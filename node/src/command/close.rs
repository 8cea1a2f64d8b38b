//! `mr-damper close`: names the physical effect that a model lacks, adds it, and says what it mends.

mod base;
pub mod live;
mod roles;
mod write;

use crate::command::Surroundings;
use crate::command::conditioning::ConditioningArgs;
use crate::command::output::OutputArgs;
use crate::command::progress::Working;
use crate::command::run_args::RunArgs;
use crate::error::NodeError;
use base::Base;
use clap::builder::PossibleValuesParser;
use live::LiveArgs;
use mr_damper_model::diagnose::{self, Runs, Settings, Sought, Stage};
use mr_damper_model::effect::Effect;
use mr_damper_model::identify::{Dataset, Watch};
use mr_damper_model::model_file::Role;
use roles::Given;
use std::path::PathBuf;
use std::time::Instant;

/// The two ways to call it.
const USAGE: &str = "\
mr-damper close --base <MODEL> --estimate <RUN>... --confirm <RUN>... --out <MODEL+.toml> [OPTIONS]
       mr-damper close --live [--history <S>] [--json [<FILE>]] [--ros-args ...]";

/// What it teaches at the end of `--help`.
const EXAMPLES: &str = "\
What each set of runs is for (whole runs; no file may serve twice):
  --estimate    effects are found on these. Excite what you suspect: several currents that step while the damper
                moves, small and large strokes, slow and fast
  --confirm     an effect must help on every one of these, or it is refused
  --test        sealed: read once, at the end, for the error before and after. Without them nothing is proved
  --replicates  two or more runs of one pattern: what they differ by is noise, and no effect is sought below it
  --reference   healthy runs, one for each of the above in the order estimate, confirm, test, with the same
                excitation: what changed since then is named, even where the base model is far off

Examples:
  mr-damper close --base damper.toml --estimate a.csv b.csv --confirm c.csv --test d.csv \\
                  --out damper+.toml --report close.html
      the model that is in use, with what it lacks
  mr-damper close --base fuzzy-tanh --estimate a.csv b.csv --confirm c.csv --test d.csv --out new.toml
      identifies the base on a.csv and b.csv first (with --reference: on the healthy runs)
  mr-damper close --base damper.toml --estimate worn-1.csv --confirm worn-2.csv --test worn-3.csv \\
                  --reference new-1.csv new-2.csv new-3.csv --out damper+.toml
      what wear has changed
  mr-damper close --live --history 60 --ros-args -r __ns:=/front_left
      has the node in that namespace do it, on its last 60 s and with the model that it runs";

/// Name the physical effect that a model lacks, add it to the model, and tell what it mends.
///
/// The base model runs free over the estimate runs; what it leaves over is held against a library of effects (lag of the
/// coil, friction, a spring in series, ...). An effect is named when it is significant, lies in its physical range, and
/// helps on every confirm run; up to three. The sealed runs are read once, at the end. When nothing is named, no model
/// file is written, which is an answer and no failure.
///
/// With --live a running node does it, with its own model and on what it remembers.
#[derive(Debug, clap::Args)]
#[command(after_long_help = EXAMPLES, override_usage = USAGE)]
pub struct Args {
    /// Where the results go.
    #[command(flatten)]
    pub output: OutputArgs,
    /// Recorded runs; `None` with --live.
    #[command(flatten)]
    pub recorded: Option<RecordedArgs>,
    /// A running node.
    #[command(flatten)]
    pub live: LiveArgs,
}

/// All arguments that `--live` leaves nothing to say. clap makes a group by the struct's name, but leaves it empty where
/// another one is flattened into the struct.
const GROUP: &str = "RecordedArgs";

/// A base and runs on disk.
#[derive(Debug, clap::Args)]
pub struct RecordedArgs {
    /// Model file, preset, or name of a model (fuzzy-tanh, kwok, ...) that is identified on the estimate runs first.
    #[arg(long, group = GROUP, value_name = "MODEL", required = false, required_unless_present = "live")]
    pub base: String,
    /// Runs that effects are found on: CSV files, rosbag2 directories, .mcap files.
    #[arg(long, group = GROUP, value_name = "RUN", num_args = 1.., required_unless_present = "live")]
    pub estimate: Vec<PathBuf>,
    /// Runs that decide whether a finding holds; at least one.
    #[arg(long, group = GROUP, value_name = "RUN", num_args = 1..)]
    pub confirm: Vec<PathBuf>,
    /// Sealed runs, read once at the end: error before and after.
    #[arg(long, group = GROUP, value_name = "RUN", num_args = 1..)]
    pub test: Vec<PathBuf>,
    /// Healthy runs with the same excitation, one for each run in the order estimate, confirm, test.
    #[arg(long, group = GROUP, value_name = "RUN", num_args = 1..)]
    pub reference: Vec<PathBuf>,
    /// Runs of one pattern, for the noise floor; at least two.
    #[arg(long, group = GROUP, value_name = "RUN", num_args = 1..)]
    pub replicates: Vec<PathBuf>,
    /// Noise floor in newtons root mean square, where you know it.
    #[arg(long, group = GROUP, value_name = "N", allow_hyphen_values = true, value_parser = positive)]
    pub noise_floor: Option<f64>,
    /// Least length of the blocks that evidence is counted by, s. With blocks under 3 s chance names effects more easily:
    /// shorten them only where there is no more data.
    #[arg(long, group = GROUP, value_name = "S", default_value_t = Settings::default().block_s)]
    pub block_s: f64,
    /// Effects to look for, by their ids (coil_lag, friction, ...), where you know what your damper can have [default: all of the
    /// library].
    #[arg(long, group = GROUP, value_name = "ID", num_args = 1.., value_delimiter = ',', value_parser = PossibleValuesParser::new(Effect::ids()))]
    pub effects: Vec<String>,
    /// Model file to write.
    #[arg(long, group = GROUP, value_name = "MODEL+.toml", required = false, required_unless_present = "live")]
    pub out: PathBuf,
    /// The form without the drive, when the base is a name.
    #[arg(long, group = GROUP)]
    pub passive: bool,
    /// Random starting points, when the base is a name [default: 25].
    #[arg(long, group = GROUP, value_name = "N")]
    pub restarts: Option<u32>,
    /// Seed of everything random.
    #[arg(long, group = GROUP, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// How runs become rows, when the base is a name; a model file holds its own filter and derivative.
    #[command(flatten)]
    pub conditioning: ConditioningArgs,
    /// How runs are read.
    #[command(flatten)]
    pub load: RunArgs,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("must be a positive number of newtons".to_owned()),
    }
}

/// Closes the loop, and writes what was found.
///
/// # Errors
/// With --live, those of a node that does not answer, rejects the goal or comes to nothing. Else when runs or base do not load
/// or do not go together, a run is given twice or a sealed one is not sealed, or a file cannot be written; when interrupted, in
/// which case nothing is written.
pub fn run(args: &Args, around: &Surroundings) -> Result<(), NodeError> {
    match &args.recorded {
        Some(recorded) => on_runs(recorded, &args.output, around),
        None => live::run(&args.live, &args.output, around),
    }
}

fn on_runs(args: &RecordedArgs, output: &OutputArgs, around: &Surroundings) -> Result<(), NodeError> {
    let started = Instant::now();
    roles::check_counts(args)?;
    write::check_targets(args, output)?;
    let base = Base::of(args)?;
    let working = Working::new(around.quiet);
    let given = roles::load(args, &base, around, &working)?;
    if args.test.is_empty() {
        tracing::warn!(
            "there are no sealed runs: nothing that is found will be proved. Give runs that nothing has touched with \
             --test"
        );
    }
    let base = base.identified(&given, args, around, &working)?;
    let data =
        given.iter().map(|given| given.rows(&base.model, args, around)).collect::<Result<Vec<_>, _>>()?;
    let of = |role: Role| -> Vec<Dataset> {
        given
            .iter()
            .zip(&data)
            .filter(|(given, _)| given.role == role)
            .map(|(_, data)| data.clone())
            .collect()
    };
    let [estimate, confirm, test, reference, replicates] =
        [Role::Estimate, Role::Confirm, Role::Test, Role::Reference, Role::Replicate].map(of);
    drop(data);
    let runs = Runs {
        estimate: &estimate,
        confirm: &confirm,
        test: &test,
        reference: &reference,
        replicates: &replicates,
    };
    let closing = close(&base, &runs, args, around, &working)?;
    drop(working);
    let done = write::Done { closing, base, runs, given: &given, seconds: started.elapsed().as_secs_f64() };
    write::all(args, output, &done, around)
}

fn close(
    base: &base::Identified,
    runs: &Runs,
    args: &RecordedArgs,
    around: &Surroundings,
    working: &Working,
) -> Result<diagnose::Closing, NodeError> {
    let sought = if args.effects.is_empty() { Sought::ALL } else { Sought::only(&args.effects)? };
    let settings = Settings {
        sought,
        noise_floor_n: args.noise_floor,
        block_s: args.block_s,
        seed: args.seed,
        ..Settings::default()
    };
    if settings.block_s < Settings::default().block_s {
        tracing::warn!(
            "blocks of {} s are shorter than the {} s at which chance was seen to name nothing: hold what is named against \
             another run",
            settings.block_s,
            Settings::default().block_s
        );
    }
    let progress = |progress| working.progress(progress);
    let watch = Watch { cancel: Some(around.interrupt.flag()), progress: Some(&progress) };
    diagnose::close(&base.model, runs, &settings, &watch, &|stage| working.stage(&in_words(stage)))
        .map_err(interrupted)
}

/// An error of the model crate, where cancelled work is interrupted work.
fn interrupted(error: mr_damper_model::Error) -> NodeError {
    match error {
        mr_damper_model::Error::Cancelled => NodeError::Interrupted,
        error => error.into(),
    }
}

/// What is being done, for people.
pub(crate) fn in_words(stage: Stage) -> String {
    match stage {
        Stage::Base => "refitting the base".to_owned(),
        Stage::Scores(round) => format!("effect {round}: scores of the library"),
        Stage::Refits(round) => format!("effect {round}: refitting the best candidates"),
        Stage::Pruning => "taking away what is not needed".to_owned(),
        Stage::Rival => "asking whether a better base would do".to_owned(),
        Stage::Sealed => "reading the sealed runs".to_owned(),
    }
}

impl Given {
    /// The run as rows, conditioned as `model` is.
    fn rows(
        &self,
        model: &mr_damper_model::model::Model,
        args: &RecordedArgs,
        around: &Surroundings,
    ) -> Result<Dataset, NodeError> {
        if around.interrupt.is_raised() {
            return Err(NodeError::Interrupted);
        }
        Ok(Dataset::from_run(&self.run, &model.conditioning, &args.conditioning.dataset())?)
    }
}
