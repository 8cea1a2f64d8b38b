//! The configuration file: every setting is in its range or refused with the file's name, and a written file has the same
//! settings.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::{check_config, file};
use mr_damper_node::settings::config::{RosArgs, dampers};

fuzz_target!(|bytes: &[u8]| {
    let path = file("node.toml", bytes);
    if let Err(error) = dampers(Some(&path), &RosArgs::default(), &[]) {
        let text = error.to_string();
        // Errors about combinations of settings name the settings instead of the file.
        assert!(
            text.contains("node.toml") || text.contains("dampers") || text.contains("differ in"),
            "{text}"
        );
    }
    check_config(Some(&path), &RosArgs::default());
});
