//! A limit on the process's memory.
//!
//! The DDS library trusts the sizes stated in a packet, so a false packet makes it allocate memory until the machine
//! runs out of it (`docs/decisions/0010-what-rustdds-does-not-survive.md`). So a node that exceeds what its dampers can
//! need ends with a message. If memory grows too fast for that check, the system refuses the allocation.

use crate::settings::error::PartError;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

const MIB: u64 = 1 << 20;
/// Allowance of a process, in addition to its dampers, bytes.
const BESIDES: u64 = 1024 * MIB;
/// Distance from the node's own limit to the system's limit, bytes. A packet can demand 4 GiB at a time, which take
/// more than a second to fill. So the check normally ends the process with a message before an allocation fails and
/// aborts it.
const MARGIN: u64 = 6 * 1024 * MIB;
/// Allowance per damper, bytes. A damper with two minutes of history at 1 kHz, services and mirror uses about 60 MiB.
const A_DAMPER: u64 = 256 * MIB;

/// The limit of a process with this number of dampers, bytes.
fn most(dampers: usize) -> u64 {
    BESIDES + A_DAMPER * dampers as u64
}

/// Sets the system's limit far above the node's own, in case [`check`] is not reached in time.
pub fn bound(dampers: usize) {
    let Rlimit { current, maximum } = getrlimit(Resource::Data);
    let limit = most(dampers) + MARGIN;
    if current.is_none_or(|current| current > limit)
        && let Err(error) = setrlimit(Resource::Data, Rlimit { current: Some(limit), maximum })
    {
        tracing::warn!(%error, "cannot limit the memory of the process");
    }
}

/// The process uses more memory than its dampers can need.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "the process uses {} MiB of memory, more than the {} MiB that it can need (dampers: {dampers}): malformed or hostile packets on \
     the DDS ports can cause this. Check who sends on this domain (UDP ports from 7400), keep strangers out (discovery_range, a \
     firewall, DDS-Security), and restart the node",
    held_bytes / MIB, most_bytes / MIB
)]
pub struct TooMuchMemory {
    /// Memory that the process uses, bytes.
    pub held_bytes: u64,
    /// The limit, bytes.
    pub most_bytes: u64,
    /// Number of dampers.
    pub dampers: usize,
}

impl PartError for TooMuchMemory {}

/// Checks the process's memory against the limit for this number of dampers. Passes if the system does not report the
/// memory.
///
/// # Errors
/// [`TooMuchMemory`].
pub fn check(dampers: usize) -> Result<(), TooMuchMemory> {
    check_at(held(), dampers)
}

fn check_at(held_bytes: Option<u64>, dampers: usize) -> Result<(), TooMuchMemory> {
    let most_bytes = most(dampers);
    match held_bytes {
        Some(held_bytes) if held_bytes > most_bytes => Err(TooMuchMemory { held_bytes, most_bytes, dampers }),
        _ => Ok(()),
    }
}

/// Memory of the process without mapped files, bytes. `None` on systems other than Linux.
fn held() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:"))?;
    line.split_whitespace().next()?.parse::<u64>().ok().map(|kib| kib * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_above_its_limit_is_an_error_with_the_figures() {
        assert!(check(1).is_ok(), "this process is below its limit");
        assert!(check_at(None, 1).is_ok() && check_at(Some(most(2)), 2).is_ok());
        let said = check_at(Some(most(2) + MIB), 2).expect_err("too much").to_string();
        assert!(
            said.contains("1537 MiB") && said.contains("1536 MiB") && said.contains("dampers: 2"),
            "{said}"
        );
    }

    #[test]
    fn the_memory_of_the_process_is_known() {
        // Other tests of this process allocate and free memory meanwhile.
        let block = std::hint::black_box(vec![1_u8; 64 << 20]);
        assert!(held().expect("known on Linux") >= block.len() as u64);
    }
}
