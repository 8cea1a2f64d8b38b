//! A bag's database, compressed or not: checked like MCAP, and nothing is written to it or next to
//! it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::{check_csv_of, check_pipeline_of, file, load_run};
use mr_damper_runs::LoadOptions;

fuzz_target!(|bytes: &[u8]| {
    let path = file("bag.db3", bytes);
    let options = LoadOptions { joint: Some("damper".to_owned()), ..LoadOptions::default() };
    let loaded = load_run(&path, &options);
    assert!(std::fs::read(&path).expect("it is there") == bytes, "the file was written to");
    for journal in ["-wal", "-journal", "-shm"] {
        assert!(
            !path.with_extension(format!("db3{journal}")).exists(),
            "there is a {journal} next to the file"
        );
    }
    if let Ok(loaded) = loaded {
        check_pipeline_of(&loaded.run);
        check_csv_of(&loaded.run);
    }
});
