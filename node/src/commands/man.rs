//! `mr-damper man`: man pages of all commands.

use crate::commands::context::CliContext;
use crate::settings::error::NodeError;
use clap_mangen::Man;
use mr_damper_base::shown;
use std::path::PathBuf;

/// Write the man pages of all commands into a directory, which is created: mr-damper.1, mr-damper-node.1 and so on.
///
/// The Debian package installs them. Without it, `mr-damper man ~/.local/share/man/man1` makes `man mr-damper` work.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Directory of the pages.
    #[arg(value_name = "DIR")]
    dir: PathBuf,
}

/// Writes the pages of `program`. Pages that exist are replaced.
///
/// # Errors
/// When the directory or a page cannot be written.
pub fn run(args: &Args, program: clap::Command, context: &CliContext) -> Result<(), NodeError> {
    let unwritable =
        |error: std::io::Error| NodeError::io(format!("writing man pages to {}", args.dir.display()))(error);
    std::fs::create_dir_all(&args.dir).map_err(unwritable)?;
    let pages = pages(program).map_err(unwritable)?;
    for (name, text) in &pages {
        std::fs::write(args.dir.join(name), text).map_err(unwritable)?;
    }
    if !context.quiet {
        let text = format!("{} in {}", shown::count(pages.len(), "man page"), args.dir.display());
        eprintln!("{}", shown::line(&text));
    }
    Ok(())
}

/// File names and texts of the pages.
fn pages(program: clap::Command) -> std::io::Result<Vec<(String, Vec<u8>)>> {
    let mut program = program.disable_help_subcommand(true);
    program.build();
    let mut pages = Vec::new();
    for command in std::iter::once(&program).chain(program.get_subcommands()) {
        let man = Man::new(command.clone());
        let mut text = Vec::new();
        man.render_title(&mut text)?;
        man.render_name_section(&mut text)?;
        text.extend_from_slice(synopsis(command).as_bytes());
        man.render_description_section(&mut text)?;
        man.render_options_section(&mut text)?;
        if command.has_subcommands() {
            man.render_subcommands_section(&mut text)?;
        }
        if command.get_version().is_some() {
            man.render_version_section(&mut text)?;
        }
        pages.push((man.get_filename(), text));
    }
    Ok(pages)
}

/// The section with the usage line. clap_mangen's own would list each option, which are a hundred for `node`.
fn synopsis(command: &clap::Command) -> String {
    let usage = command.clone().render_usage().to_string();
    let line = usage.strip_prefix("Usage: ").unwrap_or(&usage).replace('\\', "\\\\").replace('-', "\\-");
    format!(".SH SYNOPSIS\n{}\n", line.trim())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::cli::Cli;
    use clap::CommandFactory;

    #[test]
    fn each_command_has_a_page_with_its_options() {
        let pages = pages(Cli::command()).expect("pages");
        let commands = Cli::command().get_subcommands().count();
        assert_eq!(pages.len(), commands + 1);
        let page = |name: &str| {
            let (_, text) = pages.iter().find(|(page, _)| page == name).expect(name);
            String::from_utf8(text.clone()).expect("UTF-8")
        };
        assert!(page("mr-damper.1").contains("mr\\-damper\\-node"), "{}", page("mr-damper.1"));
        // roff writes a hyphen of an option as \-.
        assert!(page("mr-damper-node.1").contains("\\-\\-coast\\-s"));
        let usage = ".SH SYNOPSIS\nmr\\-damper identify [OPTIONS] \\-\\-model <NAME> \\-\\-out <MODEL.toml> <RUN>...\n";
        assert!(page("mr-damper-identify.1").contains(usage), "{}", page("mr-damper-identify.1"));
        assert!(!page("mr-damper-doctor.1").contains("\\-\\-coast\\-s"));
        assert!(page("mr-damper-identify.1").starts_with(".ie"), "{}", page("mr-damper-identify.1"));
    }
}
