//! Compiles an export with a driver that reads readings and writes estimates as bits.

use mr_damper_export::CSource;
use mr_damper_export::driver::{self, driver};
use mr_damper_export::vectors::{Expected, Readings};

pub(crate) use driver::bytes;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

/// Warnings that must not occur, on every compiler.
pub(crate) const WARNINGS: [&str; 7] =
    ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror"];

/// True if the program can be run.
pub(crate) fn is_here(program: &str) -> bool {
    Command::new(program).arg("--version").output().is_ok()
}

/// The compilers on this machine, of gcc and clang.
pub(crate) fn compilers() -> Vec<&'static str> {
    let found: Vec<&str> = ["gcc", "clang"].into_iter().filter(|name| is_here(name)).collect();
    assert!(!found.is_empty(), "this test needs gcc or clang");
    found
}

/// Writes the export and its driver to `dir`.
pub(crate) fn write(dir: &Path, source: &CSource) {
    let name = &source.name;
    for (ending, text) in [("h", &source.header), ("c", &source.source)] {
        std::fs::write(dir.join(format!("{name}.{ending}")), text).expect("written");
    }
    std::fs::write(dir.join("driver.c"), driver(source)).expect("written");
}

/// Compiles what [`write`] wrote, and runs it on `readings`.
pub(crate) fn run(
    dir: &Path,
    source: &CSource,
    compiler: &str,
    level: &str,
    readings: &[Readings],
) -> Vec<Expected> {
    run_bytes(dir, source, compiler, level, readings).chunks_exact(24).map(parse).collect()
}

/// The same, for what the driver wrote: 24 bytes for each sample, and 56 more with an inverse.
pub(crate) fn run_bytes(
    dir: &Path,
    source: &CSource,
    compiler: &str,
    level: &str,
    readings: &[Readings],
) -> Vec<u8> {
    let size = driver::size(source);
    let program = dir.join(format!("{}{level}", compiler.replace('/', "_")));
    let compiled = Command::new(compiler)
        .current_dir(dir)
        .args(WARNINGS)
        .args([level, "-o"])
        .arg(&program)
        .args([&format!("{}.c", source.name), "driver.c"])
        .output()
        .expect("the compiler runs");
    assert!(compiled.status.success(), "{compiler} {level}: {}", String::from_utf8_lossy(&compiled.stderr));
    let mut child = Command::new(&program)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the program runs");
    let bytes = bytes(readings);
    let mut stdin = child.stdin.take().expect("piped");
    let writer = std::thread::spawn(move || stdin.write_all(&bytes));
    let output = child.wait_with_output().expect("it ends");
    writer.join().expect("no panic").expect("it reads everything");
    assert!(
        output.status.success() && output.stdout.len() == size * readings.len(),
        "{compiler} {level}: {output:?}"
    );
    output.stdout
}

/// One output of the driver.
pub(crate) fn parse(bytes: &[u8]) -> Expected {
    driver::parse(bytes).expect("an output of the driver")
}
