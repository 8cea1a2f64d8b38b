//! Four dampers at full rate through Zenoh: every sample of every topic arrives, the processor time of the bridge is printed,
//! and a subscriber that stops reading does not slow down the others.
//!
//! The test takes a few seconds at 250 Hz by default; `MR_DAMPER_LONG=1` makes it a minute at 1 kHz, which needs the release
//! build and an idle machine:
//!
//! ```text
//! MR_DAMPER_LONG=1 cargo test --release --workspace --test all zenoh_load -- --nocapture --test-threads=1
//! ```

use crate::domain::Domain;
use crate::turn::turn;
use crate::vehicle_support::{CORNERS, Peer, drive, start};
use crate::zenoh_support::proxy;
use crate::zenoh_support::sessions::{endpoint, session};
use mr_damper_msgs::standard::DiagnosticArray;
use ros2_client::Subscription;
use std::collections::{BTreeMap, HashSet};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use zenoh::Wait;

/// Time for which a subscriber does not read, s.
const STALL_S: f64 = 5.0;
/// Unit of the processor time in /proc: `USER_HZ`, the same on every Linux.
const TICKS_A_SECOND: f64 = 100.0;

/// Messages received on one key.
#[derive(Default)]
struct Route {
    count: u64,
    first: u64,
    last: u64,
    /// Stamps of estimates, ns.
    stamps: HashSet<i64>,
}

/// Clock ticks used by each kind of thread of a process, from /proc.
fn used(process: u32) -> BTreeMap<String, u64> {
    let mut ticks = BTreeMap::new();
    for task in std::fs::read_dir(format!("/proc/{process}/task")).expect("it runs").flatten() {
        // A thread may have ended in the meantime.
        let Ok(stat) = std::fs::read_to_string(task.path().join("stat")) else { continue };
        let (name, rest) =
            stat.split_once('(').and_then(|(_, rest)| rest.rsplit_once(')')).expect("a name in brackets");
        let fields: Vec<&str> = rest.split_whitespace().collect();
        let spent: u64 = fields[11..13].iter().map(|text| text.parse::<u64>().expect("ticks")).sum();
        *ticks.entry(name.to_owned()).or_default() += spent;
    }
    ticks
}

/// True for the bridge's own threads and the threads of the Zenoh library.
fn is_zenoh(thread: &str) -> bool {
    ["zenoh", "app-", "acc-", "rx-", "tx-", "net-"].iter().any(|prefix| thread.starts_with(prefix))
}

#[test]
fn every_sample_of_four_dampers_arrives() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let (rate_hz, seconds) = if long() { (1000.0, 60.0) } else { (250.0, 4.0) };
    let endpoint = endpoint();
    let node = start(
        Path::new(env!("CARGO_BIN_EXE_mr-damper")),
        &CORNERS,
        domain.id(),
        &[format!("zenoh.listen:=[\"{endpoint}\"]")],
    );
    let Peer { ros, corners } = Peer::start(&CORNERS, domain.id());
    let routes: Arc<Mutex<BTreeMap<String, Route>>> = Arc::default();
    let _session = listen(&endpoint, &routes);

    // Samples sent while endpoints are still being matched do not count.
    drive(&corners, rate_hz, 1.0);
    let (before, begin) = (used(node.0.id()), Instant::now());
    let (stamps, latest) = drive(&corners, rate_hz, seconds);
    let (after, took) = (used(node.0.id()), begin.elapsed());
    let missing = |corner: &str| {
        let routes = routes.lock().expect("no panic");
        let heard = routes.get(&format!("mr_damper/{corner}/state/force_estimate"));
        heard.map_or(stamps.len(), |route| stamps.iter().filter(|at| !route.stamps.contains(at)).count())
    };
    let patience = Instant::now() + Duration::from_secs(20);
    while CORNERS.iter().any(|corner| missing(corner) > 0) && Instant::now() < patience {
        std::thread::sleep(Duration::from_millis(100));
    }

    let spent = |of: fn(&str) -> bool| {
        let sum = |ticks: &BTreeMap<String, u64>| -> u64 {
            ticks.iter().filter(|(name, _)| of(name)).map(|(_, ticks)| ticks).sum()
        };
        sum(&after).saturating_sub(sum(&before)) as f64
    };
    let (bridge, all) = (spent(is_zenoh), spent(|_| true));
    eprintln!(
        "the bridge and Zenoh's threads use {:.0} % of the node's processor time, which is {:.2} of a core; the peer was late by \
         {latest:?} at most",
        100.0 * bridge / all,
        all / TICKS_A_SECOND / took.as_secs_f64(),
    );
    assert!(bridge > 0.0 && bridge < all, "threads are distinguished by their names: {:?}", after.keys());
    for corner in CORNERS {
        let missing = missing(corner);
        eprintln!("{corner}: {missing} of {} displacements without an estimate", stamps.len());
        assert_eq!(missing, 0, "{corner}");
    }
    for (key, route) in routes.lock().expect("no panic").iter() {
        assert_eq!(route.last - route.first + 1, route.count, "{key}: sequence numbers without a gap");
    }
    drop(corners);
    ros.stop();
}

/// The latency from sample to estimate in the latest `/diagnostics`, ms: the worst of all dampers.
fn worst_ms(diagnostics: &Subscription<DiagnosticArray>) -> f64 {
    let mut worst_ms = 0.0_f64;
    while let Some((array, _)) = diagnostics.take().expect("readable") {
        let values = array.status.iter().flat_map(|status| &status.values);
        for worst in values.filter(|value| value.key == "latency_worst_ms") {
            worst_ms = worst_ms.max(worst.value.parse().expect("a number"));
        }
    }
    worst_ms
}

/// One subscriber of all keys stops reading for five seconds while another one continues: the node and the other one are not
/// affected, and the stalled one can count its missed messages.
#[test]
fn a_stalled_subscriber_affects_nobody_else() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let rate_hz = if long() { 1000.0 } else { 250.0 };
    let endpoint = endpoint();
    let node = start(
        Path::new(env!("CARGO_BIN_EXE_mr-damper")),
        &CORNERS,
        domain.id(),
        &[format!("zenoh.listen:=[\"{endpoint}\"]")],
    );
    let Peer { mut ros, corners } = Peer::start(&CORNERS, domain.id());
    let diagnostics = ros.subscribe("/diagnostics").expect("a topic");
    let (healthy, slow): (Arc<Mutex<BTreeMap<String, Route>>>, Arc<_>) = Default::default();
    let stalled = Arc::new(AtomicBool::new(false));
    let _sessions = [listen(&endpoint, &healthy), listen(&proxy::proxy(&endpoint, &stalled), &slow)];

    drive(&corners, rate_hz, 1.0);
    worst_ms(&diagnostics);
    let (mut stamps, _) = drive(&corners, rate_hz, STALL_S);
    let before_ms = worst_ms(&diagnostics);
    stalled.store(true, Ordering::Release);
    stamps.extend(drive(&corners, rate_hz, STALL_S).0);
    let during_ms = worst_ms(&diagnostics);
    stalled.store(false, Ordering::Release);
    drive(&corners, rate_hz, 1.0);

    let missing = |routes: &Arc<Mutex<BTreeMap<String, Route>>>, corner: &str| {
        let routes = routes.lock().expect("no panic");
        let heard = routes.get(&format!("mr_damper/{corner}/state/force_estimate"));
        heard.map_or(stamps.len(), |route| stamps.iter().filter(|at| !route.stamps.contains(at)).count())
    };
    // The slow subscriber receives what the system buffered for it, and the latest samples.
    let last = |routes: &Arc<Mutex<BTreeMap<String, Route>>>| -> Vec<u64> {
        routes.lock().expect("no panic").values().map(|route| route.last).collect()
    };
    let patience = Instant::now() + Duration::from_secs(20);
    let behind =
        || CORNERS.iter().any(|corner| missing(&healthy, corner) > 0) || last(&healthy) != last(&slow);
    while behind() && Instant::now() < patience {
        std::thread::sleep(Duration::from_millis(100));
    }
    let lost: u64 = slow.lock().expect("no panic").values().map(|r| r.last - r.first + 1 - r.count).sum();
    eprintln!(
        "worst latency from sample to estimate: {before_ms:.3} ms before, {during_ms:.3} ms during the stall; the subscriber missed {lost} messages, \
         as their sequence numbers show"
    );
    for corner in CORNERS {
        assert_eq!(missing(&healthy, corner), 0, "{corner}: the other subscriber received all samples");
        // All messages missing at the stalled subscriber show as gaps in its sequence numbers. The gaps also count messages
        // missed after it resumed reading.
        let routes = slow.lock().expect("no panic");
        let route = &routes[&format!("mr_damper/{corner}/state/force_estimate")];
        let by_numbers = route.last - route.first + 1 - route.count;
        drop(routes);
        let missing = missing(&slow, corner) as u64;
        assert!(
            missing <= by_numbers,
            "{corner}: {missing} are missing, but the sequence numbers show {by_numbers}"
        );
    }
    assert!(before_ms > 0.0 && during_ms > 0.0, "the node reports its latency");
    if long() {
        // In the short form the system's buffers hold five seconds of data.
        assert!(lost > 0, "it did not stall");
        assert!(
            during_ms < 2.0 * before_ms + 1.0,
            "the stall slowed down the node: {during_ms} ms, {before_ms} ms before"
        );
    }
    drop((corners, diagnostics, node));
    ros.stop();
}

/// True if the long form of the tests is requested.
fn long() -> bool {
    std::env::var("MR_DAMPER_LONG").as_deref() == Ok("1")
}

/// Subscribes to all state keys of the node at `endpoint`.
fn listen(endpoint: &str, routes: &Arc<Mutex<BTreeMap<String, Route>>>) -> zenoh::Session {
    let session = session(endpoint, &[]);
    let to = Arc::clone(routes);
    session
        .declare_subscriber("mr_damper/*/state/*")
        .callback(move |sample| {
            let (seq, stamp_ns) = head_of(&sample.payload().to_bytes());
            let key = sample.key_expr().as_str();
            let mut routes = to.lock().expect("no panic");
            let route = routes.entry(key.to_owned()).or_default();
            if route.count == 0 {
                route.first = seq;
            }
            (route.count, route.last) = (route.count + 1, seq);
            if key.ends_with("force_estimate") {
                route.stamps.insert(stamp_ns);
            }
        })
        .background()
        .wait()
        .expect("a key");
    session
}

/// Sequence number and stamp (ns) of a payload. They are the first entries of the CBOR map; decoding the rest would cost more
/// than everything that is measured here.
fn head_of(payload: &[u8]) -> (u64, i64) {
    let (seq, rest) = uint(payload[1..].strip_prefix(b"\x63seq").expect("seq is the first entry"));
    let (stamp, _) = uint(rest.strip_prefix(b"\x68stamp_ns").expect("stamp_ns is the second entry"));
    (seq, i64::try_from(stamp).expect("before 2262"))
}

/// An unsigned integer in CBOR, and the bytes after it.
fn uint(bytes: &[u8]) -> (u64, &[u8]) {
    let (head, rest) = bytes.split_first().expect("a head");
    if *head < 24 {
        return (u64::from(*head), rest);
    }
    let (number, rest) = rest.split_at(1 << (head - 24));
    (number.iter().fold(0, |number, byte| number << 8 | u64::from(*byte)), rest)
}
