//! An MDF4 file with frames or plain channels, checked like a log of candump.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::check_log;

fuzz_target!(|bytes: &[u8]| check_log("run.mf4", bytes));
