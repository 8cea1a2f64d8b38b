//! Real-time priority (`SCHED_FIFO`) for the threads on the path of every sample: DDS, source, estimating thread, sink.
//!
//! On Linux a new thread inherits the policy of the thread that starts it. So a temporary thread takes the priority,
//! starts the others and ends ([`raised`]). This also reaches threads that a library starts. If the system refuses the
//! priority, the service runs anyway and reports it in its log and on `/diagnostics`.

use std::fmt;
use std::panic::resume_unwind;
use thread_priority::{
    Error, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};
use tracing::Span;

/// Scheduling of the threads on the path.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum Scheduling {
    /// Ordinary scheduling.
    #[default]
    Ordinary,
    /// `SCHED_FIFO` at this priority, 1 to 99.
    Fifo(u8),
    /// Ordinary scheduling, although a priority was requested.
    Refused {
        /// The requested priority.
        priority: u8,
        /// The system's error.
        why: String,
    },
}

impl fmt::Display for Scheduling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ordinary => f.write_str("off"),
            Self::Fifo(priority) => write!(f, "SCHED_FIFO {priority}"),
            Self::Refused { priority, why } => write!(f, "SCHED_FIFO {priority} refused: {why}"),
        }
    }
}

/// Advice for a refused priority, as the end of a sentence.
pub const ADVICE: &str = "give it the capability CAP_SYS_NICE (setcap cap_sys_nice+ep on the binary), or a limit: LimitRTPRIO= in \
                          its systemd unit, rtprio in /etc/security/limits.conf";

/// Runs `start` on a thread with `priority` (0: on this thread), so that threads started in it inherit the priority.
/// Returns the resulting scheduling as well.
pub fn raised<T: Send>(priority: u8, start: impl FnOnce() -> T + Send) -> (T, Scheduling) {
    if priority == 0 {
        return (start(), Scheduling::Ordinary);
    }
    let span = Span::current();
    let start_raised = move || {
        let _inside = span.entered();
        let scheduling = match raise(priority) {
            Ok(()) => Scheduling::Fifo(priority),
            Err(error) => Scheduling::Refused { priority, why: error.to_string() },
        };
        (start(), scheduling)
    };
    std::thread::scope(|scope| scope.spawn(start_raised).join().unwrap_or_else(|panic| resume_unwind(panic)))
}

/// Reasons why a thread does not get a priority.
#[derive(Debug, thiserror::Error)]
enum RaiseError {
    #[error("SCHED_FIFO has the priorities 1 to 99")]
    OutOfRange,
    /// The system's own message.
    #[error(transparent)]
    System(#[from] std::io::Error),
    #[error("{0}")]
    Other(Error),
}

/// Gives the calling thread `priority` permanently.
fn raise(priority: u8) -> Result<(), RaiseError> {
    let value = ThreadPriorityValue::try_from(priority).map_err(|_| RaiseError::OutOfRange)?;
    let fifo = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), fifo).map_err(
        |error| match error {
            Error::OS(code) => std::io::Error::from_raw_os_error(code).into(),
            other => RaiseError::Other(other),
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Policy and real-time priority of the calling thread, read from the kernel.
    fn scheduled() -> (u32, u32) {
        let stat = std::fs::read_to_string("/proc/thread-self/stat").expect("Linux");
        // Fields 40 and 41. Field 2, in brackets, may contain spaces.
        let fields: Vec<&str> = stat.rsplit(')').next().expect("a name").split_whitespace().collect();
        let field = |number: usize| fields[number - 3].parse().expect("a number");
        (field(41), field(40))
    }

    #[test]
    fn started_threads_have_the_priority_and_the_caller_keeps_its_own() {
        const FIFO: u32 = 1;
        let before = scheduled();
        let (inside, scheduling) = raised(7, || std::thread::spawn(scheduled).join().expect("no panic"));
        assert_eq!(scheduled(), before);
        match scheduling {
            Scheduling::Fifo(7) => assert_eq!(inside, (FIFO, 7)),
            // This user does not have the permission.
            Scheduling::Refused { priority: 7, ref why } => {
                assert_eq!(inside, before);
                assert!(why.contains("not permitted"), "{why}");
            }
            other => panic!("{other:?}"),
        }
        assert_eq!(raised(0, scheduled), (before, Scheduling::Ordinary));
    }

    #[test]
    fn a_priority_out_of_range_is_refused() {
        let (_, scheduling) = raised(100, || ());
        assert!(matches!(scheduling, Scheduling::Refused { priority: 100, .. }), "{scheduling}");
    }
}
