//! An rclpy manager uses everything that a ROS 2 node should offer: states, parameters, mode, log, time, types, actions.

use crate::interop_support::gate::{Outcome, interop, interop_alone};
use crate::interop_support::json::{count, found, number, text, texts, truth};
use crate::interop_support::{Distro, Lab, PRESET};
use crate::{PEER, SHUTDOWN};
use serde_json::Value;

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn rclpy_jazzy_manages_the_node() {
    interop("manager with rclpy jazzy", |lab| manager(lab, Distro::Jazzy));
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn rclpy_kilted_manages_the_node() {
    interop("manager with rclpy kilted", |lab| manager(lab, Distro::Kilted));
}

/// The first request of a new client often arrives before the node knows the client's writer. That used to take 3 s, for 4 to 13
/// of 60 clients.
#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn a_new_fast_dds_client_gets_its_first_response_at_once() {
    interop_alone("new clients of rclpy jazzy", |lab| {
        let _node = lab.node(PRESET, &[]);
        let saw = lab.ros(Distro::Jazzy, "new_clients.py", &["--clients", "80"]).json(PEER);
        assert_eq!((count(&saw, "/clients"), count(&saw, "/unanswered")), (80, 0), "{saw:#}");
        let late = count(&saw, "/late");
        assert!(late <= 1, "{late} waited longer than 0.2 s: {saw:#}");
        Outcome::Passed(format!("80 clients, {late} late, median {:#} s", found(&saw, "/median_s")))
    });
}

/// An rclpy manager uses everything that a ROS 2 node should offer.
fn manager(lab: &Lab, distro: Distro) -> Outcome {
    let params = lab.folder().join("params.yaml");
    let sections = "/**/damper:\n  ros__parameters:\n    autostart: false\n    coast_s: 0.3\n\
                    /rear/*:\n  ros__parameters:\n    coast_s: 9.0\n";
    std::fs::write(&params, sections).expect("a file in a temporary directory");
    let renames =
        ["__ns:=/corner", "mr_damper:__node:=damper", "other:__node:=wrong", "displacement:=/lvdt/x"];
    let mut args: Vec<&str> = renames.iter().flat_map(|rule| ["-r", rule]).collect();
    let out = format!("close_loop.out:={}", lab.folder().display());
    args.extend(["-r", "rosservice://reset:=forget", "-p", "other:coast_s:=5.0", "-p", &out]);
    args.extend(["--params-file", params.to_str().expect("UTF-8 path"), "--log-level", "info"]);
    let mut node = lab.node("overridden-by-the-peer", &args);
    let saw = lab.ros(distro, "manage_peer.py", &["--model", PRESET]).json(PEER);
    assert_eq!(text(&saw, "/distro"), distro.name());
    the_states_are_gone_through(&saw);
    parameters_are_described_and_set(&saw);
    mode_and_time_are_kept(&saw);
    a_run_was_designed(&saw);
    a_model_was_identified(&saw);

    let log = found(&saw, "/log").as_array().expect("a list of lines");
    let said = |level: u64, part: &str| {
        log.iter().any(|line| {
            line[0] == level
                && line[1] == "corner.damper"
                && line[2].as_str().is_some_and(|msg| msg.contains(part))
        })
    };
    for (level, part) in [
        (30, "/no/such/model.toml"),
        (20, "the node is active; it was inactive"),
        (30, "simulated time went back"),
        (20, "the node is finalized"),
    ] {
        assert!(said(level, part), "the log says {part:?}: {log:#?}");
    }
    node.signal("INT");
    let status = node.wait(SHUTDOWN);
    assert!(status.success(), "a node that was shut down exits with success: {status}");
    Outcome::Passed(format!(
        "{} transitions, {} lines of log, identified: {}",
        found(&saw, "/events").as_array().map_or(0, Vec::len),
        log.len(),
        text(&saw, "/identified/message")
    ))
}

fn the_states_are_gone_through(saw: &Value) {
    assert_eq!(text(saw, "/first_state"), "unconfigured");
    assert_eq!(texts(saw, "/states"), ["unconfigured", "inactive", "active", "finalized"]);
    assert_eq!(found(saw, "/graph").as_array().map(Vec::len), Some(7));
    assert!(texts(saw, "/nodes").contains(&"/corner/damper"), "{:#}", found(saw, "/nodes"));
    for phase in ["unasked", "inactive"] {
        assert_eq!(count(saw, &format!("/{phase}/estimates")), 0, "{phase}");
    }
    assert!(truth(saw, "/bad_model/0/successful") && !truth(saw, "/bad_model/1"), "{saw:#}");
    assert!(truth(saw, "/good_model/0/successful") && truth(saw, "/good_model/1"), "{saw:#}");
    assert_eq!(texts(saw, "/ways_when_inactive"), ["cleanup", "activate", "shutdown"]);
    assert_eq!(text(saw, "/activated/1"), "active");
    assert_eq!(count(saw, "/active/estimates"), count(saw, "/active/sent"));
    assert!(truth(saw, "/silenced/0") && truth(saw, "/silenced/1"), "{:#}", found(saw, "/silenced"));
    assert_eq!(text(saw, "/last_state"), "finalized");
    let events = serde_json::json!([
        ["unconfigured", "configure", "inactive"],
        ["inactive", "activate", "active"],
        ["active", "deactivate", "inactive"],
        ["inactive", "shutdown", "finalized"]
    ]);
    assert_eq!(*found(saw, "/events"), events);
}

fn parameters_are_described_and_set(saw: &Value) {
    let described = found(saw, "/described");
    assert_eq!(found(described, "/coast_s/range")[0], serde_json::json!([0.0, 3600.0, 0.0]));
    assert!(text(described, "/coast_s/description").contains("how long ARX"), "{described:#}");
    assert!(truth(described, "/domain_id/read_only") && !truth(described, "/law/read_only"));
    assert_eq!(found(described, "/domain_id/range")[0], serde_json::json!([-1, 232, 1]));
    assert!(text(described, "/law/constraints").contains("skyhook"), "{described:#}");
    assert_eq!(count(described, "/no.such/type"), 0);
    assert!(texts(saw, "/listed/0").contains(&"current.max_a"), "{:#}", found(saw, "/listed"));
    assert_eq!(texts(saw, "/listed/1"), ["current"]);

    assert!(
        !truth(saw, "/refused/successful") && text(saw, "/refused/reason").contains("hold_s is -1"),
        "{saw:#}"
    );
    assert_eq!(number(saw, "/after_refusal"), 0.3, "the file's value for this node is unchanged");
    assert!(truth(saw, "/set/successful"), "{:#}", found(saw, "/set"));
    assert!(text(saw, "/model_when_active/reason").contains("load_model"), "{saw:#}");
    let event = serde_json::json!(["/corner/damper", ["coast_s", "current.safe_a"]]);
    assert!(
        found(saw, "/parameter_events").as_array().is_some_and(|events| events.contains(&event)),
        "{saw:#}"
    );
}

fn mode_and_time_are_kept(saw: &Value) {
    assert!(truth(saw, "/mode_fault") && truth(saw, "/mode_auto") && truth(saw, "/reset"), "{saw:#}");
    assert_eq!(found(saw, "/held/modes"), &serde_json::json!([4]), "the mode is fault, as requested");
    assert!(text(saw, "/mode_hold").contains("cannot be requested"), "{saw:#}");
    assert!(truth(saw, "/type/successful"), "{:#}", found(saw, "/type"));
    assert_eq!(found(saw, "/type/fields"), found(saw, "/fields_here"), "the fields equal rosidl's");
    assert_eq!(texts(saw, "/type/sources").len(), 3);
    for phase in ["simulated", "again"] {
        let told = found(saw, &format!("/{phase}"));
        assert_eq!(count(told, "/estimates"), count(told, "/sent"), "{phase}: {told:#}");
    }
    let diagnostics = found(saw, "/diagnostics").as_array().expect("a list");
    assert!(diagnostics.len() >= 2, "{diagnostics:#?}");
    for array in diagnostics {
        assert_eq!(texts(array, "/names"), ["/corner/damper: node", "/corner/damper: residual"]);
        assert!((0.9..4.0).contains(&number(array, "/stamp")), "stamped in simulated time: {array:#}");
        assert_eq!(text(array, "/values/state"), "active");
        assert_eq!(text(array, "/values/model_hash").len(), 64);
    }
    let hz = |array: &Value| text(array, "/values/displacement_hz").parse::<f64>().expect("a number");
    assert!(diagnostics.iter().any(|array| (200.0..300.0).contains(&hz(array))), "{diagnostics:#?}");
}

fn a_run_was_designed(saw: &Value) {
    let designed = found(saw, "/designed");
    assert!(text(designed, "/status") == "succeeded" && truth(designed, "/success"), "{designed:#}");
    assert!(text(designed, "/message").contains("friction|gas_spring"), "{designed:#}");
    let report: Value = serde_json::from_str(text(designed, "/report")).expect("JSON");
    assert_eq!((text(&report, "/schema"), found(&report, "/seed").as_u64()), ("mr-damper/design/1", Some(3)));
    // The node runs on this machine.
    let run = std::fs::read_to_string(text(designed, "/run_file")).expect("the run is there");
    assert!(run.lines().count() > 12 * 128, "{} lines", run.lines().count());
    assert_eq!(text(saw, "/design_cancelled/status"), "canceled", "{:#}", found(saw, "/design_cancelled"));
    assert!(!truth(saw, "/design_refused/accepted"), "{:#}", found(saw, "/design_refused"));
}

fn a_model_was_identified(saw: &Value) {
    let identified = found(saw, "/identified");
    assert_eq!(text(identified, "/status"), "succeeded", "{identified:#}");
    assert!(
        truth(identified, "/success")
            && text(identified, "/message").contains("held out, simulation (free run)"),
        "{identified:#}"
    );
    let stages = found(identified, "/stages").as_array().expect("a list");
    assert!(stages.len() >= 3, "feedback arrives: {stages:#?}");
    let progress: Vec<f64> = stages.iter().filter_map(|stage| stage[1].as_f64()).collect();
    assert!(progress.is_sorted() && progress.iter().all(|share| (0.0..=1.0).contains(share)), "{stages:#?}");
    assert!(truth(saw, "/loaded/success"), "the identified model was loaded: {:#}", found(saw, "/loaded"));
    let cancelled = found(saw, "/identify_cancelled");
    assert_eq!(
        (text(cancelled, "/status"), truth(cancelled, "/success")),
        ("canceled", false),
        "{cancelled:#}"
    );
    assert!(!truth(saw, "/identify_refused/accepted"), "{:#}", found(saw, "/identify_refused"));
}
