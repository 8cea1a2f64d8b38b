//! `mr-damper replay`: plays recorded runs onto the node's input topics, or to viewers.

mod to_viewers;

use crate::commands::context::CliContext;
use crate::commands::run_args::RunArgs;
use crate::ros2::participant;
use crate::settings::config::Config;
use crate::settings::error::{NodeError, PartError};
use crate::streams::player::{Keys, NODE, PlaybackOptions, Played, Player, Rate};
use crate::views::foxglove::args::FoxgloveArgs;
use indicatif::{ProgressBar, ProgressStyle};
use mr_damper_base::shown;
use mr_damper_model::sample::Run;
use mr_damper_views::serve::AllowedOrigin;
use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

/// Play recorded runs onto the node's input topics.
///
/// Runs are CSV files, rosbag2 directories, bare .mcap or .db3 files, or logs of a CAN bus. The original spacing of samples is kept. Stamps
/// are shifted so that the first sample is now; with --clock they are kept, and /clock is published. Only the topics of the channels that
/// the runs have are published.
///
/// At another speed than 1 the stamps keep their spacing too, so a live node needs simulated time: --clock here, and
/// use_sim_time:=true on the node.
///
/// In a terminal, space pauses and resumes, right arrow or s plays one sample while paused, up and down change the speed
/// by a tenth, and q ends the command. The services of `ros2 bag play` work too: ~/pause, ~/resume, ~/toggle_paused,
/// ~/is_paused, ~/get_rate, ~/set_rate, ~/play_next, ~/burst, ~/seek (rosbag2_interfaces), for example
/// `ros2 service call /mr_damper_replay/pause rosbag2_interfaces/srv/Pause`.
///
/// With --foxglove the runs are not played onto topics but to Foxglove, Lichtblick and PlotJuggler, without ROS and with the
/// recorded times. Of a bag, all messages are played, also estimates. Playing begins when a viewer subscribes to a topic, and
/// the command then runs until Ctrl-C.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Runs to play, one after the other.
    #[arg(required = true, value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    /// Speed: 1 is the original speed, 2 twice that, `max` as fast as DDS transmits without loss.
    #[arg(long, value_name = "R|max", default_value = "1")]
    pub rate: Rate,
    /// Play again and again until interrupted.
    #[arg(long = "loop")]
    pub repeat: bool,
    /// Start this many seconds into each run.
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    pub start: f64,
    /// Play this many seconds of each run.
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Keep the recorded stamps and publish /clock, with each sample or HZ times per second of real time.
    #[arg(long, value_name = "HZ", num_args = 0..=1, require_equals = true, default_missing_value = "samples")]
    pub clock: Option<ClockRate>,
    /// Start paused, before the first sample.
    #[arg(long)]
    pub start_paused: bool,
    /// Play onto another topic, e.g. displacement:=/lvdt/displacement; may be given several times. It is the same as
    /// --ros-args -r OLD:=NEW.
    #[arg(long, value_name = "OLD:=NEW")]
    pub remap: Vec<String>,
    /// Longest time to wait for a subscriber before the first sample, s; by default 5, and with --foxglove without limit.
    #[arg(long, value_name = "S")]
    pub wait: Option<f64>,
    /// Where viewers connect.
    #[command(flatten)]
    pub foxglove: FoxgloveArgs,
    /// Allow a --foxglove address beyond loopback, without password and encryption.
    #[arg(long, requires = "foxglove")]
    pub any_host: bool,
    /// Allow web pages of exactly this origin (e.g. `https://app.foxglove.dev`) to connect to --foxglove. May be given several
    /// times.
    #[arg(long, value_name = "URL", requires = "foxglove")]
    pub allow_origin: Vec<AllowedOrigin>,
    /// How runs are read.
    #[command(flatten)]
    pub load: RunArgs,
    /// ROS domain; by default ROS_DOMAIN_ID, else 0.
    #[arg(long, value_name = "ID", default_value_t = -1, value_parser = participant::domain_flag)]
    pub domain_id: i64,
}

/// Time to wait for a subscriber of ROS, s.
const WAIT_S: f64 = 5.0;

impl Args {
    /// The part of each run that is played, and how.
    fn playback(&self) -> PlaybackOptions {
        PlaybackOptions {
            rate: self.rate,
            start: self.start,
            duration: self.duration,
            clock: self.clock.is_some(),
            clock_hz: self.clock.and_then(|clock| match clock {
                ClockRate::Hz(hz) => Some(hz),
                ClockRate::Samples => None,
            }),
        }
    }

    /// Longest time to wait for a subscriber; `None` without limit.
    fn longest_wait(&self, default_s: Option<f64>) -> Option<Duration> {
        self.wait.or(default_s).map(|wait| Duration::from_secs_f64(wait.clamp(0.0, 3600.0)))
    }
}

/// When /clock is published.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ClockRate {
    /// With each sample.
    Samples,
    /// At this rate, Hz, of real time.
    Hz(f64),
}

impl FromStr for ClockRate {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text.parse::<f64>() {
            _ if text == "samples" => Ok(Self::Samples),
            Ok(hz) if (0.01..=10_000.0).contains(&hz) => Ok(Self::Hz(hz)),
            _ => Err("give a number from 0.01 to 10000, as in --clock=40, or nothing at all"),
        }
    }
}

/// `--start` is beyond the end of a run, so nothing of it would be played.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{}: --start {start_s} is beyond the end of the run, which is {length_s:.3} s long; give a smaller --start", run.display())]
struct StartBeyondEnd {
    /// Path of the run.
    run: PathBuf,
    /// The value of `--start`.
    start_s: f64,
    /// Time from the run's first to its last sample.
    length_s: f64,
}

impl PartError for StartBeyondEnd {
    fn is_wrong_usage(&self) -> bool {
        true
    }
}

/// Refuses a start beyond the end of the run at `path`, which is `length_s` long.
///
/// # Errors
/// [`StartBeyondEnd`].
fn check_start(start_s: f64, path: &Path, length_s: f64) -> Result<(), StartBeyondEnd> {
    if start_s > length_s {
        return Err(StartBeyondEnd { run: path.to_owned(), start_s, length_s });
    }
    Ok(())
}

/// Time from the first to the last sample of all channels, s.
fn length_s(run: &Run) -> f64 {
    run.span().map_or(0.0, |(first, last)| last.since(first).get())
}

/// Warns once that stamps keep their recorded spacing although the speed is not 1 and no time is published.
struct SpacingWarning {
    /// True if /clock is published.
    clock: bool,
    is_given: Cell<bool>,
}

impl SpacingWarning {
    fn new(clock: bool) -> Self {
        Self { clock, is_given: Cell::new(false) }
    }

    /// Warns if it is due at the speed `rate`.
    fn look(&self, rate: Rate) {
        if !self.is_due(rate) {
            return;
        }
        self.is_given.set(true);
        let speed = match rate {
            Rate::Times(rate) => rate.to_string(),
            Rate::Max => "max".to_owned(),
        };
        tracing::warn!(
            "the runs are played at the rate {speed}, but their stamps keep the recorded spacing and drift from the system time: a live node \
             flags samples as STAMP_AHEAD or LATE, and refuses some; use --clock here and use_sim_time:=true on the node"
        );
    }

    fn is_due(&self, rate: Rate) -> bool {
        !self.clock && !self.is_given.get() && rate != Rate::Times(1.0)
    }
}

/// Plays the runs.
///
/// # Errors
/// When a run does not load, `--start` is beyond its end, or ROS does not start.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    if args.foxglove.foxglove.is_some() {
        return to_viewers::run(args, context);
    }
    let config = Config { domain_id: args.domain_id, ..Config::default() };
    context.ros_args.refuse_stray_rules(NODE, &Player::TOPICS, &Player::SERVICES)?;
    let ros_args = context.ros_args.with_topics_renamed(&args.remap, &Player::TOPICS)?;
    let mut runs = Vec::with_capacity(args.runs.len());
    for path in &args.runs {
        let run = args.load.load(path)?.run;
        check_start(args.start, path, length_s(&run))?;
        runs.push(run);
    }
    let spacing = SpacingWarning::new(args.clock.is_some());
    spacing.look(args.rate);
    let mut player = Player::start_for(&runs, &config, &ros_args, args.clock.is_some())?;
    player.offer_services(&ros_args)?;
    if args.start_paused {
        player.control().pause();
        tracing::info!("started paused: press space, or call ~/resume");
    }
    let wait = args.longest_wait(Some(WAIT_S)).unwrap_or_default();
    if !player.wait_for_listener(wait, &context.interrupt) {
        tracing::warn!("{} has no subscriber yet; playing anyway", ros_args.topic("displacement"));
    }
    let keys = Keys::start(context.quiet);
    let mut played = Played::default();
    'all: loop {
        for run in &runs {
            let options = args.playback();
            let bar = progress(&run.name, run.duration().get(), &options, context.quiet);
            player.play(run, &options, &mut played, &context.interrupt, keys.as_ref(), &|at_s| {
                bar.set_position((at_s * 1e3) as u64);
                // A key or ~/set_rate may have changed the speed.
                spacing.look(player.control().rate());
            });
            bar.finish_and_clear();
            player.check()?;
            if context.interrupt.is_raised() {
                break 'all;
            }
        }
        if !args.repeat {
            break;
        }
    }
    drop(keys);
    // Reliable readers may still request the last samples again.
    std::thread::sleep(Duration::from_millis(200));
    player.stop();
    tracing::info!(samples = played.samples, failed = played.failed, "played");
    Ok(played.check()?)
}

/// A bar for the run called `name` that lasts `whole_s`.
fn progress(name: &str, whole_s: f64, options: &PlaybackOptions, quiet: bool) -> ProgressBar {
    if quiet {
        return ProgressBar::hidden();
    }
    let length_s = options.duration.unwrap_or(f64::INFINITY).min(whole_s - options.start).max(0.0);
    let style = ProgressStyle::with_template("{msg} [{bar:40}] {percent}% of {prefix}, {eta} left")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new((length_s * 1e3) as u64)
        .with_style(style)
        .with_prefix(format!("{length_s:.0} s"))
        .with_message(shown::line(name).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use mr_damper_model::sample::{Stamp, Trace};

    fn trace(seconds: &[i64]) -> Trace {
        let stamps: Vec<Stamp> = seconds.iter().map(|s| Stamp::from_nanos(s * 1_000_000_000)).collect();
        Trace { values: vec![0.0; stamps.len()], stamps }
    }

    #[test]
    fn a_start_beyond_the_end_is_refused_with_the_length() {
        let mut run = Run { displacement_m: trace(&[10, 20]), ..Run::default() };
        assert_eq!(length_s(&Run::default()), 0.0);
        assert_eq!(length_s(&run), 10.0);
        run.force_n = Some(trace(&[10, 25]));
        assert!((length_s(&run) - 15.0).abs() < 1e-9, "the last sample of all channels counts");
        let path = Path::new("run.csv");
        assert_eq!(check_start(15.0, path, length_s(&run)), Ok(()));
        let refusal = check_start(100.0, path, length_s(&run)).expect_err("it is beyond the end");
        assert!(refusal.is_wrong_usage());
        assert_eq!(
            refusal.to_string(),
            "run.csv: --start 100 is beyond the end of the run, which is 15.000 s long; give a smaller --start"
        );
    }

    #[test]
    fn another_speed_without_a_clock_is_warned_of_once() {
        let spacing = SpacingWarning::new(false);
        assert!(!spacing.is_due(Rate::Times(1.0)));
        for rate in [Rate::Times(4.0), Rate::Times(0.5), Rate::Max] {
            assert!(spacing.is_due(rate), "{rate:?}");
            assert!(!SpacingWarning::new(true).is_due(rate), "{rate:?}: /clock is published");
        }
        spacing.look(Rate::Times(4.0));
        assert!(!spacing.is_due(Rate::Times(0.5)), "it was said");
    }
}
