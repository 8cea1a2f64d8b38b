//! Four dampers at full rate through Zenoh: every sample of every topic arrives, and what the bridge costs is said.
//!
//! A few seconds at 250 Hz by default; `MR_DAMPER_LONG=1` makes it a minute at 1 kHz, for which the binary has to be the release
//! build and the machine idle:
//!
//! ```text
//! MR_DAMPER_LONG=1 cargo test --release --workspace --test zenoh_load -- --nocapture
//! ```

mod vehicle_support;

use std::collections::{BTreeMap, HashSet};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use vehicle_support::{CORNERS, Peer, drive, start};
use zenoh::Wait;

const DOMAIN: i64 = 69;
/// By which the system counts processor time: `USER_HZ`, the same on every Linux.
const TICKS_A_SECOND: f64 = 100.0;

/// What came on one key.
#[derive(Default)]
struct Route {
    count: u64,
    first: u64,
    last: u64,
    /// Stamps of estimates, ns.
    stamps: HashSet<i64>,
}

/// Clock ticks that each kind of thread of a process has used, by the system's count.
fn used(process: u32) -> BTreeMap<String, u64> {
    let mut ticks = BTreeMap::new();
    for task in std::fs::read_dir(format!("/proc/{process}/task")).expect("it runs").flatten() {
        // A thread may have ended since.
        let Ok(stat) = std::fs::read_to_string(task.path().join("stat")) else { continue };
        let (name, rest) =
            stat.split_once('(').and_then(|(_, rest)| rest.rsplit_once(')')).expect("a name in brackets");
        let fields: Vec<&str> = rest.split_whitespace().collect();
        let spent: u64 = fields[11..13].iter().map(|text| text.parse::<u64>().expect("ticks")).sum();
        *ticks.entry(name.to_owned()).or_default() += spent;
    }
    ticks
}

/// True for the bridge's own threads, and for those of the Zenoh library.
fn is_zenoh(thread: &str) -> bool {
    ["zenoh", "app-", "acc-", "rx-", "tx-", "net-"].iter().any(|prefix| thread.starts_with(prefix))
}

#[test]
fn four_dampers_arrive_whole() {
    let long = std::env::var("MR_DAMPER_LONG").as_deref() == Ok("1");
    let (rate_hz, seconds) = if long { (1000.0, 60.0) } else { (250.0, 4.0) };
    let port =
        std::net::TcpListener::bind("127.0.0.1:0").and_then(|l| l.local_addr()).expect("a free port").port();
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let node = start(DOMAIN, &[format!("zenoh.listen:=[\"{endpoint}\"]")]);
    let Peer { ros, corners } = Peer::start(DOMAIN);
    let routes: Arc<Mutex<BTreeMap<String, Route>>> = Arc::default();
    let _session = listen(&endpoint, &routes);

    // What is sent while endpoints are still matched counts for nothing.
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
        "the bridge and Zenoh's threads: {:.0} % of the node's processor time, which was {:.2} of a core; the peer was late by \
         {latest:?} at most",
        100.0 * bridge / all,
        all / TICKS_A_SECOND / took.as_secs_f64(),
    );
    assert!(bridge > 0.0 && bridge < all, "threads are told apart by their names: {:?}", after.keys());
    for corner in CORNERS {
        let missing = missing(corner);
        eprintln!("{corner}: {missing} of {} displacements without an estimate", stamps.len());
        assert_eq!(missing, 0, "{corner}");
    }
    for (key, route) in routes.lock().expect("no panic").iter() {
        assert_eq!(route.last - route.first + 1, route.count, "{key}: numbers without a gap");
    }
    drop(corners);
    ros.stop();
}

/// Hears everything that the node at `endpoint` says.
fn listen(endpoint: &str, routes: &Arc<Mutex<BTreeMap<String, Route>>>) -> zenoh::Session {
    let mut config = zenoh::Config::default();
    for (key, value) in [
        ("listen/endpoints", "[]".to_owned()),
        ("connect/endpoints", format!("[\"{endpoint}\"]")),
        ("scouting/multicast/enabled", "false".to_owned()),
    ] {
        config.insert_json5(key, &value).expect("these are Zenoh's settings");
    }
    let session = zenoh::open(config).wait().expect("a peer always opens");
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

/// Number and stamp of a payload, ns. They stand first in the CBOR map; to decode the rest would cost more than all that is
/// measured here.
fn head_of(payload: &[u8]) -> (u64, i64) {
    let (seq, rest) = uint(payload[1..].strip_prefix(b"\x63seq").expect("seq stands first"));
    let (stamp, _) = uint(rest.strip_prefix(b"\x68stamp_ns").expect("stamp_ns stands second"));
    (seq, i64::try_from(stamp).expect("before 2262"))
}

/// A whole number of CBOR, and what follows it.
fn uint(bytes: &[u8]) -> (u64, &[u8]) {
    let (head, rest) = bytes.split_first().expect("a head");
    if *head < 24 {
        return (u64::from(*head), rest);
    }
    let (number, rest) = rest.split_at(1 << (head - 24));
    (number.iter().fold(0, |number, byte| number << 8 | u64::from(*byte)), rest)
}
