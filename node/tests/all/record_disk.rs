//! `mr-damper record` on a disk that is full or becomes read-only: it reports the error, exits with code 1, and the written part
//! can be read.
//!
//! The disk is a small tmpfs in its own mount namespace. Mounting needs root.

use crate::domain::Domain;
use crate::run_support::*;
use crate::turn::turn;
use mr_damper_msgs::Displacement;
use mr_damper_node::ros2::participant::{self, Ros};
use mr_damper_node::settings::config::{Config, RosArgs};
use ros2_client::NodeOptions;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const CHUNK_AGE: Duration = Duration::from_millis(200);
/// Time to reach the recorder and pass through it on a busy machine.
const SLACK: Duration = Duration::from_millis(600);
const SPACING: Duration = Duration::from_millis(5);
/// Length of the random frame name in bytes, which compression cannot shrink: a megabyte is full within a second.
const FRAME: usize = 16_384;

/// Runs the recorder on a disk of `mib` MiB mounted on `disk`, and copies the bag to `disk/../out` when it has ended. The shell
/// code `meanwhile` runs at the same time.
fn recorder(domain: &Domain, disk: &Path, mib: u32, storage: &str, meanwhile: &str) -> Command {
    let script = format!(
        "mount -t tmpfs -o size={mib}m none \"$1\" || exit 77
         cd / ; ({meanwhile}) </dev/null >/dev/null &
         \"$2\" --quiet record --out \"$1/bag\" --domain-id {} --storage {storage} --chunk-age {} --max-bag-duration 1
         code=$?; wait; cp -r \"$1/bag\" \"$1/../out\"; exit $code",
        domain.id(),
        CHUNK_AGE.as_secs_f64()
    );
    let mut command = Command::new("unshare");
    command.args(["--mount", "--propagation", "private", "sh", "-c", &script, "sh"]);
    command.arg(disk).arg(env!("CARGO_BIN_EXE_mr-damper")).stdout(Stdio::null()).stderr(Stdio::piped());
    command
}

/// Plays to a recorder until it ends; returns its output, when each stamp was sent, and when it ended.
fn play_to(domain: &Domain, mut command: Command) -> (Output, HashMap<i64, Instant>, Instant) {
    let config = Config { domain_id: domain.id(), ..Config::default() };
    let mut ros =
        Ros::start(&config, &RosArgs::default(), NodeOptions::new(), "peer").expect("a peer starts");
    let publisher: participant::Output<Displacement> = ros.publish("/displacement").expect("a topic");
    let mut child = command.spawn().expect("unshare starts");
    let (begun, mut sent, mut random) = (Instant::now(), HashMap::new(), 1_u64);
    while child.try_wait().expect("a child of ours").is_none() {
        assert!(begun.elapsed() < Duration::from_secs(30), "it ends");
        if ros.readers_of(publisher.guid()) > 0 {
            let number = sent.len() as i64 + 1;
            let mut message = displacement(number, number as f64);
            message.header.frame_id = std::iter::repeat_with(|| {
                random =
                    random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                char::from(b' ' + (random >> 58) as u8)
            })
            .take(FRAME)
            .collect();
            publisher.publish(message).expect("taken");
            sent.insert(number, Instant::now());
        }
        std::thread::sleep(SPACING);
    }
    let ended = Instant::now();
    drop(publisher);
    ros.stop();
    (child.wait_with_output().expect("its output"), sent, ended)
}

/// Checks that the recorder exited with code 1 and these words, and that the bag is complete up to its last chunk.
fn holds(dir: &Path, output: &Output, sent: &HashMap<i64, Instant>, ended: Instant, says: &[&str]) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    let error = said.lines().find(|line| line.starts_with("error: ")).unwrap_or_else(|| panic!("{said}"));
    for word in says {
        assert!(error.contains(word), "{word:?} in {error}");
    }
    let run = read(&dir.join("out")).run;
    let stamps: Vec<i64> = run.displacement_m.stamps.iter().map(|stamp| stamp.nanos()).collect();
    let (first, last) = (stamps[0], stamps[stamps.len() - 1]);
    assert_eq!(
        stamps.len() as i64,
        last - first + 1,
        "no sample is missing: {} from {first} to {last}",
        stamps.len()
    );
    let behind = ended - sent[&last];
    println!("{error}\n{} messages read, the last sent {behind:?} before the end", stamps.len());
    assert!(behind < CHUNK_AGE + SLACK, "the last sample is {behind:?} older than the end");
}

/// A directory, and the directory in it on which a small disk is mounted.
fn place_of_a_disk() -> (TempDir, PathBuf) {
    let dir = temporary();
    let disk = dir.path().join("disk");
    std::fs::create_dir(&disk).expect("a directory");
    (dir, disk)
}

fn full(storage: &str) {
    let domain = Domain::lease();
    let (dir, disk) = place_of_a_disk();
    let (output, sent, ended) = play_to(&domain, recorder(&domain, &disk, 3, storage, "true"));
    let bag = disk.join("bag");
    let says = [bag.to_str().expect("UTF-8"), "make room on that disk, or write to another"];
    holds(dir.path(), &output, &sent, ended, &says);
}

#[test]
#[ignore = "needs root: mounts a small disk"]
fn a_full_disk_ends_an_mcap_recording_and_the_written_part_is_readable() {
    let _turn = turn(module_path!());
    full("mcap");
}

#[test]
#[ignore = "needs root: mounts a small disk"]
fn a_full_disk_ends_an_sqlite3_recording_and_the_written_part_is_readable() {
    let _turn = turn(module_path!());
    full("sqlite3");
}

#[test]
#[ignore = "needs root: mounts a small disk"]
fn a_disk_that_becomes_read_only_ends_a_recording_and_the_written_part_is_readable() {
    let _turn = turn(module_path!());
    let domain = Domain::lease();
    let (dir, disk) = place_of_a_disk();
    // A disk with a file open for writing cannot be remounted read-only, so the same disk is bind-mounted over itself, read-only:
    // open files stay writable, and the next file of the bag cannot be created.
    let meanwhile = "until [ -s \"$1\"/bag/bag_bag_1.mcap ]; do sleep 0.05; done
        mount --bind \"$1\" \"$1\" && mount -o remount,bind,ro \"$1\"";
    let (output, sent, ended) = play_to(&domain, recorder(&domain, &disk, 64, "mcap", meanwhile));
    let bag = disk.join("bag");
    holds(
        dir.path(),
        &output,
        &sent,
        ended,
        &[bag.to_str().expect("UTF-8"), "read-only", "write to another"],
    );
    assert!(
        files_of(&dir.path().join("out")).len() >= 2,
        "the bag was split before the disk became read-only"
    );
}
