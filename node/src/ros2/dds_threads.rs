//! Watches the threads of a DDS participant.
//!
//! RustDDS does not expose its threads, and they can end without a panic. When a process is stopped and continued
//! (Ctrl-Z and `fg`, SIGSTOP, a debugger), the system interrupts their wait, and the library treats this as an error
//! (`docs/decisions/0010-what-rustdds-does-not-survive.md`). From then on nothing is received or sent, and no error is
//! reported. So this module notes the threads when a participant is made, and checks that they still exist.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// Where Linux lists the threads of this process. On other systems the threads are unknown and count as alive.
const LISTED: &str = "/proc/self/task";
/// Start of the threads' names; Linux keeps 15 characters.
const NAMED: &str = "RustDDS";

/// The threads of one participant.
#[derive(Debug)]
pub struct DdsThreads(Vec<PathBuf>);

impl DdsThreads {
    /// Makes a participant with `make`, and notes the threads that came with it.
    pub fn of<T>(make: impl FnOnce() -> T) -> (T, Self) {
        // One participant at a time, so that its threads can be identified.
        static MAKING: Mutex<()> = Mutex::new(());
        let _alone = MAKING.lock().unwrap_or_else(PoisonError::into_inner);
        let before = listed();
        let made = make();
        let new = listed().into_iter().filter(|thread| !before.contains(thread));
        (made, Self(new.collect()))
    }

    /// False once one of the threads has ended, with or without a panic.
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
    fn only_the_participant_whose_thread_ended_is_not_alive() {
        let start = || {
            DdsThreads::of(|| {
                let (stop, stopped) = mpsc::channel::<()>();
                let (begun, begins) = mpsc::channel();
                let thread =
                    Builder::new().name("RustDDS Participant 3 event loop".to_owned()).spawn(move || {
                        begun.send(()).expect("the receiver waits");
                        // `recv` fails when the sender is dropped.
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
