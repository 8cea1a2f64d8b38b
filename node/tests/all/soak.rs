//! Four dampers in one process for a while: nothing is lost between the node and a peer, the node's counters add up, and its
//! memory does not grow.
//!
//! The test takes a few seconds at 250 Hz by default. `MR_DAMPER_LONG=1` makes it half an hour at 1 kHz (or `MR_DAMPER_SOAK_S`
//! seconds); this needs the release build and an idle machine:
//!
//! ```text
//! MR_DAMPER_LONG=1 cargo test --release --workspace --test all soak -- --nocapture
//! ```

use crate::domain::Domain;
use crate::live_support::Ended;
use crate::turn::turn;
use crate::vehicle_support::{CORNERS, Peer, drive, hear, settle, start};
use crate::wait::wait_until;
use mr_damper_msgs::standard::DiagnosticArray;
use ros2_client::Subscription;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// Largest growth of the node's resident memory after the first third of the test, relative to its size then.
const GROWTH: f64 = 0.02;
/// Longest time from the signal to the end of the process.
const LEAVE: Duration = Duration::from_secs(2);

/// Resources of a process: resident memory in kB, number of threads, number of open files.
fn used(process: u32) -> [u64; 3] {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).expect("it runs");
    let field = |name: &str| {
        let line = status.lines().find(|line| line.starts_with(name)).expect("a line of /proc");
        line.split_whitespace().nth(1).and_then(|text| text.parse().ok()).expect("a number")
    };
    let files = std::fs::read_dir(format!("/proc/{process}/fd")).expect("it runs").count() as u64;
    [field("VmRSS:"), field("Threads:"), files]
}

#[test]
fn four_dampers_lose_nothing_and_do_not_grow() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let long = std::env::var("MR_DAMPER_LONG").as_deref() == Ok("1");
    let asked_s = std::env::var("MR_DAMPER_SOAK_S").ok().and_then(|text| text.parse().ok());
    let (rate_hz, seconds) = if long { (1000.0, asked_s.unwrap_or(1800.0)) } else { (250.0, 4.0) };
    let mut node = start(Path::new(env!("CARGO_BIN_EXE_mr-damper")), &CORNERS, domain.id(), &[]);
    let Peer { mut ros, corners } = Peer::start(&CORNERS, domain.id());
    let diagnostics = ros.subscribe::<DiagnosticArray>("/diagnostics").expect("a topic");
    settle(&corners, rate_hz);
    let done = AtomicBool::new(false);
    let (mut stamps, mut latest) = (Vec::new(), Duration::ZERO);
    let mut memory = Vec::new();
    let heard = std::thread::scope(|scope| {
        let hearing = scope.spawn(|| hear(&corners, &done));
        let driving = scope.spawn(|| {
            let _ended = Ended(&done);
            drive(&corners, rate_hz, seconds)
        });
        while !driving.is_finished() {
            memory.push(used(node.0.id()));
            std::thread::sleep(Duration::from_secs_f64(seconds / 100.0));
        }
        (stamps, latest) = driving.join().expect("it sends");
        hearing.join().expect("it hears")
    });
    let mut all_lost = 0;
    for (name, heard) in CORNERS.iter().zip(&heard) {
        let lost: Vec<usize> = (0..stamps.len()).filter(|k| !heard.contains(&stamps[*k])).collect();
        let first = &lost[..lost.len().min(10)];
        eprintln!(
            "{name}: {} displacements at {rate_hz} Hz, {} without an estimate, first ones {first:?}",
            stamps.len(),
            lost.len()
        );
        all_lost += lost.len();
    }
    eprintln!("the peer was late by {latest:?} at most");
    let (third, last) = (memory[memory.len() / 3], *memory.last().expect("it was looked at"));
    eprintln!("of the node after a third, at the end: [memory kB, threads, files] {third:?}, {last:?}");
    assert_eq!(all_lost, 0, "displacements without an estimate");
    assert_eq!(third[1..], last[1..], "threads and open files do not change");
    // In a few seconds the history of raw input is still filling up.
    if long {
        let grown = last[0] as f64 / third[0] as f64 - 1.0;
        assert!(grown < GROWTH, "resident memory grew by {:.1} % after the first third", 100.0 * grown);
    }

    // Displacement and current for each stamp.
    let sent = 2 * stamps.len() as u64;
    while diagnostics.take().expect("readable").is_some() {}
    let mut counts = BTreeMap::new();
    wait_until("counters that add up", || {
        take_counts(&diagnostics, &mut counts);
        let adds_up = |[received, rest @ ..]: &[u64; COUNTS.len()]| {
            *received >= sent && *received == rest.iter().sum::<u64>()
        };
        let done = counts.len() == CORNERS.len() && counts.values().all(adds_up);
        if done {
            counts.iter().for_each(|(name, counts)| eprintln!("{name}: {COUNTS:?} {counts:?}"));
        }
        done
    });

    let asked = Instant::now();
    let kill = Command::new("kill").args(["-INT", &node.0.id().to_string()]).status().expect("kill runs");
    assert!(kill.success());
    let status = node.0.wait().expect("it ends");
    assert!(status.success() && asked.elapsed() < LEAVE, "{status} after {:?}", asked.elapsed());
    drop((corners, diagnostics));
    ros.stop();
}

/// Counters of messages: the first one is the sum of the others.
const COUNTS: [&str; 6] = ["received", "used", "refused", "unreadable", "dropped", "idle"];

/// Takes the newest counters of each damper from the status messages that have arrived.
fn take_counts(
    diagnostics: &Subscription<DiagnosticArray>,
    counts: &mut BTreeMap<String, [u64; COUNTS.len()]>,
) {
    while let Some((array, _)) = diagnostics.take().expect("readable") {
        for status in array.status.into_iter().filter(|status| status.name.ends_with(": node")) {
            let count = |name| {
                let value = status.values.iter().find(|value| value.key == name).expect("each status has it");
                value.value.parse().expect("a number")
            };
            counts.insert(status.name.clone(), COUNTS.map(count));
        }
    }
}
