//! `compare` on the command line: tables, JSON as in the contract, resuming after an interrupt, bad input.

use crate::turn::turn;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_runs::{SaveOptions, save};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

/// Two experiments of the virtual rig with two replicates each.
fn runs(dir: &Path) {
    for (name, stem) in [("RP-ICPS", "rp-icps"), ("RP1-CS", "rp1-cs")] {
        for replicate in 1..=2 {
            let experiment = Experiment::thesis(name).expect("a thesis experiment");
            let experiment = experiment.with_duration_s(6.0).with_pattern(5);
            let run = record(&experiment, &Plant::default(), &Channels::default(), replicate);
            let path = dir.join(format!("{stem}-{replicate:02}.csv"));
            save(&run, &path, &SaveOptions::default()).expect("room in the temporary directory");
        }
    }
}

fn compare(dir: &Path, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    command.arg("compare").arg(dir.join("runs")).args(["--restarts", "2", "--quiet"]).args(more);
    command.current_dir(dir).output().expect("it runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn temporary() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a temporary directory");
    runs(&dir.path().join("runs"));
    dir
}

#[test]
fn the_json_follows_the_contract_and_the_tables_show_its_values() {
    let _turn = turn(module_path!());
    let dir = temporary();
    let more = ["--models", "arx,fuzzy-tanh", "--json", "r.json", "--report", "r.html"];
    let output = compare(dir.path(), &more);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let json = std::fs::read_to_string(dir.path().join("r.json")).expect("a file");
    let json: Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(json["schema"], "mr-damper/compare/1");

    let rows = |key: &str| json[key].as_array().unwrap_or_else(|| panic!("{key} is a list")).clone();
    // ARX has two forms and two fits (rls) with two predictors each, fuzzy-tanh two forms with one predictor; all on
    // two experiments.
    assert_eq!(rows("identification").len(), 20);
    for row in rows("identification") {
        // With seven current levels, seven fuzzy sets cannot be placed: the row has a note instead of values.
        if row["form"] == "free_fuzzy" && row["experiment"] == "RP1-CS" {
            assert!(row["note"].as_str().is_some_and(|note| note.contains("cannot be placed")), "{row:#}");
            continue;
        }
        for key in ["rsse_n", "esr", "seconds"] {
            assert!(row[key].as_f64().is_some_and(|v| v > 0.0), "{key}: {row:#}");
        }
        assert!(row["parameters"].as_u64().is_some() && row["restarts"] == 2);
        assert!(["RP-ICPS", "RP1-CS"].contains(&row["experiment"].as_str().expect("a name")));
    }
    // Each of the nineteen models with values is tested on the three other runs.
    assert_eq!(rows("cross_validation").len(), 57);
    for row in rows("cross_validation") {
        assert!(["passive", "semi_active", "free_fuzzy"].contains(&row["form"].as_str().expect("a form")));
        assert!(["free_run", "one_step"].contains(&row["predictor"].as_str().expect("a predictor")));
        assert!(row["esr"].as_f64().is_some() && row["rsse_n"].as_f64().is_some(), "{row:#}");
        let training = row["trained_on"] == row["tested_on"] && row["replicate"] == 1;
        assert!(!training, "{row:#}");
    }
    let persistence: Vec<Value> = rows("persistence").iter().map(|row| row["experiment"].clone()).collect();
    assert_eq!(persistence, ["RP-ICPS", "RP1-CS"]);
    assert!(rows("models").iter().all(|row| row["ns_per_step"].as_f64().is_some_and(|ns| ns > 0.0)));

    let table = text(&output.stdout);
    let first = &rows("identification")[0];
    assert!(table.contains(&format!("{:.4}", first["esr"].as_f64().expect("a figure"))), "{table}");
    let (free, stepped) = table.split_once("one step ahead").expect("two predictors");
    assert!(
        free.contains("fuzzy-tanh") && !stepped.contains("  fuzzy-tanh") && stepped.contains("persistence")
    );
    let page = std::fs::read_to_string(dir.path().join("r.html")).expect("a report");
    for word in ["RP1-CS", "Persistence", "fuzzy-tanh (semi-active)", "Force over velocity", "<svg"] {
        assert!(page.contains(word), "{word} is missing in the report");
    }
    for word in ["http", "src=", "NaN", "inf "] {
        assert!(!page.contains(word), "{word} in the report");
    }
    assert!(
        !dir.path().join("compare.partial.jsonl").exists(),
        "the work is complete, so no state file is left"
    );
}

#[test]
fn the_same_command_resumes_and_a_changed_option_starts_over() {
    let _turn = turn(module_path!());
    let dir = temporary();
    let state = dir.path().join("state.jsonl");
    let lines = || std::fs::read_to_string(&state).expect("the state").lines().count();
    let more = ["--models", "savaresi", "--passive-only", "--resume", "state.jsonl", "--json"];
    let figures = |output: &Output| -> Value {
        assert!(output.status.success(), "{}", text(&output.stderr));
        let json: Value = serde_json::from_slice(&output.stdout).expect("JSON alone on stdout");
        // The seconds are compared as well: a cell that is not computed again keeps its time.
        json["identification"].clone()
    };
    let first = figures(&compare(dir.path(), &more));
    assert_eq!(lines(), 2);
    // The state file after an interrupt: one cell is done.
    let kept = std::fs::read_to_string(&state).expect("the state");
    let half: String = kept.lines().take(1).map(|line| format!("{line}\n")).collect();
    std::fs::write(&state, half).expect("room");
    let second = figures(&compare(dir.path(), &more));
    assert_eq!(lines(), 2);
    let seconds = |rows: &Value| {
        rows.as_array().expect("rows").iter().filter(|r| first.as_array().expect("rows").contains(r)).count()
    };
    assert_eq!(seconds(&second), 2, "the two rows of the kept cell are unchanged, including their seconds");

    let mut changed = more.to_vec();
    changed.extend(["-", "--cutoff", "25"]);
    figures(&compare(dir.path(), &changed));
    assert_eq!(lines(), 4, "another filter cutoff is computed separately");
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_it_at_once_and_it_says_how_to_resume() {
    let _turn = turn(module_path!());
    let dir = temporary();
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    command.arg("compare").arg(dir.path().join("runs")).args(["--quiet", "--restarts", "100000"]);
    let child = command
        .args(["--models", "arx,fuzzy-tanh", "--json", "r.json"])
        .current_dir(dir.path())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("it runs");
    let state = dir.path().join("compare.partial.jsonl");
    let deadline = Instant::now() + Duration::from_secs(60);
    // Waits for the first cell only: later cells may share the thread pool with a hundred thousand restarts.
    while std::fs::read_to_string(&state).map_or(true, |text| text.lines().count() < 1) {
        assert!(Instant::now() < deadline, "the first ARX cell is done within 60 s");
        std::thread::sleep(Duration::from_millis(50));
    }
    let killed = Instant::now();
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().expect("kill").success());
    let output = child.wait_with_output().expect("it ends");
    // Takes a second on an idle machine; the limit allows for a busy one.
    assert!(killed.elapsed() < Duration::from_secs(5), "{:?}", killed.elapsed());
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("the same command continues"), "{}", text(&output.stderr));
    assert!(state.exists() && !dir.path().join("r.json").exists());
}

#[test]
fn bad_input_is_refused_with_a_plain_message() {
    let _turn = turn(module_path!());
    let dir = temporary();
    let fails = |more: &[&str], code: i32, wanted: &str| {
        let output = compare(dir.path(), more);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{said}");
        assert!(said.contains(wanted), "{wanted}: {said}");
    };
    fails(&["--models", "arks"], 2, "arx");
    fails(&["--experiments", "RP-XYZ"], 1, "there are RP-ICPS, RP1-CS");
    fails(&["--models", "fuzzy-tanh", "--passive-only"], 1, "passive-only");
    fails(&["--models", "arx", "--rate", "100"], 1, "100");
    let empty = tempfile::tempdir().expect("a temporary directory");
    std::fs::create_dir(empty.path().join("runs")).expect("room");
    let output = compare(empty.path(), &[]);
    assert!(!output.status.success() && text(&output.stderr).contains("holds no runs"));
    let absent = tempfile::tempdir().expect("a temporary directory");
    let output = compare(absent.path(), &[]);
    assert!(!output.status.success() && text(&output.stderr).contains("runs"));
}

#[test]
fn named_runs_train_together_and_are_tested_one_by_one() {
    let _turn = turn(module_path!());
    let dir = temporary();
    let run = |name: &str| dir.path().join("runs").join(name).display().to_string();
    let given = |train: &[&str], test: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
        command.args(["compare", "--models", "sp,p", "--restarts", "2", "--quiet", "--json"]);
        command.arg("--train").args(train.iter().map(|name| run(name)));
        command.arg("--test").args(test.iter().map(|name| run(name)));
        command.current_dir(dir.path()).output().expect("it runs")
    };
    let output = given(&["rp-icps-01.csv", "rp1-cs-01.csv"], &["rp-icps-02.csv", "rp1-cs-02.csv"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let json: Value = serde_json::from_slice(&output.stdout).expect("JSON alone on stdout");
    let rows = |key: &str| json[key].as_array().unwrap_or_else(|| panic!("{key} is a list")).clone();
    // Two models in two forms each. Model `p` cannot be simulated, so it has a predictor of its own.
    assert_eq!(rows("identification").len(), 4);
    assert!(rows("identification").iter().all(|row| row["experiment"] == "training"));
    for (row, tested) in rows("cross_validation").iter().zip(["rp-icps-02", "rp1-cs-02"].iter().cycle()) {
        assert_eq!(row["tested_on"], **tested, "{row:#}");
        let predictor = if row["model"] == "p" { "same_instant" } else { "free_run" };
        assert!(row["predictor"] == predictor && row["esr"].as_f64().is_some(), "{row:#}");
    }

    let twice = given(&["rp-icps-01.csv"], &["rp-icps-01.csv"]);
    assert_eq!(twice.status.code(), Some(1));
    assert!(text(&twice.stderr).contains("rp-icps-01.csv is named twice"), "{}", text(&twice.stderr));
}

#[test]
fn inverse_methods_are_compared_by_the_current_that_they_find() {
    let _turn = turn(module_path!());
    let dir = temporary();
    let more = ["--models", "sp", "--inverse", "search,wang-hu", "--json", "i.json", "--report", "i.html"];
    let output = compare(dir.path(), &more);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let json = std::fs::read_to_string(dir.path().join("i.json")).expect("a file");
    let json: Value = serde_json::from_str(&json).expect("JSON");
    let inverses = json["inverse"].as_array().expect("a list");
    // Two methods on two experiments, each tested on the three other runs.
    assert_eq!(inverses.len(), 4);
    for inverse in inverses {
        let tests = inverse["cross_validation"].as_array().expect("tests");
        assert_eq!(tests.len(), 3);
        for figure in tests.iter().map(|test| &test["figure"]).chain([&inverse["identification"]]) {
            assert!(figure["rmse_a"].as_f64().is_some_and(|a| (0.0..2.5).contains(&a)), "{inverse:#}");
        }
    }
    let best = json["inverse_ranking"].as_array().expect("a list");
    let mean = |k: usize| best[k]["mean_rmse_a"].as_f64().expect("a mean");
    assert!(best.len() == 2 && mean(0) <= mean(1), "{best:#?}");
    let printed = text(&output.stdout);
    let (_, table) = printed.split_once("Inverse methods").expect("a table");
    for row in best {
        let (method, rmse_a) = (row["method"].as_str().expect("a name"), row["mean_rmse_a"].as_f64());
        let line = table.lines().find(|line| line.trim_start().starts_with(method)).expect("a line");
        assert!(line.contains(&format!("{:.3}", rmse_a.expect("a mean"))), "{line}");
    }
    let page = std::fs::read_to_string(dir.path().join("i.html")).expect("a file");
    assert!(page.contains("Inverse methods"));

    let unknown = compare(dir.path(), &["--inverse", "chan"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(text(&unknown.stderr).contains("search, polynomial, fuzzy, chen"), "{}", text(&unknown.stderr));
}
