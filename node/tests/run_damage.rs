//! Bags that are cut off, damaged or hostile: what can be read is read, and nothing panics.

mod run_support;

use mr_damper_model::sample::Run;
use mr_damper_msgs::Force;
use mr_damper_node::run::{BagOptions, BagWriter, Note, load};
use proptest::prelude::*;
use run_support::*;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// True when every channel of `part` is a beginning of that of `whole`.
fn is_prefix(part: &Run, whole: &Run) -> bool {
    let force = |run: &Run| run.force_n.clone().unwrap_or_default();
    whole.displacement_m.stamps.starts_with(&part.displacement_m.stamps)
        && whole.displacement_m.values.starts_with(&part.displacement_m.values)
        && force(whole).stamps.starts_with(&force(part).stamps)
        && force(whole).values.starts_with(&force(part).values)
}

/// A bag of 2000 samples on two topics; returns its file.
fn two_topics(dir: &Path, compress: bool) -> PathBuf {
    let path = dir.join(if compress { "zstd" } else { "plain" });
    bag(&path, BagOptions { chunk_max_bytes: 20_000, compress, ..BagOptions::default() }, |writer| {
        for step in 1..=1000_i64 {
            let (nanos, value) = (step * 1_000_000, (step as f64).sin());
            writer.write_message(
                "/measured_force",
                &Force { header: at(nanos), force: value, variance: 0.0 },
                nanos,
                nanos,
            )?;
            writer.write_message("/displacement", &displacement(nanos, value), nanos, nanos)?;
        }
        Ok(())
    });
    mcap_of(&path)
}

#[test]
fn a_truncated_file_yields_what_came_before() {
    let dir = temporary();
    for compress in [false, true] {
        let file = two_topics(dir.path(), compress);
        let whole = std::fs::read(&file).expect("read");
        let all = read(&file).run;
        assert_eq!(all.displacement_m.len(), 1000);
        let cut = dir.path().join("cut.mcap");
        let (mut last, mut most) = (0, 0);
        for length in (0..whole.len()).step_by(997) {
            std::fs::write(&cut, &whole[..length]).expect("written");
            match load(&cut, &plain()) {
                Ok(loaded) => {
                    assert!(is_prefix(&loaded.run, &all), "at {length}");
                    let samples = loaded.run.displacement_m.len();
                    assert!(samples >= last, "{samples} samples at {length} after {last}");
                    last = samples;
                    let data_end = loaded.notes.is_empty();
                    let noted = loaded.notes.iter().any(
                        |note| matches!(note, Note::CutShort { offset, .. } if *offset <= length as u64),
                    );
                    assert!(noted || (data_end && samples == 1000), "at {length}: {:?}", loaded.notes);
                    most = most.max(samples);
                }
                // Before the first displacement there is no run.
                Err(error) => assert_eq!(last, 0, "at {length}: {error}"),
            }
        }
        assert!(most > 900, "{most}");
    }
}

#[test]
fn a_cut_plain_chunk_gives_its_whole_messages() {
    let dir = temporary();
    let file = two_topics(dir.path(), false);
    let whole = std::fs::read(&file).expect("read");
    let cut = dir.path().join("cut.mcap");
    // Well inside the first chunk, which holds about 20 kB.
    std::fs::write(&cut, &whole[..15_000]).expect("written");
    let loaded = read(&cut);
    assert!(loaded.run.displacement_m.len() > 50);
    let note = loaded.notes[0].to_string();
    assert!(note.ends_with("messages; there: the file ends inside a chunk"), "{note}");
}

#[test]
fn a_damaged_chunk_costs_only_itself() {
    let dir = temporary();
    for compress in [false, true] {
        let file = two_topics(dir.path(), compress);
        let mut bytes = std::fs::read(&file).expect("read");
        let middle = bytes.len() / 3;
        bytes[middle] ^= 0x40;
        std::fs::write(&file, &bytes).expect("written");
        let loaded = read(&file);
        let [Note::ChunkDamaged { offset, .. }] = loaded.notes.as_slice() else {
            panic!("{:?}", loaded.notes)
        };
        assert!((*offset as usize) < middle);
        let stamps = &loaded.run.displacement_m.stamps;
        assert!((500..1000).contains(&stamps.len()), "{}", stamps.len());
        assert_eq!(stamps.last().map(|stamp| stamp.nanos()), Some(1_000_000_000));
    }
}

#[test]
fn files_that_are_no_mcap_are_refused() {
    let dir = temporary();
    let file = dir.path().join("x.mcap");
    for (bytes, text) in [
        (&b""[..], "x.mcap: not an MCAP file: it is empty"),
        (b"\x89MCA", "x.mcap: not an MCAP file: it begins with `\\x89MCA\\x00\\x00\\x00\\x00`"),
        (b"time_s,displacement_m", "x.mcap: not an MCAP file: it begins with `time_s,d`"),
    ] {
        std::fs::write(&file, bytes).expect("written");
        assert_eq!(refusal(&file, &plain()), text);
    }
    std::fs::write(&file, b"SQLite format 3\0").expect("written");
    assert!(refusal(&file, &plain()).starts_with("x.mcap: sqlite3 bags (.db3) are not read yet"));
    // Compression that is not built in: the name in the chunk's header is all that counts.
    let bytes = std::fs::read(two_topics(dir.path(), true)).expect("read");
    let at = bytes.windows(4).position(|window| window == b"zstd").expect("a chunk's header");
    let mut bytes = bytes;
    bytes[at..at + 4].copy_from_slice(b"none");
    std::fs::write(&file, &bytes).expect("written");
    let text = refusal(&file, &plain());
    assert!(
        text.contains("x.mcap, at byte ") && text.contains("compressed with `none`, which is not read"),
        "{text}"
    );
}

/// Runs in a child of the test below, writing until it is killed.
#[test]
fn recorder_to_be_killed() {
    let Some(path) = std::env::var_os("RUN_BAG_KILLED") else { return };
    let options = BagOptions { chunk_max_age: Duration::from_millis(50), ..BagOptions::default() };
    let mut writer = BagWriter::create(Path::new(&path), options).expect("created");
    for step in 1.. {
        let nanos = step * 1_000_000;
        writer.write_message("/displacement", &displacement(nanos, 1.0), nanos, nanos).expect("written");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_killed_recorder_loses_at_most_a_chunk() {
    let dir = temporary();
    let path = dir.path().join("bag");
    let mut child = std::process::Command::new(std::env::current_exe().expect("this program"))
        .args(["--exact", "recorder_to_be_killed"])
        .env("RUN_BAG_KILLED", &path)
        .stdout(std::process::Stdio::null())
        .spawn()
        .expect("started");
    std::thread::sleep(Duration::from_millis(1500));
    // SIGKILL on Unix.
    child.kill().expect("killed");
    child.wait().expect("gone");
    let loaded = read(&path);
    assert!(loaded.run.displacement_m.len() > 50, "{} samples", loaded.run.displacement_m.len());
    let text = loaded.notes.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
    assert!(text.contains("no metadata.yaml") && text.contains("the file ends without a footer"), "{text}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn hostile_bytes_do_not_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        let dir = temporary();
        let file = dir.path().join("x.mcap");
        std::fs::write(&file, [&b"\x89MCAP0\r\n"[..], &bytes].concat()).expect("written");
        let _ = load(&file, &plain());
        std::fs::write(&file, &bytes).expect("written");
        let _ = load(&file, &plain());
    }

    #[test]
    fn damaged_files_do_not_panic(
        faults in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        compress: bool,
    ) {
        let dir = temporary();
        let path = dir.path().join("bag");
        bag(&path, small_chunks(compress), |writer| {
            (1..60).try_for_each(|n| writer.write_message("/displacement", &displacement(n, 0.5), n, n))
        });
        let file = mcap_of(&path);
        let mut bytes = std::fs::read(&file).expect("read");
        for (index, value) in faults {
            let at = index.index(bytes.len());
            bytes[at] = value;
        }
        std::fs::write(&file, &bytes).expect("written");
        if let Ok(loaded) = load(&path, &plain()) {
            prop_assert!(loaded.run.displacement_m.stamps.is_sorted_by(|a, b| a < b));
        }
    }

    #[test]
    fn hostile_metadata_does_not_panic(text in "([a-z_:\\-\\[\\]{}&*! 0-9\"]{0,30}\n){0,6}") {
        let dir = temporary();
        let text = format!("rosbag2_bagfile_information:\n{text}");
        std::fs::write(dir.path().join("metadata.yaml"), text).expect("written");
        let _ = load(dir.path(), &plain());
    }
}
