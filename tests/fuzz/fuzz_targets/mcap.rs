//! A bag file in MCAP, compressed or not: a readable file gives a run, which goes through the pipeline and to CSV and
//! back.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::{check_csv_of, check_pipeline_of, file, load_run};
use mr_damper_runs::LoadOptions;

fuzz_target!(|bytes: &[u8]| {
    let path = file("bag.mcap", bytes);
    let joint = Some("damper".to_owned());
    for namespace in [None, Some("/a".to_owned())] {
        let options = LoadOptions { namespace, joint: joint.clone(), ..LoadOptions::default() };
        if let Ok(loaded) = load_run(&path, &options) {
            check_pipeline_of(&loaded.run);
            check_csv_of(&loaded.run);
        }
    }
});
