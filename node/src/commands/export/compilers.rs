//! Compilers around an export: `cc` for the binary of an FMU and for the difference of single precision, `arm-none-eabi-gcc` for flash and
//! stack. A machine needs neither.

use crate::commands::context::CliContext;
use crate::settings::error::NodeError;
use mr_damper_base::shown;
use mr_damper_export::fmu::{FmiVersion, Fmu};
use mr_damper_export::footprint::{OPTIONS, Processor, probe, sizes, stack};
use mr_damper_export::{CSource, Difference, driver, vectors};
use mr_damper_model::model::Model;
use mr_damper_runs::{write_bytes, write_text};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;

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

/// Readings on which code in single precision is compared with the service.
const COMPARED: usize = 20_000;

/// How far `source`, code in single precision, is from the service, in sentences; none without a C compiler.
pub(super) fn difference(
    source: &CSource,
    model: &Model,
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
    let readings = vectors::readings(model, COMPARED, 1);
    write_bytes(&file("in.bin"), &driver::bytes(&readings))?;
    let done = Command::new(file("driver")).current_dir(folder.path()).status();
    if !done.is_ok_and(|status| status.success()) {
        return Err(compiler_fault("the compiled code does not run on this machine".to_owned()));
    }
    let exported: Vec<_> =
        read(&file("out.bin"))?.chunks_exact(driver::size(source)).filter_map(driver::parse).collect();
    let sentences = Difference::of(&vectors::expected(model, &readings)?, &exported).sentences();
    if !context.quiet {
        sentences.iter().for_each(|sentence| eprintln!("{sentence}"));
    }
    Ok(sentences)
}

/// Writes NAME.h and NAME.c. Returns their paths.
pub(super) fn write_code(folder: &Path, source: &CSource) -> Result<[PathBuf; 2], NodeError> {
    let paths = ["h", "c"].map(|ending| folder.join(format!("{}.{ending}", source.name)));
    for (path, text) in paths.iter().zip([&source.header, &source.source]) {
        write_text(path, text)?;
    }
    Ok(paths)
}

fn compiler_folder() -> Result<tempfile::TempDir, NodeError> {
    tempfile::tempdir().map_err(|error| NodeError::File {
        path: std::env::temp_dir(),
        message: format!("cannot create a folder for the compiler: {error}"),
    })
}

fn compiler_fault(message: String) -> NodeError {
    NodeError::File { path: PathBuf::from("cc"), message }
}

/// Compiles in `folder`; false without a C compiler.
fn compile(folder: &Path, options: impl IntoIterator<Item = String>) -> Result<bool, NodeError> {
    let done = Command::new("cc").current_dir(folder).args(["-std=c99", "-O2"]).args(options).output();
    let done = match done {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(false),
        other => {
            other.map_err(|error| NodeError::Usage(format!("the C compiler (cc) does not start: {error}")))?
        }
    };
    if !done.status.success() {
        let said = String::from_utf8_lossy(&done.stderr);
        return Err(compiler_fault(format!("the C compiler refuses the code: {}", shown::line(&said))));
    }
    Ok(true)
}

/// A file that the compiler wrote, or a program that it compiled.
fn read(path: &Path) -> Result<Vec<u8>, NodeError> {
    fs::read(path).map_err(|error| NodeError::File { path: path.to_owned(), message: error.to_string() })
}

/// The compiler for Cortex-M.
const CORTEX_GCC: &str = "arm-none-eabi-gcc";

/// What `source` takes on Cortex-M processors, in a sentence for each; none without the compiler.
pub(super) fn footprint(source: &CSource) -> Result<Vec<String>, NodeError> {
    let Ok(version) = Command::new(CORTEX_GCC).arg("-dumpfullversion").output() else {
        return Ok(Vec::new());
    };
    let version = String::from_utf8_lossy(&version.stdout).trim().to_owned();
    let folder = compiler_folder()?;
    let file = |name: &str| folder.path().join(name);
    let name = &source.name;
    write_code(folder.path(), source)?;
    write_text(&file("probe.c"), &probe(source))?;
    let run = |program: &str, arguments: &[&str]| -> Result<String, NodeError> {
        let fault = |why: &str| NodeError::File { path: PathBuf::from(program), message: why.to_owned() };
        let done = Command::new(program).current_dir(folder.path()).args(arguments).output();
        let done = done.map_err(|error| fault(&format!("it does not start: {error}")))?;
        if !done.status.success() {
            return Err(fault(&shown::line(&String::from_utf8_lossy(&done.stderr))));
        }
        Ok(String::from_utf8_lossy(&done.stdout).into_owned())
    };
    let mut lines = vec![format!("Compiled by {CORTEX_GCC} {version} with -Os:")];
    for processor in Processor::ALL {
        let size_of = |stem: &str| -> Result<Option<[u64; 3]>, NodeError> {
            let code = format!("{stem}.c");
            run(CORTEX_GCC, &[processor.options, &OPTIONS, &[code.as_str()]].concat())?;
            Ok(sizes(&run("arm-none-eabi-size", &[&format!("{stem}.o")])?))
        };
        let (code, state) = (size_of(name)?, size_of("probe")?);
        let calls = String::from_utf8_lossy(&read(&file(&format!("{name}.ci")))?).into_owned();
        let stack = stack(&calls, &format!("{name}_step"));
        if let (Some([flash, ..]), Some([_, _, state]), Some(stack)) = (code, state, stack) {
            lines.push(format!(
                "{}: {flash} bytes of flash with the default parameters, {state} of state, {stack} of stack.",
                processor.name
            ));
        }
    }
    lines.push("Routines of the compiler's library come on top.".to_owned());
    Ok(lines)
}
