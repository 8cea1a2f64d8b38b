//! Real-time priority (`SCHED_FIFO`) for the threads on the path of every sample: DDS, source, estimating thread, sink.
//!
//! On Linux a new thread inherits the policy of the thread that starts it. So a temporary thread takes the priority,
//! starts the others and ends ([`raised`]). This also reaches threads that a library starts. If the system refuses the
//! priority, the service runs anyway and reports it in its log and on `/diagnostics`. A refusal is a warning only if the
//! user asked for a priority ([`Request`]).

use std::fmt;
use std::panic::resume_unwind;
use thread_priority::{
    Error, RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};
use tracing::Span;

/// The requested scheduling of the threads on the path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// Ordinary scheduling.
    Ordinary,
    /// `SCHED_FIFO` at [`Request::PRIORITY`] if the system permits it, and ordinary scheduling otherwise.
    IfPermitted,
    /// `SCHED_FIFO` at this priority, 1 to 99.
    Fifo(u8),
}

impl Request {
    /// The priority that [`Request::IfPermitted`] tries: above all ordinary threads, and below the kernel's interrupt
    /// threads (50).
    pub const PRIORITY: u8 = 20;

    /// Reads a parameter: -1 if permitted, 0 ordinary, otherwise the priority.
    #[must_use]
    pub fn from_parameter(value: i64) -> Self {
        match u8::try_from(value) {
            Ok(0) => Self::Ordinary,
            Ok(priority) => Self::Fifo(priority),
            Err(_) => Self::IfPermitted,
        }
    }

    /// The priority to try, if any.
    fn priority(self) -> Option<u8> {
        match self {
            Self::Ordinary => None,
            Self::IfPermitted => Some(Self::PRIORITY),
            Self::Fifo(priority) => Some(priority),
        }
    }
}

/// The resulting scheduling of the threads on the path.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum Scheduling {
    /// Ordinary scheduling.
    #[default]
    Ordinary,
    /// `SCHED_FIFO` at this priority, 1 to 99.
    Fifo(u8),
    /// Ordinary scheduling, because the system does not permit another one, and none was required.
    NotPermitted {
        /// The priority that was tried.
        priority: u8,
        /// The system's error.
        why: String,
    },
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
            Self::NotPermitted { priority, why } => {
                write!(f, "off, SCHED_FIFO {priority} is not available: {why}")
            }
            Self::Refused { priority, why } => write!(f, "SCHED_FIFO {priority} refused: {why}"),
        }
    }
}

/// Advice for a refused priority, as the end of a sentence.
pub const ADVICE: &str = "give it the capability CAP_SYS_NICE (setcap cap_sys_nice+ep on the binary), or a limit: LimitRTPRIO= in \
                          its systemd unit, rtprio in /etc/security/limits.conf";

/// Runs `start` on a thread with the requested priority, if any, so that threads started in it inherit the priority.
/// Returns the resulting scheduling as well.
pub fn raised<T: Send>(request: Request, start: impl FnOnce() -> T + Send) -> (T, Scheduling) {
    let Some(priority) = request.priority() else {
        return (start(), Scheduling::Ordinary);
    };
    let span = Span::current();
    let start_raised = move || {
        let _inside = span.entered();
        let scheduling = match raise(priority) {
            Ok(()) => Scheduling::Fifo(priority),
            Err(error) => {
                let why = error.to_string();
                match request {
                    Request::IfPermitted => Scheduling::NotPermitted { priority, why },
                    _ => Scheduling::Refused { priority, why },
                }
            }
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
        for (request, wanted) in [(Request::Fifo(7), 7), (Request::IfPermitted, Request::PRIORITY)] {
            let (inside, scheduling) =
                raised(request, || std::thread::spawn(scheduled).join().expect("no panic"));
            assert_eq!(scheduled(), before);
            let required = request != Request::IfPermitted;
            match scheduling {
                Scheduling::Fifo(priority) => {
                    assert_eq!((priority, inside), (wanted, (FIFO, u32::from(wanted))));
                }
                // This user does not have the permission.
                Scheduling::Refused { priority, ref why } if required => {
                    assert_eq!((priority, inside), (wanted, before));
                    assert!(why.contains("not permitted"), "{why}");
                }
                Scheduling::NotPermitted { priority, ref why } if !required => {
                    assert_eq!((priority, inside), (wanted, before));
                    assert!(why.contains("not permitted"), "{why}");
                }
                other => panic!("{request:?}: {other:?}"),
            }
        }
        assert_eq!(raised(Request::Ordinary, scheduled), (before, Scheduling::Ordinary));
    }

    #[test]
    fn a_parameter_is_read() {
        let read = [-1, 0, 1, 99].map(Request::from_parameter);
        assert_eq!(read, [Request::IfPermitted, Request::Ordinary, Request::Fifo(1), Request::Fifo(99)]);
    }

    #[test]
    fn a_priority_out_of_range_is_refused() {
        let (_, scheduling) = raised(Request::Fifo(100), || ());
        assert!(matches!(scheduling, Scheduling::Refused { priority: 100, .. }), "{scheduling}");
    }
}
