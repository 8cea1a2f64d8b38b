//! Peers and nodes that stop silently, are killed in the middle of a message, or run twice.

use super::NO_ARX;
use super::peer_records::{FaultPeer, PeerRecords};
use crate::PEER;
use crate::interop_support::gate::{Outcome, interop, interop_alone, long, survives};
use crate::interop_support::json::text;
use crate::interop_support::process::{Program, resident_mib};
use crate::interop_support::{Distro, Lab, PRESET};
use mr_damper_model::pipeline::{Mode, Settings};
use std::time::Duration;

/// Longest time from the end of a stop to the first VALID estimate, s.
const BACK_S: f64 = 1.0;
/// Longest time from an estimate to its arrival at the peer, on loopback and a busy machine, s.
const WAY_S: f64 = 0.3;
/// Largest growth of the node's memory for a reader that does not read, MiB: a topic's history of 1024 estimates takes less than
/// one.
const GROWTH_MIB: u64 = 8;

/// The same for peers that sent messages of a megabyte each, MiB: their remains are kept until their leases expire.
const LONG_MIB: u64 = 256;

/// Longer than the time until a killed rclpy peer is forgotten.
const LEASE: Duration = Duration::from_secs(30);

/// Stops a program for a while.
fn stop_for(seconds: f64, signal: impl Fn(&str)) {
    signal("STOP");
    std::thread::sleep(Duration::from_secs_f64(seconds));
    signal("CONT");
}

/// Checks that no VALID estimate was older than `input_timeout_s` on arrival; returns the largest age in s.
fn none_is_stale(records: &PeerRecords) -> f64 {
    let valid = records.estimates.iter().filter(|estimate| estimate.is_valid());
    let oldest_s =
        valid.map(|estimate| (estimate.at_ns - estimate.stamp_ns) as f64 * 1e-9).fold(0.0, f64::max);
    let limit_s = Settings::default().input_timeout_s + WAY_S;
    assert!(oldest_s <= limit_s, "a VALID estimate was {oldest_s:.2} s old: {}", records.summary());
    oldest_s
}

/// The modes of the estimates that bridged silence in a phase, without repetitions.
fn bridging(records: &PeerRecords, phase: &str) -> Vec<u8> {
    let (number, _) = records.phase(phase);
    let silent = records.estimates.iter().filter(|estimate| estimate.phase == number && !estimate.is_live());
    let mut modes: Vec<u8> = silent.map(|estimate| estimate.mode).collect();
    modes.dedup();
    modes
}

/// Starts an rclpy peer that sends or receives, and waits until it is ready. (A RustDDS peer would not survive a stop.)
fn steady(lab: &Lab, args: &[&str]) -> Program {
    let mut peer = lab.ros_commanded(Distro::Jazzy, "steady_peer.py", args);
    assert_eq!(text(&peer.json_line(PEER), "/event"), "ready");
    peer
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn a_sender_and_a_reader_may_stop_and_continue() {
    interop("suspended sender and reader", |lab| {
        let node = lab.node(PRESET, NO_ARX);
        let mut peer = FaultPeer::start(lab, "fault_peer", &["--loopback"]);
        let sender = steady(lab, &[]);
        peer.phase("steady", 1.0);
        peer.command("phase no_sender");
        stop_for(2.5, |signal| sender.signal(signal));
        peer.phase("sender_back", 1.0);
        sender.close();
        // Now another sender, and a reliable reader that stops: nothing may wait for the reader, or be kept for it without a bound.
        let reader = steady(lab, &["--hear"]);
        peer.phase("between", 0.5);
        peer.command("send");
        let before = resident_mib(node.id());
        peer.phase("stands", 0.2);
        peer.command("phase no_reader");
        stop_for(if long() { 600.0 } else { 5.0 }, |signal| reader.signal(signal));
        let grown = resident_mib(node.id()).saturating_sub(before);
        reader.close();
        let records = peer.finish();

        let silent = [Mode::Hold as u8, Mode::Fault as u8];
        assert_eq!(bridging(&records, "no_sender"), silent, "{}", records.summary());
        none_is_stale(&records);
        let (phase, back_ns) = records.phase("sender_back");
        let first = records.estimates.iter().find(|estimate| estimate.is_valid() && estimate.phase == phase);
        let back_s = (first.expect("VALID again").at_ns - back_ns) as f64 * 1e-9;
        assert!(back_s < BACK_S, "{back_s:.2} s: {}", records.summary());
        assert_eq!(records.answered("no_reader"), 1.0, "a stalled reader causes no loss for others");
        assert!(grown <= GROWTH_MIB, "{grown} MiB for a reader that does not read");
        Outcome::Passed(format!(
            "sender stopped: hold, fault, VALID again after {:.0} ms; reader stopped: {grown} MiB, none lost to others",
            1e3 * back_s
        ))
    });
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn stopped_programs_report_that_their_dds_library_did_not_continue() {
    interop_alone("suspended node and recorder", |lab| {
        if let Some(skipped) = survives() {
            return skipped;
        }
        let mut node = lab.node(PRESET, NO_ARX);
        let bag = lab.folder().join("bag");
        let mut recorder = lab.mr_damper(&["record", "--out", bag.to_str().expect("UTF-8 path")]);
        let mut peer = FaultPeer::start(lab, "fault_peer", &["--loopback"]);
        peer.command("phase all");
        peer.command("send");
        std::thread::sleep(Duration::from_secs(1));
        peer.command("phase stopped");
        for program in [&node, &recorder] {
            program.signal("STOP");
        }
        std::thread::sleep(Duration::from_secs(2));
        for program in [&node, &recorder] {
            program.signal("CONT");
        }
        let going = std::time::Instant::now();
        let mut ended = Vec::new();
        for (program, name) in [(&mut node, "mr-damper node"), (&mut recorder, "mr-damper record")] {
            let status = program.wait(Duration::from_secs(10));
            assert_eq!(status.code(), Some(1), "{name}: {status}");
            let said = lab.last_log(name);
            assert!(said.contains("a thread of the DDS library has ended"), "{name}: {said}");
            ended.push(format!("{name} ended with 1 after {} ms", going.elapsed().as_millis()));
        }
        let run = mr_damper_runs::load(&bag, &mr_damper_runs::LoadOptions::default()).expect("a whole bag");
        assert!(run.run.displacement_m.len() > 50, "{} displacements", run.run.displacement_m.len());
        let records = peer.read_records();
        let oldest_s = none_is_stale(&records);
        Outcome::Passed(format!(
            "{}; the oldest VALID estimate was {:.0} ms old",
            ended.join(", "),
            1e3 * oldest_s
        ))
    });
}

/// Kills peers one after another while they send messages of a megabyte, in fragments.
fn kill_in_the_middle(lab: &Lab, times: u64) {
    for turn in 0..times {
        let mut peer = lab.ros(Distro::Jazzy, "long_peer.py", &[]);
        assert_eq!(text(&peer.json_line(PEER), "/event"), "sending");
        // Each peer is killed at another place in its message.
        std::thread::sleep(Duration::from_millis(300 + 37 * turn));
        peer.signal("KILL");
        assert!(!peer.wait(Duration::from_secs(5)).success());
    }
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn peers_killed_in_the_middle_of_long_messages_harm_nobody() {
    interop("peers killed in the middle", |lab| {
        let mut node = lab.node(PRESET, NO_ARX);
        let mut sender = FaultPeer::start(lab, "fault_peer", &["--loopback"]);
        sender.phase("quiet_before", 0.0);
        sender.command("send");
        // The node's memory is read after half a second of estimates.
        std::thread::sleep(Duration::from_millis(500));
        let before = resident_mib(node.id());
        sender.command("phase killing");
        for round in 1.. {
            kill_in_the_middle(lab, 2);
            if !long() || round == 5 {
                break;
            }
            std::thread::sleep(LEASE);
        }
        sender.phase("after", 1.0);
        let grown = resident_mib(node.id()).saturating_sub(before);
        assert!(node.is_running());
        let records = sender.finish();
        records.is_sound();
        assert!(
            records.answered("killing") > 0.95 && records.answered("after") > 0.99,
            "{}",
            records.summary()
        );
        assert!(grown <= LONG_MIB, "{grown} MiB");
        Outcome::Passed(format!(
            "{:.1} % answered while peers were killed while sending long requests, {grown} MiB",
            1e2 * records.answered("killing")
        ))
    });
}

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn two_nodes_with_the_same_name_both_report_it() {
    interop("two nodes of one name", |lab| {
        let first = lab.node(PRESET, NO_ARX);
        let sender = FaultPeer::start(lab, "fault_peer", &["--loopback"]);
        let second = lab.start_with(
            "mr-damper twin",
            &crate::interop_support::gate::binary(),
            &[&["node", "--ros-args", "-p", &format!("model:={PRESET}")], NO_ARX].concat(),
            &[],
        );
        for name in ["mr-damper node", "mr-damper twin"] {
            lab.wait_for_log(name, "/force_estimate has another publisher");
        }
        let records = sender.finish();
        let warned: Vec<_> =
            records.diagnostics.iter().map(|status| text(&status[3], "/other_publishers")).collect();
        assert!(warned.contains(&"1"), "{warned:?}");
        let message = records.diagnostics.last().and_then(|status| status[2].as_str()).expect("a message");
        assert!(message.contains("stop the other node of this name"), "{message}");
        drop((first, second));
        Outcome::Passed(message.to_owned())
    });
}
