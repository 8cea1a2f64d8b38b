//! A sender and receiver that records everything, for the tests under faults: it reports each sample that it sent and each estimate
//! that it received, without checking them.
//!
//! Usage: `fault_peer --out FILE [--rate HZ] [--loopback]`, with `ROS_DOMAIN_ID` as in any ROS 2 program. It sends displacement, coil
//! current and measured force with one stamp, at a fixed rate. Commands are lines on standard input, each answered with a line of
//! JSON:
//!
//! ```text
//! phase NAME     everything from now on belongs to phase NAME
//! send / quiet   starts and stops sending
//! jump SECONDS   shifts stamps from now on, later or earlier
//! ```
//!
//! When standard input closes, it writes FILE: `sent` as `[stamp, sent at, displacement, current, force, phase]` (values as bits),
//! `estimates` as `[stamp, received at, force as bits, mode, validity, reasons, input age or null, phase]` (times in ns; phases by
//! number), `phases` as `[name, begun at]`, and `diagnostics`: the node's status messages as `[received at, level, message, {key:
//! value}]`.

use futures::executor::block_on;
use mr_damper_msgs::standard::DiagnosticArray;
use mr_damper_msgs::{CoilCurrent, Displacement, Force, ForceEstimate, Message};
use ros2_client::qos::{Durability, History};
use ros2_client::{
    Context, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, QosProfile, Subscription,
};
use rustdds::DomainParticipantBuilder;
use serde_json::{Value, json};
use std::io::BufRead;
use std::net::Ipv4Addr;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// Depth of the queues on either side: nothing may be lost here.
const DEPTH: i32 = 8192;
/// Longest time to discover the node.
const PATIENCE: Duration = Duration::from_secs(20);
/// Time from discovering the node to being discovered by it.
const SETTLE: Duration = Duration::from_millis(500);

struct Args {
    out: String,
    rate_hz: f64,
    loopback: bool,
}

fn args() -> Outcome<Args> {
    let mut args = Args { out: String::new(), rate_hz: 100.0, loopback: false };
    let mut given = std::env::args().skip(1);
    while let Some(name) = given.next() {
        let mut value = || given.next().ok_or_else(|| format!("{name} needs a value"));
        match name.as_str() {
            "--out" => args.out = value()?,
            "--rate" => args.rate_hz = value()?.parse()?,
            "--loopback" => args.loopback = true,
            _ => return Err(format!("unknown option {name}; use --out, --rate or --loopback").into()),
        }
    }
    if args.out.is_empty() { Err("--out FILE is missing".into()) } else { Ok(args) }
}

/// The topics of the node that are used here, with its diagnostics.
struct Topics {
    displacement: Publisher<Displacement>,
    current: Publisher<CoilCurrent>,
    force: Publisher<Force>,
    estimates: Subscription<ForceEstimate>,
    diagnostics: Subscription<DiagnosticArray>,
}

impl Topics {
    fn new(node: &mut Node) -> Outcome<Self> {
        let qos = QosProfile::publisher_default()
            .history(History::KeepLast { depth: DEPTH as usize })
            .durability(Durability::Volatile);
        let topic = |node: &Node, name: &str, package: &str, message: &str| {
            node.create_topic(&Name::parse(name)?, MessageTypeName::new(package, message), &qos)
                .map_err(Box::<dyn std::error::Error>::from)
        };
        let displacement = topic(node, "/displacement", Displacement::PACKAGE, Displacement::NAME)?;
        let current = topic(node, "/coil_current", CoilCurrent::PACKAGE, CoilCurrent::NAME)?;
        let force = topic(node, "/measured_force", Force::PACKAGE, Force::NAME)?;
        let estimates = topic(node, "/force_estimate", ForceEstimate::PACKAGE, ForceEstimate::NAME)?;
        let diagnostics = topic(node, "/diagnostics", DiagnosticArray::PACKAGE, DiagnosticArray::NAME)?;
        Ok(Self {
            displacement: node.create_publisher(&displacement, Some(qos.clone()))?,
            current: node.create_publisher(&current, Some(qos.clone()))?,
            force: node.create_publisher(&force, Some(qos.clone()))?,
            estimates: node.create_subscription(&estimates, Some(qos.clone()))?,
            diagnostics: node.create_subscription(&diagnostics, Some(qos))?,
        })
    }

    /// True once all publishers and subscriptions are matched.
    fn are_found(&self, node: &Node) -> bool {
        self.displacement.get_subscription_count(node) > 0
            && self.current.get_subscription_count(node) > 0
            && self.force.get_subscription_count(node) > 0
            && self.estimates.get_publisher_count(node) > 0
            && self.diagnostics.get_publisher_count(node) > 0
    }
}

/// Everything that was sent and received.
#[derive(Default)]
struct Records {
    phases: Vec<Value>,
    sent: Vec<Value>,
    estimates: Vec<Value>,
    diagnostics: Vec<Value>,
}

impl Records {
    fn phase(&self) -> usize {
        self.phases.len().saturating_sub(1)
    }

    fn hear(&mut self, topics: &Topics) -> Outcome<()> {
        let phase = self.phase();
        while let Some((heard, _)) = topics.estimates.take()? {
            let age = Some(heard.input_age).filter(|age| age.is_finite());
            self.estimates.push(json!([
                heard.header.stamp.as_nanos(),
                unix_ns(),
                heard.force.to_bits(),
                heard.mode,
                heard.validity,
                heard.reasons,
                age,
                phase
            ]));
        }
        while let Some((heard, _)) = topics.diagnostics.take()? {
            for status in heard.status.iter().filter(|status| status.name.ends_with(": node")) {
                let values: serde_json::Map<_, _> =
                    status.values.iter().map(|v| (v.key.clone(), Value::from(v.value.clone()))).collect();
                self.diagnostics.push(json!([unix_ns(), status.level, status.message, values]));
            }
        }
        Ok(())
    }
}

fn unix_ns() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
}

/// Sends the sample at `t` seconds: a sine of 8 mm and 2 Hz, a stepped current, and a force of no particular damper.
fn send(topics: &Topics, t: f64, stamp_ns: i64, records: &mut Records) -> Outcome<()> {
    let omega = 4.0 * std::f64::consts::PI;
    let displacement = 0.008 * (omega * t).sin();
    let current = if t % 2.0 < 1.0 { 0.4 } else { 0.8 };
    let force = (300.0 + 400.0 * current) * (20.0 * 0.008 * omega * (omega * t).cos()).tanh();
    let header =
        mr_damper_node::estimation::wire::header(mr_damper_model::sample::Stamp::from_nanos(stamp_ns), "");
    topics.current.publish(CoilCurrent { header: header.clone(), current, variance: 0.0 })?;
    topics.force.publish(Force { header: header.clone(), force, variance: 0.0 })?;
    topics.displacement.publish(Displacement { header, displacement, variance: 0.0 })?;
    // As text, a number might lose its last bit.
    let bits = [displacement, current, force].map(f64::to_bits);
    records.sent.push(json!([stamp_ns, unix_ns(), bits[0], bits[1], bits[2], records.phase()]));
    Ok(())
}

/// Sends and receives until the commands end.
fn work(topics: &Topics, rate_hz: f64, commands: &Receiver<String>, records: &mut Records) -> Outcome<()> {
    let (begin, first_ns) = (Instant::now(), unix_ns());
    let (mut due_s, mut sending, mut jumped_ns) = (0.0_f64, false, 0_i64);
    loop {
        match commands.try_recv() {
            Ok(line) => {
                match line.split_once(' ').unwrap_or((&line, "")) {
                    ("phase", name) => records.phases.push(json!([name, unix_ns()])),
                    ("send", _) => sending = true,
                    ("quiet", _) => sending = false,
                    ("jump", seconds) => jumped_ns += (seconds.parse::<f64>()? * 1e9) as i64,
                    _ => return Err(format!("unknown command {line}; use phase, send, quiet or jump").into()),
                }
                println!("{}", json!({ "done": line }));
            }
            Err(TryRecvError::Empty) => {}
            Err(TryRecvError::Disconnected) => return Ok(()),
        }
        let elapsed_s = begin.elapsed().as_secs_f64();
        if elapsed_s >= due_s {
            // Samples that were due while this process was delayed are skipped, and the next sample keeps its distance: frames that
            // overtake each other by less do not change the order of samples on a topic.
            due_s = due_s.max(elapsed_s - 0.1 / rate_hz) + 1.0 / rate_hz;
            if sending {
                let stamp_ns = first_ns + (elapsed_s * 1e9) as i64 + jumped_ns;
                send(topics, elapsed_s, stamp_ns, records)?;
            }
        }
        records.hear(topics)?;
        std::thread::sleep(Duration::from_micros(300));
    }
}

fn main() -> Outcome<()> {
    let args = args()?;
    let domain = std::env::var("ROS_DOMAIN_ID").unwrap_or_else(|_| "0".to_owned()).parse()?;
    let mut builder = DomainParticipantBuilder::new(domain);
    if args.loopback {
        builder = builder.with_only_networks([Ipv4Addr::LOCALHOST]);
    }
    let context = Context::from_domain_participant(builder.build()?)?;
    let mut node =
        context.new_node(NodeName::new("/", "fault_peer")?, NodeOptions::new().enable_rosout(false))?;
    let spinner = node.spinner()?;
    let spinner = std::thread::spawn(move || block_on(spinner.spin()));
    let topics = Topics::new(&mut node)?;
    let deadline = Instant::now() + PATIENCE;
    while !topics.are_found(&node) {
        if Instant::now() > deadline {
            return Err(format!("no node with these topics in domain {domain} within {PATIENCE:?}").into());
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    std::thread::sleep(SETTLE);
    println!("{}", json!({ "event": "ready" }));

    let (lines, commands) = channel();
    std::thread::spawn(move || {
        // Ends with the input; the closed channel tells the main loop that the input has ended.
        for line in std::io::stdin().lock().lines().map_while(Result::ok) {
            if lines.send(line).is_err() {
                break;
            }
        }
    });
    let mut records = Records::default();
    work(&topics, args.rate_hz, &commands, &mut records)?;
    let Records { phases, sent, estimates, diagnostics } = records;
    let all = json!({ "phases": phases, "sent": sent, "estimates": estimates, "diagnostics": diagnostics });
    std::fs::write(&args.out, all.to_string())?;
    println!("{}", json!({ "sent": all["sent"].as_array().map(Vec::len) }));

    drop(topics);
    drop(node);
    if spinner.join().is_err() {
        eprintln!("fault_peer: the spinner panicked");
    }
    drop(context);
    Ok(())
}
