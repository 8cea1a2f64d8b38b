//! Malformed RTPS on the node's ports (`bad_rtps.py`): noise changes nothing, and packets that the DDS library does not survive end the
//! node with an explanation.

use super::NO_ARX;
use super::peer_records::{FaultPeer, PeerRecords};
use crate::PEER;
use crate::interop_support::gate::{Outcome, interop, interop_alone, long, survives};
use crate::interop_support::json::{count, text};
use crate::interop_support::process::{Program, resident_mib, script};
use crate::interop_support::{Lab, PRESET};
use serde_json::Value;
use std::path::Path;
use std::time::{Duration, Instant};

/// Largest growth of the node's memory under a storm of about ten thousand packets, MiB: discovery keeps unknown participants until
/// their leases expire, and a reader that accepts a fragment allocates its claimed size of up to one MiB. (At most ten MiB were seen.)
const GROWTH_MIB: u64 = 128;
/// Longest time from the end of a storm to the first VALID estimate, s.
const BACK_S: f64 = 1.0;
/// Longest time from a packet that exhausts the memory to the end of the process.
const END: Duration = Duration::from_secs(30);

pub(super) fn bad_rtps(lab: &Lab, args: &[&str]) -> Program {
    let file = script("bad_rtps.py");
    let mut all = vec![file.to_str().expect("UTF-8 path")];
    all.extend(args);
    lab.start_with("bad_rtps.py", Path::new("/usr/bin/env"), &[&["python3"], all.as_slice()].concat(), &[])
}

/// Sends a storm of `seconds` to a node with a peer; returns the peer's records, the storm's counts, and the node's growth in MiB.
fn storm(lab: &Lab, node: &Program, play: &str, seconds: u32) -> (PeerRecords, Value, u64) {
    let mut peer = FaultPeer::start(lab, &format!("fault_peer {play}"), &["--loopback"]);
    peer.command("phase before");
    peer.command("send");
    let seconds_text = seconds.to_string();
    let mut bad = bad_rtps(lab, &["--as", play, "--seconds", &seconds_text, "--seed", "7"]);
    // It captures real packets first.
    assert_eq!(text(&bad.json_line(PEER), "/event"), "storm");
    let before = resident_mib(node.id());
    peer.command("phase storm");
    let sent = bad.json(Duration::from_secs(30 + u64::from(seconds)));
    peer.phase("after", 1.5);
    let grown = resident_mib(node.id()).saturating_sub(before);
    (peer.finish(), sent, grown)
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn malformed_packets_change_nothing_for_a_peer() {
    interop_alone("malformed RTPS", |lab| {
        let mut node = lab.node(PRESET, NO_ARX);
        let seconds = if long() { 300 } else { 4 };
        let (records, sent, grown) = storm(lab, &node, "stranger", seconds);
        assert!(node.is_running(), "the node still runs");
        records.is_sound();
        let answered = records.answered("storm");
        assert!(answered > 0.95, "{answered:.3} answered: {}", records.summary());
        let back_s = records.valid_after_s("after");
        assert!(back_s < BACK_S && records.answered("after") > 0.99, "{back_s:.2} s: {}", records.summary());
        assert!(grown < GROWTH_MIB, "{grown} MiB");
        assert!(count(&sent, "/mutated") > 1000 && count(&sent, "/crafted") > 1000, "{sent:#}");

        // Packets in a peer's name may harm that peer, because only DDS-Security can tell them apart. The next peer must be served.
        let (forged, more, grown_more) = storm(lab, &node, "peer", seconds);
        assert!(node.is_running(), "the node still runs");
        assert!(
            forged.estimates.iter().all(|estimate| estimate.force_n.is_finite() || estimate.reasons.0 != 0)
        );
        assert!(grown_more < GROWTH_MIB, "{grown_more} MiB");
        let mut next = FaultPeer::start(lab, "fault_peer next", &["--loopback"]);
        next.command("phase next");
        next.command("send");
        std::thread::sleep(Duration::from_secs(1));
        let next = next.finish();
        assert!(next.answered("next") > 0.99, "{}", next.summary());
        Outcome::Passed(format!(
            "{} packets of unknown participants ({} lethal ones not sent): {:.1} % answered meanwhile, {grown} MiB; {} in the peer's name: \
             {grown_more} MiB, the next peer {:.1} % answered",
            count(&sent, "/mutated") + count(&sent, "/crafted") + count(&sent, "/noise"),
            count(&sent, "/lethal"),
            1e2 * answered,
            count(&more, "/mutated") + count(&more, "/crafted") + count(&more, "/noise"),
            1e2 * next.answered("next"),
        ))
    });
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn a_packet_that_exhausts_the_memory_ends_the_node_with_an_explanation() {
    interop("lethal RTPS", |lab| {
        if let Some(skipped) = survives() {
            return skipped;
        }
        let mut figures = Vec::new();
        for kind in ["heartbeat", "gap", "datafrag"] {
            let mut node = lab.node(PRESET, NO_ARX);
            bad_rtps(lab, &["--lethal", kind]).json(Duration::from_secs(40));
            let sent = Instant::now();
            let status = node.wait(END);
            assert_eq!(status.code(), Some(1), "{kind}: {status}");
            let said = lab.last_log("mr-damper node");
            let words = said.lines().find(|line| line.contains("malformed or hostile packets"));
            let words = words.unwrap_or_else(|| panic!("{kind}: {said}"));
            let held =
                words.split_once("uses ").and_then(|(_, rest)| rest.split_once(" MiB")).expect("a figure").0;
            figures
                .push(format!("{kind}: ended with 1 at {held} MiB after {} ms", sent.elapsed().as_millis()));
        }
        Outcome::Passed(figures.join("; "))
    });
}
