//! The native module of the Python package `mr_damper`: the functions behind the classes in `python/mr_damper`, and the command
//! `mr-damper`.
//!
//! Every function calls what the command line calls, so both give bit-identical numbers. Options arrive as the words of a
//! command line (`--restarts 5`) and are parsed by the same parser. Results leave as JSON in the schemas of the commands, tables as
//! columns of bytes.
//!
//! Work that may take long runs on a thread of its own without Python's global lock (`work.rs`).

mod arguments;
mod error;
mod jobs;
mod model;
mod run;
mod table;
mod work;

use pyo3::prelude::*;
use std::io::Write;

/// Runs the command line `arguments` (without the program's name) and returns the exit code.
///
/// The caller restores the default handling of SIGINT first: the command installs handlers of its own.
#[pyfunction]
fn main(py: Python<'_>, arguments: Vec<String>) -> u8 {
    py.detach(|| {
        // A program that panics ends with exit code 101. The panic hook has printed the message.
        let code =
            std::panic::catch_unwind(|| mr_damper_node::commands::cli::exit_code(arguments)).unwrap_or(101);
        // Rust flushes stdout only at the end of its own `main`. A reader that has closed the pipe is not an error here.
        let _ = std::io::stdout().flush();
        code
    })
}

#[pymodule]
mod _native {
    #[pymodule_export]
    use super::jobs::{Identification, close, compare, evaluate, identify, simulate};
    #[pymodule_export]
    use super::main;
    #[pymodule_export]
    use super::model::{Model, Stepper, changes};
    #[pymodule_export]
    use super::run::Run;
    /// The version of the package.
    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "a name in Python")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
