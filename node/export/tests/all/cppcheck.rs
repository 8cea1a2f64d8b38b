//! Static analysis of the exported code.

use crate::cases::{conditionings, effects, forces, fuzzy_tanh, learned, terms, with};
use crate::compile::is_here;
use crate::inverse::with_learned;
use mr_damper_export::fmu::{FmiVersion, Fmu};
use mr_damper_export::{CExport, Precision};
use mr_damper_model::effect::Effect;
use mr_damper_model::inverse::{InverseController, Limits, Method};
use std::path::Path;
use std::process::Command;

/// Cppcheck's findings that are justified, each with its reason.
const JUSTIFIED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/cppcheck.txt");

/// The findings in the files of `dir`, which are an export of `what`.
fn findings(what: &str, dir: &Path) -> Vec<String> {
    let out = Command::new("cppcheck")
        .current_dir(dir)
        .args(["--std=c99", "--enable=warning,style,performance,portability", "--quiet"])
        .arg("--template={id} {file}:{line} {message}: {code}")
        .arg(format!("--suppressions-list={JUSTIFIED}"))
        .arg(".")
        .output()
        .expect("cppcheck runs");
    assert!(out.status.success(), "{what}: cppcheck ended with {}", out.status);
    let text = String::from_utf8_lossy(&out.stderr).into_owned();
    let lines = text.lines().filter(|line| line.contains(".c:") || line.contains(".h:"));
    lines.map(|line| format!("{what}: {line}")).collect()
}

#[test]
#[ignore = "needs cppcheck"]
fn cppcheck_finds_nothing_that_is_not_justified() {
    assert!(is_here("cppcheck"), "install it");
    let mut found = Vec::new();
    let all = [forces(), learned(), conditionings(), effects(), terms()].concat();
    for (index, (name, model)) in all.iter().step_by(3).enumerate() {
        for precision in [Precision::Double, Precision::Single] {
            let export = CExport::new("damper", model).precision(precision);
            let export = if index % 2 == 0 { export.corrected_stamps() } else { export };
            // Lazy learning has no code in single precision.
            let Ok(source) = export.source() else { continue };
            let dir = tempfile::tempdir().expect("a directory");
            std::fs::write(dir.path().join("damper.h"), &source.header).expect("written");
            std::fs::write(dir.path().join("damper.c"), &source.source).expect("written");
            found.extend(findings(&format!("{name}, {}", precision.c_type()), dir.path()));
        }
    }
    let lag = with(fuzzy_tanh(), &[Effect::CoilLag.example(), Effect::GasSpring.example()]);
    for method in Method::ALL {
        let model = with_learned(lag, method, 1e-3);
        let controller =
            InverseController::with_method(&model, Limits::default(), method).expect("an inverse");
        let parts = controller.parts().expect("it has an inverse");
        let source = CExport::new("damper", &model).inverse(&parts).source().expect("it is exported");
        let dir = tempfile::tempdir().expect("a directory");
        std::fs::write(dir.path().join("damper.h"), &source.header).expect("written");
        std::fs::write(dir.path().join("damper.c"), &source.source).expect("written");
        found.extend(findings(method.name(), dir.path()));
    }
    let source = CExport::new("damper", &lag).source().expect("it is exported");
    for version in FmiVersion::ALL {
        let dir = tempfile::tempdir().expect("a directory");
        for (path, text) in Fmu::new(&source, version).files().expect("written") {
            if let Some(name) = path.strip_prefix("sources/") {
                std::fs::write(dir.path().join(name), text).expect("written");
            }
        }
        found.extend(findings(&format!("FMI {}", version.name()), dir.path()));
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// Each suppression has a reason: a comment of its own before it.
#[test]
fn each_justified_finding_has_a_reason() {
    let text = std::fs::read_to_string(JUSTIFIED).expect("the list");
    let lines: Vec<&str> = text.lines().filter(|line| !line.is_empty()).collect();
    for (index, line) in lines.iter().enumerate() {
        let has_reason = index > 0 && lines[index - 1].starts_with("# ") && lines[index - 1].len() > 20;
        assert!(line.starts_with('#') || has_reason, "{line}");
    }
    assert!(lines.iter().any(|line| !line.starts_with('#')));
}
