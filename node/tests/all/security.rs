//! A node with DDS-Security requested either has it or does not start. Tests with a peer:
//! `tests/tests/interop_deploy/security.rs`.

use std::process::{Command, Output};

fn node(variables: &[(&str, &str)], ros_args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_mr-damper"));
    command.args(["node", "--ros-args", "-p", "model:=thesis/fuzzy-tanh/rp3-cs"]).args(ros_args);
    for name in ["ENABLE", "STRATEGY", "KEYSTORE", "ENCLAVE_OVERRIDE"] {
        command.env_remove(format!("ROS_SECURITY_{name}"));
    }
    command.envs(variables.iter().copied()).output().expect("the binary runs")
}

#[test]
fn a_node_with_security_requested_does_not_start_without_it() {
    let (on, keystore) = (("ROS_SECURITY_ENABLE", "true"), ("ROS_SECURITY_KEYSTORE", "/no/such/keystore"));
    let lacks = if cfg!(feature = "security") {
        "/no/such/keystore/enclaves/front_left/identity_ca.cert.pem: No such file"
    } else {
        "built without DDS-Security. Build one with `cargo build --release --features security`"
    };
    for (variables, says) in [
        (&[on, keystore, ("ROS_SECURITY_STRATEGY", "Enforce")][..], lacks),
        (&[on, keystore, ("ROS_SECURITY_STRATEGY", "Permissive")], lacks),
        (&[on, keystore], lacks),
        (&[], "--enclave /front_left was given, but ROS_SECURITY_ENABLE is not set"),
    ] {
        let output = node(variables, &["--enclave", "/front_left"]);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{variables:?}: {stderr}");
        assert!(stderr.contains("DDS-Security") && stderr.contains(says), "{variables:?}: {stderr}");
        assert!(!stderr.contains("the node is up"), "{variables:?}: {stderr}");
    }
}
