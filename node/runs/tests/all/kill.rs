//! Recorders that are killed: the bag holds everything older than the maximum age of a chunk, with either storage.
//!
//! Each test kills three recorders, at instants chosen by a seed; fifty with `MR_DAMPER_LONG=1`.

use crate::run_support::*;
use crate::turn::turn;
use mr_damper_runs::{BagOptions, BagWriter, Note, Storage};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const CHUNK_AGE: Duration = Duration::from_millis(100);
/// Allowance beyond the maximum age of a chunk: the writer is called a millisecond later, and a write takes time on a
/// busy machine.
const SLACK: Duration = Duration::from_millis(250);

/// Runs in a child process of the tests below: writes until it is killed, and prints a line after each message.
#[test]
fn recorder_to_be_killed() {
    // As a test of its own it has nothing to do.
    let Some(path) = std::env::var_os("RUN_KILL_BAG") else { return };
    let storage =
        if std::env::var_os("RUN_KILL_SQLITE").is_some() { Storage::Sqlite3 } else { Storage::Mcap };
    let options = BagOptions {
        chunk_max_age: CHUNK_AGE,
        max_file_duration: Some(Duration::from_millis(400)),
        ..BagOptions::default().stored(storage)
    };
    let mut writer = BagWriter::create(Path::new(&path), options).expect("created");
    let start = Instant::now();
    for step in 1.. {
        let nanos = start.elapsed().as_nanos() as i64 + 1;
        writer
            .write_message("/displacement", &displacement(nanos, step as f64), nanos, nanos)
            .expect("written");
        eprintln!("written {step} {nanos}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Kills a recorder after it has written for `life`, and compares its bag with the lines it printed.
fn kill(storage: Storage, life: Duration) {
    let dir = temporary();
    let path = dir.path().join("bag");
    let mut command = Command::new(std::env::current_exe().expect("this program"));
    command.args(["--exact", "kill::recorder_to_be_killed", "--nocapture"]).env("RUN_KILL_BAG", &path);
    if storage == Storage::Sqlite3 {
        command.env("RUN_KILL_SQLITE", "1");
    }
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("started");
    let lines = BufReader::new(child.stderr.take().expect("piped")).lines();
    let (mut began, mut written) = (None, Vec::new());
    for line in lines {
        let line = line.expect("text");
        let Some(said) = line.strip_prefix("written ") else { continue };
        let nanos: i64 = said.split_once(' ').and_then(|(_, nanos)| nanos.parse().ok()).expect("two numbers");
        written.push(nanos);
        let began = *began.get_or_insert_with(Instant::now);
        if began.elapsed() >= life {
            // SIGKILL on Unix. Lines that are already in the pipe are still read.
            child.kill().expect("killed");
        }
    }
    child.wait().expect("gone");
    let before = contents(&path);
    let loaded = read(&path);
    assert_eq!(contents(&path), before, "reading changes nothing");
    let run = loaded.run;
    let last = *written.last().expect("it wrote");
    let old = written.iter().filter(|&&nanos| nanos + (CHUNK_AGE + SLACK).as_nanos() as i64 <= last).count();
    assert!(run.displacement_m.len() >= old, "{} of {old} old samples", run.displacement_m.len());
    assert!(old > 100, "only {old} old samples, too few for a test");
    // The bag holds what was written, without a missing sample.
    let stamps: Vec<i64> = run.displacement_m.stamps.iter().map(|stamp| stamp.nanos()).collect();
    assert!(written.starts_with(&stamps[..stamps.len().min(written.len())]), "a sample is missing");
    assert!(loaded.notes.contains(&Note::NoMetadata { path }), "{:?}", loaded.notes);
}

/// Kills recorders at instants chosen by a seed, once there are old samples.
fn kill_often(storage: Storage, seed: u64) {
    let times = if std::env::var("MR_DAMPER_LONG").as_deref() == Ok("1") { 50 } else { 3 };
    let mut state = seed;
    for _ in 0..times {
        // The upper bits of a linear congruential generator: any instant within the life of two or three files will
        // do.
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        kill(storage, Duration::from_micros(550_000 + (state >> 44) % 700_000));
    }
    println!("killed {times} times, {storage:?}");
}

#[test]
fn a_killed_recorder_of_mcap_loses_at_most_a_chunk() {
    let _turn = turn(module_path!());
    kill_often(Storage::Mcap, 61);
}

#[test]
fn a_killed_recorder_of_sqlite3_loses_at_most_a_chunk() {
    let _turn = turn(module_path!());
    kill_often(Storage::Sqlite3, 59);
}
