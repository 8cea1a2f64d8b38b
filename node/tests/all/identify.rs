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

/// Runs without fast motion at 0 A: the warning, the figures, and the note in the model file.
#[test]
fn a_weak_prior_is_said_and_recorded() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let experiment = Experiment::thesis("RP-APRBS").expect("a thesis experiment").with_duration_s(8.0);
    let thin = dir.path().join("thin.csv");
    let made = record(&experiment.with_pattern(0), &Plant::default(), &Channels::default(), 0);
    save(&made, &thin, &SaveOptions::default()).expect("room in the temporary directory");
    let thin = thin.display().to_string();
    let full = run(dir.path(), "full.csv", 1);
    for (name, run, needs_prior) in [("thin", &thin, true), ("full", &full, false)] {
        let model = dir.path().join(format!("{name}.toml")).display().to_string();
        let identified = json(&[
            "identify",
            "--model",
            "fuzzy-tanh",
            run,
            "--velocity",
            "backward",
            "--out",
            &model,
            "--json",
            "-",
        ]);
        let (swept, without) = (&identified["swept"], &identified["without_prior"]);
        assert_eq!(swept["sines"].as_array().map(Vec::len), Some(20), "{name}");
        assert_eq!(swept["faults"], serde_json::json!([]), "{name}");
        assert_eq!(without["faults"][0]["code"] == "drives_motion", needs_prior, "{name}: {without}");
        let warned = identified["warnings"].to_string().contains("a weak prior was added");
        let recorded = std::fs::read_to_string(&model).expect("a model").contains("weak_prior = true");
        assert_eq!((warned, recorded), (needs_prior, needs_prior), "{name}");
        assert_eq!(json(&["evaluate", &model, run, "--json"])["runs"][0]["used_as"], "estimate");
    }
}

/// An inverse model is identified with the force model, scored on the held-out runs, and used by `inverse`.
#[test]
fn an_inverse_model_is_identified_stored_and_used() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let (fitted, held_out) = (run(dir.path(), "fitted.csv", 1), run(dir.path(), "held_out.csv", 2));
    let at = |name: &str| dir.path().join(name).display().to_string();
    let (model, plain) = (at("model.toml"), at("plain.toml"));
    let line = [
        "identify",
        "--model",
        "fuzzy-tanh",
        &fitted,
        "--validate",
        &held_out,
        "--restarts",
        "2",
        "--json",
        "-",
    ];
    let without = json(&[line.as_slice(), &["--out", &plain]].concat());
    let with = json(&[line.as_slice(), &["--out", &model, "--inverse", "wang-hu"]].concat());
    assert!(without.get("inverse").is_none() && without["training"] == with["training"], "{with:#}");
    let inverse = &with["inverse"];
    assert_eq!((&inverse["kind"], &inverse["parameters"]), (&"wang-hu".into(), &126.into()));
    for which in ["training", "validation"] {
        let fit = &inverse[which];
        let (rmse_a, nmse) = (fit["rmse_a"].as_f64(), fit["nmse"].as_f64());
        assert!(rmse_a.is_some_and(|a| a > 0.0) && nmse.is_some_and(|nmse| nmse < 0.8), "{inverse:#}");
        assert!(fit["samples"].as_u64().is_some_and(|samples| samples > 1500), "{inverse:#}");
    }
    let text = std::fs::read_to_string(&model).expect("a model file");
    assert!(text.contains("[inverse_model]\nkind = \"wang-hu\""), "{text}");
    let mr_damper = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_mr-damper")).args(arguments).output().expect("it runs");
        let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
        (output.status.code(), said)
    };
    let (code, [said, error]) =
        mr_damper(&["inverse", &model, "--force", &held_out, "--no-rig", "--method", "wang-hu"]);
    assert!(code == Some(0) && said.contains("currents by the inverse model wang-hu"), "{said} {error}");
    let (code, [_, error]) = mr_damper(&["inverse", &plain, "--force", &held_out, "--method", "wang-hu"]);
    assert!(
        code == Some(1)
            && error.contains(
                "no inverse of the fuzzy-tanh model: it has no inverse model wang-hu in its file; identify it with the model: `mr-damper \
                 identify --inverse wang-hu --model NAME RUN... --out MODEL.toml`, or use search"
            ),
        "{error}"
    );
    let (code, [said, error]) = mr_damper(&[
        "identify",
        "--model",
        "fuzzy-tanh",
        &fitted,
        "--restarts",
        "1",
        "--out",
        &at("table.toml"),
        "--inverse",
        "wang-hu",
    ]);
    assert!(code == Some(0), "{error}");
    assert!(
        said.contains("inverse model wang-hu, 126 parameters") && said.contains("current, training RMSE 0."),
        "{said}"
    );
}
