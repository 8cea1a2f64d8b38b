//! The C compiler of this machine (`cc`), for the binary of an FMU and for the difference of single precision. A machine does not need it.

use crate::commands::context::CliContext;
use crate::settings::error::NodeError;
use mr_damper_base::shown;
use mr_damper_export::arm::{SUM, SUM_FILE};
use mr_damper_export::fmu::{FmiVersion, Fmu};
use mr_damper_export::vectors::{self, Readings};
use mr_damper_export::{CSource, Difference, Precision, driver};
use mr_damper_model::model::Model;
use mr_damper_runs::{write_bytes, write_text};
use std::fs;
use std::io::{self, Read as _, Seek as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// The shared object of `fmu` for this machine; `None`, with a message, without a compiler or on a machine that FMI has no name for.
pub(super) fn fmu_binary(
    fmu: &Fmu<'_>,
    version: FmiVersion,
    context: &CliContext,
) -> Result<Option<Vec<u8>>, NodeError> {
    let without = |why: &str| {
        if !context.quiet {
            eprintln!(
                "the FMU has C sources and no binary: {why}. Simulators that compile sources can use it."
            );
        }
        Ok(None)
    };
    if version.platform().is_none() {
        let name = version.name();
        return without(&format!("FMI {name} has no name for this kind of machine"));
    }
    let folder = compiler_folder()?;
    for (path, text) in fmu.files()? {
        if let Some(name) = path.strip_prefix("sources/") {
            write_text(&folder.path().join(name), &text)?;
        }
    }
    let object = folder.path().join("fmu.so");
    let options = ["-fPIC", "-shared", "-fvisibility=hidden", "-o", "fmu.so"].map(str::to_owned);
    if !compile(folder.path(), options.into_iter().chain(fmu.compiled()))? {
        return without(NO_COMPILER);
    }
    read(&object).map(Some)
}

/// Why nothing is compiled.
const NO_COMPILER: &str = "there is no C compiler (cc) on this machine";

/// How far `source`, code in single precision, is from the service on `readings`, in sentences; none without a C compiler.
pub(super) fn difference(
    source: &CSource,
    model: &Model,
    readings: &[Readings],
    context: &CliContext,
) -> Result<Vec<String>, NodeError> {
    let folder = compiler_folder()?;
    let file = |name: &str| folder.path().join(name);
    write_code(folder.path(), source)?;
    write_text(&file("driver.c"), &driver::driver(source))?;
    let code = format!("{}.c", source.name);
    let options = ["-DFILES", "-o", "driver", &code, "driver.c"].map(str::to_owned);
    if !compile(folder.path(), options)? {
        if !context.quiet {
            eprintln!("the difference from the node is not measured: {NO_COMPILER}");
        }
        return Ok(Vec::new());
    }
    write_bytes(&file("in.bin"), &driver::bytes(readings))?;
    run(folder.path(), &file("driver").to_string_lossy(), &[])?;
    let exported: Vec<_> =
        read(&file("out.bin"))?.chunks_exact(driver::size(source)).filter_map(driver::parse).collect();
    let sentences = Difference::of(&vectors::expected(model, readings)?, &exported).sentences();
    if !context.quiet {
        sentences.iter().for_each(|sentence| eprintln!("{sentence}"));
    }
    Ok(sentences)
}

/// Writes NAME.h and NAME.c and, for double precision, the file that mends the sums of an Arm processor. Returns their paths.
pub(super) fn write_code(folder: &Path, source: &CSource) -> Result<Vec<PathBuf>, NodeError> {
    let own = |ending: &str| format!("{}.{ending}", source.name);
    let mut files = vec![(own("h"), source.header.as_str()), (own("c"), source.source.as_str())];
    if source.precision == Precision::Double {
        files.push((SUM_FILE.to_owned(), SUM));
    }
    let write = |(name, text): (String, &str)| {
        let path = folder.join(name);
        write_text(&path, text)?;
        Ok(path)
    };
    files.into_iter().map(write).collect()
}

/// A folder for the files of a compiler.
pub(super) fn compiler_folder() -> Result<tempfile::TempDir, NodeError> {
    tempfile::tempdir().map_err(|error| NodeError::File {
        path: std::env::temp_dir(),
        message: format!("cannot create a folder for the compiler: {error}"),
    })
}

/// Compiles in `folder`; false without a C compiler.
fn compile(folder: &Path, options: impl IntoIterator<Item = String>) -> Result<bool, NodeError> {
    let options: Vec<String> = ["-std=c99", "-O2"].map(str::to_owned).into_iter().chain(options).collect();
    let options: Vec<&str> = options.iter().map(String::as_str).collect();
    Ok(run(folder, "cc", &options)?.is_some())
}

/// Longest time that a program may take. Compilers take a second; a program in an emulator that has crashed there would run for ever.
const LIMIT: Duration = Duration::from_secs(60);

/// Runs `program` in `folder`. Returns what it prints; `None` if this machine does not have it.
pub(super) fn run(folder: &Path, program: &str, arguments: &[&str]) -> Result<Option<String>, NodeError> {
    run_within(LIMIT, Command::new(program).current_dir(folder).args(arguments))
}

/// The same for a command that ends, or is ended, within `limit`.
fn run_within(limit: Duration, command: &mut Command) -> Result<Option<String>, NodeError> {
    let path = PathBuf::from(command.get_program());
    let fault = |message: String| NodeError::File { path: path.clone(), message };
    let failed = |error: io::Error| fault(format!("it does not run: {error}"));
    // Files, and not pipes, which would fill while nobody reads them.
    let [mut printed, mut said] =
        [tempfile::tempfile().map_err(failed)?, tempfile::tempfile().map_err(failed)?];
    command.stdin(Stdio::null());
    command.stdout(printed.try_clone().map_err(failed)?).stderr(said.try_clone().map_err(failed)?);
    let mut child = match command.spawn() {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        other => other.map_err(failed)?,
    };
    let started = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().map_err(failed)? {
            break status;
        }
        if started.elapsed() > limit {
            child.kill().and_then(|()| child.wait()).map_err(failed)?;
            return Err(fault(format!("it did not end within {} s, and was stopped", limit.as_secs_f64())));
        }
        thread::sleep(Duration::from_millis(5));
    };
    let text_of = |file: &mut fs::File| -> io::Result<String> {
        let mut bytes = Vec::new();
        file.rewind()?;
        file.read_to_end(&mut bytes)?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    };
    if !status.success() {
        let said = text_of(&mut said).map_err(failed)?;
        return Err(fault(format!("it ends with {status}: {}", shown::line(&said))));
    }
    text_of(&mut printed).map(Some).map_err(failed)
}

/// Reads a file that a compiler wrote, or a program that it compiled.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, NodeError> {
    fs::read(path).map_err(|error| NodeError::File { path: path.to_owned(), message: error.to_string() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_does_not_end_is_stopped() {
        let folder = std::env::temp_dir();
        let error =
            run_within(Duration::from_millis(50), Command::new("sleep").current_dir(&folder).arg("60"));
        let message = error.expect_err("it sleeps longer").to_string();
        assert!(message.contains("sleep") && message.contains("within 0.05 s"), "{message}");
        let printed = run(&folder, "echo", &["a word"]).expect("it runs");
        assert_eq!(printed.as_deref(), Some("a word\n"));
        let failed = run(&folder, "ls", &["/no/such/place"]).expect_err("there is none").to_string();
        assert!(failed.contains("exit status"), "{failed}");
        assert!(run(&folder, "no-such-program-here", &[]).expect("none is no error").is_none());
    }
}
