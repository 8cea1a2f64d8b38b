//! Control of a player while it plays: by keys, by services, or by the code that owns the player.
//!
//! There is one lock and one condition variable. The playing thread waits on them for its next sample, so it reacts to a
//! change at once. This module does not depend on time or ROS.

use super::Rate;
use mr_damper_model::sample::Stamp;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Longest time between two samples of a step; after it, the caller of [`Control::step`] gets the number of samples so far.
const STEP_PATIENCE: Duration = Duration::from_secs(10);

/// The controls of a player. Any thread may use them.
#[derive(Debug, Default)]
pub struct Control {
    state: Mutex<State>,
    changed: Condvar,
}

/// The requests to the player, and its state.
#[derive(Debug, Default)]
pub(super) struct State {
    pub(super) paused: bool,
    /// The speed that was set while playing. It stays in effect for later runs.
    set_rate: Option<Rate>,
    /// The speed of the plan, used if none was set.
    planned_rate: Option<Rate>,
    /// Number of samples to play while paused.
    pub(super) steps: u64,
    /// Total number of samples that were played while paused.
    stepped: u64,
    /// Target of a requested jump.
    pub(super) seek: Option<Stamp>,
    /// First and last stamp of the current run.
    playing: Option<(Stamp, Stamp)>,
}

impl State {
    /// The current speed.
    pub(super) fn rate(&self) -> Rate {
        self.set_rate.or(self.planned_rate).unwrap_or(Rate::Times(1.0))
    }

    /// Counts a played sample as a step, if paused.
    fn count_step(&mut self) {
        if self.paused {
            self.steps = self.steps.saturating_sub(1);
            self.stepped += 1;
        }
    }
}

impl Control {
    pub(super) fn lock(&self) -> MutexGuard<'_, State> {
        // After a panic the state is still valid, because it consists of independent plain values.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until the state changes, for at most `timeout`.
    pub(super) fn wait<'a>(&self, state: MutexGuard<'a, State>, timeout: Duration) -> MutexGuard<'a, State> {
        self.changed.wait_timeout(state, timeout).unwrap_or_else(PoisonError::into_inner).0
    }

    fn change(&self, how: impl FnOnce(&mut State)) {
        how(&mut self.lock());
        self.changed.notify_all();
    }

    /// Notes that a run begins.
    pub fn begin(&self, planned: Rate, range: (Stamp, Stamp)) {
        self.change(|state| {
            state.planned_rate = Some(planned);
            state.playing = Some(range);
        });
    }

    /// Notes that the run is over.
    pub fn end(&self) {
        self.change(|state| {
            state.playing = None;
            state.seek = None;
            state.steps = 0;
        });
    }

    /// Notes that a sample was published.
    pub(super) fn played(&self) {
        let mut state = self.lock();
        if state.paused {
            state.count_step();
            drop(state);
            self.changed.notify_all();
        }
    }

    /// Pauses the player; does nothing if it is paused.
    pub fn pause(&self) {
        self.change(|state| state.paused = true);
    }

    /// Resumes playing; does nothing if the player is not paused.
    pub fn resume(&self) {
        self.change(|state| {
            state.paused = false;
            state.steps = 0;
        });
    }

    /// Pauses if playing, resumes if paused.
    pub fn toggle_paused(&self) {
        self.change(|state| {
            state.paused = !state.paused;
            state.steps = 0;
        });
    }

    /// True if the player is paused.
    #[must_use]
    pub fn is_paused(&self) -> bool {
        self.lock().paused
    }

    /// The current speed.
    #[must_use]
    pub fn rate(&self) -> Rate {
        self.lock().rate()
    }

    /// Sets the speed, as a multiple of the original speed; false if it is not a positive finite number.
    pub fn set_rate(&self, rate: f64) -> bool {
        let good = rate > 0.0 && rate.is_finite();
        if good {
            self.change(|state| state.set_rate = Some(Rate::Times(rate)));
        }
        good
    }

    /// Requests one sample while paused, without waiting for it.
    pub fn nudge(&self) {
        self.change(|state| state.steps = state.steps.saturating_add(u64::from(state.paused)));
    }

    /// Plays `count` samples while paused (0 for all that are left) and waits for them; returns the number of samples that
    /// were played. Plays none if the player is not paused or no run is played.
    pub fn step(&self, count: u64) -> u64 {
        let mut state = self.lock();
        if !state.paused || state.playing.is_none() {
            return 0;
        }
        let before = state.stepped;
        state.steps = if count == 0 { u64::MAX } else { state.steps.saturating_add(count) };
        self.changed.notify_all();
        loop {
            let had = state.stepped;
            state = self.wait(state, STEP_PATIENCE);
            let over = !state.paused || state.playing.is_none() || state.steps == 0;
            if over || state.stepped == had {
                return state.stepped - before;
            }
        }
    }

    /// Continues at the first sample at or after `to`, paused or not; false if `to` is outside the current run.
    pub fn seek(&self, to: Stamp) -> bool {
        let mut state = self.lock();
        let within = state.playing.is_some_and(|(first, last)| (first..=last).contains(&to));
        if within {
            state.seek = Some(to);
            drop(state);
            self.changed.notify_all();
        }
        within
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    #[test]
    fn steps_are_played_only_while_paused() {
        let control = Control::default();
        assert_eq!(control.step(1), 0, "nothing plays");
        let range = (Stamp::from_nanos(10), Stamp::from_nanos(20));
        control.begin(Rate::Times(2.0), range);
        assert_eq!(control.step(1), 0, "it is not paused");
        control.nudge();
        assert_eq!(control.lock().steps, 0);
        control.pause();
        let steps = std::thread::scope(|threads| {
            let stepping = threads.spawn(|| control.step(3));
            let deadline = Instant::now() + Duration::from_secs(5);
            let mut played = 0;
            while !stepping.is_finished() && Instant::now() < deadline {
                if control.lock().steps > 0 {
                    control.played();
                    played += 1;
                }
                std::thread::yield_now();
            }
            (stepping.join().expect("no panic"), played)
        });
        assert_eq!(steps, (3, 3));
        for (to, within) in [(9, false), (10, true), (20, true), (21, false)] {
            assert_eq!(control.seek(Stamp::from_nanos(to)), within, "{to}");
        }
        control.end();
        assert!(!control.seek(Stamp::from_nanos(15)), "nothing plays");
    }

    #[test]
    fn a_set_speed_is_kept_for_the_next_run() {
        let control = Control::default();
        control.begin(Rate::Times(2.0), (Stamp::from_nanos(0), Stamp::from_nanos(1)));
        assert_eq!(control.rate(), Rate::Times(2.0));
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(!control.set_rate(bad));
        }
        assert!(control.set_rate(0.5));
        control.begin(Rate::Max, (Stamp::from_nanos(0), Stamp::from_nanos(1)));
        assert_eq!(control.rate(), Rate::Times(0.5));
    }
}
