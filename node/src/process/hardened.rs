//! The DDS libraries that this program was built with: the released ones, or those edited by `node/hardened/build`.
//! `docs/decisions/0011-hardened-build.md` says why there are two builds.

use mr_damper_msgs::Service;
use std::sync::LazyLock;

/// Names of the edits, separated by commas; `None` in the default build.
pub const EDITS: Option<&str> = option_env!("MR_DAMPER_HARDENED");

/// Limits of the default build that the edited DDS libraries remove.
pub const LACKS: [(&str, &str); 6] = [
    (
        "long answers",
        "service answers longer than about 1.4 kB do not reach clients that have a network address",
    ),
    ("type hashes", "`ros2 topic info -v` shows no type hash and the graph no enclave"),
    ("hostile packets", "one crafted packet ends the node"),
    ("SIGSTOP", "a node that was stopped (Ctrl-Z, a debugger) ends when it continues"),
    (
        "lagging readers with DDS-Security",
        "with DDS-Security on, a reader that stays in the graph and never acknowledges makes the node's memory grow until its memory limit ends it",
    ),
    (
        "keys with DDS-Security",
        "with DDS-Security on, 1 of 256 Fast DDS peers that begin the handshake gets no data until it joins again",
    ),
];

/// The program's version, with the names of the edits in a hardened build.
#[must_use]
pub fn version() -> &'static str {
    static VERSION: LazyLock<String> = LazyLock::new(|| match EDITS {
        Some(edits) => format!("{} (hardened: {edits})", env!("CARGO_PKG_VERSION")),
        None => env!("CARGO_PKG_VERSION").to_owned(),
    });
    &VERSION
}

/// One sentence about this build, for the log.
#[must_use]
pub fn summary() -> String {
    match EDITS {
        Some(edits) => format!("hardened build: DDS libraries with {edits}"),
        None => {
            let names: Vec<_> = LACKS.iter().map(|(name, _)| *name).collect();
            format!(
                "default build: DDS libraries as released, with known limits ({}); `mr-damper doctor` explains them",
                names.join(", ")
            )
        }
    }
}

/// Makes all participants created from now on announce `enclave`, and their endpoints the hashes of their types. Only
/// the hardened build can do this; in the default build it does nothing.
pub fn announce(enclave: &str) {
    #[cfg(mr_damper_hardened)]
    {
        rustdds::announcement::enclave(enclave);
        for message in mr_damper_msgs::MESSAGES {
            rustdds::announcement::type_hash(message.dds_type_name, message.type_hash);
        }
    }
    #[cfg(not(mr_damper_hardened))]
    let _ = enclave;
}

/// The same for a service. Both of its topics carry the hash of the service, as in rmw.
pub fn announce_service<S: Service>() {
    #[cfg(mr_damper_hardened)]
    for part in ["Request", "Response"] {
        let dds_type = format!("{}::srv::dds_::{}_{part}_", S::PACKAGE, S::NAME);
        rustdds::announcement::type_hash(&dds_type, S::TYPE_HASH);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn version_and_summary_name_the_edits_of_a_hardened_build_and_the_limits_of_a_default_one() {
        assert!(version().starts_with(env!("CARGO_PKG_VERSION")));
        match EDITS {
            Some(edits) => assert!(version().contains(edits) && summary().contains(edits)),
            None => assert!(LACKS.iter().all(|(name, _)| summary().contains(name)), "{}", summary()),
        }
    }
}
