//! `inverse` on the command line: its output, its files and its error messages.

use crate::turn::turn;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::Run;
use mr_damper_runs::{SaveOptions, save};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

const PRESET: &str = "thesis/fuzzy-tanh/rp3-cs";

fn mr_damper(dir: &Path, arguments: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    command.args(arguments.split(' ')).current_dir(dir).env_remove("RUST_LOG").output().expect("it runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A folder with demand.csv, which has the rig's force as the demanded force, and motion.csv, which has no
/// force.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(4.0);
    let run = record(&experiment, &Plant::default(), &Channels::default(), 3);
    let write = |name: &str, run: &Run| {
        save(run, &dir.path().join(name), &SaveOptions::default()).expect("room in the temporary directory");
    };
    write("motion.csv", &Run { force_n: None, ..run.clone() });
    write("demand.csv", &run);
    dir
}

#[test]
fn a_demanded_force_is_tracked_in_three_setups_and_reported_in_three_formats() {
    let _turn = turn(module_path!());
    let dir = folder();
    let output = mr_damper(
        dir.path(),
        &format!("inverse {PRESET} --force demand.csv --report page.html --json figures.json -q"),
    );
    assert!(output.status.success(), "{}", text(&output.stderr));
    let said = text(&output.stdout);
    for words in ["on the model itself", "on the rig, feedforward", "on the rig, with force feedback"] {
        assert!(said.contains(words), "{said}");
    }
    let read = |name: &str| std::fs::read_to_string(dir.path().join(name)).expect("it was written");
    let page = read("page.html");
    assert!(page.matches("<svg").count() == 6 && page.contains("On the rig, with force feedback"));
    let json: Value = serde_json::from_str(&read("figures.json")).expect("JSON");
    assert_eq!(json["schema"], "mr-damper/inverse/1");
    assert_eq!(json["monotone"], true);
    let number = |value: &Value| value.as_f64().expect("a number");
    // The preset was identified on another damper than the rig's, so accurate tracking is checked on the
    // model itself only.
    let on_model = &json["tracking"];
    assert!(number(&on_model["esr_achievable"]) < 0.05 && number(&on_model["rsse_n"]) > 0.0, "{json}");
    assert!((0.01..0.9).contains(&number(&json["infeasible_share"])), "{json}");
    let error = |place: &str| number(&json[place]["tracking"]["error"]);
    assert!(error("rig_with_feedback") < error("rig"), "{json}");
    for violations in [&json["dissipative_violations"], &json["rig"]["dissipative_violations"]] {
        assert_eq!(violations, 0);
    }
}

#[test]
fn json_alone_goes_to_stdout_and_the_rig_may_be_left_out() {
    let _turn = turn(module_path!());
    let dir = folder();
    let line = format!("inverse {PRESET} --force demand.csv --no-rig --rate-max 20 --json -");
    let output = mr_damper(dir.path(), &line);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let json: Value = serde_json::from_slice(&output.stdout).expect("JSON alone");
    assert!(json["rig"].is_null() && json["rate_limited"].as_u64() > Some(100), "{json}");
}

#[test]
fn other_inverse_methods_work_and_report_their_error() {
    let _turn = turn(module_path!());
    let dir = folder();
    for method in ["polynomial", "fuzzy"] {
        let line =
            format!("inverse {PRESET} --force demand.csv --no-rig --method {method} --json figures.json -q");
        let output = mr_damper(dir.path(), &line);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let said = text(&output.stdout);
        assert!(said.contains(&format!("by the {method} inverse; its error")), "{said}");
        let json = std::fs::read_to_string(dir.path().join("figures.json")).expect("it was written");
        let json: Value = serde_json::from_str(&json).expect("JSON");
        assert_eq!((&json["method"], &json["dissipative_violations"]), (&method.into(), &0.into()));
        assert!(json["tracking"]["error_achievable"].as_f64().is_some_and(|error| error < 0.3), "{json}");
    }
}

#[test]
fn impossible_requests_are_refused_with_advice() {
    let _turn = turn(module_path!());
    let dir = folder();
    for (line, code, words) in [
        ("inverse thesis/sp-passive/rp-icps --force demand.csv", 1, "has no current input"),
        (&format!("inverse {PRESET} --force motion.csv"), 1, "force_n"),
        (&format!("inverse {PRESET} --force none.csv"), 1, "none.csv"),
        (&format!("inverse {PRESET} --force demand.csv --current-max -2"), 1, "current.max_a is -2"),
        (
            &format!("inverse {PRESET} --force demand.csv --method chen"),
            1,
            "identify it with the model: `mr-damper identify --inverse chen",
        ),
        (&format!("inverse {PRESET}"), 2, "--force <RUN>"),
        (
            &format!("inverse {PRESET} --force demand.csv --method neural"),
            2,
            "search, polynomial, fuzzy, chen, wang-liao, wang-hu",
        ),
    ] {
        let output = mr_damper(dir.path(), line);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{line}: {said}");
        assert!(said.contains(words) && !said.contains("panicked"), "{line}: {said}");
    }
}
