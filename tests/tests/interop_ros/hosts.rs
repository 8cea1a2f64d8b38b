//! Nodes and peers on different hosts: over a cable, and behind a router that carries no multicast.

use crate::interop_support::gate::{Outcome, interop};
use crate::interop_support::json::{count, found, texts, truth};
use crate::interop_support::{Distro, NODE, PRESET};
use crate::{PEER, diagnostics_arrived, estimates_arrived, models_were_loaded, residuals_arrived};

#[test]
fn another_host_is_served_when_the_subnet_may_find_the_node() {
    interop("two hosts", |lab| {
        let Some(far) = lab.neighbour() else {
            return Outcome::Skipped("two network namespaces cannot be wired: that takes root".to_owned());
        };
        // By default the node is this machine's alone: nobody over there sees it.
        let hidden = lab.node(PRESET, &[]);
        let seen = far.ros(Distro::Jazzy, "graph_peer.py", &["--node", NODE, "--absent", "4"]).json(PEER);
        assert!(!truth(&seen, "/found"), "{seen:#}");
        drop(hidden);
        let _node = lab.node(PRESET, &["-p", "discovery_range:=subnet"]);
        // Longer answers of services are lost on their way: docs/decisions/0006-answers-between-hosts.md.
        let args = ["--node", NODE, "--force-seconds", "3", "--list-below", "current"];
        let saw = far.ros(Distro::Jazzy, "ros_peer.py", &args).json(PEER);
        estimates_arrived(&saw);
        residuals_arrived(&saw);
        assert!(truth(&saw, "/parameters/set/successful"), "{:#}", found(&saw, "/parameters"));
        models_were_loaded(&saw);
        diagnostics_arrived(&saw);
        let long = far.ros(Distro::Jazzy, "far_peer.py", &["--node", NODE]).json(PEER);
        assert!(count(&long, "/listed_below") > 0, "short answers arrive: {long:#}");
        assert!(truth(&long, "/type_answered"), "an answer that can be shortened arrives: {long:#}");
        // The hardened build sends the whole.
        let is_told = texts(&long, "/type_told").iter().any(|text| text.contains("shortened"));
        assert!(is_told || count(&long, "/type_sources") > 0, "what is not whole says so: {long:#}");
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
fn a_listed_host_is_served_where_no_multicast_goes() {
    interop("a listed host", |lab| {
        let Some([_router, far]) = lab.behind_a_router() else {
            return Outcome::Skipped("network namespaces cannot be wired: that takes root".to_owned());
        };
        // Without the list, nobody over there hears of the node.
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
