//! The command line without a running node: overview, hints, exit codes, completions, man pages, coefficients.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// The program without the variables that cargo sets for it.
fn program(dir: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    for name in ["CARGO_PKG_NAME", "ROS_DOMAIN_ID", "RUST_LOG"] {
        command.env_remove(name);
    }
    command.current_dir(dir);
    command
}

fn run(dir: &Path, arguments: &[&str]) -> Output {
    program(dir).args(arguments).output().expect("it runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn temporary() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary directory")
}

/// Writes runs of the rig with a current that varies.
fn runs(dir: &Path, count: &str, seconds: &str) {
    let arguments = [
        "simulate",
        "--quiet",
        "--experiment",
        "RP-ICPS",
        "--replicates",
        count,
        "--duration",
        seconds,
        "--out",
        ".",
    ];
    let output = run(dir, &arguments);
    assert!(output.status.success(), "{}", text(&output.stderr));
}

#[test]
fn without_a_command_the_commands_are_shown_and_under_cargo_the_demo_runs() {
    let dir = temporary();
    let output = run(dir.path(), &[]);
    let shown = text(&output.stdout);
    assert!(output.status.success() && output.stderr.is_empty(), "{}", text(&output.stderr));
    assert!(shown.contains("\n  mr-damper demo\n") && shown.contains("\n  identify "), "{shown}");

    let output = run(dir.path(), &["--ros-args", "-p", "coast_s:=1"]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));

    // `cargo run` names the package. The demo says what it does before it starts; it is ended then.
    let mut demo = program(dir.path());
    demo.env("CARGO_PKG_NAME", env!("CARGO_PKG_NAME")).env("TMPDIR", dir.path());
    let mut demo = demo.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("it runs");
    let mut first = String::new();
    BufReader::new(demo.stdout.take().expect("a pipe")).read_line(&mut first).expect("a line");
    demo.kill().expect("it runs still");
    demo.wait().expect("it ends");
    assert!(!first.contains("mr-damper estimates") && !first.trim().is_empty(), "{first:?}");
}

#[test]
fn wrong_parameters_have_exit_code_2_wherever_they_come_from() {
    let dir = temporary();
    let file = |name: &str, content: &str| fs::write(dir.path().join(name), content).expect("written");
    file("range.toml", "coast_s = -1\n");
    file("name.toml", "coast = 1\n");
    file("broken.toml", "coast_s = \n");
    file("range.yaml", "mr_damper:\n  ros__parameters:\n    coast_s: -1.0\n");
    file("form.yaml", "mr_damper:\n  coast_s: 1.0\n");
    let model = "model:=thesis/fuzzy-tanh/rp3-cs";
    let ros = |more: &[&'static str]| [&["node", "--ros-args", "-p", model][..], more].concat();
    for (arguments, says) in [
        (vec!["node", "--coast-s", "-1"], "coast_s is -1"),
        (vec!["node", "--ros-args", "-p", "coast_s:=-1"], "coast_s is -1"),
        (vec!["node", "--ros-args", "-p", "coast:=1"], "did you mean coast_s?"),
        (vec!["node", "--config", "range.toml"], "range.toml: parameter coast_s is -1"),
        (vec!["node", "--config", "name.toml"], "did you mean coast_s?"),
        (vec!["node", "--config", "broken.toml"], "broken.toml"),
        (
            vec!["node", "--ros-args", "--params-file", "range.yaml"],
            "range.yaml: mr_damper: parameter coast_s is -1",
        ),
        (vec!["node", "--ros-args", "--params-file", "form.yaml"], "no ros__parameters"),
        (vec!["doctor", "--config", "range.toml"], "coast_s is -1"),
        // Values that do not fit each other or the models.
        (ros(&["-p", "law:=skyhook", "-p", "skyhook.gains_n_s_m:=[1.0, 2.0]"]), "skyhook.centres_a"),
        (ros(&["-p", "current.safe_a:=5.0"]), "current.safe_a is 5"),
        (ros(&["-p", "arx_model:=thesis/fuzzy-tanh/rp3-cs"]), "cannot be seeded"),
        (ros(&["-p", "zenoh.listen:=['tcp/0.0.0.0:7447']"]), "not on loopback"),
        (ros(&["-p", "zenoh.commands:=['x']"]), "Zenoh has no endpoint"),
    ] {
        let output = run(dir.path(), &arguments);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains(says), "{arguments:?}: {said}");
    }
    // A file that does not exist is no wrong parameter: it may exist later.
    for arguments in
        [vec!["node", "--config", "absent.toml"], vec!["node", "--ros-args", "-p", "model:=absent.toml"]]
    {
        let output = run(dir.path(), &arguments);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {}", text(&output.stderr));
    }
}

#[test]
fn a_suggestion_is_near_and_ros_arguments_get_their_marker() {
    let dir = temporary();
    let said = |arguments: &[&str]| text(&run(dir.path(), arguments).stderr);
    let far = said(&["node", "--ros-args", "-p", "foo:=1"]);
    assert!(!far.contains("did you mean") && far.contains("mr-damper node --help"), "{far}");
    let far = said(&["evaluate", "thesis/foo", "a.csv"]);
    assert!(!far.contains("nearest") && far.contains("mr-damper presets"), "{far}");
    let near = said(&["evaluate", "thesis/fuzzy-tanh/rp3", "a.csv"]);
    assert!(near.contains("the nearest is \"thesis/fuzzy-tanh/rp3-cs\""), "{near}");
    let far = said(&["simulate", "--experiment", "zzzzzzzz", "--out", "x"]);
    assert!(!far.contains("the nearest") && far.contains("simulate --list"), "{far}");
    let far = said(&["evaluate", "m", "a.csv", "--map", "qqq=x"]);
    assert!(!far.contains("did you mean") && far.contains("Channels are displacement"), "{far}");
    let hint = said(&["node", "-p", "model:=x"]);
    assert!(hint.contains("mr-damper node --ros-args -p model:=x"), "{hint}");
}

#[test]
fn bash_accepts_the_completions_and_each_command_has_a_man_page() {
    let dir = temporary();
    let completions = run(dir.path(), &["completions", "bash"]);
    assert!(completions.status.success());
    fs::write(dir.path().join("mr-damper.bash"), &completions.stdout).expect("written");
    // The function fills in the commands that begin with `iden`.
    let script = "source ./mr-damper.bash; COMP_WORDS=(mr-damper iden); COMP_CWORD=1; _mr__damper mr-damper iden mr-damper; \
                  echo \"${COMPREPLY[@]}\"";
    let output =
        Command::new("bash").args(["-c", script]).current_dir(dir.path()).output().expect("bash runs");
    assert_eq!(text(&output.stdout).trim(), "identify", "{}", text(&output.stderr));

    let output = run(dir.path(), &["man", "pages"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains(" man pages in pages"), "{}", text(&output.stderr));
    for page in ["mr-damper.1", "mr-damper-node.1", "mr-damper-coefficients.1"] {
        assert!(dir.path().join("pages").join(page).exists(), "{page}");
    }
}

#[test]
fn forces_are_in_newtons_or_in_pounds() {
    let dir = temporary();
    runs(dir.path(), "1", "4");
    let table = |command: &[&str], more: &[&str]| {
        let output = run(dir.path(), &[command, &["rp-icps-01.csv", "--quiet"], more].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stdout)
    };
    let rmse = |table: &str, unit: &str| -> f64 {
        let line = table.lines().find(|line| line.contains("simulation")).expect("a line");
        let words: Vec<&str> = line.split_whitespace().collect();
        let at = words.iter().position(|word| *word == unit).unwrap_or_else(|| panic!("no {unit} in {line}"));
        words[at - 1].parse().expect(line)
    };
    let identify = ["identify", "--model", "savaresi", "--out", "model.toml"];
    for command in [&["evaluate", "thesis/fuzzy-tanh/rp3-cs"][..], &identify] {
        let (newtons, pounds) = (table(command, &[]), table(command, &["--units", "lbf"]));
        assert!(!newtons.contains("lbf") && !pounds.contains(" N "), "{newtons}{pounds}");
        assert!((rmse(&newtons, "N") / rmse(&pounds, "lbf") - 4.448_221_6).abs() < 0.01);
    }
}

#[test]
fn the_table_of_an_identification_has_the_errors_of_the_fit_and_of_the_bootstrap() {
    let dir = temporary();
    runs(dir.path(), "3", "6");
    let all = ["rp-icps-01.csv", "rp-icps-02.csv", "rp-icps-03.csv"];
    let identify = |runs: &[&str], more: &[&str]| {
        let fixed = [
            "identify",
            "--quiet",
            "--model",
            "kwok",
            "--passive",
            "--restarts",
            "2",
            "--velocity",
            "backward",
        ];
        run(dir.path(), &[&fixed[..], runs, &["--out", "m.toml", "--json", "m.json"], more].concat())
    };
    let output = identify(&all, &["--coefficients", "m.csv", "--bootstrap", "12"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let table = fs::read_to_string(dir.path().join("m.csv")).expect("a table");
    assert!(
        table.contains("# standard error: of this one fit")
            && table.contains("# bootstrap: 12 fits to 3 runs"),
        "{table}"
    );
    let json = fs::read_to_string(dir.path().join("m.json")).expect("figures");
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    let rows: Vec<Vec<&str>> =
        table.lines().filter(|line| !line.starts_with('#')).map(|line| line.split(',').collect()).collect();
    let number = |cell: &str| cell.parse::<f64>().expect("a number");
    assert_eq!(rows[0][..5], ["name", "symbol", "value", "unit", "standard_error"]);
    for estimate in json["estimates"].as_array().expect("a list") {
        let name = estimate["parameter"].as_str().expect("a name").trim_end_matches("[0]");
        let row = rows.iter().find(|row| row[0] == name).unwrap_or_else(|| panic!("{name}: {table}"));
        assert_eq!(Some(number(row[2])), estimate["value"].as_f64(), "{name}");
        assert_eq!(Some(number(row[4])), estimate["standard_error"].as_f64(), "{name}");
        let [error, low, high] = [5, 6, 7].map(|column| number(row[column]));
        assert!(error > 0.0 && low < high, "{row:?}");
    }
    assert_eq!(rows.iter().find(|row| row[0] == "hysteresis_force_n").expect("a row")[1], "alpha");

    let output = identify(&all[..2], &["--coefficients", "m.csv", "--bootstrap", "12"]);
    let said = text(&output.stderr);
    assert!(
        output.status.code() == Some(2) && said.contains("needs at least 3 of them, but 2 are given"),
        "{said}"
    );
    let output = identify(&all, &["--coefficients", "m.txt"]);
    assert!(text(&output.stderr).contains(".csv, .md or .tex"), "{}", text(&output.stderr));
    // The table of a model file has no errors.
    let output = run(dir.path(), &["coefficients", "m.toml", "--format", "markdown"]);
    let shown = text(&output.stdout);
    assert!(
        shown.starts_with("| name | symbol | value | unit |\n") && shown.contains("$\\alpha$"),
        "{shown}"
    );
}
