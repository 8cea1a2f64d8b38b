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
        let used = &json(&["evaluate", model, &runs[1], &runs[5], "--json", "-"])["runs"];
        assert_eq!((&used[0]["used_as"], used[1].get("used_as")), (&"validate".into(), None), "{used}");
    }
    let output = Command::new(env!("CARGO_BIN_EXE_mr-damper"))
        .args(["evaluate", &bare, &runs[1], "--calibrate", &at("none.toml")])
        .output()
        .expect("it runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("1 of 3") && said.contains("hold out"), "{said}");
    assert!(!Path::new(&at("none.toml")).exists());
}

/// No command writes over a run, and no run counts twice.
#[test]
fn runs_are_not_overwritten_and_not_used_twice() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let runs: Vec<String> = (1..=3).map(|seed| run(dir.path(), &format!("{seed}.csv"), seed)).collect();
    let at = |name: &str| dir.path().join(name).display().to_string();
    let (model, copy) = (at("model.toml"), at("copy.csv"));
    std::fs::copy(&runs[0], &copy).expect("copied");
    let before = std::fs::read(&runs[0]).expect("read");
    let refused = |arguments: &[&str], code: i32, says: &str| {
        let output = Command::new(env!("CARGO_BIN_EXE_mr-damper")).args(arguments).output().expect("it runs");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(code) && said.contains(says), "{arguments:?}: {said}");
    };
    let identify = |rest: &[&str], code: i32, says: &str| {
        let line = ["identify", "--model", "fuzzy-tanh", "--restarts", "1", &runs[0]];
        refused(&[&line[..], rest].concat(), code, says);
    };
    identify(&["--out", &runs[0]], 2, "is also an input, and would be overwritten");
    identify(&["--out", &model, "--json", &model], 2, "--out and --json are the same file");
    identify(&["--out", &model, "--report", &runs[1]], 2, "has the name of a run");
    identify(&["--out", &model, "--validate", &copy], 1, "copy.csv: has the same content as");
    identify(&[&copy, "--out", &model], 1, "copy.csv: has the same content as");
    identify(&["--out", &model, "--cutoff", "0"], 2, "positive number of hertz");
    identify(&["--out", &model, "--cutoff", "5"], 2, "--cutoff has no effect without a filter");
    let backward = ["--out", &model, "--velocity", "backward", "--slope-window", "0.1"];
    identify(&backward, 2, "--slope-window has no effect without --velocity slope");
    assert!(!Path::new(&model).exists());
    json(&["identify", "--model", "fuzzy-tanh", "--restarts", "1", &runs[0], "--out", &model, "--json", "-"]);
    refused(&["predict", &model, &runs[0], "--out", &runs[0]], 2, "is also an input");
    let calibrated = at("calibrated.toml");
    let calibrate = |given: [&str; 3], says: &str| {
        let line = [&["evaluate", &model], &given[..], &["--calibrate", &calibrated]].concat();
        refused(&line, 1, says);
    };
    calibrate([&runs[0], &runs[1], &runs[2]], "1.csv: the model was identified from this run");
    calibrate([&runs[1], &runs[2], &runs[2]], "3.csv: the run is given twice");
    assert_eq!(std::fs::read(&runs[0]).expect("read"), before);
}

/// Millimetres in a column that says metres are not taken in silence, and a run without a force to compare says so.
#[test]
fn doubtful_units_and_empty_comparisons_are_said() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let good = run(dir.path(), "good.csv", 1);
    let at = |name: &str| dir.path().join(name).display().to_string();
    let (model, bad, one) = (at("model.toml"), at("mm.csv"), at("one.csv"));
    let text = std::fs::read_to_string(&good).expect("read");
    let (head, rows) = text.split_once('\n').expect("a header");
    let column = head.split(',').position(|name| name == "displacement_m").expect("a displacement");
    let in_mm = |row: &str| {
        let mut cells: Vec<String> = row.split(',').map(str::to_owned).collect();
        if let Ok(metres) = cells[column].parse::<f64>() {
            cells[column] = (1e3 * metres).to_string();
        }
        cells.join(",")
    };
    let rows_in_mm: Vec<String> = rows.lines().map(in_mm).collect();
    std::fs::write(&bad, format!("{head}\n{}\n", rows_in_mm.join("\n"))).expect("written");
    let first = rows.lines().next().expect("a row");
    std::fs::write(&one, format!("{head}\n{first}\n")).expect("written");
    let said = |arguments: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_mr-damper")).args(arguments).output().expect("it runs");
        format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
    };
    let identify = ["identify", "--model", "fuzzy-tanh", "--restarts", "1", "--out", &model];
    let doubt = said(&[&identify[..], &[&bad]].concat());
    assert!(
        doubt.contains("displacement of the training runs reaches") && doubt.contains("displacement_mm"),
        "{doubt}"
    );
    let none = said(&[&identify[..], &[&good]].concat());
    assert!(!none.contains("is the unit right"), "{none}");
    let empty = said(&["evaluate", &model, &one]);
    assert!(empty.contains("nothing to compare"), "{empty}");
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
        assert_eq!(both["runs"][1]["used_as"], "validate", "{name}: {both:#}");
        assert_eq!(both["other_runs"], serde_json::Value::Null, "no run is another one: {both:#}");

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
