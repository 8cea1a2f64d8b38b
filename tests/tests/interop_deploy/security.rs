//! DDS-Security with Fast DDS: who may hear, who may not, on which side it is refused.

use crate::PEER;
use crate::interop_support::gate::{Outcome, interop, optional_environment, secure_binary};
use crate::interop_support::json::{count, number};
use crate::interop_support::process::{Program, script};
use crate::interop_support::{Lab, PRESET};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

/// How long a peer goes on once it is matched, s.
const SECONDS: &str = "6";

#[test]
fn only_who_may_hears_the_estimate() {
    interop("security with Fast DDS", |lab| {
        let (binary, peer) = match (secure_binary(), optional_environment("secure")) {
            (Ok(binary), Ok(folder)) => (binary, folder.join("secure_peer")),
            (Err(why), _) | (_, Err(why)) => return Outcome::Skipped(why),
        };
        let keystores = keystores(lab);
        let mut node = secured(lab, &binary, &keystores, "/node");
        // How many readers and writers of the node the peer waits for is what it is allowed.
        let saw = |enclave: &str, readers: &str, writers: &str| -> Value {
            let path = keystores.join(enclave);
            let path = if enclave == "none" { Path::new(enclave) } else { &path };
            let arguments = [path.to_str().expect("UTF-8"), readers, writers, SECONDS];
            lab.start_with(enclave, &peer, &arguments, &[]).json(PEER)
        };

        let sensor = saw("ours/enclaves/sensor", "1", "1");
        assert_eq!(count(&sensor, "/authorized"), 1, "{sensor:#}");
        let heard = count(&sensor, "/heard");
        assert!(heard > 100 && count(&sensor, "/known") == heard, "estimates of what was sent: {sensor:#}");
        assert!(number(&sensor, "/largest_force_n") > 10.0, "a damper's force: {sensor:#}");

        // These two are who they say they are, and the node refuses what their permissions do not give.
        let deaf = saw("ours/enclaves/deaf", "1", "0");
        assert_eq!((count(&deaf, "/authorized"), count(&deaf, "/heard")), (1, 0), "{deaf:#}");
        assert!(count(&deaf, "/readers") > 0, "what it may send is read: {deaf:#}");
        let mute = saw("ours/enclaves/mute", "0", "1");
        assert_eq!((count(&mute, "/authorized"), count(&mute, "/known")), (1, 0), "{mute:#}");
        assert!(count(&mute, "/readers") == 0 && count(&mute, "/writers") > 0, "it may hear: {mute:#}");
        for enclave in ["strangers/enclaves/sensor", "none"] {
            let saw = saw(enclave, "0", "0");
            assert_eq!((count(&saw, "/authorized"), count(&saw, "/heard")), (0, 0), "{enclave}: {saw:#}");
            assert_eq!((count(&saw, "/readers"), count(&saw, "/writers")), (0, 0), "{enclave}: {saw:#}");
        }

        let again = saw("ours/enclaves/sensor", "1", "1");
        assert!(count(&again, "/heard") > 100, "those who may not have not kept out who may: {again:#}");
        node.signal("INT");
        assert!(node.wait(PEER).success());

        let status = secured(lab, &binary, &keystores, "/narrow").wait(PEER);
        assert_eq!(status.code(), Some(1), "a node without permission for its own topics");
        assert!(lab.logs().contains("rt/force_estimate"), "{}", lab.logs());
        Outcome::Passed(format!("{heard} estimates to the peer that may, none to four that may not"))
    });
}

pub(super) fn secured(lab: &Lab, binary: &Path, keystores: &Path, enclave: &str) -> Program {
    let model = format!("model:={PRESET}");
    let arguments = ["node", "--ros-args", "-p", &model, "--enclave", enclave];
    let keystore = keystores.join("ours");
    let on = [("ROS_SECURITY_ENABLE", Path::new("true")), ("ROS_SECURITY_KEYSTORE", &keystore)];
    lab.start_with(&format!("mr-damper node of {enclave}"), binary, &arguments, &on)
}

pub(super) fn keystores(lab: &Lab) -> PathBuf {
    let folder = lab.folder().join("keystores");
    let output = Command::new(script("keystore.sh")).arg(&folder).output().expect("keystore.sh starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    folder
}
