//! `mr-damper node`: runs the service.

use crate::commands::context::CliContext;
use crate::nodes::damper_node::DDS_THREAD;
use crate::nodes::fleet::Fleet;
use crate::process::hardened;
use crate::ros2::participant::{self, DdsThreadEnded};
use crate::settings::config::{self, ParameterFlags};
use crate::settings::error::{NodeError, PartError};
use crate::watchdogs::memory;
use mr_damper_base::shown;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// How often the node checks its threads.
const WATCH: Duration = Duration::from_millis(100);
/// How long a node may take to stop after one of its threads has died. Code that waits for that thread never returns.
const LAST_WORDS: Duration = Duration::from_secs(5);

/// Run the service: subscribe to displacement and drive, publish force estimates and residuals.
///
/// The command takes the usual ROS arguments: --ros-args -p name:=value -r from:=to -r __ns:=/front_left
/// --params-file FILE --log-level LEVEL. Flags override ROS parameters, and ROS parameters override --config.
///
/// To serve several dampers in one process, list their names in the parameter dampers. Each damper is a node in its own
/// namespace, and its parameters have its name as a prefix (front_left.model); parameters without such a prefix apply to
/// all. An example is launch-configs/vehicle.toml.
///
/// Example: mr-damper node --ros-args -p model:=thesis/fuzzy-tanh/rp3-cs
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Configuration file (TOML) that sets the parameters below by name.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Parameters as flags.
    #[command(flatten)]
    pub parameters: ParameterFlags,
}

/// Runs the service until a signal comes or a thread dies.
///
/// # Errors
/// When the service does not start, a thread of the service or of a middleware has panicked, or the process exceeds its
/// memory limit.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    let dampers = config::dampers(args.config.as_deref(), &context.ros_args, &args.parameters.given)?;
    tracing::info!("{}", hardened::summary());
    let fleet = Fleet::start(&dampers)?;
    for ((_, service), damper) in fleet.services().zip(&dampers) {
        let names = service.names();
        let names = names.read().unwrap_or_else(std::sync::PoisonError::into_inner);
        tracing::info!(
            model = names.free,
            arx_model = names.seeded.as_deref().unwrap_or("none"),
            reach = participant::reach(&damper.config)?,
            zenoh = or_none(&damper.config.zenoh.listen),
            node = damper.args.full_name(),
            "the node is up"
        );
    }
    memory::bound(dampers.len());
    let mut dead = None;
    while context.interrupt.sleep_until(Instant::now() + WATCH) {
        if let Err(outgrown) = memory::check(dampers.len()) {
            // An orderly stop would wait for the thread that takes the memory. The end of the process closes everything.
            std::mem::forget(fleet);
            return Err(outgrown.into());
        }
        dead = fleet.dead_thread().map(|(damper, thread)| DeadThread::of(thread, damper));
        if let Some(died) = &dead {
            end_at_last(died)?;
            break;
        }
    }
    let counters: Vec<_> =
        fleet.services().map(|(name, service)| (name.to_owned(), service.counters())).collect();
    let ended = fleet.stop();
    for (damper, counters) in counters {
        tracing::info!(
            damper,
            samples = counters.estimator.samples.load(Ordering::Relaxed),
            refused = counters.estimator.refused.load(Ordering::Relaxed),
            incomplete = counters.source.incomplete.load(Ordering::Relaxed),
            estimates = counters.ros_sink.estimates.load(Ordering::Relaxed),
            residuals = counters.ros_sink.residuals.load(Ordering::Relaxed),
            commands = counters.ros_sink.commands.load(Ordering::Relaxed),
            lost = counters.lost(),
            losses = counters.losses_in_words(),
            "the node has ended"
        );
    }
    match dead {
        Some(died) => Err(died.into()),
        None => Ok(ended?),
    }
}

/// The endpoints as text for the log.
fn or_none(endpoints: &[String]) -> String {
    if endpoints.is_empty() { "none".to_owned() } else { endpoints.join(", ") }
}

/// A thread has died, so the node has ended.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
enum DeadThread {
    /// A thread of the DDS library.
    #[error(transparent)]
    OfDds(DdsThreadEnded),
    /// A thread of a damper's service.
    #[error(
        "the {thread} thread of {damper} has died; the log above says why. Please report it, and restart the node"
    )]
    OfService {
        /// Name of the thread.
        thread: &'static str,
        /// Name of the damper.
        damper: String,
    },
}

impl DeadThread {
    fn of(thread: &'static str, damper: &str) -> Self {
        if thread == DDS_THREAD {
            Self::OfDds(DdsThreadEnded)
        } else {
            Self::OfService { thread, damper: damper.to_owned() }
        }
    }
}

impl PartError for DeadThread {}

/// Ends the process with exit code 1 and the message of `died` if the orderly stop takes too long.
fn end_at_last(died: &DeadThread) -> Result<(), NodeError> {
    let words = format!("{died} (its other threads did not end within {} s)", LAST_WORDS.as_secs());
    let ending = std::thread::Builder::new().name("ending".to_owned()).spawn(move || {
        std::thread::sleep(LAST_WORDS);
        eprintln!("{}", shown::error(&words));
        std::process::exit(1);
    });
    ending.map(drop).map_err(NodeError::io("starting the thread that ends the node"))
}
