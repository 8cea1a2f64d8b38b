//! The memory and the instructions of an export on Cortex-M processors, for its header: by `arm-none-eabi-gcc` and by QEMU. A machine needs
//! neither.

use super::compilers::{compiler_folder, read, run, write_code};
use crate::settings::error::NodeError;
use mr_damper_export::arm::{SUM_FILE, SUM_LINKED};
use mr_damper_export::board::{COUNTED, Instructions, LINK, LINKED, Processor, START};
use mr_damper_export::footprint::{OPTIONS, probe, sizes, stack};
use mr_damper_export::vectors::Readings;
use mr_damper_export::{CSource, Precision, driver};
use mr_damper_runs::{write_bytes, write_text};
use std::path::{Path, PathBuf};

const GCC: &str = "arm-none-eabi-gcc";
const SIZE: &str = "arm-none-eabi-size";
const QEMU: &str = "qemu-system-arm";

/// Processors whose figures a header states. M4F has an FPU for single precision, M7 one for both.
const STATED: [Processor; 2] = [Processor::M4F, Processor::M7];

/// What `source` takes, in sentences; none without the compiler. Instructions are those on `readings`; without QEMU or the compiler's C
/// library (newlib) they are not stated.
pub(super) fn footprint(source: &CSource, readings: &[Readings]) -> Result<Vec<String>, NodeError> {
    let folder = compiler_folder()?;
    let folder = folder.path();
    let Some(version) = run(folder, GCC, &["-dumpfullversion"])? else {
        return Ok(Vec::new());
    };
    write_code(folder, source)?;
    write_text(&folder.join("probe.c"), &probe(source))?;
    let counted = can_count(folder)?;
    let mut lines = vec![format!("Compiled by {GCC} {} with -Os:", version.trim())];
    for processor in STATED {
        let mut line = format!("{}: {}", processor.name, memory(folder, source, processor)?);
        if counted {
            line += &match instructions(folder, source, processor, readings) {
                Ok(instructions) => format!("; {instructions}"),
                Err(error) => format!("; the instructions of a step were not counted: {error}"),
            };
        }
        lines.push(line + ".");
    }
    let sums = if source.precision == Precision::Double { ", and so does mr_damper_sum.c" } else { "" };
    lines.push(format!("Routines of the compiler's library come on top of flash and stack{sums}."));
    if counted {
        let count = readings.len();
        lines.push(format!("QEMU counted the instructions, with those routines, on {count} readings like those of the test vectors."));
    }
    Ok(lines)
}

/// Flash, state and stack.
fn memory(folder: &Path, source: &CSource, processor: Processor) -> Result<String, NodeError> {
    let name = &source.name;
    let size_of = |stem: &str| -> Result<[u64; 3], NodeError> {
        let code = format!("{stem}.c");
        run(folder, GCC, &[processor.options, &OPTIONS, &[code.as_str()]].concat())?;
        let printed = run(folder, SIZE, &[&format!("{stem}.o")])?.unwrap_or_default();
        sizes(&printed).ok_or_else(|| fault(SIZE, "it printed no sizes"))
    };
    let ([flash, ..], [_, _, state]) = (size_of(name)?, size_of("probe")?);
    let calls = read(&folder.join(format!("{name}.ci")))?;
    let stack = stack(&String::from_utf8_lossy(&calls), &format!("{name}_step"))
        .ok_or_else(|| fault(GCC, "it knows no bound of the stack"))?;
    Ok(format!("{flash} bytes of flash with the default parameters, {state} of state, {stack} of stack"))
}

/// True if this machine has QEMU and the C library that a program for it needs.
fn can_count(folder: &Path) -> Result<bool, NodeError> {
    let specs = run(folder, GCC, &["-print-file-name=rdimon.specs"])?.unwrap_or_default();
    // GCC prints the bare name of a file that it does not find.
    Ok(specs.contains('/') && run(folder, QEMU, &["--version"])?.is_some())
}

/// Instructions of a step, from a program with the driver that runs in QEMU.
fn instructions(
    folder: &Path,
    source: &CSource,
    processor: Processor,
    readings: &[Readings],
) -> Result<Instructions, NodeError> {
    for (name, text) in [("driver.c", driver::driver(source).as_str()), ("start.c", START), ("link.ld", LINK)]
    {
        write_text(&folder.join(name), text)?;
    }
    write_bytes(&folder.join("in.bin"), &driver::bytes(readings))?;
    let code = format!("{}.c", source.name);
    let options =
        ["-std=c99", "-Os", "-DFILES", "-DTICKS", "-o", "counted.elf", &code, "driver.c", "start.c"];
    let sums: &[&str] = if source.precision == Precision::Double { &[SUM_FILE, SUM_LINKED] } else { &[] };
    run(folder, GCC, &[processor.options, &options, sums, &LINKED].concat())?;
    run(folder, QEMU, &[processor.qemu("counted.elf").as_slice(), &COUNTED].concat())?;
    Instructions::of(&read(&folder.join("out.bin"))?).ok_or_else(|| fault(QEMU, "it counted no instructions"))
}

fn fault(program: &str, message: &str) -> NodeError {
    NodeError::File { path: PathBuf::from(program), message: message.to_owned() }
}
