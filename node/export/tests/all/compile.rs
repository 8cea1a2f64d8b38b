//! Compiles an export with a driver that reads readings and writes estimates as bits.

use mr_damper_export::CSource;
use mr_damper_export::vectors::{Expected, Readings, SILENCE_NS};
use std::fmt::Write as _;
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
    let mut fields = String::new();
    if let Some(kind) = source.drive {
        let _ = writeln!(fields, "        in.{} = given[1];", kind.name());
    }
    if source.needs_velocity {
        fields += "        in.velocity_m_s = given[2];\n";
    }
    if source.needs_temperature {
        fields += "        in.case_temp_c = given[3];\n";
    }
    let mut commands = String::new();
    if source.has_inverse {
        fields += "        in.force_request_n = given[4];\n";
        let substituted = if source.has_learned_inverse { " | (out.is_substituted ? 8U : 0U)" } else { "" };
        commands = format!(
            "        {{
            const double numbers[6] = {{ out.current_a, out.requested_n, out.expected_n, out.achievable_n[0], out.achievable_n[1],
                {name}_silent_current_a(&{name}_default_parameters, &state, time_ns + INT64_C({SILENCE_NS})) }};
            words[0] = out.limited_by;
            words[1] = (out.is_commanded ? 1U : 0U) | (out.is_achievable ? 2U : 0U) | (out.is_dissipative ? 4U : 0U){substituted};
            fwrite(words, sizeof words, 1, to);
            fwrite(numbers, sizeof numbers, 1, to);
        }}
"
        );
    }
    let driver = format!(
        "#include <stdio.h>
#include \"{name}.h\"
int main(void) {{
    static {name}_state state;
    int64_t time_ns;
    double given[5];
#ifdef FILES
    FILE *from = fopen(\"in.bin\", \"rb\"), *to = fopen(\"out.bin\", \"wb\");
#else
    FILE *from = stdin, *to = stdout;
#endif
    while (fread(&time_ns, sizeof time_ns, 1, from) == 1 && fread(given, sizeof given, 1, from) == 1) {{
        {name}_input in;
        {name}_output out;
        uint32_t words[2];
        in.time_ns = time_ns;
        in.displacement_m = given[0];
{fields}        words[0] = {name}_step(&{name}_default_parameters, &state, &in, &out) ? 1U : 0U;
        words[1] = out.flags;
        fwrite(words, sizeof words, 1, to);
        fwrite(&out.force_n, sizeof out.force_n, 1, to);
        fwrite(&out.reading_n, sizeof out.reading_n, 1, to);
{commands}    }}
    fclose(to);
    return 0;
}}
"
    );
    std::fs::write(dir.join("driver.c"), driver).expect("written");
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
    let size = if source.has_inverse { 80 } else { 24 };
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

/// The readings as the driver reads them.
pub(crate) fn bytes(readings: &[Readings]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(48 * readings.len());
    for r in readings {
        bytes.extend(r.time_ns.to_le_bytes());
        for value in [r.displacement_m, r.drive, r.velocity_m_s, r.case_temp_c, r.force_request_n] {
            bytes.extend(value.to_le_bytes());
        }
    }
    bytes
}

/// One output of the driver.
pub(crate) fn parse(bytes: &[u8]) -> Expected {
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
    let number = |at: usize| f64::from_le_bytes(bytes[at..at + 8].try_into().expect("eight bytes"));
    Expected { accepted: word(0) == 1, force_n: number(8), reading_n: number(16), flags: word(4) }
}
