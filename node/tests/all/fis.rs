//! `fis` on the command line: FIS files become model files that run, and the other way round.

use mr_damper_model::force::ForceModel;
use mr_damper_model::model_file::ModelFile;
use mr_damper_model::preset;
use std::path::Path;
use std::process::{Command, Output};

/// Takes velocity (m/s) and current (A), and returns N.
const OWN: &str = "\
[System]
Name='own'
Type='sugeno'
NumInputs=2
NumOutputs=1
NumRules=4
AndMethod='prod'
DefuzzMethod='wtaver'

[Input1]
Name='velocity (m/s)'
Range=[-0.2 0.2]
NumMFs=2
MF1='in1mf1':'gaussmf',[0.1 -0.2]
MF2='in1mf2':'gaussmf',[0.1 0.2]

[Input2]
Name='Current'
Range=[0 2]
NumMFs=2
MF1='in2mf1':'trimf',[-2 0 2]
MF2='in2mf2':'trimf',[0 2 4]

[Output1]
Name='force'
Range=[-900 900]
NumMFs=4
MF1='out1mf1':'constant',[-100]
MF2='out1mf2':'constant',[-800]
MF3='out1mf3':'constant',[100]
MF4='out1mf4':'constant',[800]

[Rules]
1 1, 1 (1) : 1
1 2, 2 (1) : 1
2 1, 3 (1) : 1
2 2, 4 (1) : 1
";

fn mr_damper(dir: &Path, arguments: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    command.args(arguments.split(' ')).current_dir(dir).env_remove("RUST_LOG").output().expect("it runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs the command, which must succeed.
fn done(dir: &Path, arguments: &str) -> Output {
    let output = mr_damper(dir, arguments);
    assert!(output.status.success(), "{arguments}: {}", text(&output.stderr));
    output
}

fn read(path: &Path) -> ModelFile {
    ModelFile::from_toml(&std::fs::read_to_string(path).expect("it was written")).expect("a model file")
}

/// A folder with own.fis and a run.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a temporary directory");
    std::fs::write(dir.path().join("own.fis"), OWN).expect("written");
    let rows: String = (0..200)
        .map(|k| {
            let t = f64::from(k) / 100.0;
            format!("{t},{},{},{}\n", 0.01 * (6.0 * t).sin(), 400.0 * (6.0 * t).cos(), 1.0 + 0.5 * t.sin())
        })
        .collect();
    std::fs::write(dir.path().join("run.csv"), format!("time_s,displacement_m,force_n,current_a\n{rows}"))
        .expect("written");
    dir
}

#[test]
fn a_preset_is_the_same_model_after_its_way_through_a_fis_file() {
    let dir = folder();
    let name = "thesis/anfis/rp1-cs";
    done(dir.path(), &format!("fis {name} --out fis"));
    let said = text(&done(dir.path(), &format!("fis fis/rp1-cs.fis --like {name} --out models")).stderr);
    assert!(said.contains("fis/rp1-cs.fis: written to models/rp1-cs.toml"), "{said}");
    let (back, original) =
        (read(&dir.path().join("models/rp1-cs.toml")), preset::load(name).expect("a preset"));
    assert_eq!(back.model.force, original.force);
    assert_eq!(back.model.conditioning, original.conditioning);
    assert_eq!(back.model.rate_hz, original.rate_hz);
    assert!(back.provenance.tool.contains("fis/rp1-cs.fis"), "{}", back.provenance.tool);
    let figures = |model: &str| {
        let output = done(dir.path(), &format!("evaluate {model} run.csv"));
        text(&output.stdout).split_once('\n').expect("a table below the name").1.to_owned()
    };
    assert_eq!(figures("models/rp1-cs.toml"), figures(name));
}

#[test]
fn a_fis_file_of_si_values_becomes_a_model_that_evaluate_runs() {
    let dir = folder();
    done(dir.path(), "fis own.fis --rate 100 --out models");
    let model = read(&dir.path().join("models/own.toml")).model;
    assert_eq!(model.rate_hz, 100.0);
    assert_eq!(model.envelope.velocity_m_s, Some([-0.2, 0.2]));
    assert_eq!(model.envelope.drive, Some([0.0, 2.0]));
    assert_eq!(model.envelope.force_n, Some([-900.0, 900.0]));
    let ForceModel::Tsk(rules) = model.force else { panic!("{} has no rules", model.force.name()) };
    assert_eq!(rules.rules(), 4);
    let said = text(&done(dir.path(), "evaluate models/own.toml run.csv").stdout);
    assert!(said.contains("simulation (free run)"), "{said}");
    // The way back: the file has the same system.
    done(dir.path(), "fis models/own.toml --out back");
    done(dir.path(), "fis back/own.fis --rate 100 --out again");
    assert_eq!(read(&dir.path().join("again/own.toml")).model, model);
}

#[test]
fn what_cannot_be_converted_is_refused_and_nothing_is_written() {
    let dir = folder();
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).expect("written");
    write("mamdani.fis", &OWN.replace("'sugeno'", "'mamdani'"));
    write("names.fis", &OWN.replace("'Current'", "'x'"));
    let refused = |arguments: &str, code: i32, words: &[&str]| {
        let output = mr_damper(dir.path(), &format!("fis {arguments} --out refused"));
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{arguments}: {said}");
        for word in words {
            assert!(said.contains(word), "{arguments}: \"{word}\" is missing in: {said}");
        }
        assert!(!dir.path().join("refused").exists(), "{arguments} wrote something");
    };
    refused("own.fis mamdani.fis --rate 100", 1, &["mamdani.fis: line 3", "'mamdani'", "'sugeno'"]);
    refused("names.fis --rate 100", 1, &["names.fis: [Input2]", "\"x\"", "current or voltage", "--like"]);
    refused("none.fis --rate 100", 1, &["none.fis"]);
    refused("own.fis", 2, &["own.fis", "--rate HZ", "--like MODEL"]);
    refused("own.fis --rate 0", 2, &["--rate", "positive number of hertz"]);
    refused("own.fis --rate 100 --like thesis/anfis/rp1-cs", 2, &["--rate", "--like"]);
    refused("own.fis --like thesis/anfis/rp1-cs", 1, &["own.fis", "2 inputs", "thesis/anfis/rp1-cs has 3"]);
    done(dir.path(), "fis thesis/anfis/rp1-cs --out fis");
    let preset = std::fs::read_to_string(dir.path().join("fis/rp1-cs.fis")).expect("it was written");
    write("swapped.fis", &preset.replace("Name='displacement'", "Name='velocity'"));
    refused("swapped.fis --like thesis/anfis/rp1-cs", 1, &["[Input1]", "\"velocity\"", "displacement"]);
    refused("own.fis --like thesis/sp-passive/rp-icps", 1, &["model sp", "no fuzzy rules"]);
    refused("thesis/fuzzy-tanh/rp3-cs", 1, &["thesis/fuzzy-tanh/rp3-cs", "model fuzzy-tanh", "anfis"]);
    refused("own.fis ./own.fis --rate 100", 1, &["refused/own.toml", "./own.fis would replace this file"]);
    done(dir.path(), "fis own.fis --rate 100 --out models");
    let output = mr_damper(dir.path(), "fis own.fis --rate 100 --out models");
    let said = text(&output.stderr);
    assert!(output.status.code() == Some(1) && said.contains("would replace"), "{said}");
}
