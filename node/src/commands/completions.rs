//! `mr-damper completions`: completions for a shell.

use crate::settings::error::NodeError;
use clap::ValueEnum;
use clap_complete::Shell;
use std::io::Write;

/// Print the completions of commands and options for a shell.
///
/// The Debian package installs them. Without it:
///
///   mr-damper completions bash > ~/.local/share/bash-completion/completions/mr-damper
///   mr-damper completions zsh > ~/.zfunc/_mr-damper
///   mr-damper completions fish > ~/.config/fish/completions/mr-damper.fish
///
/// For zsh, ~/.zfunc must be in fpath before compinit runs.
#[derive(Debug, clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Args {
    /// The shell.
    #[arg(value_enum)]
    shell: ShellArg,
}

/// A shell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ShellArg {
    Bash,
    Zsh,
    Fish,
}

/// Prints the completions of `program` to stdout.
///
/// # Errors
/// When stdout cannot be written.
pub fn run(args: &Args, program: clap::Command) -> Result<(), NodeError> {
    match std::io::stdout().lock().write_all(&completions(args.shell, program)) {
        // A closed pipe (`| head`) is not an error.
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(NodeError::io("writing to stdout")(error))
        }
        _ => Ok(()),
    }
}

fn completions(shell: ShellArg, mut program: clap::Command) -> Vec<u8> {
    let shell = match shell {
        ShellArg::Bash => Shell::Bash,
        ShellArg::Zsh => Shell::Zsh,
        ShellArg::Fish => Shell::Fish,
    };
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut program, "mr-damper", &mut text);
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::cli::Cli;
    use clap::CommandFactory;

    #[test]
    fn each_shell_completes_commands_and_options() {
        for shell in [ShellArg::Bash, ShellArg::Zsh, ShellArg::Fish] {
            let text = String::from_utf8(completions(shell, Cli::command())).expect("UTF-8");
            for word in ["identify", "coefficients", "validate", "coast-s", "log-format"] {
                assert!(text.contains(word), "{shell:?}: {word}");
            }
        }
    }
}
