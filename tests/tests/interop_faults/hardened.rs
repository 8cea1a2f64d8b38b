//! Faults that the hardened build survives and the default build does not (decision 0010).

use super::NO_ARX;
use super::malformed::bad_rtps;
use super::peer_records::{FaultPeer, PeerRecords};
use crate::PEER;
use crate::interop_support::gate::{Outcome, interop, long};
use crate::interop_support::json::text;
use crate::interop_support::process::resident_mib;
use crate::interop_support::{Distro, Lab};
use std::time::Duration;

/// Largest growth of the node's memory for a packet with a wrong size, MiB.
const GROWTH_MIB: u64 = 48;
/// Longest time from the end of a stop to the first VALID estimate, s.
const BACK_S: f64 = 1.0;
/// Rate of the peer that is served while another reader is dead, Hz.
const RATE_HZ: &str = "500";
/// Longer than 8192 samples take, after which a RustDDS writer of the default build blocks, s.
const DEAD_S: f64 = 20.0;
/// Limit of the 99th percentile of the delay from input to output, on a busy machine, s.
const P99_S: f64 = 0.1;

#[test]
#[ignore = "needs a hardened build: MR_DAMPER_HARDENED_BIN"]
fn a_hardened_node_survives_hostile_packets() {
    interop("hardened: hostile RTPS", |lab| {
        let mut node = match lab.hardened_node(NO_ARX) {
            Ok(node) => node,
            Err(why) => return Outcome::Missing(why),
        };
        // The packets go to the ports of the domain's first participant, so only the node may run until they are
        // sent.
        lab.wait_for_log("mr-damper node", "the node is up");
        let before = resident_mib(node.id());
        for kind in ["heartbeat", "gap", "datafrag", "nackfrag"] {
            bad_rtps(lab, &["--lethal", kind]).json(PEER);
            // A node that does not survive the packet ends within this time.
            std::thread::sleep(Duration::from_secs(2));
            assert!(node.is_running(), "{kind}: {}", lab.last_log("mr-damper node"));
        }
        let grown = resident_mib(node.id()).saturating_sub(before);
        let mut peer = FaultPeer::start(lab, "fault_peer", &["--loopback"]);
        peer.command("phase after");
        peer.command("send");
        std::thread::sleep(Duration::from_secs(2));
        let records = peer.finish();
        records.is_sound();
        assert!(records.answered("after") > 0.99, "{}", records.summary());
        assert!(grown < GROWTH_MIB, "{grown} MiB");
        Outcome::Passed(format!(
            "4 packets, {grown} MiB, {:.2} % answered after them",
            1e2 * records.answered("after")
        ))
    });
}

#[test]
#[ignore = "needs a hardened build: MR_DAMPER_HARDENED_BIN"]
fn a_hardened_node_continues_after_it_was_stopped() {
    interop("hardened: suspended node", |lab| {
        let mut node = match lab.hardened_node(NO_ARX) {
            Ok(node) => node,
            Err(why) => return Outcome::Missing(why),
        };
        let mut peer = FaultPeer::start(lab, "fault_peer", &["--loopback"]);
        peer.command("phase before");
        peer.command("send");
        std::thread::sleep(Duration::from_secs(1));
        peer.command("phase stopped");
        node.signal("STOP");
        std::thread::sleep(Duration::from_secs(2));
        node.signal("CONT");
        peer.phase("back", 3.0);
        assert!(node.is_running(), "{}", lab.last_log("mr-damper node"));
        let records = peer.finish();
        let back_s = records.valid_after_s("back");
        assert!(back_s < BACK_S && records.answered("back") > 0.9, "{back_s:.2} s: {}", records.summary());
        Outcome::Passed(format!("VALID again after {:.0} ms", 1e3 * back_s))
    });
}

/// The 99th percentile of the delays of a phase's estimates, s.
fn p99_s(records: &PeerRecords, phase: &str) -> f64 {
    let (number, _) = records.phase(phase);
    let live = records.estimates.iter().filter(|estimate| estimate.phase == number && estimate.is_live());
    let mut delays: Vec<f64> =
        live.map(|estimate| (estimate.at_ns - estimate.stamp_ns) as f64 * 1e-9).collect();
    delays.sort_by(f64::total_cmp);
    delays[delays.len() * 99 / 100]
}

/// Checks that the peer got every estimate in time while another reader was dead.
fn was_served(records: &PeerRecords, phase: &str) -> String {
    records.is_sound();
    let p99_s = p99_s(records, phase);
    assert_eq!(records.answered(phase), 1.0, "a dead reader causes no loss: {}", records.summary());
    assert!(p99_s < P99_S, "99 % within {p99_s:.3} s: {}", records.summary());
    format!("none lost, 99 % within {:.1} ms", 1e3 * p99_s)
}

fn dead_s() -> Duration {
    Duration::from_secs_f64(if long() { 3.0 * DEAD_S } else { DEAD_S })
}

#[test]
#[ignore = "needs a hardened build: MR_DAMPER_HARDENED_BIN"]
fn a_hardened_node_does_not_wait_for_a_dead_reader() {
    interop("hardened: dead reader", |lab| {
        let mut node = match lab.hardened_node(NO_ARX) {
            Ok(node) => node,
            Err(why) => return Outcome::Missing(why),
        };
        let mut reader = lab.ros_commanded(Distro::Jazzy, "steady_peer.py", &["--hear"]);
        assert_eq!(text(&reader.json_line(PEER), "/event"), "ready");
        let mut peer = FaultPeer::start(lab, "fault_peer", &["--loopback", "--rate", RATE_HZ]);
        peer.command("phase before");
        peer.command("send");
        std::thread::sleep(Duration::from_secs(2));
        peer.command("phase dead");
        reader.signal("KILL");
        reader.wait(PEER);
        std::thread::sleep(dead_s());
        assert!(node.is_running());
        Outcome::Passed(was_served(&peer.finish(), "dead"))
    });
}

#[test]
#[ignore = "needs root and a hardened build: MR_DAMPER_HARDENED_BIN"]
fn a_hardened_node_does_not_wait_for_a_lost_host() {
    interop("hardened: host that is gone", |lab: &Lab| {
        let (far, mut wire) = match lab.behind_a_bad_wire(5) {
            Ok(both) => both,
            Err(why) => return Outcome::Missing(why),
        };
        let node = match lab.hardened_node(&[NO_ARX, &["-p", "discovery_range:=subnet"]].concat()) {
            Ok(node) => node,
            Err(why) => return Outcome::Missing(why),
        };
        let mut reader = far.ros_commanded(Distro::Jazzy, "steady_peer.py", &["--hear"]);
        assert_eq!(text(&reader.json_line(PEER), "/event"), "ready");
        let mut peer = FaultPeer::start(lab, "fault_peer", &["--rate", RATE_HZ]);
        peer.command("phase before");
        peer.command("send");
        std::thread::sleep(Duration::from_secs(2));
        peer.command("phase gone");
        wire.command(r#"{"name": "cut", "cut": true}"#);
        std::thread::sleep(dead_s());
        let records = peer.finish();
        wire.command(r#"{"name": "clean"}"#);
        drop((node, reader));
        wire.close();
        Outcome::Passed(was_served(&records, "gone"))
    });
}
