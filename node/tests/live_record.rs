//! `mr-damper record` over real DDS, as a process that is killed: what had come before the age of a chunk is there.

mod run_support;

use mr_damper_msgs::Displacement;
use mr_damper_node::config::{Config, RosArgs};
use mr_damper_node::ros::Ros;
use mr_damper_node::run::Note;
use ros2_client::{NodeOptions, Publisher};
use run_support::*;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const DOMAIN: i64 = 80;
const CHUNK_AGE: Duration = Duration::from_millis(200);
/// On the way to the recorder, and through it, on a busy machine.
const SLACK: Duration = Duration::from_millis(400);
const SPACING: Duration = Duration::from_millis(5);

/// A process that ends with the test, whatever becomes of that.
struct Recorder(Child);

impl Drop for Recorder {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Publishes numbered samples 5 ms apart for `time`, and notes when each was sent.
fn publish(publisher: &Publisher<Displacement>, sent: &mut Vec<(i64, Instant)>, time: Duration) {
    let start = Instant::now();
    while start.elapsed() < time {
        let number = sent.len() as i64 + 1;
        publisher.publish(displacement(number, number as f64)).expect("taken");
        sent.push((number, Instant::now()));
        std::thread::sleep(SPACING);
    }
}

#[test]
fn a_recording_that_is_killed_keeps_what_is_older_than_a_chunk() {
    let dir = temporary();
    let config = Config { domain_id: DOMAIN, ..Config::default() };
    let mut ros =
        Ros::start(&config, &RosArgs::default(), NodeOptions::new(), "peer").expect("a peer starts");
    let publisher: Publisher<Displacement> = ros.publish("/displacement").expect("a topic");
    // Both storages at once, each killed at a time of its own.
    let mut recorders = ["mcap", "sqlite3"].map(|storage| {
        let path = dir.path().join(storage);
        let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
        command.args(["--quiet", "record", "--storage", storage, "--max-bag-duration", "0.7", "--out"]);
        command.arg(&path).args(["--chunk-age", &CHUNK_AGE.as_secs_f64().to_string()]);
        command.args(["--domain-id", &DOMAIN.to_string()]);
        (path, Recorder(command.stdout(Stdio::null()).spawn().expect("started")))
    });
    let deadline = Instant::now() + Duration::from_secs(30);
    while publisher.get_subscription_count(ros.node()) < recorders.len() {
        assert!(Instant::now() < deadline, "the recorders listen");
        std::thread::sleep(Duration::from_millis(20));
    }
    let mut sent = Vec::new();
    for (life, (path, recorder)) in [1900, 230].into_iter().zip(&mut recorders) {
        publish(&publisher, &mut sent, Duration::from_millis(life));
        // SIGKILL on Unix.
        recorder.0.kill().expect("killed");
        let killed = Instant::now();
        recorder.0.wait().expect("gone");

        let loaded = read(path);
        assert!(loaded.notes.contains(&Note::NoMetadata { path: path.clone() }), "{:?}", loaded.notes);
        let (name, stamps) = (path.display(), loaded.run.displacement_m.stamps);
        let (first, last) = (stamps[0].nanos(), stamps[stamps.len() - 1].nanos());
        assert_eq!(stamps.len() as i64, last - first + 1, "{name}: no hole");
        // The first ones may go before both ends know of each other.
        assert!(first < sent[sent.len() / 2].0, "{name}: it began at {first}");
        let old = sent.iter().rev().find(|(_, at)| killed - *at > CHUNK_AGE + SLACK).expect("old ones").0;
        assert!(last >= old, "{name}: the last one is {last}, {old} was old");
        assert!(files_of(path).len() > 1, "{name}: it was split meanwhile");
    }
    drop(publisher);
    ros.stop();
}
