//! The threads of a DDS participant. The library keeps them to itself, and they can end without a panic: when a process is stopped
//! and goes on (Ctrl-Z and `fg`, SIGSTOP, a debugger), the system interrupts their wait, which they take for an error
//! (`docs/decisions/0010-what-rustdds-does-not-survive.md`). From then on nothing comes, nothing goes, and nobody is told. So they are
//! noted when a participant is made, and looked for.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// Where Linux lists the threads of this process. Elsewhere they are not known, and taken to live.
const LISTED: &str = "/proc/self/task";
/// What their names begin with; Linux keeps 15 characters.
const NAMED: &str = "RustDDS";

/// The threads of one participant.
#[derive(Debug)]
pub struct DdsThreads(Vec<PathBuf>);

impl DdsThreads {
    /// Makes a participant with `make`, and notes the threads that came with it.
    pub fn of<T>(make: impl FnOnce() -> T) -> (T, Self) {
        // One at a time, so that each has its own.
        static MAKING: Mutex<()> = Mutex::new(());
        let _alone = MAKING.lock().unwrap_or_else(PoisonError::into_inner);
        let before = listed();
        let made = make();
        let new = listed().into_iter().filter(|thread| !before.contains(thread));
        (made, Self(new.collect()))
    }

    /// False once one of them has ended, by a panic or without.
    #[must_use]
    pub fn are_alive(&self) -> bool {
        self.0.iter().all(|thread| thread.exists())
    }
}

/// The library's threads in this process.
fn listed() -> Vec<PathBuf> {
    let Ok(threads) = std::fs::read_dir(LISTED) else { return Vec::new() };
    let is_named = |thread: &PathBuf| {
        std::fs::read_to_string(thread.join("comm")).is_ok_and(|name| name.starts_with(NAMED))
    };
    threads.flatten().map(|thread| thread.path()).filter(is_named).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;
    use std::thread::Builder;

    #[test]
    fn a_thread_that_ends_is_missed_and_no_other() {
        let start = || {
            DdsThreads::of(|| {
                let (stop, stopped) = mpsc::channel::<()>();
                let (begun, begins) = mpsc::channel();
                let thread =
                    Builder::new().name("RustDDS Participant 3 event loop".to_owned()).spawn(move || {
                        begun.send(()).expect("somebody waits");
                        // An error is the end of the other end.
                        let _ = stopped.recv();
                    });
                begins.recv().expect("it begins");
                (stop, thread.expect("a thread"))
            })
        };
        let ((stop, thread), mine) = start();
        let ((other_stop, other_thread), others) = start();
        assert_eq!((mine.0.len(), others.0.len()), (1, 1));
        assert!(mine.are_alive() && others.are_alive());
        drop(stop);
        thread.join().expect("no panic");
        assert!(!mine.are_alive() && others.are_alive());
        drop(other_stop);
        other_thread.join().expect("no panic");
    }
}
