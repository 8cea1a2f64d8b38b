//! The command line.

use crate::command::{self, Surroundings};
use crate::config::RosArgs;
use crate::error::NodeError;
use crate::interrupt::Interrupt;
use crate::logging::{self, LogFormat, Outputs};
use crate::player;
use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Force of magneto-rheological dampers: a virtual sensor on ROS 2, mirrored to Zenoh.
///
/// Without a command the demo runs. Exit codes: 0 done, 1 the work failed, 2 wrong usage.
#[derive(Debug, Parser)]
#[command(name = "mr-damper", version, max_term_width = 110)]
pub struct Cli {
    /// Log only warnings and errors, show no progress.
    #[arg(long, short, global = true)]
    quiet: bool,
    /// How log lines look (they go to stderr).
    #[arg(long, global = true, value_enum, default_value_t)]
    log_format: LogFormat,
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(command::demo::Args),
    Node(command::node::Args),
    Replay(command::replay::Args),
    Record(command::record::Args),
    Convert(command::convert::Args),
    Simulate(command::simulate::Args),
    Identify(command::identify::Args),
    Compare(command::compare::Args),
    Evaluate(command::evaluate::Args),
    Close(command::close::Args),
    Inverse(command::inverse::Args),
    Presets(command::presets::Args),
    Doctor(command::doctor::Args),
    Serve(command::serve::Args),
    Top(command::top::Args),
}

impl Command {
    /// What the command calls its node, for rules that are for one node alone.
    const fn node_name(&self) -> &'static str {
        match self {
            Self::Replay(_) => player::NODE,
            Self::Record(_) => command::record::NODE,
            Self::Serve(_) => command::serve::NODE,
            Self::Top(_) => command::top::NODE,
            Self::Close(_) => command::close::live::NODE,
            _ => "mr_damper",
        }
    }
}

/// Runs the command line `arguments` (without the program's name).
#[must_use]
pub fn main(arguments: impl IntoIterator<Item = String>) -> ExitCode {
    let (plain, ros_args) = match RosArgs::split(arguments) {
        Ok(split) => split,
        Err(error) => {
            eprintln!("error: {error}");
            return ExitCode::from(2);
        }
    };
    let cli = match Cli::try_parse_from(std::iter::once("mr-damper".to_owned()).chain(plain)) {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version are answers, not errors; clap knows which is which.
            let _ = error.print();
            return ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2));
        }
    };
    let level = match (&ros_args.log_level, cli.quiet) {
        (Some(level), _) => level.as_str(),
        (None, true) => "warn",
        (None, false) => "info",
    };
    let outputs = Outputs { stderr: ros_args.stdout_logs, rosout: ros_args.rosout_logs };
    logging::start(cli.log_format, level, outputs);
    match run(cli, ros_args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            let cause = match &error {
                NodeError::Damper { why, .. } => why,
                other => other,
            };
            match cause {
                NodeError::Parameter { .. }
                | NodeError::UnknownParameter { .. }
                | NodeError::RosArgs(_)
                | NodeError::Usage(_) => ExitCode::from(2),
                _ => ExitCode::FAILURE,
            }
        }
    }
}

fn run(cli: Cli, ros_args: RosArgs) -> Result<(), NodeError> {
    let command = cli.command.unwrap_or_else(|| Command::Demo(command::demo::Args::default()));
    let ros_args = ros_args.for_node(command.node_name());
    let around = Surroundings { interrupt: Interrupt::install()?, quiet: cli.quiet, ros_args };
    match command {
        Command::Demo(args) => command::demo::run(&args, &around),
        Command::Node(args) => command::node::run(&args, &around),
        Command::Replay(args) => command::replay::run(&args, &around),
        Command::Record(args) => command::record::run(&args, &around),
        Command::Convert(args) => command::convert::run(&args, &around),
        Command::Simulate(args) => command::simulate::run(&args, &around),
        Command::Identify(args) => command::identify::run(&args, &around),
        Command::Compare(args) => command::compare::run(&args, &around),
        Command::Evaluate(args) => command::evaluate::run(&args, &around),
        Command::Close(args) => command::close::run(&args, &around),
        Command::Inverse(args) => command::inverse::run(&args, &around),
        Command::Doctor(args) => command::doctor::run(&args, &around),
        Command::Presets(args) => command::presets::run(&args),
        Command::Serve(args) => command::serve::run(&args, &around),
        Command::Top(args) => command::top::run(&args, &around),
    }
}
