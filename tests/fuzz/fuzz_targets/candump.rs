//! A log of candump, with a fixed DBC file: a readable log gives a run, which goes through the pipeline and to CSV and back. Without its bad
//! lines it gives a run, too.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::check_log;

fuzz_target!(|bytes: &[u8]| check_log("run.log", bytes));
