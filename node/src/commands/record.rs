//! `mr-damper record`: records all inputs and outputs of dampers into a rosbag2 directory.

use crate::commands::bag_args::BagArgs;
use crate::commands::context::CliContext;
use crate::process::files;
use crate::ros2::participant::{self, Ros};
use crate::settings::config::{Config, RosArgs};
use crate::settings::error::{NodeError, PartError};
use indicatif::{ProgressBar, ProgressStyle};
use mr_damper_base::clock::system_now;
use mr_damper_base::shown;
use mr_damper_msgs::rcl::Log;
use mr_damper_msgs::standard::{DiagnosticArray, Temperature};
use mr_damper_msgs::{
    CoilCurrent, CommandVoltage, CurrentCommand, Displacement, EffectValue, Force, ForceEstimate,
    ForceResidual, Message, ModeChange, Velocity,
};
use mr_damper_runs::{BagOptions, BagWriter};
use mr_damper_views::watch::{MOST_DAMPERS, discovery};
use ros2_client::{NodeOptions, Subscription};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Default name of this command's node.
pub const NODE: &str = "mr_damper_record";

/// Record all inputs and outputs of dampers' nodes, /diagnostics and /rosout into a rosbag2 directory.
///
/// The command records every node that publishes force_estimate in its namespace (--ros-args -r __ns:=/vehicle) or below
/// it, also nodes that start later. If no message of a damper arrives, the command fails with exit code 1.
///
/// To record a topic that has another name, remap it: --ros-args -r displacement:=/fl/susp/pos. The bag stores the
/// original name, so it can be read without a map.
///
/// If the process is killed, only the last chunk is lost, which is at most --chunk-age old; the bag can be read without
/// repair. Ctrl-C ends the recording properly.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Directory to create; must not exist.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Stop after this many seconds.
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Longest time that a message stays in memory before it is written, s.
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    pub chunk_age: f64,
    /// How the bag is written.
    #[command(flatten)]
    pub bag: BagArgs,
    /// ROS domain; by default ROS_DOMAIN_ID, else 0.
    #[arg(long, value_name = "ID", default_value_t = -1, value_parser = participant::domain_flag)]
    pub domain_id: i64,
}

/// The recorded topics of a damper, by their names in its node.
const TOPICS: [&str; 12] = [
    "displacement",
    "coil_current",
    "command_voltage",
    "velocity",
    "measured_force",
    "force_request",
    "body_velocity",
    "case_temperature",
    "force_estimate",
    "force_residual",
    "current_command",
    "mode",
];
/// The recorded topics that all nodes share.
const SHARED: [&str; 2] = ["/diagnostics", "/rosout"];

/// How often the recorder looks for dampers.
const FIND_EVERY: Duration = Duration::from_millis(200);
/// How often the recorder polls for messages. A message keeps the time of its arrival, not of the poll.
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// Records until a signal comes or the time is over.
///
/// # Errors
/// When ROS does not start, the directory exists, no message of a damper arrives, or a write fails (the data written
/// before are readable).
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    let config = Config { domain_id: args.domain_id, ..Config::default() };
    let ros_args = &context.ros_args;
    ros_args.refuse_stray_rules(NODE, &[&TOPICS[..], &SHARED].concat(), &[])?;
    let name = ros_args.node.as_deref().unwrap_or(NODE);
    let age = Duration::from_secs_f64(args.chunk_age.clamp(0.01, 3600.0));
    let reach = participant::reach(&config)?;
    let mut bag = BagWriter::create(&args.out, BagOptions { chunk_max_age: age, ..args.bag.options() })?;
    files::allow(4);
    let ros = Ros::start(&config, ros_args, NodeOptions::new().enable_rosout(false), name)?;
    let mut taps = Taps::start(ros, ros_args, &mut bag)?;
    let deadline = args.duration.map(|s| Instant::now() + Duration::from_secs_f64(s.clamp(0.0, 1e9)));
    let bar = progress(context.quiet);
    let mut recorded = Recorded::default();
    let outcome = loop {
        // Checked before draining, so that messages that have arrived by now are still written.
        let last_round = context.interrupt.is_raised() || deadline.is_some_and(|at| Instant::now() >= at);
        if let Err(error) = taps.look(&mut bag).and_then(|()| taps.drain(&mut bag, &mut recorded)) {
            break Err(error);
        }
        if last_round {
            break Ok(());
        }
        bar.set_message(format!(
            "{} from {}",
            shown::count(recorded.messages, "message"),
            shown::count(taps.spoken(), "topic")
        ));
        std::thread::sleep(LOOK_EVERY);
    };
    bar.finish_and_clear();
    taps.stop();
    // The bag can be finished after a fault of the DDS library, but not after a failed write.
    let summary = match outcome {
        Err(error @ NodeError::Run(_)) => return Err(error),
        outcome => bag.finish().map_err(NodeError::from).and_then(|summary| outcome.map(|()| summary))?,
    };
    for (topic, messages) in &summary.topics {
        tracing::info!(topic, messages, "recorded");
    }
    if recorded.unreadable > 0 {
        tracing::warn!(messages = recorded.unreadable, "messages could not be read and are not in the bag");
    }
    if !context.quiet {
        let (path, files) = (summary.path.display(), summary.files);
        let text = format!(
            "{path}: {}, {}, {}",
            shown::count(recorded.messages, "message"),
            shown::count(files, "file"),
            shown::count(summary.bytes, "byte")
        );
        eprintln!("{}", shown::line(&text));
    }
    if recorded.of_dampers == 0 {
        return Err(NothingRecorded { namespace: ros_args.namespace(), reach }.into());
    }
    Ok(())
}

/// No message of a damper was recorded.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "no message of a damper came in namespace {namespace} or below it ({reach}), so the bag holds none. Is `mr-damper node` or a \
     sensor running there? Set the domain with ROS_DOMAIN_ID or --domain-id, the namespace with --ros-args -r __ns:=/vehicle"
)]
struct NothingRecorded {
    /// The namespace that was watched.
    namespace: String,
    /// Domain and discovery range, in words.
    reach: String,
}

impl PartError for NothingRecorded {}

/// Numbers of messages so far.
#[derive(Debug, Default)]
struct Recorded {
    messages: u64,
    /// Messages on topics of dampers, without /diagnostics and /rosout.
    of_dampers: u64,
    unreadable: u64,
}

fn progress(quiet: bool) -> ProgressBar {
    if quiet {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("recording {elapsed}: {msg} (Ctrl-C ends)");
    ProgressBar::new_spinner().with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()))
}

/// The recorder's node, and its subscriptions.
struct Taps {
    ros: Ros,
    args: RosArgs,
    /// /diagnostics and /rosout, which all nodes share.
    shared: Vec<Box<dyn Tap>>,
    /// The topics of each damper, by its namespace without a trailing slash.
    dampers: Vec<(String, Vec<Box<dyn Tap>>)>,
    looked: Option<Instant>,
    /// The warning about too many dampers was logged.
    is_full: bool,
}

impl Taps {
    /// Subscribes to the shared topics, and to a damper's topics in the node's own namespace, even without a damper there.
    fn start(mut ros: Ros, args: &RosArgs, bag: &mut BagWriter) -> Result<Self, NodeError> {
        let shared = vec![
            tap::<DiagnosticArray>(&mut ros, args.topic(SHARED[0]))?,
            tap::<Log>(&mut ros, args.topic(SHARED[1]))?,
        ];
        let mut taps =
            Self { ros, args: args.clone(), shared, dampers: Vec::new(), looked: None, is_full: false };
        taps.add(args.namespace().trim_end_matches('/').to_owned(), bag)?;
        Ok(taps)
    }

    /// Subscribes to the topics of new dampers. Looks for them once per [`FIND_EVERY`].
    fn look(&mut self, bag: &mut BagWriter) -> Result<(), NodeError> {
        if self.looked.is_some_and(|looked| looked.elapsed() < FIND_EVERY) {
            return Ok(());
        }
        self.looked = Some(Instant::now());
        for namespace in discovery::namespaces(self.ros.published(), &self.args.namespace()) {
            if self.dampers.iter().all(|(known, _)| *known != namespace) {
                self.add(namespace, bag)?;
            }
        }
        Ok(())
    }

    fn add(&mut self, namespace: String, bag: &mut BagWriter) -> Result<(), NodeError> {
        // One more than MOST_DAMPERS: there may be no damper in the node's own namespace.
        if self.dampers.len() > MOST_DAMPERS {
            if !self.is_full {
                tracing::warn!(
                    namespace,
                    "more than {MOST_DAMPERS} dampers: not all are recorded; record fewer with --ros-args -r __ns:=/namespace"
                );
                self.is_full = true;
            }
            return Ok(());
        }
        let args = self.args.below(&namespace);
        for topic in TOPICS {
            // A bag is read back by the names that the topics have before they are remapped.
            bag.note_renamed(&args.topic(topic), &args.unrenamed(topic));
        }
        let taps = taps(&mut self.ros, &|topic| args.topic(topic))?;
        tracing::info!(namespace = args.namespace(), "recording the topics of a damper");
        self.dampers.push((namespace, taps));
        Ok(())
    }

    /// Writes all messages that have arrived.
    fn drain(&self, bag: &mut BagWriter, recorded: &mut Recorded) -> Result<(), NodeError> {
        let before = recorded.messages;
        self.of_dampers().try_for_each(|tap| tap.drain(bag, recorded))?;
        recorded.of_dampers += recorded.messages - before;
        self.shared.iter().try_for_each(|tap| tap.drain(bag, recorded))?;
        bag.flush_if_due()?;
        Ok(self.ros.check()?)
    }

    fn of_dampers(&self) -> impl Iterator<Item = &Box<dyn Tap>> {
        self.dampers.iter().flat_map(|(_, taps)| taps)
    }

    /// Number of topics on which a message has arrived.
    fn spoken(&self) -> usize {
        self.of_dampers().chain(&self.shared).filter(|tap| tap.has_spoken()).count()
    }

    /// Leaves the domain.
    fn stop(self) {
        let Self { ros, shared, dampers, .. } = self;
        drop((shared, dampers));
        ros.stop();
    }
}

/// A subscribed topic, whatever its type.
trait Tap {
    /// Writes all messages that have arrived.
    fn drain(&self, bag: &mut BagWriter, recorded: &mut Recorded) -> Result<(), NodeError>;
    /// True once a message has arrived.
    fn has_spoken(&self) -> bool;
}

struct TypedTap<M: Message> {
    topic: String,
    subscription: Subscription<M>,
    spoken: std::cell::Cell<bool>,
}

impl<M: Message> Tap for TypedTap<M> {
    fn drain(&self, bag: &mut BagWriter, recorded: &mut Recorded) -> Result<(), NodeError> {
        loop {
            match self.subscription.take() {
                Ok(None) => return Ok(()),
                Ok(Some((message, info))) => {
                    self.spoken.set(true);
                    recorded.messages += 1;
                    let received_ns =
                        info.received_timestamp().map_or_else(|| system_now().nanos(), |at| at.to_nanos());
                    let sent_ns = info.source_timestamp().map_or(received_ns, |at| at.to_nanos());
                    bag.write_message(&self.topic, &message, received_ns, sent_ns)?;
                }
                Err(error) => {
                    recorded.unreadable += 1;
                    tracing::debug!(topic = self.topic, %error, "a message cannot be read");
                }
            }
        }
    }

    fn has_spoken(&self) -> bool {
        self.spoken.get()
    }
}

/// Subscribes to a topic by its full name.
fn tap<M: Message>(ros: &mut Ros, topic: String) -> Result<Box<dyn Tap>, NodeError> {
    let subscription = ros.subscribe::<M>(&topic)?;
    Ok(Box::new(TypedTap { topic, subscription, spoken: std::cell::Cell::new(false) }))
}

/// Subscribes to all inputs and outputs of a node.
fn taps(ros: &mut Ros, topic: &dyn Fn(&str) -> String) -> Result<Vec<Box<dyn Tap>>, NodeError> {
    Ok(vec![
        tap::<Displacement>(ros, topic("displacement"))?,
        tap::<CoilCurrent>(ros, topic("coil_current"))?,
        tap::<CommandVoltage>(ros, topic("command_voltage"))?,
        tap::<Velocity>(ros, topic("velocity"))?,
        tap::<Force>(ros, topic("measured_force"))?,
        tap::<Force>(ros, topic("force_request"))?,
        tap::<Velocity>(ros, topic("body_velocity"))?,
        tap::<Temperature>(ros, topic("case_temperature"))?,
        tap::<ForceEstimate>(ros, topic("force_estimate"))?,
        tap::<ForceResidual>(ros, topic("force_residual"))?,
        tap::<CurrentCommand>(ros, topic("current_command"))?,
        tap::<ModeChange>(ros, topic("mode"))?,
        tap::<EffectValue>(ros, topic("effect_values"))?,
    ])
}
