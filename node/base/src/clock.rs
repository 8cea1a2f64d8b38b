//! The time of a node: the system's clock, or `/clock` while `use_sim_time` is true.
//!
//! Any thread may read it: it is two atomics. Simulated time is unknown before the first `/clock` message; code that
//! needs the time waits.

use mr_damper_model::sample::Stamp;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Marks that no simulated time has arrived yet.
const NONE: i64 = i64::MIN;

/// The present time of the system's clock, as a stamp.
#[must_use]
pub fn system_now() -> Stamp {
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Stamp::from_nanos(i64::try_from(since_epoch.as_nanos()).unwrap_or(i64::MAX))
}

/// A node's clock.
#[derive(Debug)]
pub struct Clock {
    simulated: AtomicBool,
    sim_ns: AtomicI64,
}

impl Clock {
    /// A clock that follows `/clock` if `simulated`, otherwise the system.
    #[must_use]
    pub const fn new(simulated: bool) -> Self {
        Self { simulated: AtomicBool::new(simulated), sim_ns: AtomicI64::new(NONE) }
    }

    /// The present time; `None` if simulated time is in use and has not arrived yet.
    #[must_use]
    pub fn now(&self) -> Option<Stamp> {
        if !self.is_simulated() {
            return Some(system_now());
        }
        let at = self.sim_ns.load(Ordering::Acquire);
        (at != NONE).then_some(Stamp::from_nanos(at))
    }

    /// Time since `received`, a stamp of this clock. `None` under simulated time, or if the system's clock was set back
    /// meanwhile.
    #[must_use]
    pub fn took_since(&self, received: Stamp) -> Option<Duration> {
        let now = self.now().filter(|_| !self.is_simulated())?;
        u64::try_from(now.nanos().checked_sub(received.nanos())?).ok().map(Duration::from_nanos)
    }

    /// The time for a message: the node's time, or the system's if there is none yet.
    #[must_use]
    pub fn now_or_system(&self) -> Stamp {
        self.now().unwrap_or_else(system_now)
    }

    /// True while the clock follows `/clock`.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        self.simulated.load(Ordering::Acquire)
    }

    /// Switches to `/clock` if `simulated`, otherwise to the system's clock. Returns true if that is a change.
    pub fn simulate(&self, simulated: bool) -> bool {
        self.sim_ns.store(NONE, Ordering::Release);
        self.simulated.swap(simulated, Ordering::AcqRel) != simulated
    }

    /// Takes a time from `/clock`. Returns by how many seconds it went back, if it did. Does nothing while the clock
    /// follows the system.
    pub fn observe(&self, stamp: Stamp) -> Option<f64> {
        if !self.is_simulated() {
            return None;
        }
        let before = self.sim_ns.swap(stamp.nanos(), Ordering::AcqRel);
        (before != NONE && stamp.nanos() < before).then(|| Stamp::from_nanos(before).since(stamp).get())
    }
}

/// `stamp` in the form of `ros2 topic echo`: seconds and a fraction.
#[must_use]
pub fn in_seconds(stamp: Stamp) -> String {
    let nanos = stamp.nanos();
    format!("{}.{:03}", nanos.div_euclid(1_000_000_000), nanos.rem_euclid(1_000_000_000) / 1_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simulated_time_is_what_was_heard_last() {
        let clock = Clock::new(true);
        let at = |s: i64| Stamp::from_nanos(s * 1_000_000_000);
        assert_eq!(clock.now(), None);
        assert_eq!(clock.observe(at(5)), None);
        assert_eq!((clock.now(), clock.observe(at(6)), clock.observe(at(6))), (Some(at(5)), None, None));
        assert_eq!(clock.observe(at(2)), Some(4.0));
        assert_eq!(clock.now(), Some(at(2)));
        assert!(clock.simulate(false) && !clock.simulate(false));
        assert_eq!(clock.observe(at(1)), None);
        assert!(clock.now().expect("the system's") > at(1_700_000_000));
        assert!(clock.simulate(true));
        assert_eq!(clock.now(), None, "times heard before the switch are cleared");
    }
}
