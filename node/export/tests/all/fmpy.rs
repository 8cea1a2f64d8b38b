//! FMUs in FMPy: each model and effect, bit for bit.

use crate::back_to_back::{assert_same, each, samples};
use crate::cases::each_once;
use crate::compile::{WARNINGS, bytes, compilers, parse};
use crate::fmu::{inputs, write_sources};
use mr_damper_export::CExport;
use mr_damper_export::fmu::{FmiVersion, Fmu};
use mr_damper_export::vectors::{expected, simulated};
use std::path::Path;
use std::process::Command;

/// Writes `model.fmu` with a binary for this machine.
fn write_archive(dir: &Path, fmu: &Fmu<'_>) {
    write_sources(dir, fmu);
    let compiled = Command::new(compilers()[0])
        .current_dir(dir)
        .args(WARNINGS)
        .args(["-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-o", "fmu.so"])
        .args(fmu.compiled())
        .output()
        .expect("the compiler runs");
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    let object = std::fs::read(dir.join("fmu.so")).expect("an object");
    std::fs::write(dir.join("model.fmu"), fmu.archive(Some(&object)).expect("an archive")).expect("written");
}

#[test]
#[ignore = "needs MR_DAMPER_FMPY, a Python with FMPy; .ci/run fmu runs it"]
fn fmpy_has_the_services_bits() {
    let python = std::env::var("MR_DAMPER_FMPY").expect("MR_DAMPER_FMPY is a Python with FMPy");
    each(&each_once(), |index, (name, model)| {
        // An importer's time increases, also where no reading arrives.
        let all = simulated(model, samples(5_000), 2000 + index as u64, true);
        let service = expected(model, &all).expect("a pipeline");
        let source = CExport::new("damper", model).source().expect("it is exported");
        let version = FmiVersion::ALL[index % FmiVersion::ALL.len()];
        let dir = tempfile::tempdir().expect("a directory");
        write_archive(dir.path(), &Fmu::new(&source, version));
        std::fs::write(dir.path().join("in.bin"), bytes(&all)).expect("written");
        let ran = Command::new(&python)
            .arg(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/all/fmpy_steps.py"))
            .arg(dir.path())
            .args(inputs(&source))
            .output()
            .expect("Python runs");
        assert!(ran.status.success(), "{name}: {}", String::from_utf8_lossy(&ran.stderr));
        let found = std::fs::read(dir.path().join("out.bin")).expect("its output");
        let exported: Vec<_> = found.chunks_exact(24).map(parse).collect();
        assert_same(&format!("{name}, FMI {} in FMPy", version.name()), &all, &service, &exported);
    });
}
