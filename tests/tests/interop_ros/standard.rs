//! Estimates and commands as standard messages.

use crate::PEER;
use crate::interop_support::gate::{Outcome, interop};
use crate::interop_support::json::{count, text, truth};
use crate::interop_support::{Distro, PRESET};

/// Smallest number of estimates in the peer's 2 s at 100 Hz.
const LEAST: u64 = 150;

#[test]
#[ignore = "needs the peers of tests/interop/setup.sh"]
fn standard_messages_have_the_stamps_and_values_of_the_estimates() {
    interop("standard messages", |lab| {
        let parameters = [
            ["-p", "standard.wrench:=true"],
            ["-p", "standard.axis:=z"],
            ["-p", "standard.joint_state:=true"],
            ["-p", "standard.joint:=fl_damper"],
            ["-p", "standard.float64:=true"],
        ];
        let _node = lab.node(PRESET, parameters.as_flattened());
        let saw = lab.ros(Distro::Jazzy, "standard_peer.py", &["--axis", "z"]).json(PEER);
        for number in ["/estimates", "/usable", "/commands", "/wrenches", "/joint_states", "/numbers"] {
            assert!(count(&saw, number) >= LEAST, "{number}: {saw:#}");
        }
        for other in ["/other_wrenches", "/other_joint_states"] {
            assert_eq!(count(&saw, other), 0, "{saw:#}");
        }
        assert!(truth(&saw, "/same_numbers") && truth(&saw, "/same_commands"), "{saw:#}");
        assert_eq!(text(&saw, "/joint"), "fl_damper");
        Outcome::Passed(format!("{} estimates as three standard messages each", count(&saw, "/estimates")))
    });
}
