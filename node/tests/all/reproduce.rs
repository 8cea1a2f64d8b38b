//! `reproduce`, `predict`, and the relations p on the command line.

use crate::turn::turn;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

fn mr_damper(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mr-damper")).args(arguments).arg("--quiet").output().expect("it runs")
}

/// The standard output of a command that must succeed.
fn text(arguments: &[&str]) -> String {
    let output = mr_damper(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

fn refused(arguments: &[&str], words: &[&str]) {
    let output = mr_damper(arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success(), "{arguments:?} succeeds");
    assert!(words.iter().all(|word| said.contains(word)), "{arguments:?}: {said}");
}

fn path(dir: &Path, name: &str) -> String {
    dir.join(name).display().to_string()
}

/// The figures of a table: words and values.
fn figures<'a>(report: &'a Value, table: &str, what: &str) -> Vec<(&'a Value, Option<f64>, Option<f64>)> {
    let tables = report["tables"].as_array().expect("tables");
    let found = tables
        .iter()
        .find(|t| t["table"] == table && t["what"].as_str().is_some_and(|w| w.starts_with(what)))
        .unwrap_or_else(|| panic!("no {table} {what}"));
    let figures = found["figures"].as_array().expect("figures").iter();
    figures.map(|f| (&f["of"], f["published"].as_f64(), f["here"].as_f64())).collect()
}

/// The report on short runs: published numbers as printed, and own numbers as `simulate` and `compare` compute them.
#[test]
fn the_thesis_is_made_anew_with_the_numbers_of_compare() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let (out, runs) = (path(dir.path(), "out"), path(dir.path(), "runs"));
    text(&["reproduce", "thesis", "--out", &out, "--duration", "8", "--restarts", "1"]);
    let report = std::fs::read_to_string(dir.path().join("out/thesis.json")).expect("the figures");
    let report: Value = serde_json::from_str(&report).expect("JSON");
    assert!(!dir.path().join("out/reproduce.partial.jsonl").exists());

    text(&["simulate", "--experiment", "all", "--duration", "8", "--out", &runs]);
    let compared =
        text(&["compare", &runs, "--models", "arx,sp", "--passive-only", "--restarts", "1", "--json", "-"]);
    let compared: Value = serde_json::from_str(&compared).expect("JSON");
    for (table, model, predictor) in [("Table 4.1", "arx", "one_step"), ("Table 4.3", "sp", "free_run")] {
        let rows = figures(&report, table, "NMSE");
        assert_eq!(rows.len(), 8, "{table}");
        for (of, _, here) in rows {
            let identification = compared["identification"].as_array().expect("rows").iter();
            let same = identification.filter(|row| {
                row["model"] == model && row["predictor"] == predictor && row["experiment"] == of[0]
            });
            assert_eq!(same.map(|row| row["esr"].as_f64()).collect::<Vec<_>>(), [here], "{table} {of}");
        }
    }
    // Numbers as printed in the thesis and in its papers.
    for (table, what, row, printed) in [
        ("Table 4.1", "RMSE", &["RP-ICPS"][..], 11.19),
        ("Table 4.4", "NMSE", &["RP3-CS"], 0.0463),
        ("Table 4.7", "RMSE", &["RP-APRBS"], 23.43),
        ("Table 5.1", "", &["semi-active S-P", "RP-ICPS-L"], 24.56),
        ("Table 5.2", "", &["non-linear fuzzy (fuzzy-tanh)", "RP3-CS"], 0.0993),
        ("Table III", "", &["S-P", "6"], 37.0),
        ("Table IV", "", &["P", "5"], 2.0),
        ("Table 3", "", &["RP-APRBS", "RP3-CS"], 8.96),
        ("Table 4", "", &["fuzzy-tanh", "RP2-CS"], 0.09),
    ] {
        let rows = figures(&report, table, what);
        let found: Vec<_> = rows.iter().filter(|(of, ..)| **of == serde_json::json!(row)).collect();
        assert!(
            matches!(found[..], [(_, Some(published), _)] if *published == printed),
            "{table} {row:?}: {found:?}"
        );
    }
    let page = std::fs::read_to_string(dir.path().join("out/thesis.html")).expect("the report");
    for number in ["3.2", "A.6", "4.12", "4.15", "5.10"] {
        assert!(page.contains(&format!(">Figure {number}</a>")), "{number}");
    }
    assert!(!page.contains("NaN") && !page.contains("http://") && !page.contains("https://"));
}

#[test]
fn recorded_runs_need_all_experiments() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let (out, runs) = (path(dir.path(), "out"), path(dir.path(), "runs"));
    text(&["simulate", "--experiment", "RP-ICPS", "--replicates", "2", "--duration", "4", "--out", &runs]);
    refused(
        &["reproduce", "thesis", "--runs", &runs, "--out", &out],
        &["has no runs of RP-APRBS", "RP3-CS", "rp-icps-01.csv"],
    );
    refused(&["reproduce", "theses", "--out", &out], &["thesis"]);
}

/// The table has the run's stamps, and its columns have the errors that `evaluate` computes.
#[test]
fn predictions_have_the_stamps_of_the_run_and_the_errors_of_evaluate() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let (runs, table) = (path(dir.path(), "runs"), path(dir.path(), "forces.csv"));
    text(&["simulate", "--experiment", "RP-ICPS", "--replicates", "1", "--duration", "6", "--out", &runs]);
    let run = format!("{runs}/rp-icps-01.csv");
    let stamps = |path: &str| -> Vec<String> {
        let text = std::fs::read_to_string(path).expect("a table");
        text.lines().skip(1).map(|line| line.split(',').next().unwrap_or_default().to_owned()).collect()
    };
    for preset in ["thesis/fuzzy-tanh/rp3-cs", "thesis/arx-semi-active/rp-icps-l"] {
        text(&["predict", preset, &run, "--out", &table]);
        assert_eq!(stamps(&table), stamps(&run));
        let evaluated: Value =
            serde_json::from_str(&text(&["evaluate", preset, &run, "--json", "-"])).expect("JSON");
        let written = std::fs::read_to_string(&table).expect("a table");
        let rows: Vec<Vec<&str>> = written.lines().map(|line| line.split(',').collect()).collect();
        let column = |name: &str| rows[0].iter().position(|head| *head == name).expect("a column");
        for (name, key) in [("simulation_n", "free_run"), ("one_step_n", "one_step")] {
            let (predicted, measured) = (column(name), column("measured_n"));
            let errors = rows[1..].iter().filter_map(|row| {
                let pair = (row[predicted].parse::<f64>().ok()?, row[measured].parse::<f64>().ok()?);
                Some((pair.1 - pair.0).powi(2))
            });
            let squares: Vec<f64> = errors.collect();
            let fit = &evaluated["runs"][0][key];
            if fit.is_null() {
                assert!(squares.is_empty(), "{preset} {name}");
                continue;
            }
            let rmse_n = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
            assert_eq!(Some(squares.len() as u64), fit["samples"].as_u64(), "{preset} {name}");
            let expected_n = fit["rsse_n"].as_f64().expect("an error");
            assert!(
                (rmse_n - expected_n).abs() < 1e-9 * expected_n,
                "{preset} {name}: {rmse_n} {expected_n}"
            );
        }
    }
    refused(
        &["predict", "thesis/p-passive/rp-icps", &run, "--out", &table],
        &["cannot run as a model", "evaluate"],
    );
}

#[test]
fn relations_are_listed_printed_and_evaluated_but_not_run() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let runs = path(dir.path(), "runs");
    assert_eq!(text(&["presets"]).lines().filter(|line| line.contains("relation p")).count(), 16);
    let printed: toml::Table = text(&["presets", "thesis/p-semi-active/rp2-cs"]).parse().expect("TOML");
    let parameters = printed["parameters"].as_table().expect("parameters");
    assert_eq!(printed["drive"].as_str(), Some("current_a"));
    assert!(parameters.values().all(|values| values.as_array().is_some_and(|values| values.len() == 3)));
    text(&["simulate", "--experiment", "RP2-CS", "--duration", "14", "--out", &runs]);
    let run = format!("{runs}/rp2-cs-01.csv");
    let evaluated = text(&["evaluate", "thesis/p-semi-active/rp2-cs", &run]);
    assert!(evaluated.contains("not a prediction") && evaluated.contains("same instant"), "{evaluated}");
    refused(
        &["evaluate", "thesis/p-semi-active/rp2-cs", &run, "--calibrate", &path(dir.path(), "x.toml")],
        &["cannot run as a model"],
    );
}
