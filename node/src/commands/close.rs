//! `mr-damper close`: finds the physical effects that a model lacks, adds them, and reports the error before and after.

mod base;
pub mod live;
mod roles;
mod write;

use crate::commands::conditioning::ConditioningArgs;
use crate::commands::context::CliContext;
use crate::commands::number::{newtons, range, seconds};
use crate::commands::output::OutputArgs;
use crate::commands::progress::Working;
use crate::commands::run_args::RunArgs;
use crate::settings::error::NodeError;
use base::{Base, Prepared};
use clap::builder::PossibleValuesParser;
use live::LiveArgs;
use mr_damper_model::condition::Conditioning;
use mr_damper_model::diagnose::{self, EffectSet, Ranges, Runs, Settings};
use mr_damper_model::effect::Effect;
use mr_damper_model::effect::term::MAX_TERMS;
use mr_damper_model::identify::{Dataset, Watch};
use mr_damper_model::model_file::Role;
use mr_damper_reports::diagnosis::json::FailureDocument;
use mr_damper_reports::diagnosis::words::stage_in_words;
use roles::Given;
use std::path::PathBuf;
use std::time::Instant;

/// The usage line of `--help`: recorded runs, or a running node.
const USAGE: &str = "\
mr-damper close [--base <MODEL>] --estimate <RUN>... --confirm <RUN>... --out <MODEL+.toml> [OPTIONS]
       mr-damper close --live [--history <S>] [--json [<FILE>]] [--ros-args ...]";

/// The end of `--help`: the sets of runs, and examples.
const EXAMPLES: &str = "\
The sets of runs (whole runs; no file may be used twice):
  --estimate    training runs: effects are searched on these. Excite the effects that you suspect: several
                currents that step while the damper moves, small and large strokes, slow and fast motion
  --confirm     validation runs: an effect must reduce the error on every one of these, or it is refused
  --test        test runs: read once, at the end, for the error before and after. Without them no proof
  --replicates  two or more runs of one pattern: their differences are noise; no effect is searched below it
  --reference   healthy runs, one for each run in the order estimate, confirm, test, with the same excitation:
                only the changes since then are diagnosed, even if the base model fits poorly. They are aligned
                by crank angle or by time
  --healthy     runs of the same damper when it was healthy: they tell whether an effect or a term is new,
                or a part of the structure that the base lacks

Examples:
  mr-damper close --estimate a.csv b.csv --confirm c.csv --test d.csv --out damper.toml --report close.html
      chooses the structure of the model, identifies it, and adds the effects that it lacks
  mr-damper close --base damper.toml --estimate a.csv b.csv --confirm c.csv --test d.csv \\
                  --out damper+.toml --report close.html
      adds the effects that the model in use lacks
  mr-damper close --base fuzzy-tanh --estimate a.csv b.csv --confirm c.csv --test d.csv --out new.toml
      first identifies this structure on a.csv and b.csv (with --reference: on the healthy runs). Other structures
      are tried too; if one of them fits clearly better, new.toml has that one. --fixed-base keeps to fuzzy-tanh
  mr-damper close --base damper.toml --estimate worn-1.csv --confirm worn-2.csv --test worn-3.csv \\
                  --reference new-1.csv new-2.csv new-3.csv --out damper+.toml
      finds what wear has changed
  mr-damper close --live --history 60 --ros-args -r __ns:=/front_left
      the node in that namespace diagnoses the model that it runs, on its last 60 s of input";

/// Find the physical effect that a model lacks, add it to the model, and report the error before and after.
///
/// The base model simulates the training runs (--estimate) from displacement and drive. The residual is compared with a
/// library of effects (coil lag, friction, a spring in series, ...). An effect is accepted if it is significant, its
/// parameters are in their physical range, and it reduces the error on every validation run (--confirm); at most three
/// effects are accepted. The error that remains is searched for terms: effects that the library does not have (--terms).
/// The test runs (--test) are read once, at the end. If neither an effect nor a term is found, no model file is written;
/// the exit code is still 0.
///
/// With --live, a running node does this for its own model, on its input history.
#[derive(Debug, clap::Args)]
#[command(after_long_help = EXAMPLES, override_usage = USAGE)]
pub struct Args {
    /// Output files.
    #[command(flatten)]
    pub output: OutputArgs,
    /// Base model and recorded runs; `None` with --live.
    #[command(flatten)]
    pub recorded: Option<RecordedArgs>,
    /// Options for a running node.
    #[command(flatten)]
    pub live: LiveArgs,
}

/// Group of all arguments that conflict with `--live`. clap makes a group with the struct's name, but leaves it empty if
/// another struct is flattened into it, so each argument names the group itself.
const GROUP: &str = "RecordedArgs";

/// The value of `--effects` for no effect.
const NO_EFFECTS: &str = "none";

/// Arguments for a base model and recorded runs.
#[derive(Debug, clap::Args)]
pub struct RecordedArgs {
    /// Model file, preset, name of a model (fuzzy-tanh, kwok, ...), or `auto`. A named model is first identified, on the
    /// healthy runs if --reference is given, else on the training runs. Several other structures
    /// are identified and diagnosed, too. It stays the base if it fits the validation runs about as well as the best of them; else the simplest that
    /// does becomes the base, as with `auto`. An effect is named only if it does not depend on that choice. With --reference,
    /// name the model in use.
    #[arg(long, group = GROUP, value_name = "MODEL", default_value = base::AUTO)]
    pub base: String,
    /// Diagnose the base of --base as it is, with its filter and velocity, and no other structure. That is
    /// faster, but an effect that is found may stand for what this structure cannot follow. A linear base is always fixed.
    #[arg(long, group = GROUP)]
    pub fixed_base: bool,
    /// Training runs, on which effects are searched: CSV files, rosbag2 directories, .mcap files, logs of a
    /// CAN bus.
    #[arg(long, group = GROUP, value_name = "RUN", num_args = 1.., required_unless_present = "live")]
    pub estimate: Vec<PathBuf>,
    /// Validation runs: an effect must reduce the error on every one of them; at least one.
    #[arg(long, group = GROUP, value_name = "RUN", num_args = 1..)]
    pub confirm: Vec<PathBuf>,
    /// Test runs, read once at the end for the error before and after.
    #[arg(long, group = GROUP, value_name = "RUN", num_args = 1..)]
    pub test: Vec<PathBuf>,
    /// Healthy runs with the same excitation, one for each run in the order estimate, confirm, test.
    #[arg(long, group = GROUP, value_name = "RUN", num_args = 1..)]
    pub reference: Vec<PathBuf>,
    /// Runs of one pattern, from which the noise floor is computed; at least two. They take precedence over --noise-floor.
    #[arg(long, group = GROUP, value_name = "RUN", num_args = 1..)]
    pub replicates: Vec<PathBuf>,
    /// Noise floor as a root mean square in newtons, if you know it: of the force after the low-pass filter on the output (20 Hz by
    /// default), so it is less than the noise of the load cell. At 512 Hz, 3 N of white noise become 0.74 N. With --fixed-base or
    /// --reference, the filter is the base's. If --replicates are given, they decide.
    #[arg(long, group = GROUP, value_name = "N", allow_hyphen_values = true, value_parser = newtons)]
    pub noise_floor: Option<f64>,
    /// Minimum length of the blocks of the significance tests, s [default: 3; with --reference on a cyclic motion, one cycle]. Blocks shorter than 3 s give more false
    /// positives: use them only if the data are too short for 3 s. On test runs the length follows from the data, and this
    /// option can only make it longer.
    #[arg(long, group = GROUP, value_name = "S", allow_hyphen_values = true, value_parser = seconds)]
    pub block_s: Option<f64>,
    /// Ids of the effects to search for (coil_lag, friction, ...), if you know which ones your damper can have, or `none` to
    /// search for terms alone [default: the whole library].
    #[arg(long, group = GROUP, value_name = "ID", num_args = 1.., value_delimiter = ',', value_parser = PossibleValuesParser::new(Effect::ids().into_iter().chain([NO_EFFECTS])))]
    pub effects: Vec<String>,
    /// Physical range of an effect's first parameter, in its unit, for a machine that is not a damper of a few kilonewtons:
    /// inertia=0:200 for masses up to 200 kg. May be given several times.
    #[arg(long, group = GROUP, value_name = "ID=LOW:HIGH", allow_hyphen_values = true, value_parser = range)]
    pub range: Vec<(String, [f64; 2])>,
    /// Largest number of terms to discover in the error that the effects of the library leave; 0 for none.
    #[arg(long, group = GROUP, value_name = "N", default_value_t = MAX_TERMS as u8, value_parser = clap::value_parser!(u8).range(0..=MAX_TERMS as i64))]
    pub terms: u8,
    /// Largest number of samples of the training, validation or healthy runs on which effects and terms are searched; 0 for all. From longer runs
    /// the search takes stretches of up to 16 s from each. The model found is fitted to all samples. With --reference all are used.
    #[arg(long, group = GROUP, value_name = "N", default_value_t = Settings::DEFAULT_MOST_SAMPLES)]
    pub search_samples: usize,
    /// Runs of the same damper when it was healthy, with any excitation. They tell an effect or a term that is new from one that the structure of
    /// the base lacks. With --reference no terms are discovered.
    #[arg(long, group = GROUP, value_name = "RUN", num_args = 1.., conflicts_with = "reference")]
    pub healthy: Vec<PathBuf>,
    /// Model file to write.
    #[arg(long, group = GROUP, value_name = "MODEL+.toml", required = false, required_unless_present = "live")]
    pub out: PathBuf,
    /// Use the form without the drive, if the base is the name of a model.
    #[arg(long, group = GROUP)]
    pub passive: bool,
    /// Random starting points, if the base is the name of a model [default: 25].
    #[arg(long, group = GROUP, value_name = "N")]
    pub restarts: Option<u32>,
    /// Seed of all random numbers.
    #[arg(long, group = GROUP, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// How runs become rows, if the base is the name of a model; a model file already contains filter and derivative.
    #[command(flatten)]
    pub conditioning: ConditioningArgs,
    /// How runs are read.
    #[command(flatten)]
    pub load: RunArgs,
}

/// Runs the diagnosis and writes its results.
///
/// # Errors
/// With --live, when the node does not answer, rejects the goal or fails. Without it, when the runs or the base do not load
/// or do not fit together, a run is given twice, a test run was used for the base, or a file cannot be written.
/// [`NodeError::Interrupted`]; then nothing is written. If the diagnosis is refused, the JSON (`--json`) is the sentence with
/// the code and the fields of the reason, and nothing else is written.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    let done = match &args.recorded {
        Some(recorded) => on_runs(recorded, &args.output, context),
        None => live::run(&args.live, &args.output, context),
    };
    if let Err(error) = &done
        && error.reason().is_some()
    {
        args.output.json_only(&FailureDocument::new(error.to_string(), error.reason()))?;
    }
    done
}

fn on_runs(args: &RecordedArgs, output: &OutputArgs, context: &CliContext) -> Result<(), NodeError> {
    let started = Instant::now();
    roles::check_counts(args)?;
    write::check_targets(args, output)?;
    let base = Base::of(args)?;
    let working = Working::of(context);
    let given = roles::load(args, &base, context, &working)?;
    if args.test.is_empty() {
        tracing::warn!(
            "there are no test runs, so no effect that is found will be proved. Give runs that were not used before with \
             --test"
        );
    }
    let base = base.prepared(&given, args, context, &working)?;
    let rows = |given: &Given| given.rows(base.conditioning(), args, context);
    let data = given.iter().map(rows).collect::<Result<Vec<_>, _>>()?;
    let of = |role: Role| -> Vec<Dataset> {
        given
            .iter()
            .zip(&data)
            .filter(|(given, _)| given.role == role)
            .map(|(_, data)| data.clone())
            .collect()
    };
    let [estimate, confirm, test, reference, replicates, healthy] =
        [Role::Estimate, Role::Confirm, Role::Test, Role::Reference, Role::Replicate, Role::Healthy].map(of);
    drop(data);
    let runs = Runs {
        estimate: &estimate,
        confirm: &confirm,
        test: &test,
        reference: &reference,
        replicates: &replicates,
        healthy: &healthy,
    };
    let result = close(&base, &runs, args, context, &working)?;
    drop(working);
    let base = base.of_result(&result);
    let done = write::Done { result, base, runs, given: &given, seconds: started.elapsed().as_secs_f64() };
    write::all(args, output, &done, context)
}

fn close(
    base: &Prepared,
    runs: &Runs,
    args: &RecordedArgs,
    context: &CliContext,
    working: &Working,
) -> Result<diagnose::DiagnosisResult, NodeError> {
    let effects = match &args.effects[..] {
        [] => EffectSet::ALL,
        [only] if only == NO_EFFECTS => EffectSet::NONE,
        ids if ids.iter().any(|id| id == NO_EFFECTS) => {
            return Err(NodeError::Usage(format!(
                "--effects {NO_EFFECTS} cannot be given with other ids: leave them out"
            )));
        }
        ids => EffectSet::only(ids)?,
    };
    let with = |ranges: Ranges, (id, range): &(String, [f64; 2])| ranges.with(id, *range);
    let settings = Settings {
        effects,
        ranges: args.range.iter().try_fold(Ranges::default(), with)?,
        noise_floor_n: args.noise_floor,
        block_s: args.block_s,
        most_terms: args.terms.into(),
        most_samples: if args.search_samples == 0 { usize::MAX } else { args.search_samples },
        seed: args.seed,
        ..Settings::default()
    };
    if settings.training_block_s() < Settings::DEFAULT_BLOCK_S {
        tracing::warn!(
            "block length {} s is below the {} s that was validated against false positives; confirm the result on another \
             run",
            settings.training_block_s(),
            Settings::DEFAULT_BLOCK_S
        );
    }
    let progress = |progress| working.progress(progress);
    let watch = Watch { cancel: Some(context.interrupt.flag()), progress: Some(&progress) };
    let stage = |stage| working.stage(&stage_in_words(stage));
    Ok(base.diagnose(runs, &settings, &watch, &stage)?)
}

impl Given {
    /// The run as rows.
    fn rows(
        &self,
        conditioning: &Conditioning,
        args: &RecordedArgs,
        context: &CliContext,
    ) -> Result<Dataset, NodeError> {
        if context.interrupt.is_raised() {
            return Err(NodeError::Interrupted);
        }
        Ok(Dataset::from_run(&self.run, conditioning, &args.conditioning.dataset())?)
    }
}
