//! Only the hardened build gives peers on other hosts long responses, type hashes and the enclave (decisions 0005,
//! 0006).

use crate::PEER;
use crate::interop_support::gate::{Outcome, interop};
use crate::interop_support::json::{count, found, text, texts};
use crate::interop_support::{Distro, NODE};

/// Smallest number of parameters of the node: even their list is longer than a datagram.
const PARAMETERS: u64 = 80;

#[test]
#[ignore = "needs root and a hardened build: MR_DAMPER_HARDENED_BIN"]
fn a_hardened_node_sends_long_responses_to_another_host_and_announces_its_types() {
    interop("hardened: two hosts", |lab| {
        let Some(far) = lab.neighbour() else {
            return Outcome::Missing("two network namespaces cannot be connected without root".to_owned());
        };
        let _node = match lab.hardened_node(&["-p", "discovery_range:=subnet"]) {
            Ok(node) => node,
            Err(why) => return Outcome::Missing(why),
        };
        let saw = far.ros(Distro::Jazzy, "details_peer.py", &["--node", NODE]).json(PEER);
        let listed = count(&saw, "/listed");
        assert!(listed >= PARAMETERS, "{saw:#}");
        assert_eq!(count(&saw, "/described"), listed, "all are described in one call: {saw:#}");
        assert_eq!(count(&saw, "/got"), listed, "all are read in one call: {saw:#}");
        for topic in ["displacement", "force_estimate", "mode"] {
            let own = texts(&saw, &format!("/own_hashes/{topic}"));
            assert!(own.len() == 1 && own[0].starts_with("RIHS01_"), "{saw:#}");
            assert_eq!(texts(&saw, &format!("/hashes/{topic}")), own, "the hash of {topic}: {saw:#}");
        }
        assert_eq!(text(&saw, "/enclave"), "/");
        Outcome::Passed(format!(
            "{listed} parameters listed, described and read over a cable ({:#}); type hashes and enclave seen",
            found(&saw, "/seconds")
        ))
    });
}
