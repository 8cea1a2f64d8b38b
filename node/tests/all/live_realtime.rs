//! Priority and deadline of the running node: which threads get the priority, and what the status says if it is
//! refused or a deadline is missed.

use crate::domain::Domain;
use crate::turn::turn;
use crate::vehicle_support::{Node, Peer, drive, start};
use crate::wait::wait_until;
use mr_damper_base::realtime::Request;
use mr_damper_msgs::standard::{DiagnosticArray, DiagnosticStatus};
use std::path::Path;
use std::process::{Command, Stdio};

const PRIORITY: u32 = 11;
const FIFO: u32 = 1;

fn program() -> &'static Path {
    Path::new(env!("CARGO_BIN_EXE_mr-damper"))
}

/// Names of the threads of a process (at most 15 characters), with scheduling policy and real-time priority.
fn threads(process: u32) -> Vec<(String, u32, u32)> {
    let tasks = std::fs::read_dir(format!("/proc/{process}/task")).expect("it runs");
    let thread = |task: std::io::Result<std::fs::DirEntry>| {
        // A thread that has just ended is left out.
        let stat = std::fs::read_to_string(task.ok()?.path().join("stat")).ok()?;
        let (name, rest) = (stat.split_once('(')?.1).rsplit_once(')')?;
        // Fields 40 and 41 of the line; the first two fields are already removed.
        let fields: Vec<&str> = rest.split_whitespace().collect();
        Some((name.to_owned(), fields[38].parse().ok()?, fields[37].parse().ok()?))
    };
    tasks.filter_map(thread).collect()
}

/// Feeds the damper until the node's status meets `wanted`.
fn status_that(domain: i64, wanted: impl Fn(&DiagnosticStatus) -> bool) -> DiagnosticStatus {
    let Peer { mut ros, corners } = Peer::start(&["corner"], domain);
    let diagnostics = ros.subscribe::<DiagnosticArray>("/diagnostics").expect("a topic");
    let mut found = None;
    wait_until("the status", || {
        drive(&corners, 100.0, 0.5);
        while let Some((array, _)) = diagnostics.take().expect("readable") {
            found = array.status.into_iter().find(|status| status.name.ends_with(": node") && wanted(status));
            if found.is_some() {
                return true;
            }
        }
        false
    });
    drop((corners, diagnostics));
    ros.stop();
    found.expect("it was waited for")
}

fn value<'a>(status: &'a DiagnosticStatus, key: &str) -> &'a str {
    let value = status.values.iter().find(|value| value.key == key);
    &value.unwrap_or_else(|| panic!("no {key} in {status:?}")).value
}

#[test]
fn missed_deadlines_are_counted() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let _node = start(program(), &["corner"], domain.id(), &["deadline_s:=1e-9".to_owned()]);
    // No estimate is published within a nanosecond.
    let status = status_that(domain.id(), |status| value(status, "missed_deadlines") != "0");
    assert_eq!(status.level, DiagnosticStatus::WARN, "{status:?}");
    assert!(status.message.contains("missed their deadline"), "{status:?}");
    let ms = |key: &str| value(&status, key).parse::<f64>().expect("a number");
    assert!(ms("stepping_median_ms") > 0.0 && ms("publishing_median_ms") > 0.0, "{status:?}");
    assert!(ms("latency_worst_ms") >= ms("waiting_worst_ms").max(ms("publishing_worst_ms")), "{status:?}");
}

#[test]
#[ignore = "needs root: real-time priority"]
fn time_critical_threads_get_the_priority() {
    let _turn = turn(module_path!());
    threads_have(PRIORITY, &[format!("realtime_priority:={PRIORITY}")]);
}

#[test]
#[ignore = "needs root: real-time priority"]
fn they_get_a_priority_by_default_where_the_system_permits_it() {
    let _turn = turn(module_path!());
    threads_have(u32::from(Request::PRIORITY), &[]);
}

/// Starts a node and checks that exactly the threads on the path of a sample have `priority`.
fn threads_have(priority: u32, parameters: &[String]) {
    let domain = Domain::lease();
    let node = start(program(), &["corner"], domain.id(), parameters);
    let status = status_that(domain.id(), |status| value(status, "estimates") != "0");
    let threads = threads(node.0.id());
    let counts = |name: &str| {
        ["estimating", "ros-source", "ros-commands", "ros-sink"].contains(&name)
            || name.starts_with("RustDDS")
    };
    let (path, others): (Vec<_>, Vec<_>) = threads.iter().partition(|(name, ..)| counts(name));
    assert!(path.len() >= 5, "four threads of the node, and the threads of DDS: {threads:?}");
    assert!(others.iter().all(|(_, policy, _)| *policy == 0), "{threads:?}");
    let all = path.iter().all(|(_, policy, found)| (*policy, *found) == (FIFO, priority));
    assert!(all, "this user may not give threads a real-time priority? {threads:?} {status:?}");
    assert_eq!(value(&status, "realtime_priority"), format!("SCHED_FIFO {priority}"));
}

#[test]
#[ignore = "needs root: drops a capability"]
fn a_node_without_priority_runs_and_reports_it() {
    let _turn = turn(module_path!());
    let (status, log) = without_permission(&["--quiet"], &["-p", "realtime_priority:=11"]);
    assert_eq!(status.level, DiagnosticStatus::WARN, "{status:?}");
    assert!(status.message.contains("CAP_SYS_NICE"), "the status says what to do: {status:?}");
    assert!(value(&status, "realtime_priority").contains("not permitted"), "{status:?}");
    assert!(log.contains("no real-time priority: Operation not permitted"), "{log}");
}

#[test]
#[ignore = "needs root: drops a capability"]
fn a_node_that_was_not_asked_for_priority_does_not_warn() {
    let _turn = turn(module_path!());
    let (status, log) = without_permission(&[], &[]);
    assert!(!status.message.contains("priority"), "{status:?}");
    let found = value(&status, "realtime_priority");
    assert!(found.starts_with("off, SCHED_FIFO 20 is not available: Operation not permitted"), "{found}");
    let line = log.lines().find(|line| line.contains("no real-time priority")).expect("it is in the log");
    assert!(line.contains("INFO") && line.contains("CAP_SYS_NICE"), "{line}");
}

/// Status and log of a node that may not raise its priority, all of whose threads are checked to be ordinary.
fn without_permission(options: &[&str], parameters: &[&str]) -> (DiagnosticStatus, String) {
    let domain = Domain::lease();
    let node = Command::new("setpriv")
        .args(["--bounding-set", "-sys_nice", "--inh-caps", "-sys_nice", "--"])
        .arg(program())
        .args(options)
        .args(["node", "--ros-args", "-r", "__ns:=/corner", "-p", "model:=thesis/fuzzy-tanh/rp3-cs"])
        .args(parameters)
        .env("ROS_DOMAIN_ID", domain.id().to_string())
        .stdin(Stdio::null())
        .stderr(Stdio::piped())
        .spawn();
    let mut node = Node(node.expect("setpriv (util-linux) starts"));
    let status = status_that(domain.id(), |status| value(status, "estimates") != "0");
    assert!(threads(node.0.id()).iter().all(|(_, policy, _)| *policy == 0));

    node.0.kill().expect("it runs");
    let mut log = String::new();
    std::io::Read::read_to_string(&mut node.0.stderr.take().expect("piped"), &mut log).expect("text");
    (status, log)
}
