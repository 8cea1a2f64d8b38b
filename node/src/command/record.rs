//! `mr-damper record`: everything in and out, into a rosbag2 directory.

use crate::clock::system_now;
use crate::command::Surroundings;
use crate::command::bag_args::BagArgs;
use crate::config::Config;
use crate::error::NodeError;
use crate::ros::Ros;
use crate::run::{BagOptions, BagWriter};
use indicatif::{ProgressBar, ProgressStyle};
use mr_damper_msgs::standard::Temperature;
use mr_damper_msgs::{
    CoilCurrent, CommandVoltage, CurrentCommand, Displacement, Force, ForceEstimate, ForceResidual, Message,
    ModeChange, Velocity,
};
use ros2_client::{NodeOptions, Subscription};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Name of the node, unless it is given another.
pub const NODE: &str = "mr_damper_record";

/// Record everything in and out of a damper's node into a rosbag2 directory.
///
/// A process that is killed loses at most the last chunk, whose age --chunk-age bounds; the bag reads without repair.
/// Ctrl-C ends properly.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Directory to make; must not exist.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Stop after this many seconds.
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Longest time that a message waits in memory, s.
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    pub chunk_age: f64,
    /// How the bag is written.
    #[command(flatten)]
    pub bag: BagArgs,
    /// ROS domain; by default ROS_DOMAIN_ID, else 0.
    #[arg(long, value_name = "ID", default_value_t = -1)]
    pub domain_id: i64,
}

/// How often the recorder looks for messages. They bear the time of their arrival, not of the look.
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// Records until a signal comes or the time is over.
///
/// # Errors
/// When ROS does not start, the directory exists, or the disk refuses (what was written until then is readable).
pub fn run(args: &Args, around: &Surroundings) -> Result<(), NodeError> {
    let config = Config { domain_id: args.domain_id, ..Config::default() };
    let ros_args = &around.ros_args;
    let name = ros_args.node.as_deref().unwrap_or(NODE);
    let age = Duration::from_secs_f64(args.chunk_age.clamp(0.01, 3600.0));
    let mut bag = BagWriter::create(&args.out, BagOptions { chunk_max_age: age, ..args.bag.options() })?;
    let mut ros = Ros::start(&config, ros_args, NodeOptions::new().enable_rosout(false), name)?;
    let taps = taps(&mut ros, &|topic| ros_args.topic(topic))?;
    let deadline = args.duration.map(|s| Instant::now() + Duration::from_secs_f64(s.clamp(0.0, 1e9)));
    let bar = progress(around.quiet);
    let mut recorded = Recorded::default();
    let outcome = loop {
        // Looked at before draining, so that what had come by then is still written.
        let last_round = around.interrupt.is_raised() || deadline.is_some_and(|at| Instant::now() >= at);
        let drained = taps.iter().try_for_each(|tap| tap.drain(&mut bag, &mut recorded));
        if let Err(error) = drained.and_then(|()| Ok(bag.flush_if_due()?)).and_then(|()| ros.check()) {
            break Err(error);
        }
        if last_round {
            break Ok(());
        }
        bar.set_message(format!("{} messages from {} topics", recorded.messages, recorded.topics(&taps)));
        std::thread::sleep(LOOK_EVERY);
    };
    bar.finish_and_clear();
    drop(taps);
    ros.stop();
    // What came before a DDS library that went deaf is a whole bag; a disk that refuses lets nobody finish one.
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
    if !around.quiet {
        let (path, files) = (summary.path.display(), summary.files);
        eprintln!("{path}: {} messages, {files} files, {} bytes", recorded.messages, summary.bytes);
    }
    Ok(())
}

/// What was recorded so far.
#[derive(Debug, Default)]
struct Recorded {
    messages: u64,
    unreadable: u64,
}

impl Recorded {
    fn topics(&self, taps: &[Box<dyn Tap>]) -> usize {
        taps.iter().filter(|tap| tap.has_spoken()).count()
    }
}

fn progress(quiet: bool) -> ProgressBar {
    if quiet {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("recording {elapsed}: {msg} (Ctrl-C ends)");
    ProgressBar::new_spinner().with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()))
}

/// A subscribed topic, whatever its type.
trait Tap {
    /// Writes all messages that have come.
    fn drain(&self, bag: &mut BagWriter, recorded: &mut Recorded) -> Result<(), NodeError>;
    /// True once a message has come.
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

/// Taps on everything that goes in and out of a node.
fn taps(ros: &mut Ros, topic: &dyn Fn(&str) -> String) -> Result<Vec<Box<dyn Tap>>, NodeError> {
    fn tap<M: Message>(ros: &mut Ros, topic: String) -> Result<Box<dyn Tap>, NodeError> {
        let subscription = ros.subscribe::<M>(&topic)?;
        Ok(Box::new(TypedTap { topic, subscription, spoken: std::cell::Cell::new(false) }))
    }
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
    ])
}
