//! `simulate` on the command line: files, manifest, repeatability, refusals, Ctrl-C.

use crate::turn::turn;
use mr_damper_model::sample::Run;
use mr_damper_runs::{LoadOptions, load};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

fn command(arguments: &[&str], dir: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    command.arg("simulate").args(arguments).arg("--out").arg(dir);
    command
}

fn simulate(arguments: &[&str], dir: &Path) -> Output {
    command(arguments, dir).output().expect("it runs")
}

fn done(arguments: &[&str], dir: &Path) {
    let output = simulate(arguments, dir);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// Checks the exit code and message of a refused command.
fn refused(arguments: &[&str], dir: &Path, code: i32, word: &str) {
    let output = simulate(arguments, dir);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {stderr}");
    assert!(stderr.contains(word) && !stderr.contains("panicked"), "{arguments:?}: {stderr}");
}

fn read(path: &Path) -> Run {
    load(path, &LoadOptions::default()).expect("a run").run
}

fn values<'a>(run: &'a Run, column: &str) -> &'a [f64] {
    let other = run.other.iter().find(|(name, _)| name == column);
    other.map_or(&[], |(_, trace)| trace.values.as_slice())
}

fn manifest(dir: &Path) -> toml::Table {
    std::fs::read_to_string(dir.join("simulate.toml")).expect("a manifest").parse().expect("TOML")
}

/// Names of all files in the directory, including hidden ones.
fn files(dir: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(dir)
        .expect("a directory")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

#[test]
fn runs_follow_the_run_format_and_the_manifest_describes_them() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let out = dir.path().join("runs");
    let arguments =
        ["--experiment", "rp-icps", "--replicates", "2", "--duration", "4", "--effect", "friction=60"];
    done(&[&arguments[..], &["--effect", "coil_lag=0"]].concat(), &out);
    assert_eq!(files(&out), ["rp-icps-01.csv", "rp-icps-02.csv", "simulate.toml"]);

    let (first, second) = (read(&out.join("rp-icps-01.csv")), read(&out.join("rp-icps-02.csv")));
    assert_eq!(first.displacement_m.len(), 2048);
    assert_eq!(first.force_n.as_ref().map(|trace| trace.len()), Some(2048));
    assert_eq!(first.case_temp_c.as_ref().map(|trace| trace.len()), Some(16));
    assert_eq!((values(&first, "setpoint_m").len(), values(&first, "ambient_temp_c").len()), (2048, 16));
    assert_ne!(values(&first, "setpoint_m"), values(&second, "setpoint_m"));

    let manifest = manifest(&out);
    assert_eq!(manifest["schema"].as_str(), Some("mr-damper/simulate/1"));
    let run = &manifest["run"][1];
    assert_eq!(run["file"].as_str(), Some("rp-icps-02.csv"));
    assert_eq!((run["experiment"].as_str(), run["replicate"].as_integer()), (Some("RP-ICPS"), Some(2)));
    assert_eq!(run["effects"]["friction"].as_float(), Some(60.0));
    assert!(run["tool"].as_str().is_some_and(|tool| tool.starts_with("mr-damper ")));
}

#[test]
fn a_seed_gives_the_same_bytes_and_a_shared_pattern_the_same_set_point() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let of = |name: &str, more: &[&str]| {
        let out = dir.path().join(name);
        let arguments = ["--experiment", "RP-PRBS", "--replicates", "2", "--duration", "3"];
        done(&[&arguments[..], more].concat(), &out);
        out
    };
    let (a, b, other) = (of("a", &[]), of("b", &[]), of("other", &["--seed", "1"]));
    let bytes = |dir: &Path| std::fs::read(dir.join("rp-prbs-02.csv")).expect("a run");
    assert_eq!(bytes(&a), bytes(&b));
    assert_ne!(bytes(&a), bytes(&other));

    let same = of("same", &["--same-pattern", "--steady", "--perfect"]);
    let (first, second) = (read(&same.join("rp-prbs-01.csv")), read(&same.join("rp-prbs-02.csv")));
    assert_eq!(first.force_n, second.force_n);
    let drifting = of("drifting", &["--same-pattern"]);
    let (first, second) = (read(&drifting.join("rp-prbs-01.csv")), read(&drifting.join("rp-prbs-02.csv")));
    assert_eq!(values(&first, "setpoint_m"), values(&second, "setpoint_m"));
    assert_ne!(first.force_n, second.force_n);
}

#[test]
fn a_bag_holds_the_same_data_as_the_csv_file() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let arguments =
        ["--experiment", "chirp", "--duration", "3", "--to-frequency", "6", "--amplitude", "0.004"];
    done(&arguments, dir.path());
    done(&[&arguments[..], &["--format", "mcap"]].concat(), dir.path());
    let (csv, bag) = (read(&dir.path().join("chirp-01.csv")), read(&dir.path().join("chirp-01")));
    assert_eq!(
        (&csv.displacement_m, &csv.drive, &csv.force_n),
        (&bag.displacement_m, &bag.drive, &bag.force_n)
    );
    assert_eq!(values(&csv, "setpoint_m"), values(&bag, "setpoint_m"));
    let peak = values(&csv, "setpoint_m").iter().copied().fold(0.0, f64::max);
    assert!((peak - 0.004).abs() < 2e-4, "{peak} m");
    assert_eq!(manifest(dir.path())["run"].as_array().map(Vec::len), Some(2));
}

#[test]
fn runs_are_overwritten_only_by_force_and_other_runs_stay_in_the_manifest() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let sine = ["--experiment", "sine", "--duration", "1"];
    done(&sine, dir.path());
    done(&["--experiment", "road", "--duration", "1"], dir.path());
    refused(&sine, dir.path(), 1, "--force");
    let before = std::fs::read(dir.path().join("sine-01.csv")).expect("a run");
    done(&[&sine[..], &["--current", "2", "--force"]].concat(), dir.path());
    assert_ne!(std::fs::read(dir.path().join("sine-01.csv")).expect("a run"), before);
    let manifest = manifest(dir.path());
    assert_eq!(manifest["run"].as_array().map(Vec::len), Some(2));
    assert_eq!(manifest["run"][0]["current_a"].as_float(), Some(2.0));
    assert_eq!(files(dir.path()), ["road-01.csv", "simulate.toml", "sine-01.csv"]);
}

#[test]
fn impossible_requests_are_refused_with_advice() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let out = dir.path().join("runs");
    refused(&["--experiment", "RP-IPCS"], &out, 2, "RP-ICPS");
    refused(&["--experiment", "sine", "--effect", "stiction=1"], &out, 2, "thermal_fade");
    refused(&["--experiment", "sine", "--effect", "friction=lots"], &out, 2, "not a number");
    refused(&["--experiment", "all", "--current", "1"], &out, 2, "constant current");
    refused(&["--experiment", "sine", "--duration", "0"], &out, 2, "--duration");
    refused(&[], &out, 2, "--experiment");
    assert!(!out.exists());
    std::fs::write(dir.path().join("simulate.toml"), "schema = \"other\"").expect("a file");
    refused(&["--experiment", "sine"], dir.path(), 1, "other");
}

#[test]
fn the_list_names_every_experiment_and_effect() {
    let _turn = turn(module_path!());
    let output = Command::new(env!("CARGO_BIN_EXE_mr-damper")).args(["simulate", "--list"]).output();
    let output = output.expect("it runs");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success());
    for word in ["RP-APRBS-L", "43 runs, 5820 s", "paper1-10", "sine, chirp, road", "anti_alias_mismatch"] {
        assert!(text.contains(word), "{word} is missing in:\n{text}");
    }
}

#[test]
fn ctrl_c_keeps_only_complete_files() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let mut child = command(&["--experiment", "all", "--replicates", "20"], dir.path())
        .stderr(Stdio::null())
        .spawn()
        .expect("it runs");
    let start = Instant::now();
    // Waits until a short run has been written; long runs come first.
    while !files(dir.path()).iter().any(|name| name.ends_with("-l-01.csv") && !name.starts_with('.')) {
        assert!(start.elapsed() < Duration::from_secs(120), "no run in two minutes");
        std::thread::sleep(Duration::from_millis(20));
    }
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().expect("kill runs").success());
    assert_eq!(child.wait().expect("it ends").code(), Some(1));
    let manifest = manifest(dir.path());
    let listed = manifest["run"].as_array().expect("runs");
    let mut names: Vec<String> =
        listed.iter().filter_map(|run| run["file"].as_str()).map(str::to_owned).collect();
    names.push("simulate.toml".to_owned());
    names.sort();
    assert_eq!(files(dir.path()), names);
    assert!(listed.len() < 160);
    assert_eq!(read(&dir.path().join(&names[0])).displacement_m.len(), 600 * 512);
}
