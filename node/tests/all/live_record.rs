//! `mr-damper record` over real DDS, as a process that is killed: everything older than the maximum age of a chunk is
//! kept.

use crate::domain::Domain;
use crate::run_support::*;
use crate::turn::turn;
use mr_damper_msgs::rcl::Log;
use mr_damper_msgs::standard::DiagnosticArray;
use mr_damper_msgs::{Displacement, ForceEstimate};
use mr_damper_node::ros2::participant::{Output, Ros};
use mr_damper_node::settings::config::{Config, RosArgs};
use mr_damper_runs::Note;
use ros2_client::NodeOptions;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const CHUNK_AGE: Duration = Duration::from_millis(200);
/// Time to reach the recorder and pass through it on a busy machine.
const SLACK: Duration = Duration::from_millis(400);
const SPACING: Duration = Duration::from_millis(5);

/// A process that is killed at the end of the test, even if the test fails.
struct Recorder(Child);

impl Drop for Recorder {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Publishes numbered samples 5 ms apart for `time`, and notes when each was sent.
fn publish(publisher: &Output<Displacement>, sent: &mut Vec<(i64, Instant)>, time: Duration) {
    let start = Instant::now();
    while start.elapsed() < time {
        let number = sent.len() as i64 + 1;
        publisher.publish(displacement(number, number as f64)).expect("taken");
        sent.push((number, Instant::now()));
        std::thread::sleep(SPACING);
    }
}

#[test]
fn a_killed_recording_keeps_everything_older_than_a_chunk() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let dir = temporary();
    let config = Config { domain_id: domain.id(), ..Config::default() };
    let mut ros =
        Ros::start(&config, &RosArgs::default(), NodeOptions::new(), "peer").expect("a peer starts");
    let publisher: Output<Displacement> = ros.publish("/displacement").expect("a topic");
    // Both storages record at the same time and are killed at different times.
    let mut recorders = ["mcap", "sqlite3"].map(|storage| {
        let path = dir.path().join(storage);
        let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
        command.args(["--quiet", "record", "--storage", storage, "--max-bag-duration", "0.7", "--out"]);
        command.arg(&path).args(["--chunk-age", &CHUNK_AGE.as_secs_f64().to_string()]);
        command.args(["--domain-id", &domain.id().to_string()]);
        (path, Recorder(command.stdout(Stdio::null()).spawn().expect("started")))
    });
    let deadline = Instant::now() + Duration::from_secs(30);
    while ros.readers_of(publisher.guid()) < recorders.len() {
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
        assert_eq!(stamps.len() as i64, last - first + 1, "{name}: no sample is missing");
        // The first samples may be sent before both ends have discovered each other.
        assert!(first < sent[sent.len() / 2].0, "{name}: the recording begins at sample {first}");
        let old = sent
            .iter()
            .rev()
            .find(|(_, at)| killed - *at > CHUNK_AGE + SLACK)
            .expect("some samples are old enough")
            .0;
        assert!(last >= old, "{name}: the last sample is {last}, but sample {old} was old enough");
        assert!(files_of(path).len() > 1, "{name}: the bag was split before the kill");
    }
    drop(publisher);
    ros.stop();
}

#[test]
fn a_recording_of_renamed_topics_is_read_back_without_a_map() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let dir = temporary();
    let config = Config { domain_id: domain.id(), ..Config::default() };
    let mut ros =
        Ros::start(&config, &RosArgs::default(), NodeOptions::new(), "peer").expect("a peer starts");
    let publisher: Output<Displacement> = ros.publish("/susp/pos").expect("a topic");
    let path = dir.path().join("bag");
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    command.args([
        "--quiet",
        "record",
        "--chunk-age",
        "0.1",
        "--domain-id",
        &domain.id().to_string(),
        "--out",
    ]);
    command.arg(&path).args(["--ros-args", "-r", "__ns:=/fl", "-r", "displacement:=/susp/pos"]);
    let mut recorder = Recorder(command.stdout(Stdio::null()).spawn().expect("started"));
    let deadline = Instant::now() + Duration::from_secs(30);
    while ros.readers_of(publisher.guid()) == 0 {
        assert!(Instant::now() < deadline, "the recorder listens");
        std::thread::sleep(Duration::from_millis(20));
    }
    publish(&publisher, &mut Vec::new(), Duration::from_millis(900));
    recorder.0.kill().expect("killed");
    recorder.0.wait().expect("gone");
    let loaded = read(&path);
    assert!(loaded.run.displacement_m.len() > 20, "{}", loaded.run.displacement_m.len());
    drop(publisher);
    ros.stop();
}

/// Records three seconds in `domain` with more ROS arguments; returns the output and the bag's metadata.
fn recorded(domain: &Domain, path: &std::path::Path, ros_args: &[&str]) -> (std::process::Output, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    command.args(["--quiet", "record", "--duration", "3", "--domain-id", &domain.id().to_string(), "--out"]);
    command.arg(path).arg("--ros-args").args(ros_args);
    let output = command.output().expect("it runs");
    let metadata = std::fs::read_to_string(path.join("metadata.yaml")).unwrap_or_default();
    (output, metadata)
}

#[test]
fn a_recording_finds_dampers_in_namespaces_and_reports_when_nothing_came() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let dir = temporary();
    let config = Config { domain_id: domain.id(), ..Config::default() };
    let mut ros =
        Ros::start(&config, &RosArgs::default(), NodeOptions::new(), "peer").expect("a peer starts");
    let estimate: Output<ForceEstimate> = ros.publish("/car/front/force_estimate").expect("a topic");
    let moved: Output<Displacement> = ros.publish("/car/front/displacement").expect("a topic");
    let health: Output<DiagnosticArray> = ros.publish("/diagnostics").expect("a topic");
    let log: Output<Log> = ros.publish_log("/rosout").expect("a topic");
    let stop = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for number in 1.. {
                if stop.load(std::sync::atomic::Ordering::Relaxed) {
                    break;
                }
                estimate.publish(ForceEstimate::default()).expect("taken");
                moved.publish(displacement(number, 0.0)).expect("taken");
                health.publish(DiagnosticArray::default()).expect("taken");
                log.publish(Log::default()).expect("taken");
                std::thread::sleep(SPACING);
            }
        });
        let (output, metadata) = recorded(&domain, &dir.path().join("all"), &[]);
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        // With another namespace, only topics shared by all nodes are recorded.
        let (other, shared) = recorded(&domain, &dir.path().join("other"), &["-r", "__ns:=/bike"]);
        stop.store(true, std::sync::atomic::Ordering::Relaxed);
        assert!(output.status.success(), "{told}");
        for topic in ["/car/front/force_estimate", "/car/front/displacement", "/diagnostics", "/rosout"] {
            assert!(metadata.contains(&format!("name: {topic}\n")), "{topic} in {metadata}");
        }
        let told = String::from_utf8_lossy(&other.stderr).into_owned();
        assert_eq!(other.status.code(), Some(1), "{told}");
        assert!(told.contains("no message of a damper came in namespace /bike or below it"), "{told}");
        assert!(shared.contains("/diagnostics") && !shared.contains("/car/"), "{shared}");
    });
    drop((estimate, moved, health, log));
    ros.stop();
}
