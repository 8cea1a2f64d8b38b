//! Faults that the hardened build survives and the default build does not (decision 0010).

use super::NO_ARX;
use super::malformed::bad_rtps;
use super::told::{FaultPeer, Told};
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
fn a_hardened_node_survives_hostile_packets() {
    interop("hardened: hostile RTPS", |lab| {
        let mut node = match lab.hardened_node(NO_ARX) {
            Ok(node) => node,
            Err(why) => return Outcome::Skipped(why),
        };
        // The packets go to the ports of the domain's first participant, so only the node may run until they are
        // sent.
        std::thread::sleep(Duration::from_secs(2));
        let before = resident_mib(node.id());
        for kind in ["heartbeat", "gap", "datafrag", "nackfrag"] {
            bad_rtps(lab, &["--lethal", kind]).json(PEER);
            std::thread::sleep(Duration::from_secs(2));
            assert!(node.is_running(), "{kind}: {}", lab.last_log("mr-damper node"));
        }
        let grown = resident_mib(node.id()).saturating_sub(before);
        let mut peer = FaultPeer::start(lab, "fault_peer", &["--loopback"]);
        peer.tell("phase after");
        peer.tell("send");
        std::thread::sleep(Duration::from_secs(2));
        let told = peer.told();
        told.is_sound();
        assert!(told.answered("after") > 0.99, "{}", told.summary());
        assert!(grown < GROWTH_MIB, "{grown} MiB");
        Outcome::Passed(format!(
            "4 packets, {grown} MiB, {:.2} % answered after them",
            1e2 * told.answered("after")
        ))
    });
}

#[test]
fn a_hardened_node_continues_after_it_was_stopped() {
    interop("hardened: suspended node", |lab| {
        let mut node = match lab.hardened_node(NO_ARX) {
            Ok(node) => node,
            Err(why) => return Outcome::Skipped(why),
        };
        let mut peer = FaultPeer::start(lab, "fault_peer", &["--loopback"]);
        peer.tell("phase before");
        peer.tell("send");
        std::thread::sleep(Duration::from_secs(1));
        peer.tell("phase stopped");
        node.signal("STOP");
        std::thread::sleep(Duration::from_secs(2));
        node.signal("CONT");
        peer.phase("back", 3.0);
        assert!(node.is_running(), "{}", lab.last_log("mr-damper node"));
        let told = peer.told();
        let back_s = told.valid_after_s("back");
        assert!(back_s < BACK_S && told.answered("back") > 0.9, "{back_s:.2} s: {}", told.summary());
        Outcome::Passed(format!("VALID again after {:.0} ms", 1e3 * back_s))
    });
}

/// The 99th percentile of the delays of a phase's estimates, s.
fn p99_s(told: &Told, phase: &str) -> f64 {
    let (number, _) = told.phase(phase);
    let live = told.heard.iter().filter(|heard| heard.phase == number && heard.is_live());
    let mut delays: Vec<f64> = live.map(|heard| (heard.at_ns - heard.stamp_ns) as f64 * 1e-9).collect();
    delays.sort_by(f64::total_cmp);
    delays[delays.len() * 99 / 100]
}

/// Checks that the peer got every estimate in time while another reader was dead.
fn was_served(told: &Told, phase: &str) -> String {
    told.is_sound();
    let p99_s = p99_s(told, phase);
    assert_eq!(told.answered(phase), 1.0, "a dead reader causes no loss: {}", told.summary());
    assert!(p99_s < P99_S, "99 % within {p99_s:.3} s: {}", told.summary());
    format!("none lost, 99 % within {:.1} ms", 1e3 * p99_s)
}

fn dead_s() -> Duration {
    Duration::from_secs_f64(if long() { 3.0 * DEAD_S } else { DEAD_S })
}

#[test]
fn a_hardened_node_does_not_wait_for_a_dead_reader() {
    interop("hardened: dead reader", |lab| {
        let mut node = match lab.hardened_node(NO_ARX) {
            Ok(node) => node,
            Err(why) => return Outcome::Skipped(why),
        };
        let mut reader = lab.ros_told(Distro::Jazzy, "steady_peer.py", &["--hear"]);
        assert_eq!(text(&reader.json_line(PEER), "/event"), "ready");
        let mut peer = FaultPeer::start(lab, "fault_peer", &["--loopback", "--rate", RATE_HZ]);
        peer.tell("phase before");
        peer.tell("send");
        std::thread::sleep(Duration::from_secs(2));
        peer.tell("phase dead");
        reader.signal("KILL");
        reader.wait(PEER);
        std::thread::sleep(dead_s());
        assert!(node.is_running());
        Outcome::Passed(was_served(&peer.told(), "dead"))
    });
}

#[test]
fn a_hardened_node_does_not_wait_for_a_lost_host() {
    interop("hardened: host that is gone", |lab: &Lab| {
        let (far, mut wire) = match lab.behind_a_bad_wire(5) {
            Ok(both) => both,
            Err(why) => return Outcome::Skipped(why),
        };
        let node = match lab.hardened_node(&[NO_ARX, &["-p", "discovery_range:=subnet"]].concat()) {
            Ok(node) => node,
            Err(why) => return Outcome::Skipped(why),
        };
        let mut reader = far.ros_told(Distro::Jazzy, "steady_peer.py", &["--hear"]);
        assert_eq!(text(&reader.json_line(PEER), "/event"), "ready");
        let mut peer = FaultPeer::start(lab, "fault_peer", &["--rate", RATE_HZ]);
        peer.tell("phase before");
        peer.tell("send");
        std::thread::sleep(Duration::from_secs(2));
        peer.tell("phase gone");
        wire.tell(r#"{"name": "cut", "cut": true}"#);
        std::thread::sleep(dead_s());
        let told = peer.told();
        wire.tell(r#"{"name": "clean"}"#);
        drop((node, reader));
        wire.close();
        Outcome::Passed(was_served(&told, "gone"))
    });
}
