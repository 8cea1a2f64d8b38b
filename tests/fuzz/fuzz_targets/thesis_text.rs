//! The acquisition files of the thesis (`--thesis-txt`): checked like CSV, and a header is never
//! taken for a row.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::{check_csv_of, check_pipeline_of, file, load_run};
use mr_damper_runs::LoadOptions;

fuzz_target!(|bytes: &[u8]| {
    let path = file("run.txt", bytes);
    let options = LoadOptions { thesis_txt: true, ..LoadOptions::default() };
    let strict = load_run(&path, &options);
    let patient = load_run(&path, &LoadOptions { skip_bad_rows: true, ..options });
    if let Ok(strict) = strict {
        let patient = patient.expect("a file without faults has none to skip");
        assert_eq!((&strict.run, &strict.notes), (&patient.run, &patient.notes));
        check_pipeline_of(&strict.run);
        check_csv_of(&strict.run);
    } else if let Ok(patient) = patient {
        check_csv_of(&patient.run);
    }
});
