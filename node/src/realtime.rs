//! Real-time priority (`SCHED_FIFO`) of the threads that every sample passes: those of DDS, source, estimating thread, sink.
//!
//! Linux gives a new thread the policy of the one that starts it. So they are started by a thread that takes the priority and then ends
//! ([`raised`]), which reaches threads that a library starts, too. Where the system refuses, the service runs all the same, and says so
//! in its log and on `/diagnostics`.

use std::fmt;
use std::panic::resume_unwind;
use thread_priority::{
    Error, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};
use tracing::Span;

/// How the threads of the path are scheduled.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum Standing {
    /// Like those of any program.
    #[default]
    Ordinary,
    /// `SCHED_FIFO` at this priority, 1 to 99.
    Fifo(u8),
    /// Like those of any program, although a priority was asked for.
    Refused {
        /// What was asked for.
        priority: u8,
        /// What the system says.
        why: String,
    },
}

impl fmt::Display for Standing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ordinary => f.write_str("off"),
            Self::Fifo(priority) => write!(f, "SCHED_FIFO {priority}"),
            Self::Refused { priority, why } => write!(f, "SCHED_FIFO {priority} refused: {why}"),
        }
    }
}

/// What to do where priorities are refused, as the end of a sentence.
pub const ADVICE: &str = "give it the capability CAP_SYS_NICE (setcap cap_sys_nice+ep on the binary), or a limit: LimitRTPRIO= in \
                          its systemd unit, rtprio in /etc/security/limits.conf";

/// Runs `start` on a thread of `priority` (0: on this one), so that threads started in it have that too, and says how they stand.
pub fn raised<T: Send>(priority: u8, start: impl FnOnce() -> T + Send) -> (T, Standing) {
    if priority == 0 {
        return (start(), Standing::Ordinary);
    }
    let span = Span::current();
    let start_raised = move || {
        let _inside = span.entered();
        let standing = match raise(priority) {
            Ok(()) => Standing::Fifo(priority),
            Err(why) => Standing::Refused { priority, why },
        };
        (start(), standing)
    };
    std::thread::scope(|scope| scope.spawn(start_raised).join().unwrap_or_else(|panic| resume_unwind(panic)))
}

/// Gives the calling thread `priority` for good.
fn raise(priority: u8) -> Result<(), String> {
    let value = ThreadPriorityValue::try_from(priority)?;
    let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), fifo).map_err(
        |error| match error {
            // The system's own words.
            Error::OS(code) => std::io::Error::from_raw_os_error(code).to_string(),
            other => other.to_string(),
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Policy and real-time priority of the calling thread, as the kernel has them.
    fn scheduled() -> (u32, u32) {
        let stat = std::fs::read_to_string("/proc/thread-self/stat").expect("Linux");
        // Fields 40 and 41; the second one, in brackets, may hold blanks.
        let fields: Vec<&str> = stat.rsplit(')').next().expect("a name").split_whitespace().collect();
        let field = |number: usize| fields[number - 3].parse().expect("a number");
        (field(41), field(40))
    }

    #[test]
    fn threads_started_meanwhile_have_the_priority_and_the_starter_has_its_own_again() {
        const FIFO: u32 = 1;
        let before = scheduled();
        let (inside, standing) = raised(7, || std::thread::spawn(scheduled).join().expect("no panic"));
        assert_eq!(scheduled(), before);
        match standing {
            Standing::Fifo(7) => assert_eq!(inside, (FIFO, 7)),
            // Nobody gave this user the right.
            Standing::Refused { priority: 7, ref why } => {
                assert_eq!(inside, before);
                assert!(why.contains("not permitted"), "{why}");
            }
            other => panic!("{other:?}"),
        }
        assert_eq!(raised(0, scheduled), (before, Standing::Ordinary));
    }

    #[test]
    fn a_priority_that_there_is_not_is_refused() {
        let (_, standing) = raised(100, || ());
        assert!(matches!(standing, Standing::Refused { priority: 100, .. }), "{standing}");
    }
}
