//! A bound on the process's memory. A DDS library believes what a packet says of its own size, and a packet that lies makes it take
//! memory until the machine is out of it (`docs/decisions/0010-what-rustdds-does-not-survive.md`). So a node that has outgrown all that its dampers
//! can need ends and says so, and where it grows faster than one can look, the system refuses it.

use crate::error::NodeError;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

const MIB: u64 = 1 << 20;
/// What a process may hold, besides that of its dampers.
const BESIDES: u64 = 1024 * MIB;
/// What the system allows beyond that. A packet can ask for 4 GiB at a time; it takes more than a second to fill them, and whoever
/// looks meanwhile ends the process with words in place of an abort.
const MARGIN: u64 = 6 * 1024 * MIB;
/// What a damper may hold. One with a history of two minutes at 1 kHz, services and mirror has about 60 MiB.
const A_DAMPER: u64 = 256 * MIB;

/// The most that a process with so many dampers may hold, bytes.
fn most(dampers: usize) -> u64 {
    BESIDES + A_DAMPER * dampers as u64
}

/// Has the system refuse what is far beyond that, should nobody get round to [`check`].
pub fn bound(dampers: usize) {
    let Rlimit { current, maximum } = getrlimit(Resource::Data);
    let wanted = most(dampers) + MARGIN;
    if current.is_none_or(|current| current > wanted)
        && let Err(error) = setrlimit(Resource::Data, Rlimit { current: Some(wanted), maximum })
    {
        tracing::warn!(%error, "the memory of the process is not bounded");
    }
}

/// An error once the process holds more than so many dampers can need. Nothing where the system does not say how much it holds.
///
/// # Errors
/// [`NodeError::Failed`] with the figures and what to look for.
pub fn check(dampers: usize) -> Result<(), NodeError> {
    check_at(held(), dampers)
}

fn check_at(held: Option<u64>, dampers: usize) -> Result<(), NodeError> {
    let most = most(dampers);
    match held {
        Some(held) if held > most => Err(NodeError::Failed(format!(
            "the process holds {} MiB of memory, where {} MiB are the most that it can need (dampers: {dampers}): malformed or hostile \
             packets on the DDS ports do that. See who sends on this domain (UDP ports from 7400 on), keep strangers out \
             (discovery_range, a firewall, DDS-Security), and restart the node",
            held / MIB,
            most / MIB
        ))),
        _ => Ok(()),
    }
}

/// What the process holds besides mapped files, bytes. Only Linux says.
fn held() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:"))?;
    line.split_whitespace().next()?.parse::<u64>().ok().map(|kib| kib * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_that_outgrew_its_dampers_is_said_so() {
        assert!(check(1).is_ok(), "this one did not");
        assert!(check_at(None, 1).is_ok() && check_at(Some(most(2)), 2).is_ok());
        let said = check_at(Some(most(2) + MIB), 2).expect_err("too much").to_string();
        assert!(
            said.contains("1537 MiB") && said.contains("1536 MiB") && said.contains("dampers: 2"),
            "{said}"
        );
    }

    #[test]
    fn what_it_holds_is_told() {
        // Other tests of this process take and give back meanwhile.
        let block = std::hint::black_box(vec![1_u8; 64 << 20]);
        assert!(held().expect("Linux says") >= block.len() as u64);
    }
}
