//! Peers and nodes that stop without a word, die in the middle of one, or are there twice.

use super::NO_ARX;
use super::told::{FaultPeer, Told};
use crate::PEER;
use crate::interop_support::gate::{Outcome, interop, long};
use crate::interop_support::json::text;
use crate::interop_support::process::resident_mib;
use crate::interop_support::{Distro, Lab, PRESET};
use mr_damper_model::pipeline::{Mode, Reasons, Settings};
use std::time::Duration;

/// From the end of a stop to the first VALID estimate, at most, s.
const BACK_S: f64 = 1.0;
/// From estimate to peer on loopback, on a busy machine, s.
const WAY_S: f64 = 0.3;
/// Growth of the node's memory for a reader that does not read, at most, MiB: a topic's history of 1024 estimates is less than one.
const GROWTH_MIB: u64 = 8;

/// Stops a program for a while.
fn stop_for(seconds: f64, signal: impl Fn(&str)) {
    signal("STOP");
    std::thread::sleep(Duration::from_secs_f64(seconds));
    signal("CONT");
}

/// No VALID estimate is of a displacement that was older than `input_timeout_s` when the estimate came.
fn none_is_stale(told: &Told) -> f64 {
    let valid = told.heard.iter().filter(|heard| heard.is_valid());
    let oldest_s = valid.map(|heard| (heard.at_ns - heard.stamp_ns) as f64 * 1e-9).fold(0.0, f64::max);
    let limit_s = Settings::default().input_timeout_s + WAY_S;
    assert!(oldest_s <= limit_s, "a VALID estimate that was {oldest_s:.2} s old: {}", told.summary());
    oldest_s
}

/// The modes that were entered while a phase lasted, each once.
fn modes(told: &Told, phase: &str) -> Vec<u8> {
    let (number, _) = told.phase(phase);
    let mut modes: Vec<u8> =
        told.heard.iter().filter(|heard| heard.phase == number).map(|heard| heard.mode).collect();
    modes.dedup();
    modes
}

#[test]
fn a_sender_a_reader_and_the_node_may_stop_and_go_on() {
    interop("suspended sender, reader, node", |lab| {
        let node = lab.node(PRESET, NO_ARX);
        let mut sender = FaultPeer::start(lab, "fault_peer sender", &["--loopback"]);
        let mut reader = FaultPeer::start(lab, "fault_peer reader", &["--loopback"]);
        sender.tell("phase all");
        sender.tell("send");
        reader.phase("all", 1.0);

        reader.tell("phase no_sender");
        stop_for(3.0, |signal| sender.signal(signal));
        reader.phase("sender_back", 1.0);
        sender.phase("sender_back", 0.0);

        // Reliable, and silent: nothing may wait for it, nor be kept for it without bound.
        let before = resident_mib(node.id());
        sender.tell("phase no_reader");
        stop_for(if long() { 600.0 } else { 6.0 }, |signal| reader.signal(signal));
        let grown = resident_mib(node.id()).saturating_sub(before);

        sender.tell("phase no_node");
        stop_for(3.0, |signal| node.signal(signal));
        sender.phase("node_back", 1.5);
        let (sent, read) = (sender.told(), reader.told());
        sent.is_sound();

        assert_eq!(modes(&read, "no_sender"), [Mode::Model as u8, Mode::Hold as u8, Mode::Fault as u8], "{}", read.summary());
        let (_, back_ns) = read.phase("sender_back");
        let first = read.heard.iter().find(|heard| heard.is_valid() && heard.at_ns > back_ns);
        let back_s = (first.expect("VALID again").at_ns - back_ns) as f64 * 1e-9;
        assert!(back_s < BACK_S, "{back_s:.2} s: {}", read.summary());

        assert_eq!(sent.answered("no_reader"), 1.0, "a reader that stalls costs the others nothing");
        assert!(grown <= GROWTH_MIB, "{grown} MiB for a reader that does not read");

        let node_back_s = sent.valid_after_s("node_back");
        assert!(node_back_s < BACK_S, "{node_back_s:.2} s: {}", sent.summary());
        let oldest_s = none_is_stale(&sent);
        // Before VALID, the backlog was estimated and said to be late, or the silence was said.
        let (_, from_ns) = sent.phase("node_back");
        let woken = sent.heard.iter().find(|heard| heard.at_ns > from_ns).expect("it goes on");
        assert!(woken.reasons != Reasons::NONE, "the first word after the stop is flagged: {woken:?}");
        Outcome::Passed(format!(
            "sender stopped: hold, fault, VALID again after {:.0} ms; reader stopped: {grown} MiB, none lost to others; node \
             stopped 3 s: VALID again after {:.0} ms, the oldest VALID one {:.0} ms old",
            1e3 * back_s,
            1e3 * node_back_s,
            1e3 * oldest_s
        ))
    });
}

/// Kills peers one after the other while they send messages of megabytes, in fragments.
fn kill_in_the_middle(lab: &Lab, times: u64) {
    for turn in 0..times {
        let mut peer = lab.ros(Distro::Jazzy, "long_peer.py", &[]);
        assert_eq!(text(&peer.json_line(PEER), "/event"), "sending");
        std::thread::sleep(Duration::from_millis(300 + 37 * turn));
        peer.signal("KILL");
        assert!(!peer.wait(Duration::from_secs(5)).success());
    }
}

#[test]
fn peers_that_are_killed_in_the_middle_of_long_messages_harm_nobody() {
    interop("peers killed in the middle", |lab| {
        let mut node = lab.node(PRESET, NO_ARX);
        let mut sender = FaultPeer::start(lab, "fault_peer", &["--loopback"]);
        sender.phase("quiet_before", 0.0);
        sender.tell("send");
        std::thread::sleep(Duration::from_millis(500));
        let before = resident_mib(node.id());
        sender.tell("phase killing");
        kill_in_the_middle(lab, if long() { 20 } else { 2 });
        sender.phase("after", 1.0);
        let grown = resident_mib(node.id()).saturating_sub(before);
        assert!(node.is_running());
        let told = sender.told();
        told.is_sound();
        assert!(told.answered("killing") > 0.99 && told.answered("after") > 0.99, "{}", told.summary());
        assert!(grown <= 32, "{grown} MiB");
        Outcome::Passed(format!(
            "{:.1} % answered while peers died in fragments of long requests, {grown} MiB",
            1e2 * told.answered("killing")
        ))
    });
}

#[test]
fn two_nodes_of_one_name_both_say_so() {
    interop("two nodes of one name", |lab| {
        let first = lab.node(PRESET, NO_ARX);
        let sender = FaultPeer::start(lab, "fault_peer", &["--loopback"]);
        let second = lab.start_with(
            "mr-damper twin",
            &crate::interop_support::gate::binary(),
            &[&["node", "--ros-args", "-p", &format!("model:={PRESET}")], NO_ARX].concat(),
            &[],
        );
        std::thread::sleep(Duration::from_millis(3500));
        for name in ["mr-damper node", "mr-damper twin"] {
            let said = lab.last_log(name);
            assert!(said.contains("/force_estimate has another publisher"), "{name}: {said}");
        }
        let told = sender.told();
        let warned: Vec<_> = told.diagnostics.iter().map(|status| text(&status[3], "/other_publishers")).collect();
        assert!(warned.contains(&"1"), "{warned:?}");
        let message = told.diagnostics.last().and_then(|status| status[2].as_str()).expect("a message");
        assert!(message.contains("end the other node of this name"), "{message}");
        drop((first, second));
        Outcome::Passed(message.to_owned())
    });
}
