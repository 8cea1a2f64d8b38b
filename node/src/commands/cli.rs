//! The command line.

use crate::commands::context::CliContext;
use crate::commands::logging::{self, LogFormat, Outputs};
use crate::commands::{
    close, coefficients, compare, completions, convert, demo, design, doctor, evaluate, export, fis,
    identify, inverse, man, node, overview, predict, presets, record, replay, reproduce, serve, simulate,
    top,
};
use crate::settings::config::RosArgs;
use crate::settings::error::NodeError;
use crate::settings::interrupt::Interrupt;
use crate::streams::player;
use clap::{CommandFactory, Parser, Subcommand};
use mr_damper_base::shown;
use std::process::ExitCode;

/// Heading of the options that every command takes.
const GLOBAL: &str = "Options of all commands";

/// Force of magneto-rheological dampers: a virtual sensor on ROS 2, mirrored to Zenoh.
///
/// Without a command, the commands are listed by purpose. Exit codes: 0 done, 1 the work failed, 2 wrong usage.
#[derive(Debug, Parser)]
#[command(name = "mr-damper", version = crate::process::hardened::version(), max_term_width = 110)]
pub struct Cli {
    /// Log only warnings and errors, and show no progress.
    #[arg(long, short, global = true, help_heading = GLOBAL)]
    quiet: bool,
    /// Format of log lines (written to stderr).
    #[arg(long, global = true, value_enum, default_value_t, help_heading = GLOBAL)]
    log_format: LogFormat,
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Args),
    Node(node::Args),
    Replay(replay::Args),
    Record(record::Args),
    Convert(convert::Args),
    Simulate(simulate::Args),
    Identify(identify::Args),
    Compare(compare::Args),
    Reproduce(reproduce::Args),
    Evaluate(evaluate::Args),
    Predict(predict::Args),
    Close(close::Args),
    Design(design::Args),
    Inverse(inverse::Args),
    Fis(fis::Args),
    Export(export::Args),
    Presets(presets::Args),
    Coefficients(coefficients::Args),
    Doctor(doctor::Args),
    Serve(serve::Args),
    Top(top::Args),
    Completions(completions::Args),
    Man(man::Args),
}

impl Command {
    /// Name of the command's node, for remapping rules that apply to one node only.
    const fn node_name(&self) -> &'static str {
        match self {
            Self::Replay(_) => player::NODE,
            Self::Record(_) => record::NODE,
            Self::Serve(_) => serve::NODE,
            Self::Top(_) => top::NODE,
            Self::Close(_) => close::live::NODE,
            _ => "mr_damper",
        }
    }

    /// Refuses ROS arguments that the command would ignore.
    fn check_ros_args(&self, given: &RosArgs) -> Result<(), NodeError> {
        let offline = match self {
            Self::Convert(_) => "convert",
            Self::Simulate(_) => "simulate",
            Self::Identify(_) => "identify",
            Self::Compare(_) => "compare",
            Self::Reproduce(_) => "reproduce",
            Self::Evaluate(_) => "evaluate",
            Self::Predict(_) => "predict",
            Self::Close(args) if !args.live.live => "close",
            Self::Design(_) => "design",
            Self::Inverse(_) => "inverse",
            Self::Fis(_) => "fis",
            Self::Export(_) => "export",
            Self::Presets(_) => "presets",
            Self::Coefficients(_) => "coefficients",
            Self::Completions(_) => "completions",
            Self::Man(_) => "man",
            // These commands start nodes with names but without parameters.
            Self::Replay(_) => return self.refuse_parameters("replay", given),
            Self::Record(_) => return self.refuse_parameters("record", given),
            Self::Serve(_) => return self.refuse_parameters("serve", given),
            Self::Top(_) => return self.refuse_parameters("top", given),
            Self::Demo(_) | Self::Node(_) | Self::Doctor(_) | Self::Close(_) => return Ok(()),
        };
        given.refuse_for_no_node(offline)
    }

    fn refuse_parameters(&self, command: &str, given: &RosArgs) -> Result<(), NodeError> {
        given.clone().for_node(self.node_name()).refuse_parameters(command)
    }
}

/// Runs the command line `arguments` (without the program's name).
#[must_use]
pub fn main(arguments: impl IntoIterator<Item = String>) -> ExitCode {
    ExitCode::from(exit_code(arguments))
}

/// The same as [`main`] with the exit code as a number, for a host that ends the process itself.
#[must_use]
pub fn exit_code(arguments: impl IntoIterator<Item = String>) -> u8 {
    let arguments: Vec<String> = arguments.into_iter().collect();
    let (plain, ros_args) = match RosArgs::split(arguments.iter().cloned()) {
        Ok(split) => split,
        Err(error) => {
            eprintln!("{}", shown::error(&error));
            return 2;
        }
    };
    let cli = match Cli::try_parse_from(std::iter::once("mr-damper".to_owned()).chain(plain)) {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version count as success; clap sets the exit code.
            let _ = error.print();
            if error.kind() == clap::error::ErrorKind::UnknownArgument
                && let Some(hint) = ros_args_hint(&arguments)
            {
                eprintln!("\n{}", shown::line(&hint));
            }
            return u8::try_from(error.exit_code()).unwrap_or(2);
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
        Ok(()) => 0,
        Err(error) => {
            eprintln!("{}", shown::error(&error));
            if error.is_wrong_usage() { 2 } else { 1 }
        }
    }
}

/// A hint for ROS arguments that were given without `--ros-args`; `None` if none were.
fn ros_args_hint(arguments: &[String]) -> Option<String> {
    if arguments.iter().any(|argument| argument == "--ros-args") {
        return None;
    }
    let is_ros = |argument: &str| {
        ["-p", "-r", "-e", "--param", "--remap", "--params-file", "--log-level", "--enclave"]
            .contains(&argument)
            || argument.contains(":=")
    };
    let first = arguments.iter().position(|argument| is_ros(argument))?;
    // A bare name:=value is a parameter, as with `ros2 launch`.
    let flag = if arguments[first].contains(":=") { "-p " } else { "" };
    let (before, after) = (arguments[..first].join(" "), arguments[first..].join(" "));
    Some(format!("ROS arguments follow --ros-args: mr-damper {before} --ros-args {flag}{after}"))
}

fn run(cli: Cli, ros_args: RosArgs) -> Result<(), NodeError> {
    let command = match cli.command {
        Some(command) => command,
        None if overview::is_cargo_run() => Command::Demo(demo::Args::default()),
        None => return overview::show(&ros_args),
    };
    command.check_ros_args(&ros_args)?;
    let ros_args = ros_args.for_node(command.node_name());
    let context = CliContext { interrupt: Interrupt::install()?, quiet: cli.quiet, ros_args, progress: None };
    match command {
        Command::Demo(args) => demo::run(&args, &context),
        Command::Node(args) => node::run(&args, &context),
        Command::Replay(args) => replay::run(&args, &context),
        Command::Record(args) => record::run(&args, &context),
        Command::Convert(args) => convert::run(&args, &context),
        Command::Simulate(args) => simulate::run(&args, &context),
        Command::Identify(args) => identify::run(&args, &context),
        Command::Compare(args) => compare::run(&args, &context),
        Command::Reproduce(args) => reproduce::run(&args, &context),
        Command::Evaluate(args) => evaluate::run(&args, &context),
        Command::Predict(args) => predict::run(&args, &context),
        Command::Close(args) => close::run(&args, &context),
        Command::Design(args) => design::run(&args, &context),
        Command::Inverse(args) => inverse::run(&args, &context),
        Command::Fis(args) => fis::run(&args, &context),
        Command::Export(args) => export::run(&args, &context),
        Command::Doctor(args) => doctor::run(&args, &context),
        Command::Presets(args) => presets::run(&args),
        Command::Coefficients(args) => coefficients::run(&args),
        Command::Completions(args) => completions::run(&args, Cli::command()),
        Command::Man(args) => man::run(&args, Cli::command(), &context),
        Command::Serve(args) => serve::run(&args, &context),
        Command::Top(args) => top::run(&args, &context),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::config::TABLE;

    /// True for commands whose help names a run as input (a single value or a list).
    fn reads_runs(command: &clap::Command) -> bool {
        command.get_arguments().any(|argument| {
            let names = argument.get_value_names().unwrap_or_default();
            names.iter().any(|name| ["RUN", "IN", "RUNS_DIR", "RUN_OR_CSV"].contains(&name.as_str()))
        })
    }

    #[test]
    fn every_command_that_reads_runs_takes_a_map_and_its_help_shows_one() {
        let mut cli = Cli::command();
        cli.build();
        let mut readers = Vec::new();
        for command in cli.get_subcommands_mut() {
            let flag = |name: &str| command.get_arguments().any(|argument| argument.get_long() == Some(name));
            // The map of the node names signals of a bus.
            let (map, file) = (flag("map") && !flag("can"), flag("map-file"));
            assert_eq!(map, reads_runs(command), "{}", command.get_name());
            assert_eq!(map, file, "{}", command.get_name());
            if map {
                let help = command.render_long_help().to_string();
                assert!(help.contains("--map displacement=/fl/susp/pos"), "{help}");
                readers.push(command.get_name().to_owned());
            }
        }
        assert_eq!(
            readers,
            ["replay", "convert", "identify", "compare", "evaluate", "predict", "close", "inverse"]
        );
    }

    #[test]
    fn ros_arguments_without_their_marker_get_a_hint() {
        let hint = |line: &str| {
            let arguments: Vec<String> = line.split_whitespace().map(str::to_owned).collect();
            Cli::try_parse_from(std::iter::once("mr-damper".to_owned()).chain(arguments.clone()))
                .expect_err(line);
            ros_args_hint(&arguments)
        };
        for (line, instead) in [
            ("node -p model:=x", "mr-damper node --ros-args -p model:=x"),
            ("node --quiet model:=x -r a:=b", "mr-damper node --quiet --ros-args -p model:=x -r a:=b"),
            ("replay a.csv -r __ns:=/fl", "mr-damper replay a.csv --ros-args -r __ns:=/fl"),
            ("node --params-file a.yaml", "mr-damper node --ros-args --params-file a.yaml"),
        ] {
            assert_eq!(hint(line).expect(line), format!("ROS arguments follow --ros-args: {instead}"));
        }
        assert_eq!(hint("node --mdel x"), None);
        assert_eq!(hint("node --ros-args -p"), None);
    }

    #[test]
    fn help_shows_defaults_in_groups_and_doctor_does_not_repeat_them() {
        let mut cli = Cli::command();
        cli.build();
        let help = |name: &str| {
            let command = cli.find_subcommand(name).expect(name);
            command.clone().term_width(0).render_long_help().to_string()
        };
        let node = help("node");
        for parameter in TABLE.iter() {
            let at = node.find(&format!("--{} <VALUE>", parameter.flag())).expect(parameter.name);
            let text = node[at..].lines().nth(1).unwrap_or_default();
            let default = parameter.default_text().unwrap_or_else(|| "empty".to_owned());
            assert!(text.ends_with(&format!("; default: {default}]")), "{}: {text}", parameter.name);
        }
        let places = ["Parameters: Node", "Parameters: Zenoh mirror", "Options of all commands:"]
            .map(|heading| node.find(heading).expect(heading));
        assert!(places.is_sorted(), "{node}");
        assert!(!help("doctor").contains("--coast-s"), "{}", help("doctor"));
        for line in ["doctor --coast-s 1", "node --coast-s 1"] {
            let words = std::iter::once("mr-damper").chain(line.split_whitespace());
            Cli::try_parse_from(words).expect(line);
        }
    }

    #[test]
    fn no_command_ignores_ros_arguments_that_it_does_not_use() {
        let outcome = |line: &str| {
            let words = line.split_whitespace().map(str::to_owned);
            let (plain, ros_args) = RosArgs::split(words).expect("ROS arguments");
            let cli = Cli::try_parse_from(std::iter::once("mr-damper".to_owned()).chain(plain)).expect(line);
            cli.command.expect("a command").check_ros_args(&ros_args).map_err(|error| error.to_string())
        };
        for command in [
            "convert a b",
            "simulate --list",
            "identify --model arx --out m.toml a",
            "compare runs",
            "reproduce thesis --out out",
            "predict m.toml a --out a.csv",
            "evaluate m.toml a",
            "close --base arx --estimate a --confirm b --out m.toml",
            "design --model m.toml --for friction --stroke 0.02 --speed 0.4",
            "inverse m.toml --force a",
            "fis a.fis --rate 512 --out models",
            "export m.toml --c out",
            "presets",
            "coefficients m.toml",
            "completions bash",
            "man pages",
        ] {
            for ros in ["-r displacement:=/x", "-r __ns:=/a", "-p coast_s:=1", "--enclave /a"] {
                let message = outcome(&format!("{command} --ros-args {ros}")).expect_err(command);
                assert!(message.contains("starts no ROS node"), "{message}");
            }
            assert_eq!(outcome(&format!("{command} --ros-args --log-level debug")), Ok(()));
        }
        for command in ["replay a", "record --out b", "serve", "top"] {
            let message = outcome(&format!("{command} --ros-args -p use_sim_time:=true")).expect_err(command);
            assert!(message.contains("has no parameters"), "{message}");
            assert_eq!(outcome(&format!("{command} --ros-args -r __ns:=/a -p other:x:=1")), Ok(()));
        }
        for command in ["node", "demo", "doctor", "close --live"] {
            assert_eq!(outcome(&format!("{command} --ros-args -r __ns:=/a -p coast_s:=1")), Ok(()));
        }
    }
}
