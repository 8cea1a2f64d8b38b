//! The limit on open files. The DDS library keeps some of them for every topic and service: about two hundred a damper, so that five
//! dampers are more than the 1024 that a shell usually allows.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Files of the process besides those of its dampers.
const BESIDES: u64 = 100;
/// Files of one damper.
const A_DAMPER: u64 = 220;

/// As many as `dampers` in one process may need.
#[must_use]
pub const fn wanted(dampers: usize) -> u64 {
    BESIDES + A_DAMPER * dampers as u64
}

/// As many as this process may be allowed; `None`: any number.
#[must_use]
pub fn allowed() -> Option<u64> {
    getrlimit(Resource::Nofile).maximum
}

/// Allows this process as many open files as the system lets it, and says so where that is too few for `dampers`.
pub fn allow(dampers: usize) {
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    let wanted = wanted(dampers);
    let raised = Rlimit { current: maximum, maximum };
    let allowed = match setrlimit(Resource::Nofile, raised) {
        Ok(()) => maximum,
        Err(error) => {
            tracing::debug!(%error, "the limit on open files stays");
            current
        }
    };
    if let Some(allowed) = allowed.filter(|allowed| *allowed < wanted) {
        tracing::warn!(
            allowed,
            wanted,
            "{dampers} dampers may need more open files than are allowed; raise the limit (ulimit -Hn, LimitNOFILE= of systemd)"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_is_raised_to_the_most_there_may_be() {
        allow(1);
        let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
        assert_eq!(current, maximum);
    }
}
