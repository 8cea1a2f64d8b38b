//! The `mr-damper` command. Without arguments it runs the demo; `mr-damper --help` lists all commands.

fn main() -> std::process::ExitCode {
    mr_damper_node::commands::cli::main(std::env::args().skip(1))
}
