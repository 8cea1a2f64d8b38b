//! Nodes and peers on different hosts: over a cable, and behind a router that carries no multicast.

use crate::interop_support::gate::{Outcome, interop};
use crate::interop_support::json::{count, found, texts, truth};
use crate::interop_support::{Distro, NODE, PRESET};
use crate::{PEER, diagnostics_arrived, estimates_arrived, models_were_loaded, residuals_arrived};

#[test]
#[ignore = "needs root: network namespaces that are connected"]
fn another_host_is_served_if_discovery_includes_the_subnet() {
    interop("two hosts", |lab| {
        let Some(far) = lab.neighbour() else {
            return Outcome::Missing("two network namespaces cannot be connected without root".to_owned());
        };
        // By default the node is visible only on its own machine.
        let hidden = lab.node(PRESET, &[]);
        let seen = far.ros(Distro::Jazzy, "graph_peer.py", &["--node", NODE, "--absent", "4"]).json(PEER);
        assert!(!truth(&seen, "/found"), "{seen:#}");
        drop(hidden);
        let _node = lab.node(PRESET, &["-p", "discovery_range:=subnet"]);
        // Longer service responses are lost on their way: docs/decisions/0006-answers-between-hosts.md.
        let args = ["--node", NODE, "--force-seconds", "3", "--list-below", "current"];
        let saw = far.ros(Distro::Jazzy, "ros_peer.py", &args).json(PEER);
        estimates_arrived(&saw);
        residuals_arrived(&saw);
        assert!(truth(&saw, "/parameters/set/successful"), "{:#}", found(&saw, "/parameters"));
        models_were_loaded(&saw);
        diagnostics_arrived(&saw);
        let long = far.ros(Distro::Jazzy, "far_peer.py", &["--node", NODE]).json(PEER);
        assert!(count(&long, "/listed_below") > 0, "short answers arrive: {long:#}");
        assert!(truth(&long, "/type_answered"), "a response that can be shortened arrives: {long:#}");
        // The hardened build sends the complete response.
        let is_told = texts(&long, "/type_told").iter().any(|text| text.contains("shortened"));
        assert!(is_told || count(&long, "/type_sources") > 0, "an incomplete response says so: {long:#}");
        let cyclone = far.peer("cyclone_peer.py", &["--interface", "far"]).json(PEER);
        estimates_arrived(&cyclone);
        Outcome::Passed(format!(
            "{} estimates to rclpy, {} to CycloneDDS, over a cable",
            count(&saw, "/force_estimate/count"),
            count(&cyclone, "/force_estimate/count")
        ))
    });
}

#[test]
#[ignore = "needs root: network namespaces that are connected"]
fn a_listed_host_is_served_without_multicast() {
    interop("a listed host", |lab| {
        let Some([_router, far]) = lab.behind_a_router() else {
            return Outcome::Missing("network namespaces cannot be connected without root".to_owned());
        };
        // Without the list, the other host does not discover the node.
        let unlisted = lab.node(PRESET, &["-p", "discovery_range:=subnet"]);
        let seen = far.ros(Distro::Kilted, "graph_peer.py", &["--node", NODE, "--absent", "4"]).json(PEER);
        assert!(!truth(&seen, "/found"), "{seen:#}");
        drop(unlisted);
        let _node = lab.node(PRESET, &["-p", "discovery_peers:=['10.77.2.2']"]);
        let args = ["--node", NODE, "--force-seconds", "3", "--list-below", "current"];
        let saw = far.ros(Distro::Kilted, "ros_peer.py", &args).json(PEER);
        estimates_arrived(&saw);
        residuals_arrived(&saw);
        Outcome::Passed(format!(
            "{} estimates to rclpy behind a router",
            count(&saw, "/force_estimate/count")
        ))
    });
}
