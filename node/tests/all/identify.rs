//! `identify` and `evaluate` on the command line: model file, values, report.

use crate::turn::turn;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_runs::{SaveOptions, save};
use std::path::Path;
use std::process::Command;

/// Both commands calibrate the uncertainty band on held-out runs; its coverage is then checked on
/// another run.
#[test]
fn a_band_is_calibrated_on_held_out_runs() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let runs: Vec<String> = (1..=6).map(|seed| run(dir.path(), &format!("{seed}.csv"), seed)).collect();
    let at = |name: &str| dir.path().join(name).display().to_string();
    let (model, bare, again) = (at("model.toml"), at("bare.toml"), at("again.toml"));
    let mut identify =
        vec!["identify", "--model", "fuzzy-tanh", &runs[0], "--restarts", "2", "--json", "-", "--out"];
    let identified = json(&[identify.as_slice(), &[&bare]].concat());
    assert_eq!(identified["band_calibrated"], false);
    identify.extend([model.as_str(), "--validate", &runs[1], &runs[2], &runs[3], &runs[4]]);
    let identified = json(&identify);
    assert_eq!(identified["band_calibrated"], true);
    let none = json(&[
        "evaluate",
        &bare,
        &runs[1],
        &runs[2],
        &runs[3],
        &runs[4],
        "--calibrate",
        &again,
        "--json",
        "-",
    ]);
    assert!(none["runs"].as_array().is_some_and(|runs| runs.iter().all(|run| run["band"].is_null())));
    for model in [&model, &again] {
        let band = &json(&["evaluate", model, &runs[5], "--json", "-"])["runs"][0]["band"];
        let (share, samples) = (band["share"].as_f64(), band["samples"].as_u64());
        // The coverage of a single six-second run varies widely, so only a broad range is checked.
        assert!(share.is_some_and(|share| (0.75..0.99).contains(&share)), "{band}");
        assert!(samples.is_some_and(|samples| samples > 2500), "{band}");
    }
    let output = Command::new(env!("CARGO_BIN_EXE_mr-damper"))
        .args(["evaluate", &bare, &runs[1], "--calibrate", &at("none.toml")])
        .output()
        .expect("it runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("1 of 3") && said.contains("hold out"), "{said}");
    assert!(!Path::new(&at("none.toml")).exists());
}

/// Saves a simulated run of the virtual rig and returns its path.
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
    let _turn = turn(module_path!());
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
        // The model file keeps all digits.
        assert_eq!(figure, &evaluated["runs"][0][predictor], "{name}");
        let both = json(&["evaluate", &model, &fitted, &held_out, "--json"]);
        assert_eq!(both["runs"][0]["used_as"], "estimate", "{name}: {both:#}");
        assert_eq!(both["runs"][1]["used_as"], serde_json::Value::Null, "{name}: {both:#}");
        assert_eq!(both["other_runs"], serde_json::Value::Null, "one run is no total: {both:#}");

        let page = std::fs::read_to_string(report).expect("a report");
        for word in ["fitted.csv", "held_out.csv", "held out of the fit", "persistence", "<svg"] {
            assert!(page.contains(word), "{word} is missing in the report on {name}");
        }
        assert!(!page.contains("NaN") && !page.contains("http"), "{name}");
    }
}
