//! Turns: tests of different modules that take one never run at the same time, and neither do such tests of different processes. So a
//! test with time limits does not share the processor with the tests of other modules that need much of it.

use std::net::{Ipv4Addr, TcpListener};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The process that has the turn listens on this port.
const PORT: u16 = 7399;
/// Longest time that another process may have the turn: the long forms of the tests take half an hour.
const PATIENCE: Duration = Duration::from_secs(45 * 60);

static TURN: Mutex<State> = Mutex::new(State { module: "", inside: 0, port: None });
static ENDED: Condvar = Condvar::new();

struct State {
    module: &'static str,
    /// Number of tests of `module` that have the turn.
    inside: usize,
    /// Held while tests have the turn.
    port: Option<TcpListener>,
}

/// Gives the turn back when it is dropped.
pub(crate) struct Turn(());

/// Waits until no test of another module has the turn, and takes it. `module` is `module_path!()`.
pub(crate) fn turn(module: &'static str) -> Turn {
    let busy = |state: &mut State| state.inside > 0 && state.module != module;
    let mut state = ENDED.wait_while(lock(), busy).unwrap_or_else(PoisonError::into_inner);
    state.port.get_or_insert_with(take_port);
    state.module = module;
    state.inside += 1;
    Turn(())
}

impl Drop for Turn {
    fn drop(&mut self) {
        let mut state = lock();
        state.inside -= 1;
        if state.inside == 0 {
            state.port = None;
            ENDED.notify_all();
        }
    }
}

/// The state stays correct when a test fails.
fn lock() -> MutexGuard<'static, State> {
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

fn take_port() -> TcpListener {
    let begun = Instant::now();
    loop {
        match TcpListener::bind((Ipv4Addr::LOCALHOST, PORT)) {
            Ok(port) => return port,
            Err(error) => assert!(begun.elapsed() < PATIENCE, "another process has port {PORT}: {error}"),
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}
