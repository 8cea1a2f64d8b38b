//! Conventions of ROS 2 and of the command line: domains, environment variables, shared parameter files, and untrusted text on a terminal.

use crate::domain::Domain;
use crate::turn::turn;
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// Runs the command in `dir` with `variables` as its only ROS environment variables.
fn damper(dir: &Path, arguments: &[&str], variables: &[(&str, &str)]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    for name in [
        "ROS_DOMAIN_ID",
        "ROS_AUTOMATIC_DISCOVERY_RANGE",
        "ROS_LOCALHOST_ONLY",
        "ROS_STATIC_PEERS",
        "RMW_IMPLEMENTATION",
        "RUST_LOG",
    ] {
        command.env_remove(name);
    }
    command.current_dir(dir).args(arguments).envs(variables.iter().copied()).output().expect("it runs")
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

#[test]
fn a_domain_above_232_is_refused_by_every_command() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    fs::write(dir.path().join("run.csv"), "time_s,displacement_m,current_a\n0,0,0\n0.002,0.001,0\n")
        .expect("written");
    fs::write(dir.path().join("node.toml"), "domain_id = 999\n").expect("written");
    let model = ["--model", "thesis/fuzzy-tanh/rp3-cs"];
    let node: Vec<&str> = ["node", "--domain-id", "999"].into_iter().chain(model).collect();
    let by_file: Vec<&str> = ["node", "--config", "node.toml"].into_iter().chain(model).collect();
    for arguments in [
        &["record", "--out", "bag", "--duration", "0.1", "--domain-id", "999"][..],
        &["replay", "run.csv", "--wait", "0", "--domain-id", "999"],
        &["top", "--domain-id", "999"],
        &["serve", "--listen", "127.0.0.1:0", "--domain-id", "999"],
        &["demo", "--seconds", "3", "--domain-id", "999"],
        &["close", "--live", "--domain-id", "999"],
        &["doctor", "--domain-id", "999"],
        &["doctor", "--ros-args", "-p", "domain_id:=999"],
        &node,
        &by_file,
        &["record", "--out", "bag", "--duration", "0.1", "--domain-id", "233"],
        &["record", "--out", "bag", "--duration", "0.1", "--domain-id=-2"],
    ] {
        let output = damper(dir.path(), arguments, &[]);
        let told = said(&output);
        let is_usage = output.status.code() == Some(2);
        assert!(is_usage && told.contains("232"), "{arguments:?}: {:?}: {told}", output.status);
    }
    for arguments in [&["record", "--out", "bag", "--duration", "0.1"][..], &["top"]] {
        let output = damper(dir.path(), arguments, &[("ROS_DOMAIN_ID", "999")]);
        let told = said(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {told}");
        assert!(
            told.contains("ROS_DOMAIN_ID (environment) is \"999\"") && told.contains("from 0 to 232"),
            "{told}"
        );
    }
    assert!(!dir.path().join("bag").exists(), "a refused command leaves no files");
}

#[test]
fn environment_variables_are_applied_or_refused() {
    let _turn = turn(module_path!());
    let lease = Domain::lease();
    let id = lease.id().to_string();
    let dir = tempfile::tempdir().expect("a temporary directory");
    let record = ["record", "--out", "bag", "--duration", "0.1", "--domain-id", &id];
    for (name, value, allowed) in [
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNETS", "SUBNET, LOCALHOST or SYSTEM_DEFAULT"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF", "LOCALHOST"),
        ("ROS_LOCALHOST_ONLY", "true", "0 or 1"),
    ] {
        let output = damper(dir.path(), &record, &[(name, value)]);
        let told = said(&output);
        assert_eq!(output.status.code(), Some(2), "{name}={value}: {told}");
        assert!(told.contains(name) && told.contains(allowed), "{told}");
    }
    let zenoh = damper(dir.path(), &record, &[("RMW_IMPLEMENTATION", "rmw_zenoh_cpp")]);
    assert!(said(&zenoh).contains("nodes on rmw_zenoh do not see it"), "{}", said(&zenoh));

    // The doctor reports the same. With ROS_LOCALHOST_ONLY=0 it opens the network, so it runs in its own domain.
    let doctor = |variables: &[(&str, &str)]| {
        let arguments = ["--quiet", "doctor", "--json", "--domain-id", &id];
        let report: Value =
            serde_json::from_slice(&damper(dir.path(), &arguments, variables).stdout).expect("JSON");
        let findings = report["findings"].as_array().expect("a list").clone();
        let of = move |what: &str, key: &str| {
            let found = findings.iter().find(|finding| finding["what"] == what);
            found.and_then(|finding| finding[key].as_str()).unwrap_or_default().to_owned()
        };
        (of("environment", "level"), of("environment", "found"), of("domain", "found"))
    };
    let (level, found, _) = doctor(&[("RMW_IMPLEMENTATION", "rmw_zenoh_cpp")]);
    assert!(level == "warning" && found.contains("rmw_zenoh_cpp"), "{level}: {found}");
    let (level, found, domain) = doctor(&[("ROS_LOCALHOST_ONLY", "0")]);
    assert!(level == "warning" && found.contains("ROS_LOCALHOST_ONLY is 0"), "{level}: {found}");
    assert!(domain.contains("all hosts that the network reaches"), "{domain}");
    let (level, found, _) = doctor(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNETS")]);
    assert!(level == "failure" && found.contains("SUBNETS"), "{level}: {found}");
}

#[test]
fn control_characters_in_file_names_and_headers_never_reach_the_terminal() {
    let _turn = turn(module_path!());
    let dir = tempfile::tempdir().expect("a temporary directory");
    let name = "\u{1b}[31mred\nerror: forged\u{1b}]0;title\u{7}.csv";
    let header = "time_s,displacement_m,current_a,force_n";
    let rows: String = (0..400)
        .map(|i| format!("{},{},0.5,{}\n", f64::from(i) * 0.002, f64::from(i % 50) * 1e-4, i % 50))
        .collect();
    fs::write(dir.path().join(name), format!("{header}\n{rows}")).expect("written");
    let strange = "\u{1b}[32mgreen.csv";
    fs::write(dir.path().join(strange), format!("time_s,\"\u{1b}[31mdisplacement\n_m\",current_a\n{rows}"))
        .expect("written");
    let model = "thesis/fuzzy-tanh/rp3-cs";
    let missing = "\u{1b}[33mmissing\u{9b}31m.csv";
    for (arguments, names) in [
        (&["evaluate", model, name][..], "red"),
        (&["evaluate", model, strange], "green"),
        (&["evaluate", model, missing], "missing"),
        (&["convert", name, "out"], "red"),
        (&["convert", strange, "out2"], "green"),
        (&["identify", "--model", "arx", "--out", "m\u{1b}[31m.toml", missing], "missing"),
        (&["close", "--base", model, "--estimate", missing, "--confirm", name, "--out", "c.toml"], "missing"),
        (&["node", "--ros-args", "--params-file", missing], "missing"),
        (&["node", "--ros-args", "--\u{1b}[31mred"], "red"),
    ] {
        let told = said(&damper(dir.path(), arguments, &[]));
        let bad: Vec<char> = told.chars().filter(|c| c.is_control() && !matches!(c, '\n' | '\t')).collect();
        assert!(bad.is_empty(), "{arguments:?}: {bad:?} in {told:?}");
        assert!(told.contains(names), "{arguments:?}: {told}");
        assert!(!told.lines().any(|line| line.starts_with("error: forged")), "{arguments:?}: {told}");
    }
}

#[test]
fn parameters_of_other_nodes_in_a_shared_file_are_ignored_and_named() {
    let _turn = turn(module_path!());
    let lease = Domain::lease();
    let id = lease.id().to_string();
    let dir = tempfile::tempdir().expect("a temporary directory");
    let text = format!(
        "/**:\n  ros__parameters:\n    frame_id: base_link\n    gains: [1.0, 2.0]\n    coast: 1.0\n    domain_id: {id}\n"
    );
    fs::write(dir.path().join("robot.yaml"), &text).expect("written");
    let output = damper(dir.path(), &["doctor", "--ros-args", "--params-file", "robot.yaml"], &[]);
    let told = said(&output);
    assert!(
        told.contains("robot.yaml: /**: ignored as parameters of other nodes: coast, frame_id, gains"),
        "{told}"
    );
    assert!(
        told.contains("this node does not have the parameter coast and ignores it; did you mean coast_s?"),
        "{told}"
    );
    assert!(told.contains(&format!("domain: {id}")), "{told}");

    fs::write(dir.path().join("own.yaml"), text.replace("/**", "mr_damper")).expect("written");
    let output = damper(dir.path(), &["doctor", "--ros-args", "--params-file", "own.yaml"], &[]);
    assert!(!output.status.success() && said(&output).contains("own.yaml"), "{}", said(&output));
}
