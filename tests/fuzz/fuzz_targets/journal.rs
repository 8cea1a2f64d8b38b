//! Journals left by a killed recorder next to its database: a good bag with a hostile journal. The first byte of the input selects
//! the kind (even: `-wal`); the rest is the journal.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::{check_csv_of, check_pipeline_of, file, load_run};
use mr_damper_runs::LoadOptions;
use std::path::Path;

/// A database of 40 displacements, in write-ahead logging mode.
const DATABASE: &[u8] = include_bytes!("../data/wal.db3");

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, journal)) = bytes.split_first() else { return };
    let path = file("logged.db3", DATABASE);
    let name = if kind % 2 == 0 { "logged.db3-wal" } else { "logged.db3-journal" };
    let beside = file(name, journal);
    let loaded = load_run(&path, &LoadOptions::default());
    let untouched = |path: &Path, bytes: &[u8]| std::fs::read(path).expect("it is there") == bytes;
    assert!(untouched(&path, DATABASE) && untouched(&beside, journal), "a file was written to");
    std::fs::remove_file(&beside).expect("it is ours");
    if let Ok(loaded) = loaded {
        check_pipeline_of(&loaded.run);
        check_csv_of(&loaded.run);
    }
});
