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

#[test]
fn one_model_is_converted_in_either_direction() {
    let dir = folder();
    let name = "thesis/anfis/rp1-cs";
    done(dir.path(), &format!("convert {name} rp1.fis"));
    let said = text(&done(dir.path(), &format!("convert rp1.fis rp1.toml --like {name}")).stderr);
    assert!(said.contains("rp1.fis: written to rp1.toml"), "{said}");
    assert_eq!(read(&dir.path().join("rp1.toml")).model.force, preset::load(name).expect("a preset").force);
    // The same file as `fis` writes.
    done(dir.path(), &format!("fis {name} --out fis"));
    let [one, many] = ["rp1.fis", "fis/rp1-cs.fis"]
        .map(|file| std::fs::read_to_string(dir.path().join(file)).expect("it was written"));
    assert_eq!(one, many);
    done(dir.path(), "convert own.fis own.toml --rate 100");
    done(dir.path(), "convert own.toml again.FIS");
    done(dir.path(), "convert again.FIS again.toml --rate 100");
    assert_eq!(read(&dir.path().join("again.toml")).model, read(&dir.path().join("own.toml")).model);
}

#[test]
fn convert_refuses_what_does_not_apply_and_writes_nothing() {
    let dir = folder();
    done(dir.path(), "convert own.fis own.toml --rate 100");
    let refused = |arguments: &str, code: i32, words: &[&str]| {
        let output = mr_damper(dir.path(), &format!("convert {arguments}"));
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{arguments}: {said}");
        for word in words {
            assert!(said.contains(word), "{arguments}: \"{word}\" is missing in: {said}");
        }
        assert!(!["new.toml", "new.fis", "new.csv"].iter().any(|file| dir.path().join(file).exists()));
    };
    refused("own.fis new.toml", 2, &["own.fis", "--rate HZ", "--like MODEL"]);
    refused("own.fis new.csv --rate 100", 2, &["own.fis", "ends in .toml", "new.csv"]);
    refused("own.fis new.fis --rate 100", 2, &["own.fis", "ends in .toml"]);
    refused("own.fis own.toml --rate 100", 1, &["own.toml", "exists"]);
    refused("own.fis new.toml --rate 100 --start 3", 2, &["--start is for runs", "own.fis to new.toml"]);
    refused("own.fis new.toml --rate 100 --storage mcap", 2, &["--storage is for runs"]);
    refused("own.fis new.toml --rate 100 --thesis-txt", 2, &["--thesis-txt is for runs"]);
    refused("own.toml new.fis --rate 100", 2, &["--rate is for a FIS file as IN"]);
    refused("run.csv new.csv --like own.toml", 2, &["--like is for a FIS file as IN"]);
    refused("thesis/fuzzy-tanh/rp3-cs new.fis", 1, &["model fuzzy-tanh", "no fuzzy rules"]);
}

#[test]
fn a_surface_that_a_file_cannot_hold_is_refused() {
    let dir = folder();
    // A gap between two triangles: the model takes the nearer one there, and no rule of the file would fire.
    let wide =
        OWN.replace("'trimf',[-2 0 2]", "'trimf',[-2 0 1]").replace("'trimf',[0 2 4]", "'trimf',[1 2 4]");
    std::fs::write(dir.path().join("wide.fis"), wide).expect("written");
    done(dir.path(), "convert wide.fis wide.toml --rate 100");
    let model = std::fs::read_to_string(dir.path().join("wide.toml")).expect("it was written");
    let gap = model.replace("drive_right_feet = [1.0, 4.0]", "drive_right_feet = [0.5, 4.0]");
    assert_ne!(gap, model, "{model}");
    std::fs::write(dir.path().join("gap.toml"), gap).expect("written");
    let output = mr_damper(dir.path(), "convert gap.toml gap.fis");
    let said = text(&output.stderr);
    assert!(output.status.code() == Some(1) && !dir.path().join("gap.fis").exists(), "{said}");
    for words in ["cannot hold the surface of gap.toml", "no membership is above zero between 0.5 and 1"] {
        assert!(said.contains(words), "{said}");
    }
}

#[test]
fn identify_writes_the_rules_beside_the_model_file() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    done(dir.path(), "simulate --experiment RP-ICPS --duration 6 --out .");
    let run = "rp-icps-01.csv";
    // tsk-324 has bells, tsk-555 has triangles.
    for (model, function) in [("tsk-324", "gbellmf"), ("tsk-555", "trimf")] {
        done(dir.path(), &format!("identify --model {model} {run} --out {model}.toml --fis {model}.fis"));
        let fis = std::fs::read_to_string(dir.path().join(format!("{model}.fis"))).expect("it was written");
        assert!(fis.contains(&format!("'{function}',")), "{fis}");
        done(dir.path(), &format!("convert {model}.fis {model}-back.toml --like {model}.toml"));
        let [back, original] = ["-back.toml", ".toml"].map(|end| {
            let ForceModel::Tsk(rules) = read(&dir.path().join(format!("{model}{end}"))).model.force else {
                panic!("{model}{end}")
            };
            rules
        });
        assert_eq!(
            (back.inputs(), back.conclusions()),
            (original.inputs(), original.conclusions()),
            "{model}"
        );
    }
    for (arguments, code, words) in [
        ("--model arx --fis arx.fis", 1, "--fis: a model arx has no fuzzy rules"),
        ("--model anfis --fis rules.txt", 2, "--fis rules.txt: give a name that ends in .fis"),
    ] {
        let output = mr_damper(dir.path(), &format!("identify {run} --out none.toml {arguments}"));
        let said = text(&output.stderr);
        assert!(output.status.code() == Some(code) && said.contains(words), "{said}");
        assert!(!dir.path().join("none.toml").exists());
    }
}
