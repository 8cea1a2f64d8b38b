//! Four dampers in one process for a while: nothing is lost between the node and a peer, and memory does not grow.
//!
//! A few seconds at 250 Hz by default. `MR_DAMPER_LONG=1` makes it half an hour at 1 kHz (or `MR_DAMPER_SOAK_S`), for which the
//! binary has to be the release build and the machine idle:
//!
//! ```text
//! MR_DAMPER_LONG=1 cargo test --release --workspace --test soak -- --nocapture
//! ```

use mr_damper_msgs::{CoilCurrent, Displacement, ForceEstimate};
use mr_damper_node::clock::system_now;
use mr_damper_node::config::{Config, RosArgs};
use mr_damper_node::ros::Ros;
use mr_damper_node::wire::header;
use ros2_client::{NodeOptions, Publisher, Subscription};
use std::collections::BTreeSet;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const DOMAIN: i64 = 68;
const CORNERS: [&str; 4] = ["front_left", "front_right", "rear_left", "rear_right"];
/// How much the resident memory of the node may grow after its first third, of what it is then.
const GROWTH: f64 = 0.02;
/// The end of the process after a signal.
const LEAVE: Duration = Duration::from_secs(2);

/// A corner as the peer sees it.
struct Corner {
    displacement: Publisher<Displacement>,
    current: Publisher<CoilCurrent>,
    estimates: Subscription<ForceEstimate>,
}

/// Ends the node when a test fails before it does.
struct Node(Child);

impl Drop for Node {
    fn drop(&mut self) {
        // It has ended, where all went well.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// What the system says of a process: resident memory, kB; threads; open files.
fn used(process: u32) -> [u64; 3] {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).expect("it runs");
    let field = |name: &str| {
        let line = status.lines().find(|line| line.starts_with(name)).expect("a line of /proc");
        line.split_whitespace().nth(1).and_then(|text| text.parse().ok()).expect("a number")
    };
    let files = std::fs::read_dir(format!("/proc/{process}/fd")).expect("it runs").count() as u64;
    [field("VmRSS:"), field("Threads:"), files]
}

fn start() -> Node {
    let dampers = format!("dampers:=[{}]", CORNERS.join(", "));
    let node = Command::new(env!("CARGO_BIN_EXE_mr-damper"))
        .args(["--quiet", "node", "--ros-args", "-p", "model:=thesis/fuzzy-tanh/rp3-cs", "-p", &dampers])
        .env("ROS_DOMAIN_ID", DOMAIN.to_string())
        .stdin(Stdio::null())
        .spawn();
    Node(node.expect("the node starts"))
}

fn corners(ros: &mut Ros) -> Vec<Corner> {
    let corner = |name: &&str| Corner {
        displacement: ros.publish(&format!("/{name}/displacement")).expect("a topic"),
        current: ros.publish(&format!("/{name}/coil_current")).expect("a topic"),
        estimates: ros.subscribe(&format!("/{name}/force_estimate")).expect("a topic"),
    };
    CORNERS.iter().map(corner).collect()
}

/// Sends motion at `rate_hz` for `seconds`, and returns the stamps.
fn drive(corners: &[Corner], rate_hz: f64, seconds: f64) -> Vec<i64> {
    let (begin, first) = (Instant::now(), system_now());
    let mut stamps = Vec::with_capacity((rate_hz * seconds) as usize);
    for k in 0..(rate_hz * seconds) as u64 {
        let at_s = k as f64 / rate_hz;
        std::thread::sleep(Duration::from_secs_f64(at_s).saturating_sub(begin.elapsed()));
        // On the grid, as those of a sampling card are: what is sent late was not sampled late.
        let stamp = first.shifted((at_s * 1e9).round() as i64);
        for (index, corner) in corners.iter().enumerate() {
            // Whole cycles a second, so that a second drive goes on where the first ended.
            let phase = std::f64::consts::TAU * 2.0 * at_s + index as f64;
            let (displacement, current) = (0.01 * phase.sin(), if at_s % 2.0 < 1.0 { 0.4 } else { 0.8 });
            let header = header(stamp, "");
            let current = CoilCurrent { header: header.clone(), current, variance: 0.0 };
            let sent = corner.current.publish(current).is_ok()
                && corner.displacement.publish(Displacement { header, displacement, variance: 0.0 }).is_ok();
            assert!(sent, "the middleware takes what is paced");
        }
        stamps.push(stamp.nanos());
    }
    stamps
}

/// Takes estimates until `done`, and then for a moment more; the stamps of each corner's.
fn hear(corners: &[Corner], done: &AtomicBool) -> Vec<BTreeSet<i64>> {
    let mut heard = vec![BTreeSet::new(); corners.len()];
    let mut end = None;
    while end.is_none_or(|end| Instant::now() < end) {
        for (corner, heard) in corners.iter().zip(&mut heard) {
            while let Some((estimate, _)) = corner.estimates.take().expect("readable") {
                heard.insert(estimate.header.stamp.as_nanos());
            }
        }
        if done.load(Ordering::Acquire) {
            end.get_or_insert_with(|| Instant::now() + Duration::from_millis(500));
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    heard
}

#[test]
fn four_dampers_lose_nothing_and_do_not_grow() {
    let long = std::env::var("MR_DAMPER_LONG").as_deref() == Ok("1");
    let asked_s = std::env::var("MR_DAMPER_SOAK_S").ok().and_then(|text| text.parse().ok());
    let (rate_hz, seconds) = if long { (1000.0, asked_s.unwrap_or(1800.0)) } else { (250.0, 4.0) };
    let mut node = start();
    let config = Config { domain_id: DOMAIN, ..Config::default() };
    let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
    let mut ros = Ros::start(&config, &RosArgs::default(), options, "soak").expect("a peer starts");
    let corners = corners(&mut ros);
    let found = || corners.iter().all(|c| c.displacement.get_subscription_count(ros.node()) > 0);
    let patience = Instant::now() + Duration::from_secs(20);
    while !found() {
        assert!(Instant::now() < patience, "the node is not found");
        std::thread::sleep(Duration::from_millis(50));
    }
    // What arrives while endpoints are still matched counts for nothing.
    let done = AtomicBool::new(false);
    let mut stamps = Vec::new();
    let mut memory = Vec::new();
    let heard = std::thread::scope(|scope| {
        let hearing = scope.spawn(|| hear(&corners, &done));
        let driving = scope.spawn(|| {
            drive(&corners, rate_hz, 1.0);
            let stamps = drive(&corners, rate_hz, seconds);
            done.store(true, Ordering::Release);
            stamps
        });
        while !driving.is_finished() {
            memory.push(used(node.0.id()));
            std::thread::sleep(Duration::from_secs_f64(seconds / 100.0));
        }
        stamps = driving.join().expect("it sends");
        hearing.join().expect("it hears")
    });
    let mut all_lost = 0;
    for (name, heard) in CORNERS.iter().zip(&heard) {
        let lost = stamps.iter().filter(|stamp| !heard.contains(stamp)).count();
        eprintln!("{name}: {} displacements at {rate_hz} Hz, {lost} without an estimate", stamps.len());
        all_lost += lost;
    }
    let (third, last) = (memory[memory.len() / 3], *memory.last().expect("it was looked at"));
    eprintln!("of the node after a third, at the end: [memory kB, threads, files] {third:?}, {last:?}");
    assert_eq!(all_lost, 0, "displacements without an estimate");
    assert_eq!(third[1..], last[1..], "threads and files stay");
    // In a few seconds the history of raw input still fills.
    if long {
        let grown = last[0] as f64 / third[0] as f64 - 1.0;
        assert!(grown < GROWTH, "resident memory grew by {:.1} % after the first third", 100.0 * grown);
    }

    let asked = Instant::now();
    let kill = Command::new("kill").args(["-INT", &node.0.id().to_string()]).status().expect("kill runs");
    assert!(kill.success());
    let status = node.0.wait().expect("it ends");
    assert!(status.success() && asked.elapsed() < LEAVE, "{status} after {:?}", asked.elapsed());
    drop(corners);
    ros.stop();
}
