//! Bags that are truncated, damaged or hostile: the readable part is read, and nothing panics.

use crate::run_support::*;
use crate::turn::turn;
use mr_damper_runs::{BagOptions, Note, load};
use proptest::prelude::*;
use std::path::{Path, PathBuf};

/// A bag of 2000 samples on two topics; returns its file.
fn two_topics(dir: &Path, compress: bool) -> PathBuf {
    let path = dir.join(if compress { "zstd" } else { "plain" });
    thousand(&path, BagOptions { chunk_max_bytes: 20_000, compress, ..BagOptions::default() });
    mcap_of(&path)
}

#[test]
fn a_truncated_file_yields_the_part_before_the_cut() {
    let _turn = turn(module_path!());
    let dir = temporary();
    for compress in [false, true] {
        let file = two_topics(dir.path(), compress);
        let whole = std::fs::read(&file).expect("read");
        let all = read(&file).run;
        assert_eq!(all.displacement_m.len(), 1000);
        let cut = dir.path().join("cut.mcap");
        let most = read_cut_short(&whole, &all, &cut, 997, |notes, length, samples| {
            let cut_short = |note: &Note| matches!(note, Note::CutShort { offset, .. } if *offset <= length);
            notes.iter().any(cut_short) || (notes.is_empty() && samples == 1000)
        });
        assert!(most > 900, "{most}");
    }
}

#[test]
fn a_cut_uncompressed_chunk_gives_its_complete_messages() {
    let _turn = turn(module_path!());
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
fn a_damaged_chunk_loses_only_itself() {
    let _turn = turn(module_path!());
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
fn files_that_are_not_mcap_are_refused() {
    let _turn = turn(module_path!());
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
    assert_eq!(refusal(&file, &plain()), "x.mcap: not a sqlite3 database: it has 16 bytes");
    // An unsupported compression: only the name in the chunk's header matters.
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
