//! The configuration file: every setting in its range or refused with the file's name, and written again it says the same.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::{check_config, file};
use mr_damper_node::config::{RosArgs, dampers};

fuzz_target!(|bytes: &[u8]| {
    let path = file("node.toml", bytes);
    if let Err(error) = dampers(Some(&path), &RosArgs::default(), &[]) {
        let text = error.to_string();
        // What several settings make together is told by their names.
        assert!(
            text.contains("node.toml") || text.contains("dampers") || text.contains("differ in"),
            "{text}"
        );
    }
    check_config(Some(&path), &RosArgs::default());
});
