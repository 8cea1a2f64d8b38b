//! Options as the words of a command line, parsed by the parser of the command.

use clap::Parser;
use mr_damper_node::NodeError;
use mr_damper_node::commands::run_args::RunArgs;
use mr_damper_runs::LoadOptions;

/// A command line with the arguments of one command.
#[derive(Debug, Parser)]
#[command(no_binary_name = true, disable_help_flag = true)]
struct Line<A: clap::Args> {
    #[command(flatten)]
    args: A,
}

/// The arguments in `words`.
///
/// # Errors
/// [`NodeError::Usage`] with the parser's sentence.
pub(crate) fn parse<A: clap::Args>(words: &[String]) -> Result<A, NodeError> {
    Line::<A>::try_parse_from(words).map(|line| line.args).map_err(|error| NodeError::Usage(sentence(&error)))
}

/// The options for loading a run in `words`.
///
/// # Errors
/// As [`parse`]; when a channel is mapped twice, or the file of the map cannot be used.
pub(crate) fn load_options(words: &[String]) -> Result<LoadOptions, NodeError> {
    parse::<RunArgs>(words)?.options()
}

/// The parser's message without what concerns a terminal: the word "error", the usage line and the hint at --help.
fn sentence(error: &clap::Error) -> String {
    let text = error.render().to_string();
    let text = text.strip_prefix("error: ").unwrap_or(&text);
    let is_message = |line: &&str| !line.starts_with("Usage:") && !line.starts_with("For more information");
    let lines: Vec<&str> =
        text.lines().take_while(is_message).map(str::trim).filter(|line| !line.is_empty()).collect();
    lines.join(" ")
}
