//! A node with several dampers in its own process, and a peer that publishes their inputs and receives their estimates.

#![allow(dead_code, reason = "the tests and the example each use a part of it")]

use mr_damper_base::clock::system_now;
use mr_damper_msgs::{CoilCurrent, Displacement, ForceEstimate};
use mr_damper_node::estimation::wire::header;
use mr_damper_node::ros2::participant::{Output, Ros};
use mr_damper_node::settings::config::{Config, RosArgs};
use ros2_client::{NodeOptions, Subscription};
use std::collections::BTreeSet;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

pub(crate) const CORNERS: [&str; 4] = ["front_left", "front_right", "rear_left", "rear_right"];
/// Shortest pause between two samples of the peer, as a share of the sample interval.
const CATCH_UP: f64 = 0.25;

/// One damper of the vehicle, as the peer sees it.
pub(crate) struct Corner {
    pub(crate) displacement: Output<Displacement>,
    pub(crate) current: Output<CoilCurrent>,
    pub(crate) estimates: Subscription<ForceEstimate>,
}

/// Kills the node when it is dropped, for example because a test failed.
pub(crate) struct Node(pub(crate) Child);

impl Drop for Node {
    fn drop(&mut self) {
        // If the test passed, the process has already ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Starts `program` as the node of the dampers called `names` in `domain`, with more `parameters`.
pub(crate) fn start(program: &Path, names: &[&str], domain: i64, parameters: &[String]) -> Node {
    let dampers = format!("dampers:=[{}]", names.join(", "));
    let node = Command::new(program)
        .args(["--quiet", "node", "--ros-args", "-p", "model:=thesis/fuzzy-tanh/rp3-cs", "-p", &dampers])
        .args(parameters.iter().flat_map(|parameter| ["-p", parameter.as_str()]))
        .env("ROS_DOMAIN_ID", domain.to_string())
        .stdin(Stdio::null())
        .spawn();
    Node(node.expect("the node starts"))
}

/// The peer of the node.
pub(crate) struct Peer {
    pub(crate) ros: Ros,
    pub(crate) corners: Vec<Corner>,
}

impl Peer {
    /// Joins `domain`, and waits until the node with the dampers `names` is discovered.
    pub(crate) fn start(names: &[&str], domain: i64) -> Self {
        let config = Config { domain_id: domain, ..Config::default() };
        let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
        let mut ros = Ros::start(&config, &RosArgs::default(), options, "vehicle").expect("a peer starts");
        let corners = corners(&mut ros, names);
        let found = || corners.iter().all(|c| ros.readers_of(c.displacement.guid()) > 0);
        let patience = Instant::now() + Duration::from_secs(20);
        while !found() {
            assert!(Instant::now() < patience, "the node is not found");
            std::thread::sleep(Duration::from_millis(50));
        }
        Self { ros, corners }
    }
}

fn corners(ros: &mut Ros, names: &[&str]) -> Vec<Corner> {
    let corner = |name: &&str| Corner {
        displacement: ros.publish(&format!("/{name}/displacement")).expect("a topic"),
        current: ros.publish(&format!("/{name}/coil_current")).expect("a topic"),
        estimates: ros.subscribe(&format!("/{name}/force_estimate")).expect("a topic"),
    };
    names.iter().map(corner).collect()
}

/// Sends motion at `rate_hz` for `seconds`, and returns the stamps and the largest lateness. After a stall of the machine
/// it catches up at four times the rate: a burst of all late samples would overrun the queues of any middleware.
///
/// It returns one interval after the last sample, so the first sample of a second drive has the right distance from it.
pub(crate) fn drive(corners: &[Corner], rate_hz: f64, seconds: f64) -> (Vec<i64>, Duration) {
    let (begin, first) = (Instant::now(), system_now());
    let mut stamps = Vec::with_capacity((rate_hz * seconds) as usize);
    let mut latest = Duration::ZERO;
    for k in 0..(rate_hz * seconds) as u64 {
        let at_s = k as f64 / rate_hz;
        let (due, now) = (Duration::from_secs_f64(at_s), begin.elapsed());
        latest = latest.max(now.saturating_sub(due));
        std::thread::sleep(due.saturating_sub(now).max(Duration::from_secs_f64(CATCH_UP / rate_hz)));
        // Stamps are on the sampling grid, as from a sampling card: a sample sent late was not taken late.
        let stamp = first.shifted((at_s * 1e9).round() as i64);
        for (index, corner) in corners.iter().enumerate() {
            // There are whole cycles per second, so that a second drive continues where the first one ended.
            let phase = std::f64::consts::TAU * 2.0 * at_s + index as f64;
            let (displacement, current) = (0.01 * phase.sin(), if at_s % 2.0 < 1.0 { 0.4 } else { 0.8 });
            let header = header(stamp, "");
            let current = CoilCurrent { header: header.clone(), current, variance: 0.0 };
            let sent = corner.current.publish(current).is_ok()
                && corner.displacement.publish(Displacement { header, displacement, variance: 0.0 }).is_ok();
            assert!(sent, "the middleware accepts samples at this pace");
        }
        stamps.push(stamp.nanos());
    }
    std::thread::sleep(Duration::from_secs_f64(seconds).saturating_sub(begin.elapsed()));
    (stamps, latest)
}

/// Sends motion at `rate_hz`, a second at a time, until each damper's estimates arrive: then all endpoints are matched,
/// which takes longer than a second on a busy machine.
pub(crate) fn settle(corners: &[Corner], rate_hz: f64) {
    let patience = Instant::now() + Duration::from_secs(20);
    loop {
        drive(corners, rate_hz, 1.0);
        if corners.iter().all(|corner| corner.estimates.take().expect("readable").is_some()) {
            return;
        }
        assert!(Instant::now() < patience, "not every damper's estimates arrive");
    }
}

/// Collects the stamps of each damper's estimates until `done`, and half a second longer.
pub(crate) fn hear(corners: &[Corner], done: &AtomicBool) -> Vec<BTreeSet<i64>> {
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
