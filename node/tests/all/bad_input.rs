//! Bad input on the command line: the exit code is right, the message says what, where and what to do, and
//! nothing panics.

use crate::domain::Domain;
use crate::turn::turn;
use std::path::Path;
use std::process::{Command, Output};

fn mr_damper(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mr-damper"))
        .args(arguments)
        .env_remove("RUST_LOG")
        .output()
        .expect("the binary runs")
}

/// Runs the command, checks code and message, and that nothing panicked. Returns stderr.
fn refused(arguments: &[&str], code: i32, words: &[&str]) -> String {
    let output = mr_damper(arguments);
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {stderr}");
    assert!(!stderr.contains("panicked"), "{stderr}");
    for word in words {
        assert!(stderr.contains(word), "{arguments:?}: \"{word}\" is missing in: {stderr}");
    }
    stderr
}

fn write(dir: &Path, name: &str, text: &str) -> String {
    let path = dir.join(name);
    std::fs::write(&path, text).expect("a file in a temporary directory");
    path.display().to_string()
}

const GOOD_CSV: &str =
    "time_s,displacement_m,force_n,current_a\n0,0,1,0.5\n0.01,0.001,2,0.5\n0.02,0.002,3,0.5\n";

#[test]
fn a_broken_row_is_named_and_can_be_skipped() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let broken = write(dir.path(), "run.csv", &GOOD_CSV.replace("0.001,2", "0.001,two"));
    refused(
        &["evaluate", "thesis/fuzzy-tanh/rp3-cs", &broken],
        1,
        &["run.csv", "line 3", "force_n", "two", "--skip-bad-rows"],
    );
    let output = mr_damper(&["evaluate", "--skip-bad-rows", "thesis/fuzzy-tanh/rp3-cs", &broken]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stderr).contains('1'), "the skipped row is counted");
}

#[test]
fn a_model_file_with_a_wrong_unit_is_refused_and_the_right_unit_is_named() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let preset = mr_damper(&["presets", "thesis/fuzzy-tanh/rp3-cs"]);
    let text = String::from_utf8_lossy(&preset.stdout).replace("yield_force_n", "yield_force_lbf");
    let model = write(dir.path(), "model.toml", &text);
    let run = write(dir.path(), "run.csv", GOOD_CSV);
    refused(&["evaluate", &model, &run], 1, &["model.toml", "yield_force_lbf", "yield_force_n"]);
    refused(&["node", "--model", &model], 1, &["model.toml", "yield_force_lbf", "yield_force_n"]);
}

#[test]
fn a_run_with_the_wrong_drive_is_refused() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let run = write(dir.path(), "run.csv", &GOOD_CSV.replace("current_a", "command_v"));
    refused(&["evaluate", "thesis/fuzzy-tanh/rp3-cs", &run], 1, &["run.csv", "command_v", "current_a"]);
}

#[test]
fn a_truncated_bag_is_read_to_its_end_with_a_warning() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let mut csv = "time_s,displacement_m,force_n,current_a\n".to_owned();
    for k in 0..20_000 {
        let t = f64::from(k) * 0.002;
        csv += &format!("{t:.3},{},{},{}\n", 0.01 * (6.0 * t).sin(), 300.0 * (6.0 * t).cos(), 1.0);
    }
    let run = write(dir.path(), "run.csv", &csv);
    let bag = dir.path().join("bag").display().to_string();
    assert!(mr_damper(&["convert", &run, &bag]).status.success());
    let file = std::fs::read_dir(&bag)
        .expect("the bag")
        .map(|entry| entry.expect("an entry").path())
        .find(|path| path.extension().is_some_and(|e| e == "mcap"))
        .expect("an MCAP file");
    let bytes = std::fs::read(&file).expect("readable");
    std::fs::write(&file, &bytes[..bytes.len() * 2 / 3]).expect("writable");
    let output = mr_damper(&["evaluate", "thesis/fuzzy-tanh/rp3-cs", &bag, "--json", "-"]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{stderr}");
    assert!(stderr.contains("WARN") && stderr.contains("mcap"), "{stderr}");
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON alone on stdout");
    let samples = report["runs"][0]["free_run"]["samples"].as_u64().expect("a count");
    assert!((2_000..19_990).contains(&samples), "{samples}");
}

#[test]
fn wrong_usage_is_exit_code_two() {
    let _turn = turn(module_path!());
    refused(&["node", "--coast-s", "long", "--model", "x"], 2, &["coast_s", "\"long\"", "0 to 3600"]);
    refused(&["node", "--ros-args", "-p", "coats_s:=1"], 2, &["coats_s", "coast_s"]);
    refused(&["node", "--ros-args", "--frobnicate"], 2, &["--frobnicate"]);
    refused(&["node"], 2, &["model", "thesis/fuzzy-tanh/rp3-cs", "presets"]);
    refused(&["replay"], 2, &["RUN"]);
    refused(&["frobnicate"], 2, &["frobnicate"]);
    refused(&["identify", "--model", "magic", "x.csv", "--out", "m.toml"], 2, &["magic", "fuzzy-tanh"]);
}

#[test]
fn missing_files_and_presets_are_named() {
    let _turn = turn(module_path!());
    refused(&["evaluate", "thesis/fuzzy-tanh/rp4-cs", "x.csv"], 1, &["rp4-cs", "thesis/fuzzy-tanh/rp"]);
    let relation = ["predict", "thesis/p-passive/rp1-cs", "x.csv", "--out", "y.csv"];
    refused(&relation, 1, &["thesis/p-passive/rp1-cs cannot run", "diverges", "thesis/sp-passive/rp1-cs"]);
    refused(&["evaluate", "no-such.toml", "x.csv"], 1, &["no-such.toml", "presets"]);
    refused(&["evaluate", "thesis/fuzzy-tanh/rp3-cs", "no-such.csv"], 1, &["no-such.csv"]);
}

#[test]
fn a_zenoh_port_in_use_is_named() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a free port");
    let endpoint = format!("tcp/127.0.0.1:{}", listener.local_addr().expect("bound").port());
    refused(
        &[
            "node",
            "--model",
            "thesis/fuzzy-tanh/rp3-cs",
            "--domain-id",
            &domain.id().to_string(),
            "--zenoh-listen",
            &endpoint,
        ],
        1,
        &[&endpoint, "another process uses this port"],
    );
    refused(
        &[
            "node",
            "--model",
            "thesis/fuzzy-tanh/rp3-cs",
            "--domain-id",
            &domain.id().to_string(),
            "--zenoh-listen",
            "tcp/0.0.0.0:0",
        ],
        2,
        &["tcp/0.0.0.0:0"],
    );
}

/// In a new network namespace the loopback interface is down.
#[test]
#[ignore = "needs root, or the right to create network namespaces"]
fn a_missing_network_interface_is_reported_at_once() {
    let _turn = turn(module_path!());
    let binary = env!("CARGO_BIN_EXE_mr-damper");
    let output = Command::new("unshare")
        .args(["-r", "-n", binary, "node", "--model", "thesis/fuzzy-tanh/rp3-cs"])
        .output();
    let output = output.expect("unshare (util-linux) starts");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("loopback") && stderr.contains("ip link set lo up"), "{stderr}");
    assert!(!stderr.contains("panicked"), "{stderr}");
}
