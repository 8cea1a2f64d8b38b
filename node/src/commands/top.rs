//! `mr-damper top`: shows the dampers live in a terminal.

use crate::commands::context::CliContext;
use crate::settings::error::NodeError;
use crate::views::watch::source::{DataSource, SourceArgs};
use mr_damper_base::shown;
use mr_damper_views::live::{Key, Terminal};
use mr_damper_views::watch::screen::{self, ScreenContent};
use mr_damper_views::watch::{ChartCursor, ChartPoints, DamperRegistry, DamperState, DataOrigin};
use std::io::Write;
use std::time::{Duration, Instant};

/// Default name of this command's node.
pub const NODE: &str = "mr_damper_top";

/// Interval between frames: about twelve per second.
const FRAME: Duration = Duration::from_millis(80);
/// Interval at which messages are polled between frames.
const LOOK_EVERY: Duration = Duration::from_millis(10);
/// Interval between lines without a terminal.
const LINE_EVERY: Duration = Duration::from_secs(1);

/// Show dampers live in a terminal; without a terminal, print one line per second for each damper.
///
/// The command shows every node that publishes force_estimate in this namespace (--ros-args -r __ns:=/vehicle) or below it,
/// also nodes that start later. Arrow keys or digits select a damper, space freezes the screen, q ends the command.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The dampers to watch.
    #[command(flatten)]
    pub source: SourceArgs,
}

/// Shows the dampers until a key or a signal ends it.
///
/// # Errors
/// When ROS or Zenoh does not start, or the terminal is lost.
pub fn run(args: &Args, context: &CliContext) -> Result<(), NodeError> {
    let mut source = DataSource::start(&args.source, &context.ros_args, NODE)?;
    let shown = match Terminal::start() {
        Some(terminal) => on_screen(&mut source, args.source.origin(), terminal, context),
        None => in_lines(&mut source, args.source.origin(), context),
    };
    source.stop();
    shown
}

/// Receives messages until `deadline`; returns false when a signal has come.
fn listen(
    source: &mut DataSource,
    registry: &mut DamperRegistry,
    began: Instant,
    deadline: Instant,
    context: &CliContext,
) -> Result<bool, NodeError> {
    loop {
        source.poll(registry, began.elapsed().as_secs_f64(), &mut |_, _| {})?;
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() || context.interrupt.is_raised() {
            return Ok(!context.interrupt.is_raised());
        }
        std::thread::sleep(left.min(LOOK_EVERY));
    }
}

fn in_lines(source: &mut DataSource, origin: DataOrigin, context: &CliContext) -> Result<(), NodeError> {
    let (mut registry, began) = (DamperRegistry::of(origin), Instant::now());
    let mut stdout = std::io::stdout();
    for round in 1.. {
        if !listen(source, &mut registry, began, began + LINE_EVERY * round, context)? {
            break;
        }
        let snapshot = registry.snapshot(began.elapsed().as_secs_f64());
        let mut text: String = snapshot
            .dampers
            .iter()
            .map(|state| format!("{:7.1} s  {}\n", snapshot.now_s, shown::line(&screen::line(state))))
            .collect();
        if text.is_empty() {
            text = format!("{:7.1} s  no damper has been found yet\n", snapshot.now_s);
        }
        // A closed stdout (`| head`) ends the command.
        if stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()).is_err() {
            break;
        }
    }
    Ok(())
}

/// The content of a frozen screen, and the time when it was frozen.
struct Frozen {
    registry: DamperRegistry,
    at_s: f64,
}

fn on_screen(
    source: &mut DataSource,
    origin: DataOrigin,
    mut terminal: Terminal,
    context: &CliContext,
) -> Result<(), NodeError> {
    let (mut registry, began) = (DamperRegistry::of(origin), Instant::now());
    let (mut selected, mut frozen) = (0, None::<Frozen>);
    while listen(source, &mut registry, began, Instant::now() + FRAME, context)? {
        let now_s = began.elapsed().as_secs_f64();
        let (shown, at_s) =
            frozen.as_ref().map_or((&registry, now_s), |frozen| (&frozen.registry, frozen.at_s));
        let states = shown.snapshot(at_s).dampers;
        let points = states.get(selected).and_then(|state: &DamperState| points_of(shown, &state.name));
        let content = ScreenContent {
            states: &states,
            selected,
            points: points.as_ref(),
            frozen_s: frozen.as_ref().map(|frozen| now_s - frozen.at_s),
            origin: match origin {
                DataOrigin::Ros => "on ROS",
                DataOrigin::Zenoh => "on the Zenoh mirror, thinned",
            },
        };
        terminal
            .draw_with(|frame| screen::draw(frame, &content))
            .map_err(NodeError::io("drawing the screen"))?;
        let count = states.len();
        match terminal.key(Duration::ZERO) {
            Some(Key::End) => return Ok(()),
            Some(Key::Next) if count > 0 => selected = (selected + 1) % count,
            Some(Key::Previous) if count > 0 => selected = (selected + count - 1) % count,
            Some(Key::Pick(index)) if index < count => selected = index,
            Some(Key::Freeze) => {
                frozen = if frozen.is_none() {
                    Some(Frozen { registry: registry.clone(), at_s: now_s })
                } else {
                    None
                };
            }
            _ => {}
        }
    }
    Ok(())
}

fn points_of<'a>(registry: &'a DamperRegistry, name: &str) -> Option<ChartPoints<'a>> {
    registry.views().find(|view| view.name() == name)?.points(&mut ChartCursor::default())
}
