//! A DBC file, with a fixed log: each frame gives a finite value or none, and errors name the DBC file with the line, or the log.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::{check_run, file};
use mr_damper_runs::{LoadOptions, Map, RunError, load};

/// Frames of the identifiers that the seeds describe.
const LOG: &[u8] = b"(0.001) can0 120#D20403E801410000\n(0.002) can0 120#D30403E802410000\n(0.003) can0 18FF0001##0000102030405060708090A0B\n";

fuzz_target!(|bytes: &[u8]| {
    let dbc = file("fuzz.dbc", bytes);
    let log = file("frames.log", LOG);
    for source in ["A.P", "P", "B.Q:can0", "Q"] {
        let map = Map::new(vec![format!("displacement={source},unit=mm").parse().expect("a mapping")])
            .expect("one");
        match load(&log, &LoadOptions { dbc: vec![dbc.clone()], map, ..LoadOptions::default() }) {
            Ok(loaded) => check_run(&loaded.run),
            Err(error @ RunError::Dbc { .. }) => {
                let text = error.to_string();
                assert!(text.contains("fuzz.dbc, line "), "{text}");
            }
            Err(error) => assert!(error.to_string().contains("frames.log"), "{error}"),
        }
    }
});
