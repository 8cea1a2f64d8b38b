//! `mr-damper replay --foxglove`: plays recorded runs to viewers, without ROS.

use super::{Args, check_start, progress};
use crate::commands::context::CliContext;
use crate::commands::run_args::{RunArgs, log_notes};
use crate::settings::error::NodeError;
use crate::streams::player::{Control, Keys};
use crate::views::foxglove::args::print_address;
use crate::views::foxglove::recording::{PlayedRecording, wait_for_viewer};
use mr_damper_base::clock::system_now;
use mr_damper_runs::{Recording, is_bag};
use mr_damper_views::foxglove::{Channels, FoxgloveServer};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How often the command looks for signals after the last run.
const LOOK_EVERY: Duration = Duration::from_millis(50);

/// Plays the runs, then keeps the viewers connected until a signal comes.
///
/// # Errors
/// When an option is only for ROS, a run does not load, `--start` is beyond its end, or the address cannot be used.
pub(super) fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    refuse_options_of_ros(args)?;
    args.foxglove.check(args.any_host)?;
    let load = |path: &std::path::PathBuf| recording(&args.load, path);
    let recordings = args.runs.iter().map(load).collect::<Result<Vec<Recording>, NodeError>>()?;
    for (path, recording) in args.runs.iter().zip(&recordings) {
        check_start(args.start, path, length_s(recording))?;
    }
    let channels = Arc::new(Channels::recorded(system_now().nanos().to_string()));
    let played: Vec<_> =
        recordings.iter().map(|recording| PlayedRecording::new(recording, &channels)).collect();
    let Some(server) = args.foxglove.start(args.any_host, &args.allow_origin, &channels)? else {
        return Ok(());
    };
    print_address(&server);
    if !wait_for_viewer(&channels, args.longest_wait(None), &context.interrupt)
        && !context.interrupt.is_raised()
    {
        tracing::warn!("no viewer has subscribed to a topic yet; playing anyway");
    }
    play(args, context, &recordings, &played, &server);
    server.stop().map_err(NodeError::from)
}

/// Plays all recordings, again and again if asked to, until a signal comes or the server has ended.
fn play(
    args: &Args,
    context: &CliContext,
    recordings: &[Recording],
    played: &[PlayedRecording<'_>],
    server: &FoxgloveServer,
) {
    let control = Control::default();
    if args.start_paused {
        control.pause();
        tracing::info!("started paused: press space");
    }
    let keys = Keys::start(context.quiet);
    let (options, interrupt) = (args.playback(), &context.interrupt);
    let mut messages = 0;
    let is_over = || interrupt.is_raised() || !server.is_alive();
    while !is_over() {
        for ((path, recording), played) in args.runs.iter().zip(recordings).zip(played) {
            let bar = progress(&path.display().to_string(), length_s(recording), &options, context.quiet);
            messages += played.play(&options, &control, interrupt, keys.as_ref(), &|at_s| {
                bar.set_position((at_s * 1e3) as u64);
            });
            bar.finish_and_clear();
        }
        if !args.repeat {
            break;
        }
    }
    tracing::info!(messages, "played; viewers stay connected until Ctrl-C");
    while !is_over() {
        if let Some(keys) = &keys {
            keys.look(&control, interrupt);
        }
        interrupt.sleep_until(Instant::now() + LOOK_EVERY);
    }
}

/// Time from the first to the last message, s.
fn length_s(recording: &Recording) -> f64 {
    recording.range().map_or(0.0, |(first, last)| last.since(first).get())
}

/// The run at `path` as messages: all messages of a bag, unless an option says how channels are read from it; else its columns.
fn recording(load: &RunArgs, path: &Path) -> Result<Recording, NodeError> {
    if !is_bag(path) || load.given().is_some() {
        return Ok(Recording::of_run(&load.load(path)?.run, path)?);
    }
    let mut notes = Vec::new();
    let recording = Recording::of_bag(path, &mut notes)?;
    log_notes(path, &notes);
    Ok(recording)
}

/// Options that have no meaning without ROS are refused, so that nobody relies on them.
fn refuse_options_of_ros(args: &Args) -> Result<(), NodeError> {
    let given = [
        ("--clock", args.clock.is_some()),
        ("--remap", !args.remap.is_empty()),
        ("--domain-id", args.domain_id >= 0),
    ];
    match given.into_iter().find(|(_, is_given)| *is_given) {
        Some((option, _)) => Err(NodeError::Usage(format!(
            "{option} is for ROS, and --foxglove plays to viewers without ROS; leave one of them out"
        ))),
        None => Ok(()),
    }
}
