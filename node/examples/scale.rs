//! Measures what many dampers in one process cost.
//!
//! It starts a node with `--dampers` dampers and feeds them at a fixed rate. It prints one line of JSON: lost samples,
//! time from sample to estimate, processor time and memory.
//!
//! ```text
//! cargo build --release --workspace --bins --examples
//! tests/interop/netns.sh run target/release/examples/scale --node target/release/mr-damper --dampers 16 --rate-hz 512
//! ```
//!
//! The driver (this program) runs on the same machine and uses a part of it, which the JSON also states. On two cores
//! the driver is the first to be late. `tests/bench/run.sh` runs many sizes.

#[path = "../tests/all/vehicle_support/mod.rs"]
mod vehicle_support;

use clap::Parser;
use mr_damper_msgs::standard::DiagnosticArray;
use ros2_client::Subscription;
use serde_json::{Map, Value, json};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use vehicle_support::{Corner, Peer, drive, hear, settle, start};

/// Drives a node of many dampers and prints what it cost.
#[derive(Debug, Parser)]
struct Args {
    /// Path of the `mr-damper` program.
    #[arg(long)]
    node: PathBuf,
    /// Number of dampers.
    #[arg(long, default_value_t = 4)]
    dampers: usize,
    /// Samples per second of each damper.
    #[arg(long, default_value_t = 1000.0)]
    rate_hz: f64,
    /// Length of the measurement, s.
    #[arg(long, default_value_t = 10.0)]
    seconds: f64,
    /// Further parameters of the node, as `name:=value`.
    #[arg(long)]
    parameter: Vec<String>,
    /// Number of busy threads that run beside the node and only use processor time.
    #[arg(long, default_value_t = 0)]
    busy: usize,
    /// ROS domain; it must be otherwise unused.
    #[arg(long, default_value_t = 83)]
    domain: i64,
}

/// Processor time used by a process so far, s, and its resident memory, kB.
fn used(process: u32) -> Option<(f64, u64)> {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks = |index: usize| fields.get(index).and_then(|text| text.parse::<f64>().ok());
    // Fields 14 and 15 of the line (two are cut off above). Linux counts 100 ticks per second.
    let processor_s = (ticks(11)? + ticks(12)?) / 100.0;
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let memory = status.lines().find(|line| line.starts_with("VmRSS:"))?;
    Some((processor_s, memory.split_whitespace().nth(1)?.parse().ok()?))
}

/// The worst value of each figure that any damper's node reported since the last call. Medians and 99th percentiles
/// cover one second each.
fn said(diagnostics: &Subscription<DiagnosticArray>) -> Map<String, Value> {
    let mut worst = Map::new();
    while let Ok(Some((array, _))) = diagnostics.take() {
        for value in array.status.iter().flat_map(|status| &status.values) {
            let counts =
                value.key.ends_with("_ms") || ["dropped", "missed_deadlines"].contains(&value.key.as_str());
            let Some(number) = value.value.parse::<f64>().ok().filter(|_| counts) else { continue };
            let before = worst.get(&value.key).and_then(Value::as_f64).unwrap_or(0.0);
            worst.insert(value.key.clone(), json!(number.max(before)));
        }
    }
    worst
}

/// Drives `corners` and receives their estimates. Returns the number of displacements sent, how many of them got no
/// estimate, and the greatest delay of the driver.
fn exchange(corners: &[Corner], args: &Args) -> (usize, usize, Duration) {
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let hearing = scope.spawn(|| hear(corners, &done));
        let (stamps, latest) = drive(corners, args.rate_hz, args.seconds);
        done.store(true, Ordering::Release);
        let heard = hearing.join().unwrap_or_default();
        let lost =
            |heard: &std::collections::BTreeSet<i64>| stamps.iter().filter(|at| !heard.contains(at)).count();
        (stamps.len() * corners.len(), heard.iter().map(lost).sum(), latest)
    })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args = Args::parse();
    let names: Vec<String> = (0..args.dampers).map(|k| format!("damper_{k:03}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let node = start(&args.node, &names, args.domain, &args.parameter);
    let Peer { mut ros, corners } = Peer::start(&names, args.domain);
    let diagnostics = ros.subscribe::<DiagnosticArray>("/diagnostics")?;
    settle(&corners, args.rate_hz);
    // Histories are filled during this time.
    drive(&corners, args.rate_hz, 1.0);
    said(&diagnostics);

    let ended = AtomicBool::new(false);
    let measured = std::thread::scope(|scope| {
        for _ in 0..args.busy {
            scope.spawn(|| {
                while !ended.load(Ordering::Relaxed) {
                    std::hint::spin_loop()
                }
            });
        }
        let used = || Some((used(node.0.id())?, used(std::process::id())?));
        let (before, began) = (used(), Instant::now());
        let exchanged = exchange(&corners, &args);
        let measured = (before, used(), began.elapsed().as_secs_f64(), exchanged);
        ended.store(true, Ordering::Relaxed);
        measured
    });
    let (before, after, took_s, (sent, lost, latest)) = measured;
    let (Some((node_before, own_before)), Some((node_after, own_after))) = (before, after) else {
        return Err("the node ended during the measurement; see its log".into());
    };
    println!(
        "{}",
        json!({
            "dampers": args.dampers, "rate_hz": args.rate_hz, "seconds": args.seconds, "sent": sent, "lost": lost,
            "node_cores": (node_after.0 - node_before.0) / took_s,
            "driver_cores": (own_after.0 - own_before.0) / took_s - args.busy as f64,
            "driver_late_ms": latest.as_secs_f64() * 1e3,
            "memory_mb": node_after.1 as f64 / 1024.0,
            "said": said(&diagnostics),
        })
    );
    drop((corners, diagnostics));
    ros.stop();
    Ok(())
}
