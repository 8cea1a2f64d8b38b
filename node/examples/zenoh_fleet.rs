//! Simulates a fleet from one damper.
//!
//! The program records a real damper for some seconds. It then replays the recording in a loop under the names of many
//! vehicles. Each vehicle is a session of its own, a client of one router; supervisors receive all of them. The program
//! prints how many messages arrived, how late they were, and what they cost the router.
//!
//! ```text
//! cargo run --release --example zenoh_fleet -- --damper tcp/127.0.0.1:7447 --router tcp/127.0.0.1:7448 --vehicles 50
//! ```
//!
//! `tests/interop/fleet.sh` starts the damper and the router and runs many sizes; `node/docs/fleet.md` has the results.
//! Sender and supervisor use one clock, so that the delay can be measured. Both run on the router's machine and use a
//! part of it.

use clap::Parser;
use serde_json::json;
use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use zenoh::{Session, Wait};

/// Replays one damper's messages under the names of a fleet.
#[derive(Debug, Parser)]
struct Args {
    /// Zenoh endpoint of a real damper; replay a run to it during the recording.
    #[arg(long)]
    damper: String,
    /// Zenoh endpoint of the fleet's router.
    #[arg(long)]
    router: String,
    /// Zenoh endpoint of the router that supervisors connect to, if it is a different one.
    #[arg(long)]
    upper: Option<String>,
    /// Process id of the router, to measure its processor time and memory.
    #[arg(long)]
    router_pid: Option<u32>,
    /// Keys of the damper that are replayed.
    #[arg(long, default_value = "mr_damper/**/web/*")]
    keys: String,
    /// Number of vehicles, each with its own session.
    #[arg(long, default_value_t = 10)]
    vehicles: usize,
    /// Dampers per vehicle.
    #[arg(long, default_value_t = 4)]
    dampers: usize,
    /// Number of supervisors; each receives all messages.
    #[arg(long, default_value_t = 1)]
    supervisors: usize,
    /// Length of the recording that is replayed in a loop, s.
    #[arg(long, default_value_t = 3.0)]
    record_s: f64,
    /// Length of the measurement, s.
    #[arg(long, default_value_t = 10.0)]
    seconds: f64,
}

/// A recorded message of the damper.
#[derive(Debug)]
struct Said {
    after: Duration,
    /// The end of its key, for example `web/force_estimate`.
    what: String,
    bytes: Vec<u8>,
}

/// Attachment of each message: its number on the key, and when it was sent, ns after the process began.
type Mark = [u8; 16];

fn main() -> zenoh::Result<()> {
    let args = Args::parse();
    let said = record(&args)?;
    let bytes: usize = said.iter().map(|said| said.bytes.len()).sum();
    eprintln!(
        "one damper sends {:.0} messages and {:.1} kB per second",
        said.len() as f64 / args.record_s,
        bytes as f64 / args.record_s / 1e3
    );
    let began = Instant::now();
    let heard: Vec<Arc<Mutex<Lateness>>> = (0..args.supervisors).map(|_| Arc::default()).collect();
    let mut supervisors = Vec::new();
    for heard in &heard {
        supervisors.push(supervise(&args, heard, began)?);
    }
    let opening = Instant::now();
    let vehicles: Vec<Session> =
        (0..args.vehicles).map(|_| client(&args.router)).collect::<zenoh::Result<_>>()?;
    let opened_s = opening.elapsed().as_secs_f64();

    let (counts, done, sent) = (AtomicBool::new(false), AtomicBool::new(false), AtomicU64::new(0));
    let play = Play { args: &args, said: &said, began, counts: &counts, done: &done, sent: &sent };
    let (spent_s, late_s) = std::thread::scope(|scope| {
        // Two threads send: on few cores, more would only block each other.
        let half = vehicles.len().div_ceil(2).max(1);
        let senders: Vec<_> = vehicles
            .chunks(half)
            .enumerate()
            .map(|(k, some)| scope.spawn(move || play.send(some, k * half)))
            .collect();
        std::thread::sleep(Duration::from_secs(2));
        heard.iter().for_each(|heard| heard.lock().expect("no panic").clear());
        let before_s = args.router_pid.map(used_s);
        counts.store(true, Ordering::Release);
        std::thread::sleep(Duration::from_secs_f64(args.seconds));
        counts.store(false, Ordering::Release);
        let after_s = args.router_pid.map(used_s);
        // Wait for messages that are still on their way.
        std::thread::sleep(Duration::from_secs(1));
        done.store(true, Ordering::Release);
        let late_s = senders.into_iter().map(|sender| sender.join().expect("no panic")).fold(0.0, f64::max);
        (after_s.zip(before_s).map(|(after, before)| after - before), late_s)
    });
    let sent = sent.load(Ordering::Relaxed);
    let (mut received, mut late_us) = (0_u64, Vec::new());
    for heard in &heard {
        let heard = heard.lock().expect("no panic");
        received += heard.len() as u64;
        late_us.extend_from_slice(&heard);
    }
    late_us.sort_unstable();
    let quantile = |q: f64| late_us.get(((late_us.len() as f64 - 1.0).max(0.0) * q) as usize).copied();
    let wanted = sent * args.supervisors as u64;
    println!(
        "{}",
        json!({
            "vehicles": args.vehicles, "dampers": args.vehicles * args.dampers, "supervisors": args.supervisors,
            "sessions_opened_s": opened_s,
            "sent_per_s": sent as f64 / args.seconds,
            "sent_bytes_per_s": bytes as f64 / said.len() as f64 * sent as f64 / args.seconds,
            "lost": wanted.saturating_sub(received), "lost_share": wanted.saturating_sub(received) as f64 / wanted.max(1) as f64,
            "latency_us": { "p50": quantile(0.5), "p99": quantile(0.99), "max": quantile(1.0) },
            "sender_late_s": late_s,
            "router_cores": spent_s.map(|spent| spent / args.seconds),
            "router_us_per_message": spent_s.map(|spent| spent * 1e6 / sent.max(1) as f64),
            "router_memory_mb": args.router_pid.map(memory_mb),
        })
    );
    Ok(())
}

/// A session that connects to `endpoint` only.
fn client(endpoint: &str) -> zenoh::Result<Session> {
    let mut config = zenoh::Config::default();
    config.insert_json5("mode", "\"client\"")?;
    config.insert_json5("connect/endpoints", &format!("[{endpoint:?}]"))?;
    // The router may still be starting.
    config.insert_json5("connect/timeout_ms", "10000")?;
    config.insert_json5("scouting/multicast/enabled", "false")?;
    zenoh::open(config).wait()
}

/// Records the real damper's messages with their times.
fn record(args: &Args) -> zenoh::Result<Vec<Said>> {
    let session = client(&args.damper).map_err(|error| format!("--damper {}: {error}", args.damper))?;
    let samples = session.declare_subscriber(&args.keys).wait()?;
    let (mut said, mut began) = (Vec::new(), None);
    let length = Duration::from_secs_f64(args.record_s);
    while let Some(sample) = samples.recv_timeout(Duration::from_secs(10))? {
        let began = *began.get_or_insert_with(Instant::now);
        if began.elapsed() >= length {
            return Ok(said);
        }
        let key = sample.key_expr().as_str();
        let what = key.rmatch_indices('/').nth(1).map_or(key, |(at, _)| &key[at + 1..]).to_owned();
        said.push(Said { after: began.elapsed(), what, bytes: sample.payload().to_bytes().into_owned() });
    }
    Err(format!("{} sent nothing on {} within 10 s; replay a run to it", args.damper, args.keys).into())
}

/// Delay of each message that a supervisor received during the measurement, us.
type Lateness = Vec<u32>;

/// A session that receives the messages of the whole fleet.
fn supervise(args: &Args, heard: &Arc<Mutex<Lateness>>, began: Instant) -> zenoh::Result<Session> {
    let router = args.upper.as_deref().unwrap_or(&args.router);
    let session = client(router).map_err(|error| format!("{router}: {error}"))?;
    let heard = Arc::clone(heard);
    session
        .declare_subscriber("mr_damper/fleet/**")
        .callback(move |sample| {
            let mark = sample.attachment().map(|mark| mark.to_bytes().into_owned());
            let Some(Ok(mark)) = mark.map(Mark::try_from) else { return };
            // Messages outside the measurement have the number 0.
            let (number, sent_ns) = halves(mark);
            if number > 0 {
                let late = began.elapsed().saturating_sub(Duration::from_nanos(sent_ns));
                let late_us = u32::try_from(late.as_micros()).unwrap_or(u32::MAX);
                heard.lock().expect("no panic").push(late_us);
            }
        })
        .background()
        .wait()?;
    Ok(session)
}

fn mark(number: u64, began: Instant) -> Mark {
    let mut mark = [0; 16];
    mark[..8].copy_from_slice(&number.to_le_bytes());
    mark[8..].copy_from_slice(&(began.elapsed().as_nanos() as u64).to_le_bytes());
    mark
}

fn halves(mark: Mark) -> (u64, u64) {
    let half = |at: usize| u64::from_le_bytes(std::array::from_fn(|k| mark[at + k]));
    (half(0), half(8))
}

/// State that the senders share.
#[derive(Clone, Copy)]
struct Play<'a> {
    args: &'a Args,
    said: &'a [Said],
    /// The moment from which times are measured.
    began: Instant,
    /// True during the measurement: messages are numbered.
    counts: &'a AtomicBool,
    done: &'a AtomicBool,
    /// Number of messages sent during the measurement.
    sent: &'a AtomicU64,
}

impl Play<'_> {
    /// Replays the recording as `vehicles` until `done` is set. `first` is the number of the first of them; their
    /// starts are spread over the length of the recording. Returns the sender's greatest delay, s.
    fn send(self, vehicles: &[Session], first: usize) -> f64 {
        let Self { args, said, began, counts, done, sent } = self;
        let length = Duration::from_secs_f64(args.record_s);
        // The messages of all vehicles in one round, ordered by time.
        let mut plan: Vec<(Duration, usize, usize, usize)> = Vec::new();
        for k in 0..vehicles.len() {
            let shift = length.mul_f64((first + k) as f64 / args.vehicles as f64);
            for damper in 0..args.dampers {
                for (number, said) in said.iter().enumerate() {
                    let at = said.after + shift;
                    plan.push((if at >= length { at - length } else { at }, k, damper, number));
                }
            }
        }
        plan.sort_unstable();
        let mut publishers = HashMap::new();
        for (_, k, damper, number) in &plan {
            let what = said[*number].what.as_str();
            publishers.entry((*k, *damper, what)).or_insert_with(|| {
                let key = format!("mr_damper/fleet/vehicle_{:04}/damper_{damper}/{what}", first + k);
                vehicles[*k].declare_publisher(key).wait().expect("a key without wildcards")
            });
        }
        let (start, mut round, mut late_s) = (Instant::now(), 0_u32, 0.0_f64);
        loop {
            for (after, k, damper, number) in &plan {
                let due = start + length * round + *after;
                let now = Instant::now();
                if due > now {
                    std::thread::sleep(due - now);
                }
                let counted = counts.load(Ordering::Acquire);
                if counted {
                    late_s = late_s.max(now.saturating_duration_since(due).as_secs_f64());
                }
                if done.load(Ordering::Acquire) {
                    return late_s;
                }
                let said = &said[*number];
                let number = if counted { 1 + sent.fetch_add(1, Ordering::Relaxed) } else { 0 };
                let publisher = &publishers[&(*k, *damper, said.what.as_str())];
                publisher
                    .put(said.bytes.as_slice())
                    .attachment(mark(number, began).as_slice())
                    .wait()
                    .expect("the session is open");
            }
            round += 1;
        }
    }
}

/// Processor time that a process has used, s.
fn used_s(process: u32) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat"))
        .expect("--router-pid must name a running process");
    let fields: Vec<&str> = stat.rsplit_once(')').map_or("", |(_, rest)| rest).split_whitespace().collect();
    // Linux counts in hundredths of a second.
    fields[11..13].iter().map(|ticks| ticks.parse::<f64>().expect("ticks")).sum::<f64>() / 100.0
}

/// Resident memory of a process, MB.
fn memory_mb(process: u32) -> f64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status"))
        .expect("--router-pid must name a running process");
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).expect("a line of /proc");
    line.split_whitespace().nth(1).and_then(|kb| kb.parse::<f64>().ok()).expect("a number") / 1e3
}
