//! `mr-damper doctor` reports what would stop the service from working, or that nothing would.

use crate::domain::Domain;
use crate::turn::turn;
use serde_json::Value;
use std::net::TcpListener;
use std::process::{Command, Output};

const MODEL: &str = "model:=thesis/fuzzy-tanh/rp3-cs";

/// The exit code, and for each finding: what was checked, its level and its text.
fn findings(output: &Output) -> (Option<i32>, Vec<(String, String, String)>) {
    let report: Value = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&output.stderr)));
    let text = |finding: &Value, key: &str| finding[key].as_str().unwrap_or_default().to_owned();
    let all = report["findings"].as_array().expect("a list").iter();
    let all = all.map(|finding| {
        (
            text(finding, "what"),
            text(finding, "level"),
            text(finding, "found") + " " + &text(finding, "advice"),
        )
    });
    (output.status.code(), all.collect())
}

fn found<'a>(findings: &'a [(String, String, String)], what: &str) -> (&'a str, &'a str) {
    let found = findings.iter().find(|(of, ..)| of.starts_with(what));
    let (_, level, text) = found.unwrap_or_else(|| panic!("no finding on {what}: {findings:?}"));
    (level, text)
}

#[test]
fn a_sound_machine_passes_and_a_taken_port_fails() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let taken = TcpListener::bind("127.0.0.1:0").expect("a port");
    let listen = format!("zenoh.listen:=['tcp/{}']", taken.local_addr().expect("an address"));
    let doctor = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
        command
            .args(["--quiet", "doctor", "--json", "--ros-args", "-p", MODEL])
            .args(more)
            .env("ROS_DOMAIN_ID", domain.id().to_string());
        findings(&command.output().expect("it runs"))
    };
    let (code, all) = doctor(&[]);
    assert_eq!(code, Some(0), "{all:?}");
    assert!(all.iter().all(|(_, level, _)| level != "failure"), "{all:?}");
    assert_eq!(found(&all, "multicast").0, "ok");
    assert!(found(&all, "model of /mr_damper").1.contains("rp3-cs loads"), "{all:?}");
    let (level, libraries) = found(&all, "DDS libraries");
    assert_eq!(level, "ok", "{libraries}");
    match mr_damper_node::process::hardened::EDITS {
        Some(edits) => assert!(libraries.contains(edits), "{libraries}"),
        None => assert!(
            ["do not reach clients", "type hash", "crafted packet", "Ctrl-Z", "node/hardened/build"]
                .iter()
                .all(|word| libraries.contains(word)),
            "{libraries}"
        ),
    }

    let (code, all) = doctor(&["-p", &listen, "-p", "domain_id:=150"]);
    assert_eq!(code, Some(1), "{all:?}");
    assert_eq!(found(&all, "Zenoh").0, "failure", "{all:?}");
    let (level, text) = found(&all, "ports");
    assert!(level == "warning" && text.contains("0 to 101"), "{text}");
}

#[test]
#[ignore = "needs root, or the right to create network namespaces"]
fn a_missing_loopback_and_a_missing_model_are_named() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let isolated = |arguments: &[&str]| {
        let mut command = Command::new("unshare");
        command.args(["--net", "--user", "--map-root-user", "--"]).args(arguments);
        command.env("ROS_DOMAIN_ID", domain.id().to_string()).output().expect("unshare (util-linux) starts")
    };
    assert!(isolated(&["true"]).status.success(), "this user may not create network namespaces");
    let program = env!("CARGO_BIN_EXE_mr-damper");
    let (code, all) = findings(&isolated(&[
        program,
        "--quiet",
        "doctor",
        "--json",
        "--ros-args",
        "-p",
        "model:=no-such.toml",
    ]));
    assert_eq!(code, Some(1), "{all:?}");
    for (what, says) in [
        ("model of /mr_damper", "no-such.toml"),
        ("multicast", "ip link set lo up"),
        ("joining it", "loopback"),
    ] {
        let (level, text) = found(&all, what);
        assert!(level == "failure" && text.contains(says), "{what}: {level}, {text}");
    }
}
