//! The limit on open files. The DDS library keeps files open for every topic and service: about 200 per damper. Five
//! dampers therefore exceed the usual limit of 1024.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Files of the process that do not belong to a damper.
const BESIDES: u64 = 100;
/// Files of one damper.
const A_DAMPER: u64 = 220;

/// Number of files that `dampers` in one process may need.
#[must_use]
pub const fn needed(dampers: usize) -> u64 {
    BESIDES + A_DAMPER * dampers as u64
}

/// The largest limit that this process can set; `None`: no limit.
#[must_use]
pub fn allowed() -> Option<u64> {
    getrlimit(Resource::Nofile).maximum
}

/// Raises this process's limit on open files to the maximum, and warns if that is too few for `dampers`.
pub fn allow(dampers: usize) {
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    let needed = needed(dampers);
    let raised = Rlimit { current: maximum, maximum };
    let allowed = match setrlimit(Resource::Nofile, raised) {
        Ok(()) => maximum,
        Err(error) => {
            tracing::debug!(%error, "cannot raise the limit on open files");
            current
        }
    };
    if let Some(allowed) = allowed.filter(|allowed| *allowed < needed) {
        tracing::warn!(
            allowed,
            needed,
            "{dampers} dampers may need more open files than are allowed; raise the limit (ulimit -Hn, LimitNOFILE= of systemd)"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_is_raised_to_the_maximum() {
        allow(1);
        let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
        assert_eq!(current, maximum);
    }
}
