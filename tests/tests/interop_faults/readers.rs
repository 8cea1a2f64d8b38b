//! Failing readers: the other readers lose nothing. `tests/interop/fault_table.py` runs all cases.

use crate::interop_support::gate::{Outcome, binary, ecu_peer_binary, hardened_binary, interop_alone};
use crate::interop_support::process::script;
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// Rate, case and seconds. The reader that stops lasts longer than RustDDS's queue of 8192 samples; the reader that never acknowledges
/// joins after as many samples, and stays for nine times as many.
type Case = (&'static str, &'static str, &'static str);
const DEFAULT: [Case; 2] = [("1000", "rclpy-stop", "14"), ("2000", "mute", "36")];
/// CI builds the hardened node without optimisation, so the rate is lower.
const HARDENED: [Case; 2] = [("1000", "rclpy-stop", "14"), ("1000", "mute", "14")];

/// Rows of the table for one build of the node; `None` if root is needed.
fn rows(node: &Path, build: &str, cases: &[Case]) -> Option<Vec<Value>> {
    let mut all = Vec::new();
    for (rate, case, seconds) in cases {
        let output = Command::new(script("fault_table.py"))
            .arg("--node")
            .arg(node)
            .arg("--ecu")
            .arg(ecu_peer_binary())
            .args(["--build", build, "--rates", rate, "--cases", case, "--seconds", seconds, "--quiet", "2"])
            .output()
            .expect("fault_table.py starts");
        let said = String::from_utf8_lossy(&output.stderr);
        if said.contains("take root") {
            return None;
        }
        let told = String::from_utf8_lossy(&output.stdout);
        let json: Value = told
            .lines()
            .last()
            .and_then(|line| serde_json::from_str(line).ok())
            .unwrap_or_else(|| panic!("fault_table.py printed no table: {said}"));
        all.extend(json["rows"].as_array().expect("rows").iter().cloned());
    }
    Some(all)
}

fn nobody_else_loses(node: &Path, build: &str, cases: &[Case]) -> Outcome {
    let Some(rows) = rows(node, build, cases) else {
        return Outcome::Missing("network namespaces and raw sockets need root".to_owned());
    };
    assert_eq!(rows.len(), cases.len(), "{rows:?}");
    let told: Vec<_> = rows
        .iter()
        .map(|row| {
            let lost = ["estimates_lost", "commands_lost"].map(|kind| row[kind].as_u64());
            assert_eq!(lost, [Some(0); 2], "{row:#}");
            format!("{}: 0 of {} lost, p99 {:.2} ms", row["case"], row["sent"], row["estimates_p99_ms"])
        })
        .collect();
    Outcome::Passed(told.join("; "))
}

#[test]
#[ignore = "needs root: network namespaces and raw sockets"]
fn a_reader_that_stops_or_never_acknowledges_does_not_affect_the_others() {
    interop_alone("readers that fail", |_| nobody_else_loses(&binary(), "default", &DEFAULT));
}

#[test]
#[ignore = "needs root and a hardened build: MR_DAMPER_HARDENED_BIN"]
fn nor_does_it_affect_them_with_the_hardened_build() {
    interop_alone("readers that fail, hardened build", |_| match hardened_binary() {
        Ok(node) => nobody_else_loses(&node, "hardened", &HARDENED),
        Err(why) => Outcome::Missing(why),
    });
}
