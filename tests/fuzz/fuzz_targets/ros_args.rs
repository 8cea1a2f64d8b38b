//! A command line with `--ros-args`, one argument per line: names are valid ROS names, and parameters are in
//! their ranges.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::{check_config, scratch};
use mr_damper_node::settings::config::RosArgs;

fuzz_target!(|text: &str| {
    let mut before = "";
    let arguments = text.split('\n').take(64).map(|argument| {
        // Files of this machine must not be read.
        let is_file = std::mem::replace(&mut before, argument) == "--params-file";
        if is_file { scratch("none.yaml").to_string_lossy().into_owned() } else { argument.to_owned() }
    });
    let Ok((_, args)) = RosArgs::split(arguments) else { return };
    for node in ["mr_damper", "mr_damper_replay"] {
        let args = args.clone().for_node(node);
        for name in [args.namespace(), args.full_name(), args.topic("displacement"), args.topic("~/x")] {
            let parts: Vec<&str> = name.split('/').collect();
            let is_root = name == "/" && name == args.namespace();
            let good = |part: &&str| {
                part.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
                    && part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
            };
            assert!(
                is_root || (parts[0].is_empty() && parts[1..].iter().all(good)),
                "{name} is not a valid ROS name"
            );
        }
        check_config(None, &args);
    }
});
