//! The `mr-damper` command. Without arguments it lists the commands by purpose; with `cargo run` it runs the demo.

fn main() -> std::process::ExitCode {
    mr_damper_node::commands::cli::main(std::env::args().skip(1))
}
