//! `metadata.yaml` of a bag: it names only files in the bag's directory, or is refused.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::{load_run, scratch};
use mr_damper_runs::LoadOptions;
use std::sync::Once;

/// A bag of ten displacements, in either storage.
const FILES: [(&str, &[u8]); 2] = [
    ("bag_0.mcap", include_bytes!("../data/small.mcap")),
    ("bag_0.db3", include_bytes!("../data/small.db3")),
];

fuzz_target!(|bytes: &[u8]| {
    static ONCE: Once = Once::new();
    let dir = scratch("bag");
    ONCE.call_once(|| {
        std::fs::create_dir(&dir).expect("a fresh directory");
        for (name, bytes) in FILES {
            std::fs::write(dir.join(name), bytes).expect("written");
        }
    });
    std::fs::write(dir.join("metadata.yaml"), bytes).expect("written");
    if let Ok(loaded) = load_run(&dir, &LoadOptions::default()) {
        assert_eq!(loaded.run.displacement_m.len(), 10, "the directory has only this run");
    }
});
