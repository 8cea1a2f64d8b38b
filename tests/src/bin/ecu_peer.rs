//! A vehicle's ECU, for the tests of failing readers: sends the inputs of several dampers at a fixed rate, receives their estimates and
//! commands, and reports losses and delays for each phase.
//!
//! Usage: `ecu_peer [--rate HZ] [--dampers N] [--loopback] [--hear]`, with `ROS_DOMAIN_ID` as in any ROS 2 program. The dampers are the
//! namespaces `/d0`, `/d1` and so on. It prints `{"event": "ready"}` once all topics are matched, and then sends until standard input
//! closes; each input line names the phase that begins. A sample is stamped when it is sent, and belongs to the phase of its stamp. At
//! the end it prints
//!
//! ```text
//! {"phases": [{"name", "seconds", "sent",
//!              "estimates": {"lost", "p50_ms", "p99_ms", "worst_ms", "p99_of_seconds_ms"}, "commands": {the same}}],
//!  "diagnostics": [level of each status of the nodes]}
//! ```
//!
//! `p99_of_seconds_ms` holds the 99th percentile of each whole second of the phase, in order.
//!
//! With `--hear` it sends nothing and prints only that it is ready: a ros2-client reader for a test to kill.

use futures::stream::{BoxStream, SelectAll, StreamExt};
use mr_damper_msgs::standard::DiagnosticArray;
use mr_damper_msgs::{CoilCurrent, CurrentCommand, Displacement, ForceEstimate, Message};
use mr_damper_node::estimation::wire::header;
use ros2_client::qos::History;
use ros2_client::{
    Context, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, QosProfile, Subscription,
};
use rustdds::DomainParticipantBuilder;
use serde_json::{Value, json};
use std::collections::HashSet;
use std::io::BufRead;
use std::net::Ipv4Addr;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// Longest time to discover the node.
const PATIENCE: Duration = Duration::from_secs(30);
/// Time from discovering the node to being discovered by it, and from the last sample to its last answer.
const SETTLE: Duration = Duration::from_secs(1);

const SECOND_NS: i64 = 1_000_000_000;

struct Args {
    rate_hz: f64,
    dampers: usize,
    loopback: bool,
    hear: bool,
}

fn args() -> Outcome<Args> {
    let mut args = Args { rate_hz: 500.0, dampers: 1, loopback: false, hear: false };
    let mut given = std::env::args().skip(1);
    while let Some(name) = given.next() {
        let mut value = || given.next().ok_or_else(|| format!("{name} needs a value"));
        match name.as_str() {
            "--rate" => args.rate_hz = value()?.parse()?,
            "--dampers" => args.dampers = value()?.parse()?,
            "--loopback" => args.loopback = true,
            "--hear" => args.hear = true,
            _ => return Err(format!("{name}: use --rate, --dampers, --loopback or --hear").into()),
        }
    }
    Ok(args)
}

/// The topics of one damper that are used here.
struct Damper {
    displacement: Publisher<Displacement>,
    current: Publisher<CoilCurrent>,
    estimates: Subscription<ForceEstimate>,
    commands: Subscription<CurrentCommand>,
}

fn qos() -> QosProfile {
    QosProfile::publisher_default().history(History::KeepLast { depth: 8192 })
}

fn topic<M: Message>(node: &Node, name: &str) -> Outcome<rustdds::Topic> {
    Ok(node.create_topic(&Name::parse(name)?, MessageTypeName::new(M::PACKAGE, M::NAME), &qos())?)
}

impl Damper {
    fn new(node: &mut Node, number: usize) -> Outcome<Self> {
        let name = |topic: &str| format!("/d{number}/{topic}");
        let displacement = topic::<Displacement>(node, &name("displacement"))?;
        let current = topic::<CoilCurrent>(node, &name("coil_current"))?;
        let estimates = topic::<ForceEstimate>(node, &name("force_estimate"))?;
        let commands = topic::<CurrentCommand>(node, &name("current_command"))?;
        Ok(Self {
            displacement: node.create_publisher(&displacement, None)?,
            current: node.create_publisher(&current, None)?,
            estimates: node.create_subscription(&estimates, None)?,
            commands: node.create_subscription(&commands, None)?,
        })
    }

    fn is_found(&self, node: &Node) -> bool {
        self.displacement.get_subscription_count(node) > 0
            && self.current.get_subscription_count(node) > 0
            && self.is_heard(node)
    }

    fn is_heard(&self, node: &Node) -> bool {
        self.estimates.get_publisher_count(node) > 0 && self.commands.get_publisher_count(node) > 0
    }

    /// Sends a sample of a sine of 8 mm and 2 Hz, and returns its stamp.
    fn send(&self, t: f64) -> Outcome<i64> {
        let stamp_ns = unix_ns();
        let header = header(mr_damper_model::sample::Stamp::from_nanos(stamp_ns), "");
        self.current.publish(CoilCurrent { header: header.clone(), current: 0.8, variance: 0.0 })?;
        let displacement = 0.008 * (4.0 * std::f64::consts::PI * t).sin();
        self.displacement.publish(Displacement { header, displacement, variance: 0.0 })?;
        Ok(stamp_ns)
    }
}

fn unix_ns() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
}

/// An answer: the number of its damper, whether it is a command, its stamp, and its arrival time.
type ReceivedAnswer = (usize, bool, i64, i64);

/// The part of a message that is used.
enum Arrived {
    Answer(ReceivedAnswer),
    Status(u8),
}

fn arrivals<'a>(
    dampers: &'a [Damper],
    diagnostics: &'a Subscription<DiagnosticArray>,
) -> SelectAll<BoxStream<'a, Arrived>> {
    let mut all = SelectAll::new();
    for (number, damper) in dampers.iter().enumerate() {
        let answer = move |is_command, ns| Some(Arrived::Answer((number, is_command, ns, unix_ns())));
        let estimates = damper.estimates.async_stream();
        all.push(
            estimates
                .filter_map(move |m| async move { answer(false, m.ok()?.0.header.stamp.as_nanos()) })
                .boxed(),
        );
        let commands = damper.commands.async_stream();
        all.push(
            commands
                .filter_map(move |m| async move { answer(true, m.ok()?.0.header.stamp.as_nanos()) })
                .boxed(),
        );
    }
    let level = |array: DiagnosticArray| array.status.iter().map(|status| status.level).max();
    all.push(
        diagnostics
            .async_stream()
            .filter_map(move |m| async move { level(m.ok()?.0).map(Arrived::Status) })
            .boxed(),
    );
    all
}

/// Sends to all dampers at `rate_hz` until `ended`; returns the stamps by damper.
fn send_all(dampers: &[Damper], rate_hz: f64, ended: &AtomicBool) -> Outcome<Vec<Vec<i64>>> {
    let begin = Instant::now();
    let mut sent = vec![Vec::new(); dampers.len()];
    let mut due_s = 0.0_f64;
    while !ended.load(Ordering::Relaxed) {
        let elapsed_s = begin.elapsed().as_secs_f64();
        if elapsed_s < due_s {
            std::thread::sleep(Duration::from_secs_f64(due_s - elapsed_s));
            continue;
        }
        for (damper, sent) in dampers.iter().zip(&mut sent) {
            sent.push(damper.send(elapsed_s)?);
        }
        // Samples that were due while this process was delayed are skipped.
        due_s = due_s.max(elapsed_s - 1.0 / rate_hz) + 1.0 / rate_hz;
    }
    Ok(sent)
}

/// Losses and delays of one kind of answer to the samples with stamps from `from` to below `to`.
fn figures(sent: &[Vec<i64>], heard: &[ReceivedAnswer], is_command: bool, (from, to): (i64, i64)) -> Value {
    let within = |stamp: &i64| (from..to).contains(stamp);
    let mut awaited: HashSet<(usize, i64)> = HashSet::new();
    for (damper, stamps) in sent.iter().enumerate() {
        awaited.extend(stamps.iter().filter(|stamp| within(stamp)).map(|stamp| (damper, *stamp)));
    }
    let mut delays_ms = Vec::new();
    let mut delays_of_seconds_ms = vec![Vec::new(); usize::try_from((to - from) / SECOND_NS).unwrap_or(0)];
    for (damper, _, stamp, at) in
        heard.iter().filter(|(_, command, stamp, _)| *command == is_command && within(stamp))
    {
        if awaited.remove(&(*damper, *stamp)) {
            let delay_ms = (at - stamp) as f64 * 1e-6;
            delays_ms.push(delay_ms);
            // The last second of a phase is not whole.
            let second = usize::try_from((stamp - from) / SECOND_NS).ok();
            if let Some(delays_ms) = second.and_then(|second| delays_of_seconds_ms.get_mut(second)) {
                delays_ms.push(delay_ms);
            }
        }
    }
    delays_ms.sort_by(f64::total_cmp);
    let p99_of_seconds_ms: Vec<_> = delays_of_seconds_ms
        .iter_mut()
        .map(|delays_ms| {
            delays_ms.sort_by(f64::total_cmp);
            quantile(delays_ms, 0.99)
        })
        .collect();
    let at = |share: f64| quantile(&delays_ms, share);
    json!({
        "lost": awaited.len(), "p50_ms": at(0.5), "p99_ms": at(0.99), "worst_ms": at(1.0),
        "p99_of_seconds_ms": p99_of_seconds_ms,
    })
}

/// The value below which `share` of the `sorted` values lie; `None` without values.
fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    sorted.get(((sorted.len() as f64 - 1.0) * share).max(0.0) as usize).copied()
}

fn report(sent: &[Vec<i64>], heard: &[ReceivedAnswer], phases: &[(String, i64)], end_ns: i64) -> Vec<Value> {
    let ends = phases.iter().skip(1).map(|(_, at)| *at).chain([end_ns]);
    let phase = |((name, from), to): (&(String, i64), i64)| {
        let span = (*from, to);
        let count: usize = sent
            .iter()
            .map(|stamps| stamps.iter().filter(|stamp| (*from..to).contains(*stamp)).count())
            .sum();
        json!({
            "name": name, "seconds": (to - from) as f64 * 1e-9, "sent": count,
            "estimates": figures(sent, heard, false, span), "commands": figures(sent, heard, true, span),
        })
    };
    phases.iter().zip(ends).map(phase).collect()
}

fn main() -> Outcome<()> {
    let args = args()?;
    let domain = std::env::var("ROS_DOMAIN_ID").unwrap_or_else(|_| "0".to_owned()).parse()?;
    let mut builder = DomainParticipantBuilder::new(domain).socket_send_buffer_size(1 << 20);
    if args.loopback {
        builder = builder.with_only_networks([Ipv4Addr::LOCALHOST]);
    }
    let context = Context::from_domain_participant(builder.build()?)?;
    let mut node = context.new_node(
        NodeName::new("/", if args.hear { "ecu_reader" } else { "ecu_peer" })?,
        NodeOptions::new().enable_rosout(false),
    )?;
    let spinner = node.spinner()?;
    let spinner = std::thread::spawn(move || futures::executor::block_on(spinner.spin()));
    let dampers: Vec<Damper> =
        (0..args.dampers).map(|number| Damper::new(&mut node, number)).collect::<Outcome<_>>()?;
    let statuses = topic::<DiagnosticArray>(&node, "/diagnostics")?;
    let diagnostics = node.create_subscription::<DiagnosticArray>(&statuses, None)?;
    let deadline = Instant::now() + PATIENCE;
    let there = |damper: &Damper| if args.hear { damper.is_heard(&node) } else { damper.is_found(&node) };
    while !dampers.iter().all(there) {
        if Instant::now() > deadline {
            return Err(format!("no node with {} dampers in domain {domain}", args.dampers).into());
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    std::thread::sleep(SETTLE);
    println!("{}", json!({ "event": "ready" }));
    if args.hear {
        std::io::stdin().lock().lines().map_while(Result::ok).for_each(drop);
        return Ok(());
    }

    let (ended, all_heard) = (AtomicBool::new(false), AtomicBool::new(false));
    let heard = Mutex::new((Vec::<ReceivedAnswer>::new(), Vec::<u8>::new()));
    let (sent, phases, end_ns) = std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut arrivals = arrivals(&dampers, &diagnostics);
            while let Some(arrived) = futures::executor::block_on(arrivals.next()) {
                let Ok(mut heard) = heard.lock() else { return };
                match arrived {
                    Arrived::Answer(answer) => heard.0.push(answer),
                    // The node's status messages arrive once per second: the last one ends this thread.
                    Arrived::Status(level) => heard.1.push(level),
                }
                if all_heard.load(Ordering::Relaxed) {
                    return;
                }
            }
        });
        let sending =
            scope.spawn(|| send_all(&dampers, args.rate_hz, &ended).map_err(|error| error.to_string()));
        let mut phases = vec![("start".to_owned(), unix_ns())];
        for line in std::io::stdin().lock().lines().map_while(Result::ok) {
            phases.push((line, unix_ns()));
            println!("{}", json!({ "done": phases.len() - 1 }));
        }
        let end_ns = unix_ns();
        ended.store(true, Ordering::Relaxed);
        let sent = sending.join();
        std::thread::sleep(SETTLE);
        all_heard.store(true, Ordering::Relaxed);
        (sent, phases, end_ns)
    });
    let sent = sent.map_err(|_| "the sender panicked")??;
    let (heard, levels) = heard.into_inner().map_err(|_| "the receiver panicked")?;
    println!("{}", json!({ "phases": report(&sent, &heard, &phases, end_ns), "diagnostics": levels }));

    drop((dampers, diagnostics));
    drop(node);
    if spinner.join().is_err() {
        eprintln!("ecu_peer: the spinner panicked");
    }
    drop(context);
    Ok(())
}
