//! `close` on the command line: it refuses unsuitable input before any work, finds an effect and writes the model, and
//! stops at once on Ctrl-C.

use crate::turn::turn;
use mr_damper_model::rig::{Channels, Experiment, Plant, record};
use mr_damper_model::sample::{DriveKind, Run};
use mr_damper_runs::{SaveOptions, save};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

const PRESET: &str = "thesis/fuzzy-tanh/rp3-cs";

/// A simulated run of the virtual rig, a few seconds long.
fn rig(seed: u64) -> Run {
    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(4.0);
    record(&experiment, &Plant::default(), &Channels::default(), seed)
}

fn write(dir: &Path, name: &str, run: &Run) {
    save(run, &dir.join(name), &SaveOptions::default()).expect("room in the temporary directory");
}

/// A folder with the runs a.csv to e.csv, a copy of a.csv, a run driven by a voltage, a run without a drive, and a model
/// identified from a.csv.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a temporary directory");
    for (seed, name) in (1..).zip(["a.csv", "b.csv", "c.csv", "d.csv", "e.csv"]) {
        write(dir.path(), name, &rig(seed));
    }
    std::fs::copy(dir.path().join("a.csv"), dir.path().join("copy-of-a.csv")).expect("room");
    let run = rig(7);
    let drive = run.drive.clone().map(|(_, trace)| (DriveKind::CommandVoltage, trace));
    write(dir.path(), "volts.csv", &Run { drive, ..run.clone() });
    write(dir.path(), "no-drive.csv", &Run { drive: None, ..run });
    let identified = mr_damper(
        dir.path(),
        &["identify", "--model", "sp", "a.csv", "--restarts", "1", "--out", "a.toml", "-q"],
    );
    assert!(identified.status.success(), "{}", text(&identified.stderr));
    dir
}

fn mr_damper(dir: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    command.args(arguments).current_dir(dir).env_remove("RUST_LOG").output().expect("it runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn unsuitable_input_is_refused_before_any_work() {
    let _turn = turn(module_path!());
    let dir = folder();
    let refused = |line: &str, code: i32, words: &[&str]| {
        let arguments: Vec<&str> =
            ["close", "--out", "new.toml"].into_iter().chain(line.split(' ')).collect();
        let output = mr_damper(dir.path(), &arguments);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{line}: {said}");
        assert!(!said.contains("panicked") && !dir.path().join("new.toml").exists(), "{line}: {said}");
        for word in words {
            assert!(said.contains(word), "{line}: \"{word}\" is missing in: {said}");
        }
    };
    let preset = |line: &str| format!("--base {PRESET} {line}");
    let three = preset("--estimate a.csv --confirm b.csv --test c.csv");

    // The same run twice: it is recognised by content under any name, also within one role.
    let twice =
        ["copy-of-a.csv: given with --test", "a.csv, given with --estimate", "SHA-256", "another run"];
    refused(&preset("--estimate a.csv --confirm b.csv --test copy-of-a.csv"), 1, &twice);
    refused(
        &preset("--estimate a.csv copy-of-a.csv --confirm b.csv"),
        1,
        &["a run that is used twice", "copy-of-a.csv"],
    );
    refused(&format!("{three} --replicates d.csv copy-of-a.csv"), 1, &["given with --replicates"]);

    // A test run (`--test`, "sealed") that the base was trained on.
    let known = ["copy-of-a.csv: given with --test", "a.toml was made with this very run", "another base"];
    refused("--base a.toml --estimate b.csv --confirm c.csv --test copy-of-a.csv", 1, &known);

    // Too few runs, or too many.
    refused(&preset("--estimate a.csv"), 2, &["no validation run", "--confirm"]);
    refused(&preset("--confirm a.csv"), 2, &["--estimate"]);
    refused(
        &format!("{three} --reference d.csv e.csv"),
        2,
        &["2 reference runs for 3 runs", "in that order"],
    );
    refused(&format!("{three} --replicates d.csv"), 2, &["d.csv is the only replicate", "--noise-floor"]);

    // Drives.
    let volts = ["volts.csv: is driven by command_v", "current_a", "--drive"];
    refused(&preset("--estimate a.csv --confirm volts.csv"), 1, &volts);
    refused("--base fuzzy-tanh --estimate a.csv --confirm b.csv --test volts.csv", 1, &volts);
    refused(
        "--base sp --estimate a.csv --confirm no-drive.csv",
        1,
        &["no-drive.csv: has no current_a", "--passive"],
    );

    // The base.
    refused(
        "--base fuzzy-tanhh --estimate a.csv --confirm b.csv",
        1,
        &["fuzzy-tanhh", "no such file", "fuzzy-tanh,"],
    );
    refused("--base none.toml --estimate a.csv --confirm b.csv", 1, &["none.toml", "presets"]);
    for flag in [
        "--cutoff 20",
        "--filter inputs",
        "--velocity slope",
        "--slope-window 0.01",
        "--restarts 3",
        "--passive",
    ] {
        let name = flag.split(' ').next().expect("a flag");
        refused(&format!("{three} {flag}"), 2, &[name, PRESET, "holds its own"]);
    }

    // With healthy runs, the base must be given.
    let healthy = "close --estimate a.csv --confirm b.csv --reference a.csv b.csv --out new.toml";
    let output = mr_damper(dir.path(), &healthy.split(' ').collect::<Vec<_>>());
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("Give the model in use with --base"), "{}", text(&output.stderr));

    // Files and numbers.
    refused(&format!("{three} --report none/r.html"), 1, &["none/r.html", "no folder none"]);
    refused(&format!("{three} --noise-floor -3"), 2, &["--noise-floor", "positive number of newtons"]);
    refused(&format!("{three} --terms 4"), 2, &["--terms", "0..=3"]);
    refused(&format!("{three} --block-s 0"), 2, &["--block-s", "positive number of seconds"]);
    refused(&format!("{three} --json new.toml"), 2, &["--out and --json are the same file", "new.toml"]);
    refused(&format!("{three} --report a.csv"), 2, &["--report a.csv is also an input"]);
    refused(&format!("{three} --report other.csv"), 2, &["--report other.csv has the name of a run"]);
    refused(
        &format!("{three} --healthy copy-of-a.csv"),
        1,
        &["given with --healthy", "a run that is used twice"],
    );
    let both = format!("{three} --healthy d.csv --reference a.csv b.csv c.csv");
    refused(&both, 2, &["--healthy", "--reference", "cannot be used with"]);
    refused(&format!("{three} --effects coil_lag,cavitation"), 2, &["cavitation", "coil_lag, remanence"]);
    refused(&preset("--estimate a.csv --confirm none.csv"), 1, &["none.csv"]);
    let own = ["close", "--base", "a.toml", "--estimate", "b.csv", "--confirm", "c.csv", "--out", "a.toml"];
    let output = mr_damper(dir.path(), &own);
    assert!(text(&output.stderr).contains("--out a.toml is also an input"), "{}", text(&output.stderr));
}

#[test]
fn a_refused_diagnosis_has_a_code_and_numbers_in_json() {
    let _turn = turn(module_path!());
    let dir = folder();
    let line = "--estimate a.csv --confirm b.csv --block-s 60 --out new.toml --json";
    let arguments: Vec<&str> = ["close", "--base", PRESET].into_iter().chain(line.split(' ')).collect();
    let output = mr_damper(dir.path(), &arguments);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(!dir.path().join("new.toml").exists(), "{said}");
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON on stdout");
    let reason = &json["reason"];
    assert_eq!((&reason["code"], &reason["needed_blocks"]), (&"too_short".into(), &6.into()), "{json:#}");
    assert_eq!((&reason["block_s"], &reason["needed_s"]), (&60.0.into(), &360.0.into()), "{json:#}");
    assert!(json["error"].as_str().is_some_and(|error| said.contains(error)), "{json:#} {said}");
}

#[test]
fn the_help_explains_each_set_of_runs() {
    let _turn = turn(module_path!());
    let help = text(&mr_damper(Path::new("."), &["close", "--help"]).stdout);
    for word in [
        "no file may be used twice",
        "test runs: read once",
        "--replicates",
        "--healthy",
        "--terms <N>",
        "Examples:",
        "mr-damper close [--base",
    ] {
        assert!(help.contains(word), "\"{word}\" is missing in: {help}");
    }
    assert!(help.lines().all(|line| line.chars().count() <= 110), "{help}");
}

#[test]
fn the_rigs_coil_lag_is_found_and_written_and_its_test_run_cannot_be_used_again() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let experiment = Experiment::thesis("RP-ICPS").expect("a thesis experiment").with_duration_s(20.0);
    for (seed, name) in (1..).zip(["a.csv", "b.csv", "c.csv", "d.csv"]) {
        write(dir.path(), name, &record(&experiment, &Plant::default(), &Channels::default(), seed));
    }
    let runs = "--estimate a.csv b.csv --confirm c.csv --test d.csv --quiet --json -";
    let close = |line: &str| {
        let arguments: Vec<&str> = line.split(' ').chain(runs.split(' ')).collect();
        mr_damper(dir.path(), &arguments)
    };
    let output = close(
        "close --base fuzzy-tanh --restarts 2 --effects coil_lag,force_lag --out new.toml --report new.html",
    );
    assert!(output.status.success(), "{}", text(&output.stderr));
    let json: Value = serde_json::from_slice(&output.stdout).expect("JSON alone on stdout");
    assert_eq!((&json["schema"], &json["mode"]), (&"mr-damper/close/1".into(), &"absolute".into()));
    let effects = json["effects"].as_array().expect("effects");
    let lag =
        effects.iter().find(|effect| effect["id"] == "coil_lag").expect("the rig's coil has a lag of 12 ms");
    // The lag has one time constant, or one each for rising and falling current; one of them must be near 12 ms.
    let taus = ["tau_s", "tau_rise_s"].map(|name| lag["parameters"][name].as_f64());
    assert!(taus.iter().flatten().any(|tau_s| (0.008..0.016).contains(tau_s)), "{lag:#}");
    assert!(json["test"]["ratio_ci95"][1].as_f64().is_some_and(|high| high < 0.6), "{:#}", json["test"]);
    let roles: Vec<&Value> = json["runs"].as_array().expect("runs").iter().map(|run| &run["role"]).collect();
    assert_eq!(roles, ["estimate", "estimate", "confirm", "test"]);

    let structures = json["structures"].as_array().expect("structures");
    let given: Vec<bool> = structures.iter().map(|row| row["given"] == true).collect();
    assert_eq!(given, [true, false], "the base that was named, and the Bouc-Wen law");

    // Without a base, the structure is chosen on the validation run, and the file that is written has it.
    let output = close("close --restarts 2 --effects coil_lag,force_lag --out chosen.toml");
    assert!(output.status.success(), "{}", text(&output.stderr));
    let chosen: Value = serde_json::from_slice(&output.stdout).expect("JSON alone on stdout");
    let structures = chosen["structures"].as_array().expect("structures");
    let names: Vec<&str> = structures.iter().filter_map(|row| row["structure"].as_str()).collect();
    assert_eq!(names, ["fuzzy-tanh", "bouc-wen"]);
    let [best] = structures.iter().filter(|row| row["chosen"] == true).collect::<Vec<_>>()[..] else {
        panic!("one structure is chosen: {structures:#?}");
    };
    assert!(
        structures.iter().all(|row| row["rsse_n"].as_f64() >= best["rsse_n"].as_f64()),
        "{structures:#?}"
    );
    let found = chosen["effects"].as_array().expect("effects");
    assert!(found.iter().any(|effect| effect["id"] == "coil_lag"), "{found:#?}");
    let ids =
        |effects: &[Value]| -> Vec<Value> { effects.iter().map(|effect| effect["id"].clone()).collect() };
    assert_eq!(ids(effects), ids(found), "the base that is given does not change the names");
    let written = std::fs::read_to_string(dir.path().join("chosen.toml")).expect("a model file");
    assert!(written.contains(best["structure"].as_str().expect("a name")), "{written}");

    // An effect that `--effects` excludes is neither named nor reported as absent.
    let other = close(
        "close --base fuzzy-tanh --fixed-base --restarts 2 --out other.toml --effects gas_spring,friction",
    );
    let other: Value = serde_json::from_slice(&other.stdout).expect("JSON alone on stdout");
    let ids = |list: &str| -> Vec<&str> {
        other[list].as_array().expect(list).iter().filter_map(|effect| effect["id"].as_str()).collect()
    };
    assert!(!ids("effects").contains(&"coil_lag"), "{other:#}");
    assert!(ids("untestable").contains(&"coil_lag") && !ids("untestable").contains(&"friction"), "{other:#}");

    // The model file contains the effect: evaluating the file gives the same error.
    let evaluated = mr_damper(dir.path(), &["evaluate", "new.toml", "d.csv", "--json"]);
    let evaluated: Value = serde_json::from_slice(&evaluated.stdout).expect("JSON");
    let esr = |value: &Value| value["esr"].as_f64().expect("a figure");
    let (sealed, again) =
        (esr(&json["test"]["after"]), esr(&evaluated["runs"][0]["free_run_without_offset"]));
    assert!((again / sealed - 1.0).abs() < 0.1, "{again} {sealed}: only a few rows at the ends differ");
    let page = std::fs::read_to_string(dir.path().join("new.html")).expect("a report");
    assert!(
        page.contains("coil_lag")
            && page.contains("d.csv")
            && !page.contains("NaN")
            && !page.contains("http")
    );

    // The test run has been read once: the next diagnosis needs another one.
    let output = close("close --base new.toml --out newer.toml");
    assert_eq!(output.status.code(), Some(1));
    assert!(
        text(&output.stderr).contains("d.csv: given with --test, but new.toml was made with this very run")
    );
}

#[test]
fn options_for_recorded_runs_are_refused_with_live() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    for (line, word) in [
        ("close --live --base damper.toml", "--base"),
        ("close --live --estimate a.csv --confirm b.csv --out new.toml", "--estimate"),
        ("close --live --out new.toml", "--out"),
        ("close --live --block-s 3", "--block-s"),
        ("close --live --velocity measured", "--velocity"),
        ("close --live --skip-bad-rows", "--skip-bad-rows"),
        ("close --live --report new.html", "--report"),
        ("close --live --history 0", "positive number of seconds"),
        ("close --live --history -1", "positive number of seconds"),
        ("close --live --history nan", "positive number of seconds"),
        ("close --live --domain-id 233", "233"),
        ("close --history 60", "--live"),
        ("close --history 60 --base a.toml --estimate a.csv --out new.toml", "--history"),
        ("close --domain-id 1 --base a.toml --estimate a.csv --out new.toml", "--domain-id"),
        ("close", "--estimate"),
    ] {
        let output = mr_damper(dir.path(), &line.split(' ').collect::<Vec<_>>());
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line}: {said}");
        assert!(said.contains(word), "{line}: \"{word}\" is missing in: {said}");
    }
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_it_at_once_and_nothing_is_written() {
    let _turn = turn(module_path!());
    let dir = folder();
    let arguments = "close --base fuzzy-tanh --estimate a.csv --confirm b.csv --out new.toml --json r.json";
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    command.args(arguments.split(' ')).args(["--restarts", "100000"]).current_dir(dir.path());
    let mut child = command.stderr(Stdio::piped()).spawn().expect("it runs");
    // Without a terminal the stages are logged. The first two lines are the warning about missing test runs, and the base.
    let mut log = std::io::BufReader::new(child.stderr.take().expect("a pipe"));
    let mut said = String::new();
    while !said.contains("identifying the base") {
        assert!(std::io::BufRead::read_line(&mut log, &mut said).expect("a pipe") > 0, "{said}");
    }
    assert!(said.contains("no test runs") && said.contains("--test"), "{said}");
    // Interrupts the identification itself, which takes minutes and reports nothing before its end.
    std::thread::sleep(Duration::from_millis(300));
    let killed = Instant::now();
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().expect("kill").success());
    let status = child.wait().expect("it ends");
    // Takes a second on an idle machine; the limit allows for a busy one.
    assert!(killed.elapsed() < Duration::from_secs(5), "{:?}", killed.elapsed());
    assert_eq!(status.code(), Some(1));
    assert!(!dir.path().join("new.toml").exists() && !dir.path().join("r.json").exists());
}
