//! Creates topics in one thread and readers and writers in another thread, for some seconds, with DDS-Security.
//!
//! Usage: `create_peer SECONDS`, with `ROS_DOMAIN_ID`, `ROS_SECURITY_*` and the feature `mr-damper-node/security`. Prints one line of
//! JSON: the numbers of `topics` and `endpoints` that it created, and `stuck`: whether a thread has still not ended `PATIENCE` after
//! the end.

use mr_damper_node::ros2::security::Enclave;
use rustdds::{DomainParticipant, DomainParticipantBuilder, QosPolicies, QosPolicyBuilder, Topic, TopicKind};
use serde_json::json;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::time::{Duration, Instant};

type Outcome<T> = Result<T, Box<dyn std::error::Error + Send + Sync>>;

/// Pause between two creations of a thread. Without it, the topics fill RustDDS' queue of discovery commands (1024), which causes
/// another deadlock between its discovery and its event loop. A program that creates only what it needs does not meet that deadlock.
const PAUSE: Duration = Duration::from_millis(5);
/// A thread that is not stuck finishes its last creation within this time, also on a busy machine.
const PATIENCE: Duration = Duration::from_secs(10);

fn main() -> Outcome<()> {
    let seconds: u64 = std::env::args().nth(1).ok_or("usage: create_peer SECONDS")?.parse()?;
    let end = Instant::now() + Duration::from_secs(seconds);
    let participant = participant()?;
    let qos = QosPolicyBuilder::new().build();
    let topic = topic(&participant, &qos)?;

    let (topics, endpoints) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
    let (done, ended) = mpsc::channel();
    {
        let (participant, qos, topics, done) =
            (participant.clone(), qos.clone(), Arc::clone(&topics), done.clone());
        std::thread::spawn(move || {
            done.send(until(end, &topics, || self::topic(&participant, &qos).map(drop)))
        });
    }
    {
        let (participant, endpoints) = (participant.clone(), Arc::clone(&endpoints));
        std::thread::spawn(move || {
            done.send(until(end, &endpoints, || both_endpoints(&participant, &topic, &qos)))
        });
    }
    let mut stuck = false;
    for _ in 0..2 {
        match ended.recv_timeout((end + PATIENCE).saturating_duration_since(Instant::now())) {
            Ok(outcome) => outcome?,
            Err(_) => stuck = true,
        }
    }
    let count = |of: &AtomicU64| of.load(Ordering::Relaxed);
    println!("{}", json!({"topics": count(&topics), "endpoints": count(&endpoints), "stuck": stuck}));
    // Stuck threads would block the participant's destructor.
    std::process::exit(0)
}

fn participant() -> Outcome<DomainParticipant> {
    let domain = std::env::var("ROS_DOMAIN_ID").unwrap_or_else(|_| "0".to_owned()).parse()?;
    let enclave = Enclave::asked_for(None)?.ok_or("ROS_SECURITY_ENABLE is not true")?;
    Ok(enclave.secure(DomainParticipantBuilder::new(domain))?.build()?)
}

fn topic(participant: &DomainParticipant, qos: &QosPolicies) -> Outcome<Topic> {
    let kind = "std_msgs::msg::dds_::Float64_".to_owned();
    Ok(participant.create_topic("rt/created".to_owned(), kind, qos, TopicKind::NoKey)?)
}

fn both_endpoints(participant: &DomainParticipant, topic: &Topic, qos: &QosPolicies) -> Outcome<()> {
    participant.create_publisher(qos)?.create_datawriter_no_key_cdr::<f64>(topic, None)?;
    participant.create_subscriber(qos)?.create_datareader_no_key_cdr::<f64>(topic, None)?;
    Ok(())
}

fn until(end: Instant, count: &AtomicU64, mut create: impl FnMut() -> Outcome<()>) -> Outcome<()> {
    while Instant::now() < end {
        create()?;
        count.fetch_add(1, Ordering::Relaxed);
        std::thread::sleep(PAUSE);
    }
    Ok(())
}
