//! `mr-damper replay`: recorded runs onto the node's input topics.

use crate::cli::Surroundings;
use crate::command::run_args::RunArgs;
use crate::config::{Config, RosArgs};
use crate::error::NodeError;
use crate::hot::now;
use crate::interrupt::Interrupt;
use crate::ros::Ros;
use crate::wire::header;
use indicatif::{ProgressBar, ProgressStyle};
use mr_damper_model::sample::{Drive, Reading, Run, Sample, Stamp};
use mr_damper_msgs::standard::{Clock, Temperature, Time};
use mr_damper_msgs::{CoilCurrent, CommandVoltage, Displacement, Force, Velocity};
use ros2_client::{NodeOptions, Publisher};
use std::io::IsTerminal;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Messages a second that DDS carries without loss to best effort readers on one machine, with a margin.
const MAX_MESSAGES_PER_S: f64 = 4000.0;

/// Play recorded runs onto the node's input topics.
///
/// Runs are CSV files, rosbag2 directories, or bare .mcap files. Original spacing is kept; stamps are moved so
/// that the first sample is now, unless --clock is given, which keeps them and publishes /clock.
/// Space pauses and resumes when a terminal is there.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Runs to play, one after the other.
    #[arg(required = true, value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    /// Speed: 1 is original, 2 twice as fast, `max` as fast as DDS carries without loss.
    #[arg(long, value_name = "R|max", default_value = "1", value_parser = parse_rate)]
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
    /// Keep the recorded stamps and publish /clock with them.
    #[arg(long)]
    pub clock: bool,
    /// Wait this long for a node to listen before the first sample, s.
    #[arg(long, value_name = "S", default_value_t = 5.0)]
    pub wait: f64,
    /// How runs are read.
    #[command(flatten)]
    pub load: RunArgs,
    /// ROS domain; by default ROS_DOMAIN_ID, else 0.
    #[arg(long, value_name = "ID", default_value_t = -1)]
    pub domain_id: i64,
}

/// How fast to play.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rate {
    /// A multiple of the original speed.
    Times(f64),
    /// As fast as DDS carries without loss.
    Max,
}

fn parse_rate(text: &str) -> Result<Rate, String> {
    if text == "max" {
        return Ok(Rate::Max);
    }
    match text.parse::<f64>() {
        Ok(rate) if rate > 0.0 && rate.is_finite() => Ok(Rate::Times(rate)),
        _ => Err("give a positive number, or max".to_owned()),
    }
}

/// What was played.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Played {
    /// Samples published.
    pub samples: u64,
    /// Samples that the middleware did not take.
    pub failed: u64,
}

/// Plays the runs.
///
/// # Errors
/// When a run does not load or ROS does not start.
pub fn run(args: &Args, around: &Surroundings) -> Result<(), NodeError> {
    let mut runs = Vec::with_capacity(args.runs.len());
    for path in &args.runs {
        runs.push(args.load.load(path)?.run);
    }
    let config = Config { domain_id: args.domain_id, ..Config::default() };
    let player = Player::start(&config, &around.ros_args, args.clock)?;
    if !player.wait_for_listener(Duration::from_secs_f64(args.wait.clamp(0.0, 3600.0)), &around.interrupt) {
        tracing::warn!(
            "nobody listens to {} yet; playing all the same",
            around.ros_args.topic("displacement")
        );
    }
    let keys = Keys::start(around.quiet);
    let mut played = Played::default();
    'all: loop {
        for run in &runs {
            let plan =
                Plan { rate: args.rate, start: args.start, duration: args.duration, clock: args.clock };
            let bar = progress(run, &plan, around.quiet);
            player.play(run, &plan, &mut played, &around.interrupt, keys.as_ref(), &|at_s| {
                bar.set_position((at_s * 1e3) as u64);
            });
            bar.finish_and_clear();
            if around.interrupt.is_raised() {
                break 'all;
            }
        }
        if !args.repeat {
            break;
        }
    }
    drop(keys);
    // Reliable readers may still ask for the last samples again.
    std::thread::sleep(Duration::from_millis(200));
    player.stop();
    tracing::info!(samples = played.samples, failed = played.failed, "played");
    if played.failed > 0 {
        return Err(NodeError::Failed(format!("{} samples were not taken by the middleware", played.failed)));
    }
    Ok(())
}

fn progress(run: &Run, plan: &Plan, quiet: bool) -> ProgressBar {
    if quiet {
        return ProgressBar::hidden();
    }
    let length_s = plan.duration.unwrap_or(f64::INFINITY).min(run.duration().get() - plan.start).max(0.0);
    let style = ProgressStyle::with_template("{msg} [{bar:40}] {percent}% of {prefix}, {eta} left")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new((length_s * 1e3) as u64)
        .with_style(style)
        .with_prefix(format!("{length_s:.0} s"))
        .with_message(run.name.clone())
}

/// What part of a run is played, and how.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// Speed.
    pub rate: Rate,
    /// Seconds into the run.
    pub start: f64,
    /// Seconds to play; `None`: to the end.
    pub duration: Option<f64>,
    /// Keep stamps, publish /clock.
    pub clock: bool,
}

impl Default for Plan {
    fn default() -> Self {
        Self { rate: Rate::Times(1.0), start: 0.0, duration: None, clock: false }
    }
}

/// Publishers for all input topics.
pub struct Player {
    ros: Ros,
    displacement: Publisher<Displacement>,
    velocity: Publisher<Velocity>,
    coil_current: Publisher<CoilCurrent>,
    command_voltage: Publisher<CommandVoltage>,
    force: Publisher<Force>,
    temperature: Publisher<Temperature>,
    clock: Option<Publisher<Clock>>,
}

impl Player {
    /// Joins the domain as `mr_damper_replay`, in the namespace of the ROS arguments; `clock`: to publish /clock.
    ///
    /// # Errors
    /// When ROS does not start.
    pub fn start(config: &Config, ros_args: &RosArgs, clock: bool) -> Result<Self, NodeError> {
        let args = ros_args;
        let name = args.node.as_deref().unwrap_or("mr_damper_replay");
        let mut ros = Ros::start(config, args, NodeOptions::new().enable_rosout(false), name)?;
        Ok(Self {
            displacement: ros.publish(&args.topic("displacement"))?,
            velocity: ros.publish(&args.topic("velocity"))?,
            coil_current: ros.publish(&args.topic("coil_current"))?,
            command_voltage: ros.publish(&args.topic("command_voltage"))?,
            force: ros.publish(&args.topic("measured_force"))?,
            temperature: ros.publish(&args.topic("case_temperature"))?,
            clock: if clock { Some(ros.publish("/clock")?) } else { None },
            ros,
        })
    }

    /// Waits until somebody listens on every topic that matters; false after `timeout` or on a signal.
    pub fn wait_for_listener(&self, timeout: Duration, interrupt: &Interrupt) -> bool {
        let deadline = Instant::now() + timeout;
        let node = self.ros.node();
        let listened = || {
            self.displacement.get_subscription_count(node) > 0
                && self.force.get_subscription_count(node) > 0
                && self.coil_current.get_subscription_count(node)
                    + self.command_voltage.get_subscription_count(node)
                    > 0
        };
        while !listened() {
            if Instant::now() >= deadline
                || !interrupt.sleep_until(Instant::now() + Duration::from_millis(20))
            {
                return listened();
            }
        }
        // Matching is seen on our side first; the peer needs a moment to hear of our writers.
        interrupt.sleep_until(Instant::now() + Duration::from_millis(300))
    }

    /// Plays one run; `at` is told how many seconds of it have been played.
    pub fn play(
        &self,
        run: &Run,
        plan: &Plan,
        played: &mut Played,
        interrupt: &Interrupt,
        keys: Option<&Keys>,
        at: &dyn Fn(f64),
    ) {
        let Some(first) = run.samples().next().map(|sample| sample.stamp) else { return };
        let from_s = plan.start;
        let to_s = plan.duration.map_or(f64::INFINITY, |d| from_s + d);
        let shift_ns = if plan.clock { 0 } else { now().nanos() - first.nanos() - (from_s * 1e9) as i64 };
        let mut pace = Pace::new(plan.rate);
        let mut last_clock: Option<Stamp> = None;
        for sample in run.samples() {
            let run_s = sample.stamp.since(first).get();
            if run_s < from_s {
                continue;
            }
            if run_s >= to_s || interrupt.is_raised() {
                break;
            }
            if let Some(keys) = keys {
                pace.add_pause(keys.wait_while_paused(interrupt));
            }
            if !pace.wait(run_s - from_s, interrupt) {
                break;
            }
            let stamp = sample.stamp.shifted(shift_ns);
            if plan.clock && last_clock.is_none_or(|last| stamp.since(last).get() >= 1e-3) {
                last_clock = Some(stamp);
                let clock = Clock { clock: Time::from_nanos_saturating(stamp.nanos()) };
                let taken = self.clock.as_ref().is_none_or(|publisher| publisher.publish(clock).is_ok());
                played.failed += u64::from(!taken);
            }
            let taken = self.publish(&Sample { stamp, ..sample });
            played.samples += 1;
            played.failed += u64::from(!taken);
            at(run_s - from_s);
        }
    }

    fn publish(&self, sample: &Sample) -> bool {
        let header = header(sample.stamp, "");
        let variance = 0.0;
        match sample.reading {
            Reading::Displacement(x) => {
                self.displacement.publish(Displacement { header, displacement: x.get(), variance }).is_ok()
            }
            Reading::Velocity(v) => {
                self.velocity.publish(Velocity { header, velocity: v.get(), variance }).is_ok()
            }
            Reading::Drive(Drive::CoilCurrent(i)) => {
                self.coil_current.publish(CoilCurrent { header, current: i.get(), variance }).is_ok()
            }
            Reading::Drive(Drive::CommandVoltage(u)) => {
                self.command_voltage.publish(CommandVoltage { header, voltage: u.get(), variance }).is_ok()
            }
            Reading::Force(f) => self.force.publish(Force { header, force: f.get(), variance }).is_ok(),
            Reading::CaseTemperature(t) => {
                self.temperature.publish(Temperature { header, temperature: t.get(), variance }).is_ok()
            }
        }
    }

    /// Leaves the domain.
    pub fn stop(self) {
        let Self { ros, displacement, velocity, coil_current, command_voltage, force, temperature, clock } =
            self;
        drop((displacement, velocity, coil_current, command_voltage, force, temperature, clock));
        ros.stop();
    }
}

/// Keeps the spacing of samples.
struct Pace {
    rate: Rate,
    start: Instant,
    sent: u64,
}

impl Pace {
    fn new(rate: Rate) -> Self {
        Self { rate, start: Instant::now(), sent: 0 }
    }

    fn add_pause(&mut self, pause: Duration) {
        self.start += pause;
    }

    /// Waits until the sample at `run_s` is due; false when interrupted.
    fn wait(&mut self, run_s: f64, interrupt: &Interrupt) -> bool {
        let due_s = match self.rate {
            Rate::Times(rate) => run_s / rate,
            Rate::Max => self.sent as f64 / MAX_MESSAGES_PER_S,
        };
        self.sent += 1;
        let due = self.start + Duration::from_secs_f64(due_s.max(0.0));
        let left = due.saturating_duration_since(Instant::now());
        if left > Duration::from_millis(50) {
            return interrupt.sleep_until(due);
        }
        if !left.is_zero() {
            std::thread::sleep(left);
        }
        true
    }
}

/// The keyboard, when there is one: space pauses and resumes, q and Ctrl-C end.
pub struct Keys {
    last_look: std::cell::Cell<Instant>,
}

impl Keys {
    /// Spacing of looks at the keyboard: a system call a sample would be too many.
    const LOOK_EVERY: Duration = Duration::from_millis(50);

    /// Puts the terminal into raw mode, if there is one on both ends.
    #[must_use]
    pub fn start(quiet: bool) -> Option<Self> {
        let terminal = !quiet && std::io::stdin().is_terminal() && std::io::stderr().is_terminal();
        (terminal && ratatui::crossterm::terminal::enable_raw_mode().is_ok())
            .then(|| Self { last_look: std::cell::Cell::new(Instant::now()) })
    }

    /// Looks at the keyboard; while paused, waits. Returns how long the pause was.
    fn wait_while_paused(&self, interrupt: &Interrupt) -> Duration {
        if self.last_look.get().elapsed() < Self::LOOK_EVERY {
            return Duration::ZERO;
        }
        self.last_look.set(Instant::now());
        let start = Instant::now();
        let mut paused = false;
        loop {
            match Self::pressed(if paused { Self::LOOK_EVERY } else { Duration::ZERO }) {
                Some(Key::Pause) => paused = !paused,
                Some(Key::End) => interrupt.raise(),
                None if !paused => break,
                None => {}
            }
            if interrupt.is_raised() {
                break;
            }
        }
        start.elapsed()
    }

    /// The next key that means something, waiting for at most `timeout`.
    fn pressed(timeout: Duration) -> Option<Key> {
        use ratatui::crossterm::event::{Event, KeyCode, KeyModifiers, poll, read};
        let Ok(true) = poll(timeout) else { return None };
        let Ok(Event::Key(key)) = read() else { return None };
        match key.code {
            KeyCode::Char(' ') => Some(Key::Pause),
            KeyCode::Char('q') | KeyCode::Esc => Some(Key::End),
            // Raw mode takes Ctrl-C away from the signal handler.
            KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => Some(Key::End),
            _ => None,
        }
    }
}

impl Drop for Keys {
    fn drop(&mut self) {
        // Nothing can be done about a terminal that is gone.
        let _ = ratatui::crossterm::terminal::disable_raw_mode();
    }
}

/// What a key means.
enum Key {
    Pause,
    End,
}
