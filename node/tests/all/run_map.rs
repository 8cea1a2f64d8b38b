//! Commands on a bag whose topics have their own names, with a map in flags or in a file.

use crate::run_support::*;
use mr_damper_runs::BagOptions;
use std::path::Path;
use std::process::{Command, Output};

fn mr_damper(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_mr-damper")).args(arguments).output().expect("it runs")
}

fn failed(arguments: &[&str]) -> (i32, String) {
    let output = mr_damper(arguments);
    (output.status.code().expect("ended by itself"), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn commands_read_foreign_bags_by_flags_and_by_a_file() {
    let dir = temporary();
    let path = |name: &str| dir.path().join(name).to_str().expect("text").to_owned();
    foreign(Path::new(&path("bag")), BagOptions::default());
    ours_csv(Path::new(&path("ours.csv")));
    let mut file = "[machine.ranges]\ncoil_lag = \"0:0.1\"\n[map]\n".to_owned();
    for mapping in OF_BAG {
        let (channel, source) = mapping.split_once('=').expect("one");
        file += &format!("{channel} = \"{source}\"\n");
    }
    std::fs::write(path("map.toml"), file).expect("written");
    let flags: Vec<&str> = OF_BAG.iter().flat_map(|mapping| ["--map", mapping]).collect();
    let evaluated = |run: &str, more: &[&str]| {
        let run = path(run);
        let arguments = [&["--quiet", "evaluate", "thesis/fuzzy-tanh/rp3-cs", &run, "--json"], more].concat();
        let output = mr_damper(&arguments);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let mut json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
        json["runs"][0].as_object_mut().expect("a run").remove("run");
        json
    };
    let ours = evaluated("ours.csv", &["-"]);
    assert_eq!(evaluated("bag", &[&["-"], &flags[..]].concat()), ours);
    assert_eq!(evaluated("bag", &["-", "--map-file", &path("map.toml")]), ours);
    // A flag takes precedence over the file.
    let turned = ["-", "--map-file", &path("map.toml"), "--map", "displacement=/fl/susp/pos,unit=mm,sign=-1"];
    assert_ne!(evaluated("bag", &turned), ours);

    let convert =
        |arguments: &[&str]| failed(&[&["convert", &path("bag"), &path("out.csv")], arguments].concat());
    for (arguments, code, says) in [
        (&["--map", "displacment=/x"][..], 2, "`displacment` is not a channel; did you mean displacement?"),
        (&["--map", "displacement=/fl/ray,unit=deg"], 2, "unit `deg` does not fit displacement"),
        (&["--map", "displacement=/fl/ray", "--map", "displacement_m=/x"], 2, "displacement is mapped twice"),
        (&["--map-file", "/nowhere.toml"], 1, "/nowhere.toml: No such file"),
        (&["--map", "displacement=/nowhere"], 1, "topic /nowhere is not in the bag"),
        (&["--ros-args", "-r", "displacement:=/fl/ray"], 2, "--map displacement=/fl/ray reads the channel"),
    ] {
        let (found, text) = convert(arguments);
        assert!(found == code && text.contains(says), "{arguments:?}: {found} {text}");
    }
    assert!(!Path::new(&path("out.csv")).exists());
    // Commands with a node refuse a rule that renames nothing, before they create or play anything.
    for command in [&["replay", &path("bag")][..], &["record", "--out", &path("recorded")]] {
        let (code, text) = failed(&[command, &["--ros-args", "-r", "displacment:=/x"]].concat());
        assert!(code == 2 && text.contains("-r displacment:=/x renames nothing"), "{code} {text}");
    }
    assert!(!Path::new(&path("recorded")).exists());
}
