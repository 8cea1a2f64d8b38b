//! A ROS 2 parameter file: its parameters for three nodes are in their ranges, and equal a configuration file written
//! from them.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mr_damper_fuzz::{check_config, file};
use mr_damper_node::settings::config::RosArgs;

fuzz_target!(|bytes: &[u8]| {
    let path = file("params.yaml", bytes);
    for namespace in ["/", "/front_left", "/vehicle/front/left"] {
        let arguments =
            ["--ros-args", "--params-file", &path.to_string_lossy(), "-r", &format!("__ns:={namespace}")];
        let (_, args) = RosArgs::split(arguments.map(str::to_owned)).expect("good arguments");
        let args = args.for_node("mr_damper");
        if let Err(error) = args.assignments() {
            assert!(error.to_string().contains("params.yaml"), "{error}");
        }
        check_config(None, &args);
    }
});
