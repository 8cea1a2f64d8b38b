//! Ctrl-C and SIGTERM: they set one flag, which every command checks.

use crate::settings::error::NodeError;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The flag that SIGINT and SIGTERM set. A second signal ends the process at once, in case the normal shutdown hangs.
#[derive(Debug, Clone)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Installs the signal handlers.
    ///
    /// # Errors
    /// When the system rejects them.
    pub fn install() -> Result<Self, NodeError> {
        let flag = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            let installed = signal_hook::flag::register_conditional_shutdown(signal, 1, Arc::clone(&flag))
                .and_then(|_| signal_hook::flag::register(signal, Arc::clone(&flag)));
            installed.map_err(NodeError::io("installing the signal handlers"))?;
        }
        Ok(Self(flag))
    }

    /// A flag without signal handlers, which the caller raises.
    #[must_use]
    pub fn manual() -> Self {
        Self(Arc::new(AtomicBool::new(false)))
    }

    /// Raises the flag.
    pub fn raise(&self) {
        self.0.store(true, Ordering::Release);
    }

    /// True once a signal has arrived.
    #[must_use]
    pub fn is_raised(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }

    /// The flag itself.
    #[must_use]
    pub fn flag(&self) -> &AtomicBool {
        &self.0
    }

    /// Sleeps until `deadline`, in steps short enough to notice a signal. Returns false if a signal arrived.
    pub fn sleep_until(&self, deadline: Instant) -> bool {
        const STEP: Duration = Duration::from_millis(50);
        loop {
            if self.is_raised() {
                return false;
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return true;
            }
            std::thread::sleep(left.min(STEP));
        }
    }
}
