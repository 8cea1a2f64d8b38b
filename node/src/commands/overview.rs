//! What `mr-damper` shows without a command.

use crate::settings::config::RosArgs;
use crate::settings::error::NodeError;
use std::fmt::Write as _;
use std::io::Write as _;

/// Commands with their purpose.
type Purposes = &'static [(&'static str, &'static str)];

/// The commands by purpose.
const GROUPS: [(&str, Purposes); 4] = [
    (
        "Live",
        &[
            ("node", "run the ROS 2 service: force estimates from displacement and current"),
            ("doctor", "check what would keep the service from working on this machine"),
            ("serve", "show dampers live in a browser, and to Foxglove and PlotJuggler"),
            ("top", "show dampers live in a terminal"),
            ("replay", "play recorded runs onto the node's input topics"),
            ("record", "record all topics of the dampers into a bag"),
        ],
    ),
    (
        "Models",
        &[
            ("identify", "fit a model to recorded runs"),
            ("evaluate", "report the errors of a model on recorded runs"),
            ("predict", "write the forces of a model at the stamps of a run"),
            ("coefficients", "print the coefficients of a model as a table"),
            ("compare", "identify and test every model on every experiment"),
            ("close", "find the effect that a model lacks, and add it"),
            ("design", "design the run that tells confounded effects apart"),
            ("inverse", "find the current for a demanded force"),
            ("export", "write a model as C source for an electronic control unit"),
            ("presets", "list the built-in models"),
            ("reproduce", "reproduce the tables and figures of the thesis"),
        ],
    ),
    (
        "Files",
        &[
            ("simulate", "write runs of a simulated damper"),
            ("convert", "convert runs between CSV and rosbag2"),
            ("fis", "convert fuzzy models to and from MATLAB's .fis"),
        ],
    ),
    (
        "Shell",
        &[
            ("completions", "print the completions for bash, zsh or fish"),
            ("man", "write the man pages"),
            ("help", "print the help of a command"),
        ],
    ),
];

/// The package's name, which `cargo run` puts into the environment of the program.
const PACKAGE: &str = env!("CARGO_PKG_NAME");

/// True if `cargo run` has started the program from this repository. It then runs the demo without a command.
pub(super) fn is_cargo_run() -> bool {
    std::env::var_os("CARGO_PKG_NAME").is_some_and(|name| name == PACKAGE)
}

/// Prints the commands, and offers the demo.
///
/// # Errors
/// When there are ROS arguments, because no command takes them; when stdout cannot be written.
pub(super) fn show(ros_args: &RosArgs) -> Result<(), NodeError> {
    if *ros_args != RosArgs::default() {
        return Err(NodeError::Usage(
            "the ROS arguments have no command: give one that starts a node, such as `mr-damper node --ros-args ...`".to_owned(),
        ));
    }
    match std::io::stdout().lock().write_all(text().as_bytes()) {
        // A closed pipe (`| head`) is not an error.
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(NodeError::io("writing to stdout")(error))
        }
        _ => Ok(()),
    }
}

fn text() -> String {
    let mut text = "mr-damper estimates the force of a magneto-rheological damper, live on ROS 2 or from recorded runs.\n\n\
                    To see it work (under a minute, on a simulated damper):\n  mr-damper demo\n"
        .to_owned();
    for (title, commands) in GROUPS {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "\n{title}:");
        for (name, purpose) in commands {
            let _ = writeln!(text, "  {name:<13} {purpose}");
        }
    }
    text + "\n`mr-damper COMMAND --help` describes a command with its options.\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::cli::Cli;
    use clap::CommandFactory;

    #[test]
    fn every_command_is_listed_once_and_lines_fit_a_terminal() {
        let mut cli = Cli::command();
        cli.build();
        let known: Vec<&str> = cli.get_subcommands().map(clap::Command::get_name).collect();
        let mut listed: Vec<&str> = GROUPS.iter().flat_map(|(_, of)| *of).map(|(name, _)| *name).collect();
        listed.push("demo");
        for name in &known {
            assert_eq!(listed.iter().filter(|other| other == &name).count(), 1, "{name}");
        }
        assert_eq!(listed.len(), known.len());
        assert!(text().lines().all(|line| line.chars().count() <= 100), "{}", text());
        assert!(text().contains("\n  mr-damper demo\n"));
    }

    #[test]
    fn ros_arguments_without_a_command_are_refused() {
        let error = show(&RosArgs::in_namespace("/front_left")).expect_err("no command");
        assert!(error.is_wrong_usage() && error.to_string().contains("mr-damper node --ros-args"), "{error}");
    }
}
