//! Work on recorded runs without ROS: other people's headers, signs, sampling, cycles, folds of one level each.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

fn run(dir: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    command.env_remove("RUST_LOG").current_dir(dir).args(arguments).output().expect("it runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// The output of a command that must succeed.
fn done(dir: &Path, arguments: &[&str]) -> String {
    let output = run(dir, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// The message of a command that must fail.
fn refused(dir: &Path, arguments: &[&str]) -> String {
    let output = run(dir, arguments);
    assert!(!output.status.success(), "{arguments:?}: {}", text(&output.stdout));
    text(&output.stderr)
}

fn temporary() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary directory")
}

/// Writes `samples` of (time, displacement, force, current) to a CSV file with `header`.
fn write(path: &Path, header: &str, samples: impl Iterator<Item = [f64; 4]>) {
    let mut text = format!("{header}\n");
    for [t, x, f, i] in samples {
        text += &format!("{t:.9},{x:.9},{f:.6},{i:.6}\n");
    }
    fs::write(path, text).expect("written");
}

/// A damper F = 400 tanh(20 v) + 800 v + 300 i tanh(20 v) on a sine of 1.5 Hz and 10 mm, at `times`, with the current `i`.
fn samples(times: impl Iterator<Item = f64>, i: impl Fn(f64) -> f64) -> impl Iterator<Item = [f64; 4]> {
    let rate = std::f64::consts::TAU * 1.5;
    times.map(move |t| {
        let (x, v) = (0.01 * (rate * t).sin(), 0.01 * rate * (rate * t).cos());
        [t, x, (400.0 + 300.0 * i(t)) * (20.0 * v).tanh() + 800.0 * v, i(t)]
    })
}

fn even(count: usize, rate_hz: f64) -> impl Iterator<Item = f64> {
    (0..count).map(move |k| k as f64 / rate_hz)
}

const HEADER: &str = "time_s,displacement_m,force_n,current_a";

#[test]
fn other_headers_and_signs_give_the_same_numbers() {
    let dir = temporary();
    let varied = |t: f64| 1.0 + (3.0 * t).sin();
    write(&dir.path().join("own.csv"), HEADER, samples(even(2000, 500.0), varied));
    // Milliseconds, millimetres with the opposite sign, kilonewtons with the opposite sign, amperes.
    let others = samples(even(2000, 500.0), varied).map(|[t, x, f, i]| [1e3 * t, -1e3 * x, -1e-3 * f, i]);
    write(&dir.path().join("others.csv"), "t,x,F,I", others);
    let names = "time_ms=t,displacement_mm=x,force_kn=F,current_a=I";
    let preset = "thesis/fuzzy-tanh/rp3-cs";
    let expected = done(dir.path(), &["evaluate", preset, "own.csv", "--quiet"]);
    let found = done(
        dir.path(),
        &[
            "evaluate",
            preset,
            "others.csv",
            "--quiet",
            "--column",
            names,
            "--sign",
            "displacement=-1,force=-1",
        ],
    );
    // The name of the run differs. Kilonewtons are written with six decimals, so the last digit may too.
    let figure = |table: &str| -> f64 {
        let line = table.lines().find(|line| line.contains("simulation (free run)")).expect("a line");
        line.split_whitespace().nth(4).and_then(|word| word.parse().ok()).expect(line)
    };
    assert!((figure(&expected) - figure(&found)).abs() < 0.02, "{expected}{found}");

    let said = refused(dir.path(), &["evaluate", preset, "others.csv", "--quiet"]);
    for name in
        ["time_s", "displacement_in", "force_lbf", "current_ma", "command_v", "case_temp_f", "--column"]
    {
        assert!(said.contains(name), "{name}: {said}");
    }
    let said = refused(dir.path(), &["evaluate", preset, "others.csv", "--column", "stroke_mm=x"]);
    assert!(said.contains("not a name of the run format") && said.contains("force_request_n"), "{said}");
    let said = refused(dir.path(), &["evaluate", preset, "own.csv", "--sign", "velocity=-1"]);
    assert!(said.contains("own.csv: has no velocity"), "{said}");
    let twice = ["--map", "displacement=displacement_m,sign=-1", "--sign", "displacement=-1"];
    let said = refused(dir.path(), &[&["evaluate", preset, "own.csv"][..], &twice].concat());
    assert!(said.contains("both give displacement a sign"), "{said}");
}

#[test]
fn uneven_runs_are_refused_where_the_rate_matters_and_can_be_resampled() {
    let dir = temporary();
    let varied = |t: f64| 1.0 + (3.0 * t).sin();
    // 500 Hz for 6 s, then 200 Hz.
    let times = || even(3000, 500.0).chain(even(1200, 200.0).map(|t| 6.0 + t));
    write(&dir.path().join("uneven.csv"), HEADER, samples(times(), varied));
    let identify = |model: &str, run: &str| {
        let out = format!("{model}.toml");
        let arguments = ["identify", "--quiet", "--model", model, run, "--restarts", "2", "--out"];
        self::run(dir.path(), &[&arguments[..], &[&out]].concat())
    };
    let output = identify("arx", "uneven.csv");
    let said = text(&output.stderr);
    assert!(!output.status.success() && said.contains("mr-damper convert RUN OUT --resample"), "{said}");
    assert!(said.contains("uneven.csv") && said.contains("arx needs samples at an even rate"), "{said}");
    assert!(identify("kwok", "uneven.csv").status.success(), "a law takes the times as they are");
    done(dir.path(), &["convert", "--quiet", "uneven.csv", "even.csv", "--resample", "500"]);
    let output = identify("arx", "even.csv");
    assert!(output.status.success(), "{}", text(&output.stderr));
    let said = refused(dir.path(), &["convert", "uneven.csv", "none.csv", "--resample", "0"]);
    assert!(said.contains("above 0 and at most"), "{said}");
}

#[test]
fn cycles_are_cut_at_the_same_phase() {
    let dir = temporary();
    write(&dir.path().join("sine.csv"), HEADER, samples(even(5000, 500.0), |_| 1.0));
    let cut = |name: &str, more: &[&str]| -> Vec<(f64, f64)> {
        done(dir.path(), &[&["convert", "--quiet", "sine.csv", name][..], more].concat());
        let text = fs::read_to_string(dir.path().join(name)).expect("a run");
        let number = |cell: Option<&str>| cell.and_then(|cell| cell.parse::<f64>().ok()).expect("a number");
        text.lines()
            .skip(1)
            .map(|line| {
                let mut cells = line.split(',');
                (number(cells.next()), number(cells.next()))
            })
            .collect()
    };
    // The sine rises through zero at k/1.5 s; the first start needs a sample below before it, so it is that at 0.667 s.
    let part = cut("part.csv", &["--cycles", "2:4"]);
    let (first, last) = (part[0], part[part.len() - 1]);
    assert!((first.0 - 2.0 / 1.5).abs() < 0.002 && (last.0 - 5.0 / 1.5).abs() < 0.003, "{first:?} {last:?}");
    assert!(first.1.abs() < 2e-4 && last.1 <= 0.0, "{first:?} {last:?}");
    // From 1 s for 3.5 s: starts at 1.333, 2, ..., 4 s.
    let whole = cut("whole.csv", &["--start", "1", "--duration", "3.5", "--whole-cycles"]);
    let (first, last) = (whole[0].0, whole[whole.len() - 1].0);
    assert!((first - 2.0 / 1.5).abs() < 0.002 && (last - 4.0).abs() < 0.003, "{first} {last}");
    let said = refused(dir.path(), &["convert", "sine.csv", "x.csv", "--cycles", "3:40"]);
    assert!(said.contains("cycles 3:40") && said.contains("13 whole cycles"), "{said}");
    let said = refused(dir.path(), &["convert", "sine.csv", "x.csv", "--cycles", "0:4"]);
    assert!(said.contains("counted from 1"), "{said}");
}

#[test]
fn runs_of_one_level_each_are_held_out_by_level() {
    let dir = temporary();
    fs::create_dir(dir.path().join("runs")).expect("a directory");
    for (name, level) in [("a", 0.0), ("b", 0.7), ("c", 1.4), ("d", 2.1)] {
        let path = dir.path().join("runs").join(format!("{name}.csv"));
        write(&path, HEADER, samples(even(2500, 500.0), |_| level));
    }
    let compare = |more: &[&str]| {
        let fixed = ["compare", "runs", "--models", "kwok,arx", "--restarts", "2", "--json", "c.json"];
        let output = run(dir.path(), &[&fixed[..], more].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        let json = fs::read_to_string(dir.path().join("c.json")).expect("figures");
        (
            text(&output.stdout),
            text(&output.stderr),
            serde_json::from_str::<serde_json::Value>(&json).expect("JSON"),
        )
    };
    let (table, log, json) = compare(&[]);
    assert!(
        table.starts_with("Each run holds one level of the drive (0.00, 0.70, 1.40, 2.10 A)."),
        "{table}"
    );
    assert!(table.contains("its 95 % interval") && table.contains("all folds"), "{table}");
    // The log says it before the work, and shows progress although stderr is no terminal.
    assert!(log.contains("Each run holds one level") && log.contains("comparing: "), "{log}");
    let rows = |key: &str| json[key].as_array().unwrap_or_else(|| panic!("{key}")).clone();
    let of_kwok: Vec<_> = rows("cross_validation")
        .into_iter()
        .filter(|row| row["model"] == "kwok" && row["form"] == "semi_active")
        .collect();
    // Each run is tested once, by the model that did not see its level.
    let pairs: Vec<(String, String)> = of_kwok
        .iter()
        .map(|row| {
            (
                row["trained_on"].as_str().unwrap_or_default().to_owned(),
                row["tested_on"].as_str().unwrap_or_default().to_owned(),
            )
        })
        .collect();
    let expected = [("0.00", "a"), ("0.70", "b"), ("1.40", "c"), ("2.10", "d")]
        .map(|(level, run)| (format!("without {level} A"), run.to_owned()));
    assert_eq!(pairs, expected);
    let ranked = rows("ranking");
    let kwok =
        ranked.iter().find(|row| row["model"] == "kwok" && row["form"] == "semi_active").expect("a row");
    assert_eq!((kwok["tests"].as_u64(), kwok["trained_on"].as_str()), (Some(4), Some("all folds")));
    let mean = of_kwok.iter().map(|row| row["rsse_n"].as_f64().expect("a figure")).sum::<f64>() / 4.0;
    assert!((kwok["mean_rsse_n"].as_f64().expect("a mean") - mean).abs() < 1e-9);
    let interval: Vec<f64> = kwok["rsse_interval_n"]
        .as_array()
        .expect("an interval")
        .iter()
        .filter_map(|end| end.as_f64())
        .collect();
    assert!(interval[0] < mean && mean < interval[1], "{interval:?}");
    // The force is linear in the current, and the model has polynomials: levels within the others are predicted well.
    let inner = of_kwok[1]["rsse_n"].as_f64().expect("a figure");
    assert!(inner < 60.0, "{inner} N");

    let (table, _, json) = compare(&["--folds", "experiments"]);
    assert!(!table.contains("Each run holds one level") && json.get("design").is_none(), "{table}");
    assert!(json["cross_validation"].as_array().expect("rows").iter().any(|row| row["trained_on"] == "a"));
}
