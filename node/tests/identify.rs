//! `identify` and `evaluate` from a shell: model file, figures, report.

use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_node::run::{SaveOptions, save};
use std::path::Path;
use std::process::Command;

/// A run of the rig on disk.
fn run(dir: &Path, name: &str, seed: u64) -> String {
    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(6.0);
    let path = dir.join(name);
    save(&record(&experiment, &Plant::default(), &Channels::default(), seed), &path, &SaveOptions::default())
        .expect("room in the temporary directory");
    path.display().to_string()
}

fn json(arguments: &[&str]) -> serde_json::Value {
    let output = Command::new(env!("CARGO_BIN_EXE_mr-damper")).args(arguments).output().expect("it runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON alone on stdout")
}

#[test]
fn a_model_is_identified_reported_and_evaluated_with_the_same_figures() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let (fitted, held_out) = (run(dir.path(), "fitted.csv", 1), run(dir.path(), "held_out.csv", 2));
    for (name, predictor) in [("fuzzy-tanh", "free_run"), ("arx", "one_step")] {
        let model = dir.path().join(format!("{name}.toml")).display().to_string();
        let report = dir.path().join(format!("{name}.html"));
        let page = report.display().to_string();
        let identified = json(&[
            "identify",
            "--model",
            name,
            &fitted,
            "--validate",
            &held_out,
            "--restarts",
            "4",
            "--out",
            &model,
            "--report",
            &page,
            "--json",
            "-",
        ]);
        let evaluated = json(&["evaluate", &model, &held_out, "--json"]);
        let figure = &identified["validation"][predictor];
        assert!(figure["esr"].as_f64().is_some_and(|esr| esr < 0.2), "{name}: {identified:#}");
        // The model file holds all digits.
        assert_eq!(figure, &evaluated["runs"][0][predictor], "{name}");

        let page = std::fs::read_to_string(report).expect("a report");
        for word in ["fitted.csv", "held_out.csv", "held out of the fit", "persistence", "<svg"] {
            assert!(page.contains(word), "{word} is missing in the report on {name}");
        }
        assert!(!page.contains("NaN") && !page.contains("http"), "{name}");
    }
}
