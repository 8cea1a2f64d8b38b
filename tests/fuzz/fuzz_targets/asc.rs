//! A log in Vector's ASC format, checked like one of candump.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::check_log;

fuzz_target!(|bytes: &[u8]| check_log("run.asc", bytes));
