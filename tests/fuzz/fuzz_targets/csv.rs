//! A run as CSV: finite values with increasing stamps, which go through the pipeline, and are unchanged through
//! CSV and a bag.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::{check_bag_of, check_csv_of, check_pipeline_of, file, load_run};
use mr_damper_runs::{LoadOptions, Note};

fuzz_target!(|bytes: &[u8]| {
    let path = file("run.csv", bytes);
    let strict = load_run(&path, &LoadOptions::default());
    let patient = load_run(&path, &LoadOptions { skip_bad_rows: true, ..LoadOptions::default() });
    if let Ok(strict) = strict {
        let patient = patient.expect("a file without faults has none to skip");
        assert_eq!((&strict.run, &strict.notes), (&patient.run, &patient.notes));
        check_pipeline_of(&strict.run);
        check_csv_of(&strict.run);
        check_bag_of(&strict.run, "csv.mcap");
    } else if let Ok(patient) = patient {
        assert!(
            patient.notes.iter().any(|note| matches!(note, Note::RowsSkipped { .. })),
            "{:?}",
            patient.notes
        );
        check_csv_of(&patient.run);
    }
});
